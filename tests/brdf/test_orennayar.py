"""Oren-Nayar: value, gradient, reciprocity and albedo, against its printed form in angles, in 60 digits."""

from __future__ import annotations

from functools import partial
from typing import Any

import drjit as dr
import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import Values, defaults, evaluate
from brdf.models.lambertian import Lambertian
from brdf.models.orennayar import OrenNayar
from tests.brdf.arrays import EPS, VECTORS, Array, call, precision, single, to_numpy
from tests.brdf.slopes import quotient, slope
from tests.oracles import diffuse, directions

VARIANTS = ("full", "fast")
SIGMAS = (0.05, 0.3, 0.6, 1.5)
WIDE = ("float32", "float64")
#: The albedo of a facet in most tests: `full` is not proportional to it.
WHITENESS = 0.5
#: Values are held relative to themselves, those below this relative to it: `full` goes through 0.
FLOOR = 0.01

variants = pytest.mark.parametrize("variant", VARIANTS)


def pairs() -> tuple[Array, Array, Array]:
    """Those of the other models, and every combination of cosines down to 1e-7 with azimuths near 0, 90 and 180 degrees."""
    wi, wo, _ = directions.grid((0.3, 1.0))
    cosines, azimuths = (1e-7, 1e-3, 0.1, 0.9, 1.0), (0.0, 1e-6, 0.5, np.pi / 2, 2.0, np.pi - 1e-6)
    combined = [
        (directions.unit(a, 0.3), directions.unit(b, 0.3 + c)) for a in cosines for b in cosines for c in azimuths
    ]
    wi = single(np.concatenate([wi, [a for a, _ in combined]]))
    wo = single(np.concatenate([wo, [b for _, b in combined]]))
    return wi, wo, single(np.resize(SIGMAS, len(wi)))


class Oracle:
    """The printed formula and its derivatives by sigma and by reflectance, for each pair and variant, once."""

    def __init__(self) -> None:
        self.wi, self.wo, self.sigma = pairs()
        i, o = self.wi, self.wo
        #: What the value moves by for relative changes of the components of the directions, at most: more than itself
        #: where both graze, at right angles.
        self.condition = (
            np.abs(i[:, :2] * o[:, :2]).sum(axis=1) / np.maximum(i[:, 2], o[:, 2]) * 0.45 * WHITENESS / np.pi
        )
        self.value: dict[str, Array] = {}
        self.by_sigma: dict[str, Array] = {}
        self.by_reflectance: dict[str, Array] = {}
        for variant in VARIANTS:
            printed = partial(diffuse.orennayar, variant)
            rows = [
                (
                    printed(i, o, mpf(WHITENESS), mpf(s)),
                    mpmath.diff(partial(printed, i, o, mpf(WHITENESS)), mpf(s)),
                    mpmath.diff(
                        lambda r, i=i, o=o, s=s, v=variant: diffuse.orennayar(v, i, o, r, mpf(s)), mpf(WHITENESS)
                    ),
                )
                for i, o, s in zip(self.wi, self.wo, self.sigma, strict=True)
            ]
            table = np.array(rows, dtype=float).T
            self.value[variant], self.by_sigma[variant], self.by_reflectance[variant] = table


@pytest.fixture(scope="module")
def oracle() -> Oracle:
    return Oracle()


def function(variant: str) -> Any:
    """``f`` of directions, sigma and reflectance, of one channel."""
    model = OrenNayar(variant=variant)
    return lambda wi, wo, sigma, white=WHITENESS: model.f(Values(reflectance=type(wi)(white), sigma=sigma), wi, wo)[0].x


@variants
@pytest.mark.parametrize("kind", VECTORS)
def test_value(kind: str, variant: str, oracle: Oracle) -> None:
    """As printed; 0 where that is negative, which happens only in `full`, and to surfaces of large sigma."""
    got = call(function(variant), VECTORS[kind], oracle.wi, oracle.wo, oracle.sigma)
    want = oracle.value[variant]
    assert (got[want < 0] == 0).all()
    assert (want < 0).any() == (variant == "full")
    assert set(oracle.sigma[want < 0]) <= {1.5}
    lit = want > 0
    off = np.abs(got - want) / (np.maximum(want, FLOOR) + oracle.condition)
    assert off[lit].max() < 8 * EPS[precision(kind)]


