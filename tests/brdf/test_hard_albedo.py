"""The mean weight of samples is the albedo, by quadrature: the sharpest lobes, parameters at their bounds, grazing."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
import pytest

from brdf import Model, builtin, defaults
from brdf.checks.directions import stratified
from brdf.checks.energy import BATCHES, summarise
from brdf.checks.values import channels
from tests.brdf.arrays import VECTORS
from tests.brdf.test_hard_sampling import WIDE, draw
from tests.oracles import quadrature

B = builtin()
WHITE = {"specular_reflectance": (1.0, 1.0, 1.0)}
COSINES = (0.7, 1e-2, 1e-5)
#: Each of 16 batches has this many samples, squared.
SIDE = 64
#: Standard errors that the mean may be off by, and samples so few that they may all have been missed.
SIGMA, MISSED = 4.5, 10
#: Rounding of a mean in float32.
ROUNDING = 1e-6
#: Points of the rule in a panel, before and after one refinement, and the change by which it does not resolve the lobe.
POINTS, UNRESOLVED = (8, 12), 1e-3


class Case(NamedTuple):
    """A lobe, and its width [rad]."""

    model: Model
    numbers: dict[str, Any]
    width: float
    lobe: int = 1


def cook(m: float, fresnel: str = "constant", roughness: str = "isotropic", **choices: str) -> Case:
    model = B["cooktorrance"](fresnel=fresnel, roughness=roughness, **choices)
    return Case(model, {**WHITE, **({"m_u": m, "m_v": 3 * m} if model.anisotropic else {"m": m})}, m)


def glossy(m: float) -> dict[str, Case]:
    """Each glossy lobe, of roughness m or of the exponent that belongs to it."""
    n = min(2 / m**2, 1e6)
    power: dict[str, Any] = {"exponent": n, **WHITE}
    width = float(np.sqrt(2 / n))
    made = {
        f"{d}-{g}": cook(m, distribution=d, masking=g)
        for d in ("beckmann", "ggx", "blinn")
        for g in ("vcavity", "smith", "none")
    }
    made["two"] = cook(m, "exact", "anisotropic")
    made["two-metal"] = cook(m, "conductor", "anisotropic", distribution="ggx", masking="smith")
    for v in ("ward", "duer", "balanced"):
        made[v] = Case(B["ward"](variant=v), {"alpha_u": m, "alpha_v": 3 * m, **WHITE}, m)
    for v in ("exact", "common"):
        made[f"blinnphong-{v}"] = Case(B["blinnphong"](normalization=v), power, width)
    for v in ("classic", "modified"):
        made[f"phong-{v}"] = Case(B["phong"](normalization=v), power, width)
    made["kajiyakay"] = Case(B["kajiyakay"](), power, width)
    return made


CASES = {f"{name}-{m:g}": case for m in (1e-4, 1e-3) for name, case in glossy(m).items()}
CASES |= {
    "kajiyakay-diffuse": Case(B["kajiyakay"](), {}, 1.0, 0),
    "orennayar": Case(B["orennayar"](), {"sigma": 1.5}, 1.0, 0),
    "diffusion": Case(B["diffusion"](), {"eta": 10.0}, 1.0, 0),
    "glazed": Case(B["glazed"](), {"eta": 10.0}, 1.0, 1),
    "layer-back": Case(B["hanrahankrueger"](), {"g": -0.95, "eta": 1.0}, 0.05, 0),
    "layer-over": Case(B["hanrahankrueger"](), {"g": 0.95, "eta": 1.0}, 0.05, 0),
    "layer-forth": Case(B["hanrahankrueger"](), {"g": 0.95, "eta": 1.0}, 0.05, 1),
    "grooves": Case(B["grooved"](), {"exponent": 1e4, "spacing": 20.0, "height": 0.999, **WHITE}, 0.01, 1),
}


@functools.cache
def albedo(name: str, cos: float) -> tuple[float, float]:
    """``integral f cos`` in float64, and how much it changed in the last refinement."""
    case = CASES[name]
    vector = VECTORS["float64"]
    wi = np.array([np.sqrt((1 - cos) * (1 + cos)), 0, cos])
    given = vector(*wi.tolist())
    p = defaults(case.model, vector, **case.numbers)
    dr.make_opaque(given, vars(p))
    found = []
    for points in POINTS:
        if case.model.name == "kajiyakay":
            wo, solid = quadrature.about_thread(np.pi - np.arctan2(wi[2], wi[0]), case.width, points)
        else:
            wo, solid = quadrature.about_mirror(np.arcsin(cos), case.width, points)
        z = -wo[2] if case.model.lobes[case.lobe].transmits else wo[2]
        f = channels(vector(case.model.f(p, given, vector(wo[0], wo[1], z))[case.lobe]))
        found.append((f * wo[2] * solid).sum(axis=1).max())
    return found[1], abs(found[1] - found[0])


def weigh(name: str, cos: float, kind: str) -> None:
    case, (want, change) = CASES[name], albedo(name, cos)
    assert change <= UNRESOLVED * want
    vector = VECTORS[kind]
    given = vector(float(np.sqrt((1 - cos) * (1 + cos))), 0, cos)
    p = defaults(case.model, vector, **case.numbers)
    u = stratified(SIDE, BATCHES, 3)
    dr.make_opaque(given, vars(p))
    weight = draw(case.model, p, given, vector(*u), case.lobe)[3]
    w = channels(weight)
    got, error = summarise(w.reshape(len(w), BATCHES, -1))
    print(f"\n{name:22} cos {cos:g}: {got:.6g} +- {error:.1g}, by quadrature {want:.6g} +- {change:.1g}", end="")
    assert abs(got - want) <= SIGMA * error + MISSED * w.max() / u.shape[1] + change + ROUNDING * want


cosines = pytest.mark.parametrize("cos", COSINES)
#: Lobes that are sampled each in its own way.
ONE_EACH = ("beckmann-vcavity", "ggx-vcavity", "ggx-smith", "blinn-smith", "balanced", "phong-modified", "kajiyakay")


@cosines
@pytest.mark.parametrize("name", ONE_EACH)
def test_sharpest(name: str, cos: float) -> None:
    """In float32, of roughness 1e-4 and exponent 1e6."""
    weigh(f"{name}-0.0001", cos, "float32")


@pytest.mark.slow
@cosines
@pytest.mark.parametrize("kind", WIDE)
@pytest.mark.parametrize("name", [name for name in CASES if not name.endswith("-0.0001")])
def test_mean_weight(name: str, kind: str, cos: float) -> None:
    """Of every glossy lobe, and of wide ones at their bounds. ``pytest -s`` prints the figures."""
    weigh(name, cos, kind)
