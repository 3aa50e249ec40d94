"""Glass: both branches, from both sides."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
import pytest
from mpmath import mpf

from brdf import Lobe, Values, defaults, evaluate, stable
from brdf.models.glass import Glass
from tests.brdf.arrays import EPS, VECTORS, to_numpy
from tests.brdf.slopes import quotient, slope
from tests.oracles import directions, optics, textbook

WIDE = ("float32", "float64")
wide = pytest.mark.parametrize("kind", WIDE)
MIRROR, REFRACTION = 0, 1


def values(eta: Any, r: Any = 1.0, t: Any = 1.0) -> Values:
    return Values(eta=eta, specular_reflectance=r, specular_transmittance=t)


def both_sides(n: int = 200) -> Any:
    w = directions.hemisphere(n, 4)
    w[::2, 2] *= -1
    return w


@wide
@pytest.mark.parametrize("eta", [1.333, 1.5, 2.419, 0.75, 1.0])
def test_branches(kind: str, eta: float) -> None:
    """Fresnel's reflectance and Snell's direction in 60 digits, from above and from below; the two weights add up to 1."""
    vector = VECTORS[kind]
    w = both_sides()
    wi = vector(*w.T)
    p = values(dr.value_t(vector)(eta))
    eta = to_numpy(p.eta).item()  # as rounded
    reflected, refracted = (Glass().ideal(p, wi, lobe) for lobe in (MIRROR, REFRACTION))
    np.testing.assert_array_equal(to_numpy(reflected.wo).T, to_numpy(wi).T * [-1, -1, 1])
    far = np.where(w[:, 2] > 0, eta, 1 / eta)
    np.testing.assert_allclose(to_numpy(refracted.eta), far, rtol=2 * EPS[kind])
    critical = np.abs(1 - (1 - w[:, 2] ** 2) / far**2) < 1e-3  # where a rounding of the input decides
    F = np.array([float(textbook.fresnel_dielectric(abs(mpf(z)), mpf(n))) for z, n in zip(w[:, 2], far, strict=True)])
    got, through = to_numpy(reflected.weight), to_numpy(refracted.weight)
    np.testing.assert_allclose(got[~critical], F[~critical], atol=200 * EPS[kind])
    np.testing.assert_allclose(got + through, 1, atol=4 * EPS[kind])
    total = far**2 < 1 - w[:, 2] ** 2
    assert (through[total & ~critical] == 0).all() and (got[total & ~critical] == 1).all()
    assert total.any() == (eta != 1)
    for i in np.flatnonzero(~total & ~critical)[:40]:
        want = [float(x) for x in optics.refracted([mpf(x) for x in w[i]], mpf(far[i]))]
        np.testing.assert_allclose(to_numpy(refracted.wo)[:, i], want, atol=200 * EPS[kind])


@wide
def test_published(kind: str) -> None:
    """Reflectances of glass from air and from inside, 9 digits; nothing passes beyond 41.8103 degrees."""
    vector = VECTORS[kind]
    p = values(dr.value_t(vector)(1.5))
    outside = {0: 0.04, 45: 0.0502399110, 60: 0.0891867128, 75: 0.2530605630, 80: 0.3877043547, 85: 0.6127996453}
    inside = {10: 0.0400829592, 30: 0.0551901673, 41: 0.3797512660, 41.82: 1, 60: 1}
    for table, side in ((outside, 1), (inside, -1)):
        a = np.radians(list(table))
        wi = vector(np.sin(a), 0 * a, side * np.cos(a))
        reflected, refracted = (to_numpy(Glass().ideal(p, wi, lobe).weight) for lobe in (0, 1))
        np.testing.assert_allclose(reflected, list(table.values()), rtol=1e-5 if kind == "float32" else 2e-9)
        np.testing.assert_allclose(refracted, 1 - np.array(list(table.values())), atol=1e-6)


@wide
@pytest.mark.parametrize("eta", [1.5, 0.75])
def test_the_way_back(kind: str, eta: float) -> None:
    """From where it was refracted to, light returns to where it came from, with the same weight: Fresnel's reciprocity."""
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    p = values(number(eta), t=vector(0.9, 0.5, 0.1))
    wi = vector(*both_sides().T)
    there = Glass().ideal(p, wi, REFRACTION)
    back = Glass().ideal(p, there.wo, REFRACTION)
    weight = to_numpy(there.weight)
    passes = weight[0] > 0.01  # a rounding of the direction is large by the critical angle
    assert passes.sum() > 100
    np.testing.assert_allclose(to_numpy(back.wo)[:, passes], to_numpy(wi)[:, passes], atol=500 * EPS[kind])
    np.testing.assert_allclose(to_numpy(back.weight)[:, passes], weight[:, passes], atol=500 * EPS[kind])
    np.testing.assert_allclose(to_numpy(back.eta * there.eta), 1, rtol=2 * EPS[kind])
    np.testing.assert_allclose(weight[1], weight[0] * 5 / 9, rtol=1e-6)


