"""Derivatives against differences with the same samples, the two modes against each other, and no kernel twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import pytest

from fitting.problem import Problem
from fitting.solvers import methods
from tests.fitting import studio
from tests.fitting.problems import grey, here, problem

#: In the coordinates `x`: differences then err by 1e-4 of the third derivative, and by 1e-5 from float32.
STEP = 0.02


def ball(kind: str, body: str) -> str:
    return f'<bsdf type="{kind}" id="ball">{body}</bsdf>'


def number(**values: float) -> str:
    return "".join(f'<float name="{name}" value="{value}"/>' for name, value in values.items())


def colour(**values: str) -> str:
    return "".join(f'<rgb name="{name}" value="{value}"/>' for name, value in values.items())


def word(**values: str) -> str:
    return "".join(f'<string name="{name}" value="{value}"/>' for name, value in values.items())


BASE = colour(diffuse_reflectance="0.3,0.2,0.1", specular_reflectance="0.5,0.6,0.7")
DISNEY = (
    number(roughness=0.5, metallic=0.3, anisotropic=0.3, spec_tint=0.4, sheen=0.5, sheen_tint=0.5)
    + number(flatness=0.4, clearcoat=0.6, clearcoat_gloss=0.3, spec_trans=0.2)
    + colour(base_color="0.5,0.3,0.2")
)
MATERIALS: dict[str, tuple[str, tuple[str, ...]]] = {
    "cooktorrance": (
        ball("cooktorrance", number(m=0.25, eta=1.6) + BASE),
        ("m", "eta", "diffuse_reflectance", "specular_reflectance"),
    ),
    "cooktorrance-smith-schlick": (
        ball("cooktorrance", number(m=0.4, eta=1.4) + BASE + word(fresnel="schlick", masking="smith")),
        ("m", "eta", "diffuse_reflectance", "specular_reflectance"),
    ),
    "cooktorrance-constant-none": (
        ball("cooktorrance", number(m=0.2) + BASE + word(fresnel="constant", masking="none")),
        ("m", "diffuse_reflectance", "specular_reflectance"),
    ),
    "lambertian": (ball("lambertian", colour(reflectance="0.3,0.2,0.1")), ("reflectance",)),
    "diffuse": (ball("diffuse", colour(reflectance="0.3,0.2,0.1")), ("reflectance",)),
    "roughconductor": (
        ball("roughconductor", number(alpha=0.25) + colour(eta="0.5,0.6,1.2", k="3,2.5,2", specular_reflectance="0.7")),
        ("alpha", "eta", "k", "specular_reflectance"),
    ),
    "roughconductor-anisotropic-ggx": (
        ball("roughconductor", number(alpha_u=0.2, alpha_v=0.35) + word(distribution="ggx", material="Cu")),
        ("alpha_u", "alpha_v", "eta", "k"),
    ),
    "roughdielectric": (
        ball("roughdielectric", number(alpha=0.3, int_ior=1.6, ext_ior=1.0) + colour(specular_reflectance="0.7")),
        ("alpha", "eta", "specular_reflectance"),
    ),
    "principled": (
        ball("principled", DISNEY + number(eta=1.6)),
        (
            "base_color",
            "roughness",
            "eta",
            "metallic",
            "anisotropic",
            "spec_trans",
            "spec_tint",
            "sheen",
            "sheen_tint",
            "flatness",
            "clearcoat",
            "clearcoat_gloss",
        ),
    ),
    "principled-specular": (ball("principled", DISNEY + number(specular=0.4)), ("specular", "roughness")),
}


def scene(folder: Path, name: str, size: int = 32) -> Path:
    return studio.write(folder, MATERIALS[name][0], studio.SPHERE, studio.camera(size), studio.KEY, studio.RIM)


def differences(p: Problem, x: np.ndarray, step: float = STEP) -> tuple[np.ndarray, np.ndarray]:
    """Jacobians of both halves by central differences, to fourth order."""
    columns: list[list[np.ndarray]] = [[], []]
    for i in range(len(x)):
        e = np.eye(len(x))[i] * step
        r = {k: p.residuals(x + k * e) for k in (-2, -1, 1, 2)}
        for half in (0, 1):
            columns[half].append((8 * (r[1][half] - r[-1][half]) - (r[2][half] - r[-2][half])) / (12 * step))
    return np.stack(columns[0], axis=1), np.stack(columns[1], axis=1)


@pytest.mark.parametrize("name", MATERIALS)
def test_jacobian_against_differences(name: str, tmp_path: Path) -> None:
    p = problem(scene(tmp_path, name), [f"ball.{q}" for q in MATERIALS[name][1]], {"camera": grey(32)})
    x = here(p)
    linear = p.linearize(x)
    for r, j, d in zip(linear.r, linear.jacobian, differences(p, x), strict=True):
        assert np.abs(p.target + r).max() > 0.01  # there is a picture
        for i, component in enumerate(p.parameters.components):
            size = np.linalg.norm(d[:, i])
            # 1e-4 of the picture: float32's share in a difference, for parameters that hardly do anything.
            floor = 1e-4 * np.linalg.norm(p.target + r)
            assert np.linalg.norm(j[:, i] - d[:, i]) < 2e-3 * size + floor, component
            assert size > 10 * floor or component.startswith("ball.k"), f"{component} does nothing here"


@pytest.mark.parametrize("name", ["cooktorrance", "roughconductor", "principled", "diffuse"])
def test_reverse_mode_gives_the_gradient_of_the_loss(name: str, tmp_path: Path) -> None:
    p = problem(scene(tmp_path, name), [f"ball.{q}" for q in MATERIALS[name][1]], {"camera": grey(32)})
    x = here(p) + 0.1
    rng = np.random.default_rng(1)
    p.weigh(p.weights * rng.uniform(0.5, 2, len(p.weights)))
    loss, gradient = p.descend(x)
    linear = p.linearize(x)
    # `gradient` of Linear is half that of the sum; the loss is a mean.
    expected = 2 * linear.gradient(p.weights) / len(p.target)
    assert loss == pytest.approx(linear.loss(p.weights), rel=1e-5)
    assert np.abs(gradient - expected).max() < 1e-4 * np.abs(expected).max()
    e = np.eye(len(x)) * STEP
    ahead = [(p.loss(x + h) - p.loss(x - h)) / (2 * STEP) for h in e]
    assert np.abs(gradient - ahead).max() < 5e-3 * np.abs(gradient).max()


@pytest.mark.parametrize("names", [["ball.m", "ball.eta", "ball.diffuse_reflectance"], ["ball.eta"]], ids=len)
def test_gradient_of_a_rendered_picture(names: list[str], tmp_path: Path) -> None:
    """The same of pictures through an integrator, where the two modes draw different samples: within their noise.

    Each half has a derivative: with one parameter Mitsuba gives it to the first of two pictures alone.
    """
    path = scene(tmp_path, "cooktorrance", 24)
    found = []
    for seed in range(6):
        p = problem(path, names, {"camera": grey(24)}, samples=64, method="rendered", seed=100 * seed)
        x = here(p) + 0.1
        linear = p.linearize(x)
        sizes = [np.linalg.norm(j, axis=0) for j in linear.jacobian]
        np.testing.assert_allclose(*sizes, rtol=0.2)
        found.append((p.descend(x)[1], 2 * linear.gradient(p.weights) / len(p.target)))
    reverse, forward = (np.array([f[k] for f in found]) for k in (0, 1))
    se = np.sqrt((reverse.var(axis=0, ddof=1) + forward.var(axis=0, ddof=1)) / len(found))
    z = (reverse.mean(axis=0) - forward.mean(axis=0)) / se
    assert np.abs(z).max() < 5  # Student's t of some ten degrees of freedom: p < 1e-3 each
    assert np.all(se < 0.1 * np.abs(forward.mean(axis=0)).max())


def test_residuals_are_ordered_as_documented(tmp_path: Path) -> None:
    """Two views, of two sizes: each residual is the prediction less the target at its own pixel, channel and view."""
    cameras = studio.camera((40, 24), name="a") + studio.camera(32, name="b", origin="4,0,1")
    path = studio.write(tmp_path, MATERIALS["diffuse"][0], studio.SPHERE, cameras, studio.KEY)
    rng = np.random.default_rng(0)
    targets = {
        name: rng.uniform(0.1, 1, shape).astype(np.float32)
        for name, shape in {"a": (24, 40, 3), "b": (32, 32, 3)}.items()
    }
    p = problem(path, ["ball.reflectance"], targets)
    assert list(p.widths) == [40, 32]
    for view, target in enumerate(targets.values()):
        of = p.view == view
        expected = target.reshape(-1, 3)[p.pixel[of], p.channel[of]]
        np.testing.assert_array_equal(p.target[of], expected.astype(np.float64))
    # Columns of the Jacobian: a reflectance moves its own channel, in both views.
    linear = p.linearize(here(p))
    for c in range(3):
        acts = np.abs(linear.jacobian[0][:, c]) > 0
        assert set(p.channel[acts]) == {c}
        assert set(p.view[acts]) == {0, 1}


def test_columns_can_be_picked(tmp_path: Path) -> None:
    p = problem(
        scene(tmp_path, "cooktorrance"), ["ball.m", "ball.eta", "ball.diffuse_reflectance"], {"camera": grey(32)}
    )
    x = here(p)
    whole, part = p.linearize(x), p.linearize(x, [1, 3])
    for a, b in zip(whole.jacobian, part.jacobian, strict=True):
        np.testing.assert_allclose(a[:, [1, 3]], b, rtol=1e-5, atol=1e-6 * np.abs(a).max())


def test_halves_are_independent_and_agree(tmp_path: Path) -> None:
    """Their difference is noise: of mean zero, and smaller with more samples."""
    path = scene(tmp_path, "cooktorrance")
    spread = []
    for samples in (4, 64):
        p = problem(path, ["ball.m"], {"camera": grey(32)}, samples)
        ra, rb = p.residuals(here(p))
        difference = ra - rb
        assert np.abs(difference).max() > 0
        assert abs(difference.mean()) < 4 * difference.std() / np.sqrt(
            len(difference) / 3
        )  # three channels, one sample
        spread.append(difference.std())
    # Kronecker points do better than the factor 4 of random ones.
    assert spread[1] < spread[0] / 3


def test_weights_come_from_the_noise(tmp_path: Path) -> None:
    """Noise of known variance a + b I + c I^2 is found again from the residuals, over two decades of intensity."""
    path = scene(tmp_path, "cooktorrance", 64)
    clean = studio.picture(path, 64)
    p = problem(path, ["ball.m"], {"camera": clean}, 64)
    x = here(p)
    ra, rb = p.residuals(x)
    predicted = p.target + 0.5 * (ra + rb)
    rng = np.random.default_rng(3)
    for a, b, c in ((1e-4, 0, 0), (0, 1e-3, 0), (0, 0, 4e-4), (1e-5, 1e-4, 1e-4)):
        variance = a + b * predicted + c * predicted**2
        p.target = predicted + np.sqrt(variance) * rng.standard_normal(len(predicted))
        r = predicted - p.target
        lit = predicted > 0.01 * predicted.max()
        ratio = p.noise((r, r))[lit] / variance[lit]
        assert np.quantile(ratio, 0.05) > 0.75
        assert np.quantile(ratio, 0.95) < 1.33


def fresh_kernels() -> tuple[int, int]:
    """How many kernels since the history was cleared were compiled or read from the disk, and how many ran."""
    kernels: Any = [k for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT]
    return sum(1 for k in kernels if k["cache_disk"] or not k["cache_hit"]), len(kernels)


@pytest.mark.parametrize("solver", ["lm", "adam", "gd", "lbfgs"])
def test_no_kernel_is_compiled_after_the_first_iteration(solver: str, tmp_path: Path) -> None:
    """A kernel is new if it was not in this process's memory: a literal would make one a value, be it from the disk."""
    path = scene(tmp_path, "cooktorrance", 24)
    target = studio.picture(path, 64)
    p = problem(path, ["ball.m", "ball.eta", "ball.diffuse_reflectance"], {"camera": target})
    start = p.parameters.free_of(np.array([0.5, 1.3, 0.2, 0.3, 0.4]))
    counted: list[tuple[int, int]] = []

    def count(iteration: int, loss: float, x: np.ndarray) -> None:
        counted.append(fresh_kernels())
        dr.kernel_history_clear()

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        methods()[solver](p, start, 8, count)
    assert len(counted) >= 5
    assert counted[0][1] >= 1
    assert [new for new, _ in counted[1:]] == [0] * (len(counted) - 1)
    assert all(launched >= 1 for _, launched in counted[1:])


def test_counting_kernels_would_see_a_literal(tmp_path: Path) -> None:
    """What the test above relies on: a value that is not opaque makes a kernel of its own."""
    p = problem(scene(tmp_path, "roughconductor", 24), ["ball.alpha"], {"camera": grey(24)})
    new = []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for i in range(4):
            dr.kernel_history_clear()
            dr.eval([part * (0.2 + 0.0137 * i) for part in p.predict()])
            new.append(fresh_kernels()[0])
    assert new[1:] == [1, 1, 1]
