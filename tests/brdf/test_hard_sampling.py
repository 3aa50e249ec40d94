"""Sampling where it is hardest: random numbers next to 0 and 1, the sharpest lobes, parameters at their bounds, grazing."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
import pytest
from scipy import stats

from brdf import Model, Values, builtin, defaults, geometry, microfacet
from brdf.checks.values import channels
from tests.brdf.arrays import EPS, VECTORS, Array, single, to_numpy
from tests.models import ends, named, variations
from tests.oracles import directions

WIDE = ("float32", "float64")
COSINES = (1.0, 1 - 1e-6, 0.7, 0.1, 1e-3, 1e-5, 1e-7)
#: Roundings by which a direction's length may differ from 1. A direction reflected on a facet is as long as `wi`, which
#: is rounded itself, to three more.
LENGTH = 4
#: How far a density in float32 may be from that of the same direction in float64.
DENSITY = 1e-5

B = builtin()


def draw(model: Model, p: Values, wi: Any, u: Any, lobe: int) -> tuple[Any, Any, Any, Any]:
    """Of directions from a lobe: they, whether they are on its side, density and weight there, and 0 elsewhere."""
    wo = model.sample(p, wi, u, lobe)
    side = dr.select((wi.z > 0) != model.lobes[lobe].transmits, 1.0, -1.0)
    there = wo.z * side > 0
    safe = type(wo)(wo.x, wo.y, dr.select(there, wo.z, side))
    density = dr.select(there, model.pdf(p, wi, safe)[lobe], 0)
    good = density > 0
    f = type(wo)(model.f(p, wi, safe)[lobe])
    return wo, there, density, dr.select(good, f * (abs(safe.z) / dr.select(good, density, 1)), 0)


def corners(model: Model, kind: str) -> tuple[Values, Any, Any, Array]:
    """All combinations of bounds, directions and random numbers, and these numbers once more, shape (3, n)."""
    vector, e = VECTORS[kind], EPS[kind] / 2
    settings = ends(model)
    seen = [directions.unit(z, a) for z in COSINES for a in (0.0, 0.4, 2.0)]
    seen += [w * [1, 1, -1] for w in seen] if model.transmits else []
    u = np.array(list(itertools.product((0.0, e, 0.3, 0.5, 0.9, 1 - e), repeat=3)))
    i, j, k = (a.ravel() for a in np.meshgrid(*(np.arange(len(x)) for x in (settings, seen, u)), indexing="ij"))
    made = {}
    for q in model.parameters():
        given: list[Any] = [s.get(q.name, q.default) for s in settings]
        rows = np.array([np.broadcast_to(x, 3) for x in given], dtype=float)[i]
        made[q.name] = dr.value_t(vector)(rows[:, 0]) if q.kind == "number" else vector(*rows.T)
    return Values(**made), vector(*np.array(seen)[j].T), vector(*u[k].T), u[k].T


def hard(model: Model, kind: str) -> None:
    p, wi, u, drawn = corners(model, kind)
    smooth = [i for i, lobe in enumerate(model.lobes) if not lobe.ideal]
    found = [draw(model, p, wi, u, i) for i in smooth]
    sent = [model.ideal(p, wi, i) for i, lobe in enumerate(model.lobes) if lobe.ideal]
    dr.eval(found, [(x.wo, x.weight) for x in sent])
    for x in sent:
        weight = channels(x.weight)
        assert np.isfinite(weight).all() and (weight >= 0).all() and (weight <= 1).all()
    for wo in [x[0] for x in found] + [x.wo for x in sent]:
        length = np.sqrt(np.sum(np.square(to_numpy(wo)), axis=0))
        assert (np.abs(length - 1) <= LENGTH * EPS[kind]).all()
    for i, (wo, there, density, weight) in zip(smooth, found, strict=True):
        q, w, on = to_numpy(density), channels(weight), np.asarray(there, dtype=bool)
        assert np.isfinite(q).all() and (q >= 0).all()
        assert np.isfinite(w).all() and (w >= 0).all()
        # Only the last number drawn leads 90 degrees away from a lobe, where a rounding may put it outside.
        assert (q > 0)[on & (drawn[0] < drawn[0].max())].all()
        assert on.mean() > 0.5
        if kind == "float32" and model.name != "grooved":  # whose density is a quadrature, of fewer points in float32
            exact, moved = exact_density(model, p, wi, wo, there, i)
            both = (q > 0) & (exact > 0)
            allowed = DENSITY * exact
            if model.name == "kajiyakay":  # whose angles are differences of roots
                allowed += moved
            assert (np.abs(q - exact) <= allowed)[both].all()


def exact_density(model: Model, p: Values, wi: Any, wo: Any, there: Any, lobe: int) -> tuple[Array, Array]:
    """The density in float64 of directions rounded to float32, and what one rounding of each component changes in it."""
    vector = VECTORS["float64"]
    number = dr.value_t(vector)
    double = Values(**{name: (vector if dr.depth_v(v) > 1 else number)(v) for name, v in vars(p).items()})
    side = dr.select((wi.z > 0) != model.lobes[lobe].transmits, 1.0, -1.0)
    given = [*vector(wi), *vector(wo.x, wo.y, dr.select(there, wo.z, side))]

    def density(by: int | None = None) -> Array:
        i = [w * dr.opaque(number, 1 + EPS["float32"] * (k == by)) for k, w in enumerate(given)]
        return to_numpy(dr.select(there, model.pdf(double, vector(*i[:3]), vector(*i[3:]))[lobe], 0))

    exact = density()
    return exact, np.sum([np.abs(density(k) - exact) for k in range(6)], axis=0)


def slow_in_float64(model: Model) -> list[Any]:
    """A parameter set for each precision; `grooved` takes long to compile in float64."""
    late = pytest.mark.slow if model.name == "grooved" else ()
    return [pytest.param(model, k, id=f"{named(model)}-{k}", marks=late if k == "float64" else ()) for k in WIDE]


@pytest.mark.parametrize(("model", "kind"), [x for model in variations() for x in slow_in_float64(model)])
def test_corners(model: Model, kind: str) -> None:
    """Finite directions of unit length; densities and weights finite, not negative, and the density is there."""
    hard(model, kind)


M, N = 1e-4, 1e6


class Sharp(NamedTuple):
    """A lobe, and minus the logarithm of the share of its samples beyond a slope `t`: of half vectors, or about the mirror
    direction."""

    model: Model
    numbers: dict[str, float]
    beyond: Callable[[Array], Array]
    mirror: bool = False


def cook(**choices: str) -> Model:
    return B["cooktorrance"](fresnel="constant", **choices)


SHARP = {
    "beckmann": Sharp(cook(), {"m": M}, lambda t: (t / M) ** 2),
    "ggx": Sharp(cook(distribution="ggx"), {"m": M}, lambda t: np.log1p((t / M) ** 2)),
    "ggx-smith": Sharp(cook(distribution="ggx", masking="smith"), {"m": M}, lambda t: np.log1p((t / M) ** 2)),
    "blinn": Sharp(cook(distribution="blinn"), {"m": M}, lambda t: np.log1p(t**2) / M**2),
    "ward": Sharp(B["ward"](), {"alpha_u": M, "alpha_v": M}, lambda t: (t / M) ** 2),
    "blinnphong": Sharp(B["blinnphong"](), {"exponent": N}, lambda t: (N + 2) / 2 * np.log1p(t**2)),
    "phong": Sharp(B["phong"](), {"exponent": N}, lambda t: (N + 1) / 2 * np.log1p(t**2), mirror=True),
}

sharp = pytest.mark.parametrize("lobe", SHARP.values(), ids=SHARP)


def slope(lobe: Sharp, kind: str, wi: Array, u: Array) -> tuple[Array, Array]:
    """Of directions sampled with `u`, shape (3, n): the slope and the azimuth, taken in float64 from what came out."""
    vector = VECTORS[kind]
    given = vector(*wi.tolist())
    p = defaults(lobe.model, vector, **lobe.numbers)
    dr.make_opaque(given, vars(p))
    wo = to_numpy(lobe.model.sample(p, given, vector(*u), 1))
    i = to_numpy(given)
    if lobe.mirror:
        axis = np.array([-i[0], -i[1], i[2]])[:, 0]
        across = np.array([axis[2], 0, -axis[0]]) / np.hypot(axis[2], axis[0])
        x, y, z = across @ wo, np.cross(axis, across) @ wo, axis @ wo
    else:
        x, y, z = wo + i
    return np.hypot(x, y) / z, np.arctan2(y, x)


@sharp
@pytest.mark.parametrize("kind", WIDE)
def test_slopes(kind: str, lobe: Sharp) -> None:
    """From the smallest to the largest random number, the share beyond the slope that comes out is 1 - u, to roundings."""
    e = EPS[kind] / 2
    u = np.concatenate([[e, 1 - e, 0.5], 1.3 * 2.0 ** -np.arange(1, 24), 1 - 1.3 * 2.0 ** -np.arange(1, 22)])
    u = single(u) if kind == "float32" else u
    turn = np.random.default_rng(4).random((2, len(u)))
    t, _ = slope(lobe, kind, np.array([0.0, 0.0, 1.0]), np.stack([u, *turn]))
    up = t < 1  # GGX's largest slope in float64 is 1e4: no direction above the surface
    assert up.sum() >= len(u) - 1
    np.testing.assert_allclose(lobe.beyond(t[up]), -np.log1p(-u[up]), rtol=24 * EPS[kind])


@sharp
def test_distribution_of_slopes(lobe: Sharp) -> None:
    """In float32, at 45 degrees, by Kolmogorov and Smirnov's test: as an exponential the one, evenly all round the other."""
    u = single(np.random.default_rng(3).random((3, 1 << 17), dtype=np.float32))
    t, turn = slope(lobe, "float32", directions.unit(np.sqrt(0.5), 0.4), u)
    assert stats.kstest(lobe.beyond(t), "expon").pvalue > 1e-3
    assert stats.kstest(turn / (2 * np.pi) + 0.5, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("kind", WIDE)
@pytest.mark.parametrize("cos", [1.0, 0.7, 0.1, 0.02, 1e-3])
def test_half_vector_is_the_facet(kind: str, cos: float) -> None:
    """A direction reflected on a facet has it as its half vector, to a quarter of a rounding over the cosine.

    That is what the rounding of directions leaves; brought to unit length, it would be further off than this.
    """
    vector, m = VECTORS[kind], 1e-4
    number = dr.value_t(vector)
    wi = vector(*directions.unit(cos, 0.4).tolist())
    u = vector(*np.random.default_rng(1).random((3, 1 << 14)))
    h = microfacet.vcavity_visible(microfacet.beckmann_sample(u, dr.opaque(number, m), wi), wi, u.z)
    facet, sum_ = to_numpy(h), to_numpy(geometry.reflect_about(wi, h)) + to_numpy(wi)
    off = np.hypot(*(sum_[:2] / sum_[2] - facet[:2] / facet[2]))
    assert off.max() <= 0.25 * EPS[kind] / cos