@variants
@pytest.mark.parametrize("kind", WIDE)
def test_gradient(kind: str, variant: str, oracle: Oracle) -> None:
    """By sigma and by reflectance, relative to the larger of the derivative and of value over parameter."""
    vector = VECTORS[kind]
    i, o, f = vector(*oracle.wi.T), vector(*oracle.wo.T), function(variant)
    value, sigma = oracle.value[variant], oracle.sigma
    lit = value > 0
    number = dr.value_t(vector)
    for got, want, at in (
        (slope(lambda s: f(i, o, s), kind, sigma), oracle.by_sigma[variant], sigma),
        (
            slope(lambda r: f(i, o, number(sigma), r), kind, np.full(len(sigma), WHITENESS)),
            oracle.by_reflectance[variant],
            0.5,
        ),
    ):
        off = np.abs(got - want) / (np.abs(want) + (np.maximum(value, FLOOR) + oracle.condition) / at)
        assert off[lit].max() < 8 * EPS[kind]
        assert (got[~lit] == 0).all()


@variants
def test_gradient_is_the_central_difference(variant: str) -> None:
    wi, wo, _ = directions.grid((0.3, 1.0), seed=5)
    vector = VECTORS["float64"]
    i, o, f = vector(*wi.T), vector(*wo.T), function(variant)
    sigma = np.full(len(wi), 0.4)  # below .66 nothing is cut off at 0
    np.testing.assert_allclose(
        slope(lambda s: f(i, o, s), "float64", sigma), quotient(lambda s: f(i, o, s), sigma), rtol=1e-7, atol=1e-8
    )


@variants
@pytest.mark.parametrize("kind", VECTORS)
def test_reciprocal_bit_for_bit(kind: str, variant: str, oracle: Oracle) -> None:
    f = function(variant)
    there = call(f, VECTORS[kind], oracle.wi, oracle.wo, oracle.sigma)
    back = call(f, VECTORS[kind], oracle.wo, oracle.wi, oracle.sigma)
    np.testing.assert_array_equal(there, back)


@variants
@pytest.mark.parametrize("kind", VECTORS)
def test_without_roughness_it_is_lambertian(kind: str, variant: str) -> None:
    vector = VECTORS[kind]
    wi, wo = (vector(*directions.unit(c, a).tolist()) for c, a in ((0.3, 1.0), (0.8, 2.5)))
    rough, smooth = OrenNayar(variant=variant), Lambertian()
    got = evaluate(rough, defaults(rough, vector, reflectance=(0.2, 0.4, 0.8), sigma=0.0), wi, wo)
    want = evaluate(smooth, defaults(smooth, vector, reflectance=(0.2, 0.4, 0.8)), wi, wo)
    np.testing.assert_allclose(to_numpy(got), to_numpy(want), rtol=2 * EPS[precision(kind)])


@pytest.mark.parametrize(
    ("variant", "sigma", "table"),
    [
        ("full", 0.3, [0.9624, 0.9708, 1.0010, 1.0267]),
        ("full", 0.5, [0.8963, 0.9086, 0.9531, 0.9909]),
        ("fast", 0.3, [0.8929, 0.9389, 0.9798, 0.9977]),
    ],
)
@pytest.mark.parametrize("kind", WIDE)
def test_directional_albedo(kind: str, variant: str, sigma: float, table: list[float]) -> None:
    """Reflectance 1, mu = 1, .7, .3, .1: published with 4 digits."""
    for mu, want in zip((1.0, 0.7, 0.3, 0.1), table, strict=True):
        assert albedo(kind, variant, sigma, mu) == pytest.approx(want, abs=6e-5)


