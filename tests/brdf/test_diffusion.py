"""Diffuse reflection by multiple scattering."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import Values, defaults, evaluate
from brdf.models.diffusion import Diffusion, total_reflectance
from tests.brdf.arrays import VECTORS, single, to_numpy
from tests.brdf.slopes import slope
from tests.oracles import directions, optics, textbook

WIDE = ("float32", "float64")
wide = pytest.mark.parametrize("kind", WIDE)
NAMES = ("sigma_s", "sigma_a", "g", "eta")
#: Hardly absorbing to black, forward and backward, near and far from the index of air.
SETTINGS = single([
    (s, a, g, n) for s in (0.01, 2.5) for a in (1e-6, 0.3) for g in (-0.5, 0.9) for n in (1.01, 1.3, 1.5, 5.0)
])  # fmt: skip


def oracle(s: Any, a: Any, g: Any, n: Any) -> Any:
    inside = 1 - (1 - optics.fresnel_mean_closed(n)) / n**2
    return optics.dipole_reflectance(s, a, g, n, inside)


@pytest.mark.parametrize("kind", VECTORS)
@pytest.mark.parametrize(
    ("eta", "sigma_s", "sigma_a", "want"), [(1.3, 2.55, 0.0021, 0.875530), (1.5, 1, 0.1, 0.286807), (1, 1, 1, 0.087808)]
)
def test_published(kind: str, eta: float, sigma_s: float, sigma_a: float, want: float) -> None:
    """Three total reflectances, to 6 digits."""
    number = dr.value_t(VECTORS[kind])
    p = Values(sigma_s=number(sigma_s), sigma_a=number(sigma_a), g=number(0), eta=number(eta))
    assert to_numpy(total_reflectance(p)) == pytest.approx(want, abs=1e-6)


@wide
def test_total_reflectance(kind: str) -> None:
    number = dr.value_t(VECTORS[kind])
    p = Values(**{name: number(x) for name, x in zip(NAMES, SETTINGS.T, strict=True)})
    want = [float(oracle(*map(mpf, row))) for row in SETTINGS]
    np.testing.assert_allclose(to_numpy(total_reflectance(p)), want, rtol=4e-6 if kind == "float32" else 1e-14)


@wide
@pytest.mark.parametrize("name", NAMES)
def test_gradient(kind: str, name: str) -> None:
    """Of the whole model, with respect to all four."""
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    at = NAMES.index(name)
    c = (0.9, 0.3)
    wi, wo = (vector(*directions.unit(x, 0.0).tolist()) for x in c)

    def got(x: Any) -> Any:
        columns = [x if i == at else number(column) for i, column in enumerate(SETTINGS.T)]
        s, a, g, n = columns
        return Diffusion().f(Values(sigma_s=vector(s), sigma_a=vector(a), g=g, eta=n), wi, wo)[0].x

    def want(row: Any) -> Any:
        def f(x: Any) -> Any:
            values = [x if i == at else mpf(v) for i, v in enumerate(row)]
            T = [1 - textbook.fresnel_dielectric(mpf(y), values[3]) for y in c]
            return T[0] * T[1] * oracle(*values) / mpmath.pi

        return mpmath.diff(f, mpf(row[at]))

    expected = np.array([float(want(row)) for row in SETTINGS])
    # d/d eta changes sign: relative to the value over eta as well.
    scale = np.abs(expected) + (to_numpy(got(number(SETTINGS[:, at]))) / SETTINGS[:, at] if name == "eta" else 0)
    off = np.abs(slope(got, kind, SETTINGS[:, at]) - expected) / scale
    assert off.max() < (2e-5 if kind == "float32" else 4e-14)


@wide
def test_reciprocal_bit_for_bit(kind: str) -> None:
    vector = VECTORS[kind]
    wi, wo = (vector(*directions.hemisphere(500, seed).T) for seed in (1, 2))
    p = defaults(Diffusion(), vector)
    there, back = to_numpy(evaluate(Diffusion(), p, wi, wo)), to_numpy(evaluate(Diffusion(), p, wo, wi))
    assert (there > 0).all()
    np.testing.assert_array_equal(there, back)


@pytest.mark.parametrize("cos", [1.0, 0.5, 0.1, 1e-3])
def test_albedo(cos: float) -> None:
    """``T R_d (1 - mean F)``: less than 1, even where nothing is absorbed, since a part stays inside."""
    vector = VECTORS["float64"]
    p = defaults(Diffusion(), vector, sigma_a=1e-6, eta=1.5)
    t, w = np.polynomial.legendre.leggauss(200)
    t, w = (t + 1) / 2, w / 2
    wo = vector(*np.array([directions.unit(x**4, 0.0) for x in t]).T)
    f = to_numpy(Diffusion().f(p, vector(*directions.unit(cos, 0.0).tolist()), wo)[0])
    albedo = np.sum(f * t**4 * 2 * np.pi * 4 * t**3 * w, axis=1)
    n = mpf("1.5")
    T = 1 - textbook.fresnel_dielectric(mpf(cos), n)
    R = [oracle(mpf(str(s)), mpf("1e-6"), 0, n) for s in (2.19, 2.62, 3.0)]  # the defaults, by channel
    want = [float(T * r * (1 - optics.fresnel_mean_closed(n))) for r in R]
    np.testing.assert_allclose(albedo, want, rtol=1e-6)
    assert (albedo < 1).all()


@wide
def test_finite_everywhere(kind: str) -> None:
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    bounds = {p.name: p.bounds for p in Diffusion.params}
    ends = [
        (s, a, g, n) for s in bounds["sigma_s"] for a in bounds["sigma_a"] for g in bounds["g"] for n in bounds["eta"]
    ]
    rows = [(c, d, *e) for c in (1.0, 0.5, 1e-7, 1e-12) for d in (1.0, 1e-3, 1e-12) for e in ends]
    c, d, s, a, g, n = np.array(rows).T
    wi, wo = (vector(*np.array([directions.unit(x, 0.3) for x in cos]).T) for cos in (c, d))
    p = Values(sigma_s=vector(number(s)), sigma_a=vector(number(a)), g=number(g), eta=number(n))
    dr.enable_grad(p.sigma_s, p.sigma_a, p.g, p.eta)
    f = evaluate(Diffusion(), p, wi, wo)
    assert (to_numpy(f) >= 0).all() and np.isfinite(to_numpy(f)).all()
    dr.backward(dr.sum(f, axis=None))
    for given in (p.sigma_s, p.sigma_a, p.g, p.eta):
        assert np.isfinite(to_numpy(given.grad)).all()
