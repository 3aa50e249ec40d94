"""The wall of hard cases as a picture: everything finite, nothing gained, float32 as good as its directions."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf import builtin
from brdf.hard import FORMULAS, outsider
from brdf.hard.criterion import EPS, TINY, UNDERFLOW, off
from brdf.hard.grid import single
from brdf.models.grooved import Grooved
from fitting.picture.exact import ExactPicture
from fitting.pixels import content, index_of
from plugins import scene as scenes
from plugins.checks.subject import differentiable
from plugins.scenes import FOLDER, stress

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
#: The largest relative difference of float32 from float64 at the same directions. A highlight is looked at down to 1e-6
#: of its maximum, exp(-14), and the exponent is rounded a few times.
ROUNDINGS = 32 * 2.0**-23
#: Where balls have a critical angle, F falls from 1 beside it as a square root does, and magnifies a rounding of the
#: direction without bound: of these the best 99 %.
CRITICAL = {"nested0", "nested1", "nested2", "silver"}
#: p99 of the difference from directions in float64, times the roughness: float32 has a hit point to 5e-7, which a
#: radius of 0.43 makes 1e-6 of a normal, and d log D / d slope is up to 8 / m in what is looked at.
MOVED = 2e-5
#: Depth at which hardly any light is left in the balls of glass.
DEEP = 20_000


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def load(width: int = 60, height: int = 48) -> mi.Scene:
    return scenes.load(FOLDER / "stress.xml", width=width, height=height).scene


def parameters(scene: Any, integrator: str = "") -> tuple[mi.SceneParameters, list[str]]:
    """All parameters of the balls, and those whose model does not declare that the integrator gets them wrong."""
    params = mi.traverse(scene)
    shapes = {shape.id(): shape.bsdf() for shape in scene.shapes()}
    ours = [key for key in differentiable(params) if hasattr(shapes.get(key.split(".")[0]), "model")]
    faults = {name: bsdf.model.faults() for name, bsdf in shapes.items() if hasattr(bsdf, "model")}
    return params, [k for k in ours if k[:4] != "wall" and f"gradient_{integrator}" not in faults[k.split(".")[0]]]


def attach(params: mi.SceneParameters, keys: Iterable[str]) -> list[Any]:
    """Make parameters differentiable, and as opaque as those of a fit."""
    values = []
    for key in keys:
        value = type(params[key])(dr.detach(params[key]))
        dr.make_opaque(value)
        dr.enable_grad(value)
        params[key] = value
        values.append(value)
    params.update()
    return values


def tangents(values: Iterable[Any]) -> None:
    """Move all parameters at once: what is not finite in one derivative is not in the sum, and no 0 hides it."""
    for value in values:
        direction = 0.5 + 0.5 * abs(dr.detach(value))
        dr.make_opaque(direction)
        dr.set_grad(value, direction)


def assert_finite(scene: Any, integrator: str, depth: int, reverse: bool) -> None:
    """A picture and its derivatives by one integrator."""
    params, keys = parameters(scene, integrator)
    settings = {} if integrator == "direct" else {"max_depth": depth}
    made = mi.load_dict({"type": integrator, **settings})
    values = attach(params, keys)
    image = mi.render(scene, params, integrator=made, spp=4, spp_grad=4, seed=1)
    pixels = np.array(image)
    assert np.isfinite(pixels).all() and (pixels >= 0).all() and pixels.max() > 1
    if reverse:
        dr.backward(dr.sum(image, axis=None))
        slopes = {key: np.array(dr.grad(value)) for key, value in zip(keys, values, strict=True)}
        assert [key for key, slope in slopes.items() if not np.isfinite(slope).all()] == []
        assert sum(bool(slope.any()) for slope in slopes.values()) > 0.5 * len(keys)
        return
    tangents(values)
    dr.forward_to(image)
    slope = np.array(dr.grad(image))
    assert np.isfinite(slope).all(), sorted({tuple(at) for at in np.argwhere(~np.isfinite(slope))[:, :2]})[:20]
    assert (slope != 0).any(axis=-1).mean() > 0.3


def test_the_files_are_what_the_module_writes() -> None:
    assert (FOLDER / "stress.xml").read_text() == stress.xml()
    np.testing.assert_array_equal(np.array(mi.Bitmap(str(FOLDER / "sky.exr"))), stress.sky().astype(np.float16))
    ids = [ball.id for ball in stress.balls()]
    assert len(ids) == len(set(ids)) == 88
    assert {ball.bsdf["type"] for ball in stress.balls()} == set(builtin()) - {"lambertian"}


def test_picture_and_gradients_by_prb() -> None:
    assert_finite(load(), "prb", 8, reverse=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("integrator", "reverse"), [("prb", True), ("direct", False), ("direct", True), ("path", False), ("path", True)]
)
def test_picture_and_gradients(integrator: str, reverse: bool) -> None:
    """At depth 6 light has been into the inner ball and out."""
    assert_finite(load(), integrator, 6, reverse)


@functools.cache
def lit_by_lamps(size: int) -> tuple[Any, dict[str, np.ndarray[Any, Any]]]:
    """The wall under two grazing lamps alone, and the pixels that see each ball."""
    whole = load(size, size * 4 // 5)
    lamps = {
        f"lamp{i}": {"type": "point", "position": at, "intensity": 400.0}
        for i, at in enumerate([[-11, 9, 4], [9, -3, 0.5]])
    }
    balls = {shape.id(): shape for shape in whole.shapes() if shape.id() not in ("strip", "wall")}
    scene = mi.load_dict({"type": "scene", "camera": whole.sensors()[0], **lamps, **balls})
    ids = content(scene, scene.sensors()[0])  # type: ignore[attr-defined]
    seen = {name: np.flatnonzero(ids == index_of(shape.bsdf())) for name, shape in balls.items()}
    return scene, {name: pixels for name, pixels in seen.items() if pixels.size}


def cached(size: int, samples: int) -> Iterator[tuple[str, Any, mi.SceneParameters, list[str]]]:
    """Each ball that is seen: its name, its cached shading, its parameters by their keys."""
    scene, seen = lit_by_lamps(size)
    shapes = {shape.id(): shape for shape in scene.shapes()}
    groups = [(shapes[name].bsdf(), pixels) for name, pixels in seen.items()]
    picture = ExactPicture(scene, scene.sensors()[0], groups, samples, 1)
    assert len(picture.caches) == 80
    for name, cache in zip(seen, picture.caches, strict=True):
        params = mi.traverse(shapes[name].bsdf())
        yield name, cache, params, differentiable(params)


def test_gradients_of_the_cached_shading() -> None:
    """All derivatives of each ball at once."""
    smooth = 0
    for name, cache, params, keys in cached(100, 16):
        tangents(attach(params, keys))
        light = cache.radiance(reverse=False)
        if dr.grad_enabled(light):
            smooth += 1
            dr.forward_to(light)
            slope = dr.grad(light)
            dr.eval(light, slope)
            assert np.isfinite(np.array(slope)).all(), name
        assert np.isfinite(np.array(light)).all() and (np.array(light) >= 0).all(), name
    assert smooth == 80 - 8 - 8 - 2  # all but glass, what is around the nested ones, metal and mirror


@pytest.mark.slow
def test_gradients_of_the_cached_shading_one_by_one() -> None:
    """The image of each derivative in forward mode, and the derivative of the sum in reverse."""
    bad = []
    for name, cache, params, keys in cached(200, 4):
        for key in keys:
            (value,) = attach(params, [key])
            light = cache.radiance(reverse=False)
            if dr.grad_enabled(light):
                tangents([value])
                dr.forward_to(light)
                if not np.isfinite(np.array(dr.grad(light))).all():
                    bad.append(f"forward {name}.{key}")
            params[key] = dr.detach(value)
        values = attach(params, keys)
        light = cache.radiance(reverse=True)
        if dr.grad_enabled(light):
            dr.backward(dr.sum(light.x + light.y + light.z))
            bad += [
                f"reverse {name}.{k}"
                for k, v in zip(keys, values, strict=True)
                if not np.isfinite(np.array(dr.grad(v))).all()
            ]
    assert bad == []


def furnace(balls: list[stress.Ball], integrator: dict[str, Any], spp: int) -> np.ndarray[Any, Any]:
    """Pixels of balls in a room whose walls all have radiance 1."""
    made: dict[str, Any] = {ball.id: sphere(ball) for ball in balls}
    camera = load().sensors()[0]
    scene = mi.load_dict({"type": "scene", "camera": camera, "room": {"type": "constant", "radiance": 1.0}, **made})
    return np.array(mi.render(scene, integrator=mi.load_dict(integrator), spp=spp, seed=2), dtype=float)  # type: ignore[arg-type]


def sphere(ball: stress.Ball) -> dict[str, Any]:
    given = {
        key: {"type": "rgb", "value": list(value)} if isinstance(value, tuple) else value
        for key, value in ball.bsdf.items()
    }
    return {"type": "sphere", "center": list(ball.at), "radius": ball.radius, "bsdf": given}


WHITE = {"diffuse_reflectance": 0.0, "specular_reflectance": 1.0}


def test_furnace_of_glass_and_mirrors() -> None:
    """From eta = 1.0001 to 10, ball in ball: a path through them weighs 1 wherever it leaves."""
    balls = [b for b in stress.balls() if b.bsdf["type"] in ("glass", "mirror")]
    balls = [b._replace(bsdf={k: v for k, v in b.bsdf.items() if k != "specular_reflectance"}) for b in balls]
    pixels = furnace(balls, {"type": "path", "max_depth": DEEP, "rr_depth": DEEP}, 16)
    np.testing.assert_allclose(pixels, 1, atol=1e-4)


def test_furnace_of_rough_balls() -> None:
    """No sample of these weighs more than 1, so no pixel is brighter, from m = 1e-4 on and at the rims as well."""
    columns = ("metal", "plastic", "paint", "brushed", "satin")
    balls = [b for b in stress.balls() if b.id.rstrip("01234567") in columns]
    white: list[stress.Ball] = []
    for b in balls:
        bsdf = {k: v for k, v in b.bsdf.items() if k not in ("material", "k")} | WHITE
        if b.id[:5] in ("metal", "plast", "satin"):
            bsdf = {k: v for k, v in bsdf.items() if k != "eta"} | {"fresnel": "constant"}
        if b.id.startswith("paint"):
            bsdf["masking"] = "vcavity"
        white.append(b._replace(bsdf=bsdf))
    pixels = furnace(white, {"type": "direct", "emitter_samples": 0, "bsdf_samples": 1}, 256)
    assert pixels.max() <= 1 + 1e-5 and pixels.min() >= 0


def test_furnace_of_a_white_glaze() -> None:
    """A white base sends back all light under any coat: 1 within four standard errors."""
    balls = [
        b._replace(bsdf={**b.bsdf, "diffuse_reflectance": 1.0}) for b in stress.balls() if b.bsdf["type"] == "glazed"
    ]
    error = furnace(balls, {"type": "path", "max_depth": 64, "rr_depth": 64}, 64) - 1
    noisy = error[error != 0]
    assert abs(noisy.mean()) < 4 * noisy.std() / np.sqrt(noisy.size / 3)  # the three channels of a pixel are alike
    assert np.abs(error).max() < 8 * noisy.std()


def test_float32_against_float64() -> None:
    """Each ball and its highlight; see docs/stress.py, which prints the table."""
    from stress import compare  # pyright: ignore[reportMissingImports]

    for row in compare():
        name, bsdf = row.ball.id, row.ball.bsdf
        if bsdf["type"] == "grooved":
            limit = FORMULAS["grooved, phong"].limits.value + 1  # and the product with the cosine
            assert grooved_roundings(row) <= limit, name
            continue
        assert np.quantile(row.same, 0.99 if name in CRITICAL else 1) <= ROUNDINGS, name
        if bsdf.keys() & {"m", "m_u", "alpha_u", "exponent"}:
            assert np.quantile(row.own, 0.99) * row.m <= MOVED, name


def grooved_roundings(row: Any) -> float:
    """The largest error in roundings of the inputs, as in tests/brdf/test_hard.py.

    A relative bound would have to be wide: about the mirror direction the lobe is ``exp(-E)``, ``E = exponent delta^2 / 2``
    with `delta` the distance from it, and a rounding of a component x changes it by ``exponent delta x = x sqrt(2 E
    exponent)`` of itself: 530 x at exponent 1e4 and E = 14, where it is 1e-6 of its maximum.
    """
    formula = outsider.formula(Grooved())
    numbers = {p.name: np.mean(p.default) for p in Grooved().parameters()} | row.ball.bsdf
    inputs = [*np.concatenate(row.directions), *(np.full(row.found.shape[1], numbers[n]) for n in formula.by)]
    exact = outsider.by_float64(formula, single(inputs))
    cos = row.directions[1][2]
    forgiven = UNDERFLOW * TINY["float32"] * exact.peak
    with np.errstate(invalid="ignore"):  # what is 0 depends on nothing
        return off(row.found[0], exact.value * cos, forgiven, EPS["float32"] * exact.value_scale * cos).max()
