"""Every model of brdf.models as a plugin: it is its formula, in XML as in Python, with textures, in spectral variants,
and samples as its density says. The other choices, and derivatives of pictures, are asked by ``brdf check --all`` in
tests/fitting/test_cli_check.py."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf import Model, Param, evaluate
from brdf.checks import ModelSubject
from brdf.checks.directions import pairs
from brdf.checks.values import channels
from plugins import registry, xmlfile
from plugins.checks.gather import as_dict, of_model, trials
from plugins.checks.subject import BsdfSubject
from tests.models import named, variations

#: eval is in float32, the formula in float64. Where a lobe is steep, a rounded direction moves it.
ROUNDING = 2e-4
#: Models whose kernels take long to compile: tried with the slow tests.
HEAVY = {"grooved"}
#: The chi-square tests of a model, of all its lobes, make a second or two.
SEED = 0


def every(models: list[Model]) -> Any:
    return pytest.mark.parametrize(
        "model", [pytest.param(m, id=named(m), marks=[pytest.mark.slow] if m.name in HEAVY else []) for m in models]
    )


def defaults_only() -> list[Model]:
    return [type(m)() for m in {m.name: m for m in variations()}.values()]


@pytest.fixture(autouse=True)
def variant(monkeypatch: pytest.MonkeyPatch) -> None:
    mi.set_variant("llvm_ad_rgb")
    monkeypatch.setattr(registry, "_known", {})
    plugins.register()


def other_value(p: Param) -> Any:
    """Something else than the default, inside the bounds."""
    low, high = p.interior()
    x = p.to_free(p.default if p.kind == "number" else p.default[0])
    near = float(p.to_value(x + 0.3))
    value = near if low < near < high else float(p.to_value(x - 0.3))
    return value if p.kind == "number" else (value, 0.5 * (value + p.default[1]), p.default[2])


@every(variations())
def test_eval_is_the_formula_times_the_cosine(model: Model) -> None:
    """At every trial, at pairs from all sides, as many of them in the lobe as outside."""
    for trial in trials(model):
        formula = ModelSubject(model, **trial)
        plugin = BsdfSubject(mi.load_dict(as_dict(model, trial)))
        i, o = pairs(formula, 1000, 3)
        single = [mi.Vector3f(channels(w)) for w in (i, o)]
        got = channels(plugin.bsdf.eval(mi.BSDFContext(), si_of(single[0]), single[1]))
        wi, wo = (formula.vector(channels(w)) for w in single)
        want = channels(evaluate(model, formula.values, wi, wo) * abs(wo.z)) + np.zeros_like(got)
        off = np.abs(got - want) / np.maximum(want, 1e-3 * want.max() + 1e-12)
        assert np.quantile(off, 0.98) < ROUNDING
        assert off.max() < 0.05
        assert [p.name for p in plugin.lobes] and len(plugin.lobes) == len(model.lobes)


def si_of(wi: mi.Vector3f) -> mi.SurfaceInteraction3f:
    from plugins.checks.subject import interaction

    return interaction(wi)


def leaves(bsdf: mi.BSDF) -> Iterator[tuple[str, Any]]:
    params = mi.traverse(bsdf)
    return ((key, np.asarray(params[key], dtype=float).ravel()) for key in params.keys())  # noqa: SIM118


@every(variations())
def test_xml_round_trip(model: Model, tmp_path: Path) -> None:
    """Written as a scene, as the material of a fit with new values, and read back: the same numbers."""
    values = {p.name: other_value(p) for p in model.parameters()}
    children = [
        f'<string name="{p.name}" value="{getattr(model, p.name)}"/>' for p in model.params if p.kind == "choice"
    ]
    scene = tmp_path / "scene.xml"
    scene.write_text(
        f'<scene version="3.0.0"><shape type="sphere"><bsdf type="{model.name}" id="it">{"".join(children)}</bsdf>'
        "</shape></scene>"
    )
    xmlfile.material(scene, "it", values, tmp_path / "material.xml")
    again: Any = mi.load_file(str(tmp_path / "material.xml"))
    made = mi.load_dict(as_dict(model, values))
    for (key, want), (other, got) in zip(leaves(made), leaves(again), strict=True):
        assert key == other
        np.testing.assert_allclose(got, want, rtol=1e-6)
    words = re.findall(r"(\w+) = (\w+)", again.to_string())
    for p in model.params:
        if p.kind == "choice":
            assert (p.name, getattr(model, p.name)) in words


@every(defaults_only())
def test_a_texture_on_each_parameter(model: Model) -> None:
    """Two pixels: each is the BSDF with that number."""
    for p in model.parameters():
        if p.kind == "number":
            ends = [p.default, other_value(p)]
            pixels = np.array(ends, dtype=np.float32).reshape(1, 2, 1)
        else:
            ends = [p.default, other_value(p)]
            pixels = np.array(ends, dtype=np.float32).reshape(1, 2, 3)
        texture = {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True, "filter_type": "nearest"}
        textured = mi.load_dict({**as_dict(model, {}), p.name: texture})
        for u, value in zip((0.25, 0.75), ends, strict=True):
            plain = mi.load_dict(as_dict(model, {p.name: value}))
            np.testing.assert_allclose(*(seen(b, u) for b in (textured, plain)), rtol=2e-4, atol=1e-7)


def seen(bsdf: mi.BSDF, u: float) -> Any:
    """What `eval` and `sample` say at a few directions, at a place of the texture."""
    angles = np.linspace(0.1, 1.3, 7)
    wi = mi.Vector3f(np.array([np.sin(angles), 0 * angles, np.cos(angles)]))
    wo = mi.Vector3f(np.array([-np.sin(angles), 0.1 + 0 * angles, np.cos(angles)]) / np.sqrt(1.01))
    si = si_of(wi)
    si.uv = mi.Point2f(u, 0.5)
    value = channels(bsdf.eval(mi.BSDFContext(), si, wo))
    _, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(0.3), mi.Point2f(0.4, 0.6))
    return np.concatenate([value + np.zeros((3, 7)), channels(weight) + np.zeros((3, 7))])


@every(defaults_only())
def test_spectral_variant(model: Model) -> None:
    """Grey is the same as in RGB; all that is said of it is finite."""
    grey = {p.name: p.default[0] for p in model.parameters() if p.kind == "colour"}
    found = []
    for name in ("llvm_ad_rgb", "llvm_ad_spectral"):
        mi.set_variant(name)
        bsdf = mi.load_dict({**as_dict(model, {}), **grey})
        angles = np.linspace(0.1, 1.3, 7)
        wi = mi.Vector3f(np.array([np.sin(angles), 0 * angles, np.cos(angles)]))
        _, weight = bsdf.sample(mi.BSDFContext(), si_of(wi), mi.Float(0.3), mi.Point2f(0.4, 0.6))
        value = channels(bsdf.eval(mi.BSDFContext(), si_of(wi), mi.Vector3f(-wi.x, 0, wi.z)))
        found.append(np.concatenate([value[:1] + np.zeros((1, 7)), channels(weight)[:1] + np.zeros((1, 7))]))
        assert np.isfinite(found[-1]).all()
    np.testing.assert_allclose(*found, rtol=2e-3, atol=1e-6)


@every(defaults_only())
def test_samples_are_distributed_as_the_density_says(model: Model) -> None:
    result = of_model(type(model), {}, ["sampling"], None, SEED, ())["sampling"]
    assert result.expected, result