@pytest.mark.parametrize(("variant", "excess"), [("full", 0.0398), ("fast", 0.0151)])
def test_it_reflects_more_than_arrives(variant: str, excess: float) -> None:
    """Declared as a fault: at 89.9 degrees, by another quadrature of the formula in angles, 4 digits."""
    assert "energy" in OrenNayar(variant=variant).faults()
    assert albedo("float64", variant, 0.2, float(np.cos(np.radians(89.9)))) == pytest.approx(1 + excess, abs=1e-4)


def albedo(kind: str, variant: str, sigma: float, mu: float) -> float:
    """By Gauss-Legendre in the cosine, on each side of `mu`, where the formula has a kink, and equal steps in azimuth."""
    vector = VECTORS[kind]
    x, w = np.polynomial.legendre.leggauss(100)
    z = np.concatenate([mu * (x + 1) / 2, mu + (1 - mu) * (x + 1) / 2])
    weight = np.concatenate([mu * w / 2, (1 - mu) * w / 2])
    phi = (np.arange(400) + 0.5) * np.pi / 400
    cos, angle = (a.ravel() for a in np.meshgrid(z, phi, indexing="ij"))
    sin = np.sqrt((1 - cos) * (1 + cos))
    i, o = vector(*directions.unit(mu, 0.0).tolist()), vector(sin * np.cos(angle), sin * np.sin(angle), cos)
    f = to_numpy(function(variant)(i, o, dr.value_t(vector)(sigma), 1.0))
    return float(np.sum(f * cos * np.repeat(weight, 400)) * 2 * np.pi / 400)


@variants
@pytest.mark.parametrize("kind", WIDE)
def test_finite_everywhere(kind: str, variant: str) -> None:
    """Value and all derivatives at every bound, at the normal, in and near the surface, equal and opposite."""
    cosines = (1.0, 1 - 1e-7, 0.5, 1e-4, 1e-7, 1e-12)
    rows = [
        (directions.unit(a, 0.3), directions.unit(b, 0.3 + c), s)
        for a in cosines
        for b in cosines
        for c in (0.0, 1e-9, 1.0, np.pi)
        for s in (0.0, 0.3, 1.5)
    ]
    rows += [(np.array([t, 0, 1]), np.array([0, t, 1]), 0.3) for t in (1e-10, 1e-20, 1e-30, 1e-200, 0.0)]
    wi, wo, sigma = (np.array(a) for a in zip(*rows, strict=True))
    vector = VECTORS[kind]
    model = OrenNayar(variant=variant)
    i, o = vector(*wi.T), vector(*wo.T)
    p = defaults(model, vector, sigma=dr.value_t(vector)(sigma), reflectance=vector(*np.full((3, len(wi)), 0.9)))
    dr.enable_grad(p.sigma, p.reflectance, i, o)
    f = evaluate(model, p, i, o)
    assert np.isfinite(to_numpy(f)).all() and (to_numpy(f) >= 0).all()
    dr.backward(dr.sum(f, axis=None))
    for given in (p.sigma, p.reflectance, i, o):
        assert np.isfinite(to_numpy(dr.grad(given))).all()


@variants
def test_nothing_below_the_horizon(variant: str) -> None:
    vector = VECTORS["float64"]
    model = OrenNayar(variant=variant)
    above, below, along = vector(0.6, 0, 0.8), vector(0, 0.6, -0.8), vector(0, 1, 0)
    for wi, wo in ((above, below), (below, above), (below, below), (above, along), (along, above)):
        assert (to_numpy(evaluate(model, defaults(model, vector), wi, wo)) == 0).all()


def test_flatter_and_brighter_backwards() -> None:
    """Lit from 60 degrees, rough clay is brighter towards the light than away from it; Lambert's surface is not."""
    vector = VECTORS["float64"]
    light = vector(*directions.unit(0.5, 0.0).tolist())
    back, forth = (vector(*directions.unit(0.7, a).tolist()) for a in (0.0, np.pi))
    for variant in VARIANTS:
        f = function(variant)
        assert to_numpy(f(back, light, 0.5)) > 1.2 * to_numpy(f(forth, light, 0.5))
