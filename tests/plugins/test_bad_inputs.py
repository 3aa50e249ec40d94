"""Inputs of a plugin that are no direction above the surface, or no number: a defined answer, and no exception."""

from __future__ import annotations

import itertools
import math
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf import Model
from brdf.model import TANGENT
from plugins.checks.gather import as_dict
from tests.models import named, variations
from tests.plugins.hits import array, interaction

#: Models whose kernels take long to compile: tried with the slow tests.
HEAVY = {"grooved"}
FEW = [m for m in {m.name: m for m in reversed(variations())}.values() if m.name not in HEAVY]
ABOVE = np.array([(0, 0, 1), (0.6, 0, 0.8), (-0.6, 0, 0.8), (0, -0.96, 0.28)])
NONE = [(0, 0, 0), (1, 0, 0), (0, 1, -0.0), (1, 0, 1e-45), (1, 0, TANGENT), (math.nan, 0, 0)]
BELOW = [(0.6, 0, -0.8), (1, 0, -1e-45), (math.nan, 0, -0.8)]

every = pytest.mark.parametrize("model", FEW, ids=named)


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def pairs(first: Any, second: Any) -> tuple[Any, Any]:
    i, o = zip(*itertools.product(first, second), strict=True)
    return np.array(i, dtype=float), np.array(o, dtype=float)


def asked(bsdf: mi.BSDF, wi: Any, wo: Any) -> list[Any]:
    """`eval` and `pdf`, each by itself and both together; then the weights and densities of samples."""
    context, si, o = mi.BSDFContext(), interaction(wi), mi.Vector3f(wo.T)
    value, pdf = bsdf.eval_pdf(context, si, o)
    u = mi.Float(np.linspace(0, 1 - 2.0**-24, len(wi)))
    bs, weight = bsdf.sample(context, si, u, mi.Point2f(u, 0.3))
    found = [bsdf.eval(context, si, o), bsdf.pdf(context, si, o), value, pdf, weight, bs.pdf]
    dr.eval(found, bs)
    return [
        np.broadcast_to(array(x).reshape(-1, array(x).shape[-1]), (array(x).size // array(x).shape[-1], len(wi)))
        for x in found
    ]


@every
def test_nothing_outside(model: Model) -> None:
    """Whatever else is wrong: eval and density are 0; if it is the viewer who is outside, so are samples."""
    none = NONE if model.transmits else NONE + BELOW
    bsdf = mi.load_dict(as_dict(model, {}))
    for viewer in (True, False):
        wi, wo = pairs(none, ABOVE) if viewer else pairs(ABOVE, none)
        found = asked(bsdf, wi, wo)
        for x in found if viewer else found[:4]:
            assert (x == 0).all()


@every
def test_unknown_directions(model: Model) -> None:
    """eval is NaN, also where the lobe does not depend on the direction; sampling does without an answer."""
    bsdf = mi.load_dict(as_dict(model, {}))
    for side, component in itertools.product((0, 1), range(3)):
        both = list(pairs(ABOVE, ABOVE))
        both[side] = both[side].copy()
        both[side][:, component] = math.nan
        found = asked(bsdf, *both)
        assert np.isnan(found[0]).all() and np.isnan(found[2]).all()


@every
def test_unknown_parameters(model: Model) -> None:
    """eval is NaN wherever it moves with the parameter, and so is the weight of a mirror; sampling ends in any case."""
    wi, wo = pairs(ABOVE, ABOVE)
    bsdf = mi.load_dict(as_dict(model, {}))
    params = mi.traverse(bsdf)
    want = asked(bsdf, wi, wo)
    for p in model.parameters():
        key = next(k for k in params.keys() if k.split(".")[0] == p.name)  # noqa: SIM118
        kind, before = type(params[key]), array(params[key])
        shown = {}
        for what, other in (("moved", float(p.to_value(p.to_free(before.flat[0]) - 0.3))), ("unknown", math.nan)):
            params[key] = kind(other)
            params.update()
            shown[what] = asked(bsdf, wi, wo)
        params[key] = kind(*before.ravel().tolist())
        params.update()
        for i in (0, 2, 4) if len(model.lobes) == 1 and model.lobes[0].ideal else (0, 2):
            depends = shown["moved"][i] != want[i]
            assert np.isnan(shown["unknown"][i][depends]).all(), p.name
    again = asked(bsdf, wi, wo)
    assert all(np.array_equal(a, b) for a, b in zip(again, want, strict=True))


@pytest.mark.parametrize("name", ["cooktorrance", "glazed", "hanrahankrueger"])
def test_one_at_a_time(name: str) -> None:
    """In a scalar variant the same, and no exception."""
    mi.set_variant("scalar_rgb")
    plugins.register()
    bsdf, context = mi.load_dict({"type": name}), mi.BSDFContext()

    def value(wi: Any, wo: Any) -> Any:
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = mi.Vector3f(*wi)
        bsdf.sample(context, si, 0.4, mi.Point2f(0.3, 0.6))
        return array(bsdf.eval(context, si, mi.Vector3f(*wo)))

    for none in NONE if name == "hanrahankrueger" else NONE + BELOW:
        assert (value(none, [0, 0, 1]) == 0).all() and (value([0, 0, 1], none) == 0).all()
    assert np.isnan(value([0.6, 0, math.nan], [0, 0, 1])).all()
    assert np.isnan(value([0, 0, 1], [math.nan, 0, 0.8])).all()