@pytest.mark.parametrize("eta", [1.333, 1.5, 0.75])
@pytest.mark.parametrize("what", ["reflectance", "transmittance", "x", "y", "z"])
def test_gradient(eta: float, what: str) -> None:
    """Of both weights and of the refracted direction, against central differences in float64, from both sides."""
    w = both_sides()
    far = np.where(w[:, 2] > 0, eta, 1 / eta)
    w = w[np.abs(1 - (1 - w[:, 2] ** 2) / far**2) > 1e-3]  # infinite at the critical angle

    def f(x: Any) -> Any:
        wi = VECTORS["float64" if stable.is_double(x) else "float32"](*w.T)
        ideal = Glass().ideal(values(x), wi, MIRROR if what == "reflectance" else REFRACTION)
        return ideal.weight if "ance" in what else getattr(ideal.wo, what)

    at = np.full(len(w), eta)
    got, want = slope(f, "float64", at), quotient(f, at, 1e-7)
    np.testing.assert_allclose(got, want, rtol=1e-4, atol=1e-7)
    assert np.abs(want).max() > 0.1
    np.testing.assert_allclose(slope(f, "float32", at), got, rtol=1e-2, atol=1e-3)


@wide
def test_same_index(kind: str) -> None:
    """eta = 1: nothing is reflected, and light goes straight on."""
    vector = VECTORS[kind]
    wi = vector(*both_sides().T)
    p = values(dr.value_t(vector)(1.0))
    assert (to_numpy(Glass().ideal(p, wi, MIRROR).weight) == 0).all()
    there = Glass().ideal(p, wi, REFRACTION)
    assert (to_numpy(there.weight) == 1).all()
    np.testing.assert_allclose(to_numpy(there.wo), -to_numpy(wi), atol=100 * EPS[kind])


@wide
def test_chances_are_weights(kind: str) -> None:
    vector = VECTORS[kind]
    wi = vector(*both_sides().T)
    p = defaults(Glass(), vector, specular_reflectance=(0.3, 0.6, 0.9), specular_transmittance=0.5)
    for lobe, chance in enumerate(Glass().choose(p, wi)):
        want = to_numpy(Glass().ideal(p, wi, lobe).weight).mean(axis=0)
        np.testing.assert_allclose(to_numpy(chance), want, rtol=4 * EPS[kind])


@wide
def test_finite_everywhere(kind: str) -> None:
    """Weights, directions and their derivatives at grazing and at the critical angle, for every index allowed."""
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    cosines = [1.0, 1 - 1e-7, 0.7, float(np.sqrt(1 - 1 / 2.25)), 1e-2, 1e-4, 1e-7, 1e-12]
    etas = [0.1, 0.75, 1 - 2.0**-20, 1.0, 1 + 2.0**-20, 1.5, 10.0]
    rows = [(side * c, n) for c in cosines for n in etas for side in (1, -1)]
    z, n = np.array(rows).T
    wi = vector(*(np.array([directions.unit(abs(c), 0.7) for c in z]) * np.sign(z)[:, None] ** [0, 0, 1]).T)
    for lobe in (MIRROR, REFRACTION):
        eta = number(n)
        dr.enable_grad(eta)
        wo, weight, far = Glass().ideal(values(eta), wi, lobe)
        for value in (wo, weight, far):
            assert np.isfinite(to_numpy(value)).all()
        assert ((to_numpy(weight) >= 0) & (to_numpy(weight) <= 1 + 4 * EPS[kind])).all()
        np.testing.assert_allclose(np.linalg.norm(to_numpy(wo), axis=0), 1, atol=8 * EPS[kind])
        assert (np.sign(to_numpy(wo)[2]) == (1 if lobe == MIRROR else -1) * np.sign(z)).all()
        for part in (weight, *wo) if lobe == REFRACTION else (weight,):
            dr.clear_grad(eta)
            dr.backward(dr.sum(part), flags=dr.ADFlag.ClearVertices & ~dr.ADFlag.ClearEdges)
            assert np.isfinite(to_numpy(eta.grad)).all()


def test_no_smooth_part() -> None:
    vector = VECTORS["float64"]
    wi, wo = vector(*both_sides().T), vector(*both_sides()[::-1].T)
    assert (to_numpy(evaluate(Glass(), defaults(Glass(), vector), wi, wo)) == 0).all()
    assert Glass.lobes == (Lobe.MIRROR, Lobe.REFRACTION) and Glass().transmits
