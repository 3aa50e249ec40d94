"""Smooth metal: the reflectance of a conductor in the mirror direction."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import Values, defaults
from brdf.models.metal import Metal
from tests.brdf.arrays import VECTORS, single, to_numpy
from tests.brdf.slopes import slope
from tests.oracles import directions, optics, textbook

WIDE = ("float32", "float64")
COSINES = single([1.0, 0.999, 0.7, 0.3, 0.02, 1e-4])
#: Real and imaginary parts: about gold's in blue and red, aluminium's, a lossy and a clear dielectric.
INDICES = single([(1.47, 1.95), (0.14, 4.54), (1.37, 7.62), (1.5, 1e-3), (1.5, 0.0)])


def cases(kind: str) -> tuple[Any, Any, Any, Any]:
    """Directions, eta, k, and the cosines of the directions."""
    c, index = np.tile(COSINES, len(INDICES)), np.repeat(INDICES, len(COSINES), axis=0)
    w = np.array([directions.unit(x, 0.0) for x in c])
    return VECTORS[kind](*w.T), index[:, 0], index[:, 1], c


def reflectance(wi: Any, eta: Any, k: Any) -> Any:
    return Metal().ideal(Values(eta=eta, k=k, specular_reflectance=1.0), wi, 0).weight


@pytest.mark.parametrize("kind", WIDE)
def test_reflectance(kind: str) -> None:
    """Complex Fresnel amplitudes in 60 digits."""
    wi, eta, k, c = cases(kind)
    number = dr.value_t(VECTORS[kind])
    want = [float(optics.fresnel_conductor(*map(mpf, x))) for x in zip(c, eta, k, strict=True)]
    got = to_numpy(reflectance(wi, number(eta), number(k)))
    np.testing.assert_allclose(got, want, rtol=2e-6 if kind == "float32" else 4e-15)


@pytest.mark.parametrize("kind", WIDE)
@pytest.mark.parametrize("name", ["eta", "k"])
def test_gradient(kind: str, name: str) -> None:
    wi, eta, k, c = cases(kind)
    number = dr.value_t(VECTORS[kind])
    keep = k > 0 if name == "k" else k >= 0  # at 0 it is one-sided
    if name == "eta":
        got = slope(lambda x: reflectance(wi, x, number(k)), kind, eta)
        oracle = [mpmath.diff(lambda x, r=r: optics.fresnel_conductor(mpf(r[0]), x, mpf(r[2])), mpf(r[1]))
                  for r in zip(c, eta, k, strict=True)]  # fmt: skip
    else:
        got = slope(lambda x: reflectance(wi, number(eta), x), kind, k)
        oracle = [mpmath.diff(lambda x, r=r: optics.fresnel_conductor(mpf(r[0]), mpf(r[1]), x), mpf(r[2]))
                  if r[2] else mpf(1) for r in zip(c, eta, k, strict=True)]  # fmt: skip
    want = np.array([float(x) for x in oracle])
    np.testing.assert_allclose(got[keep], want[keep], rtol=4e-5 if kind == "float32" else 1e-13)


def test_clear_is_a_dielectric() -> None:
    """With k = 0."""
    wi, _, _, c = cases("float64")
    got = to_numpy(reflectance(wi, dr.llvm.ad.Float64(1.5), dr.llvm.ad.Float64(0.0)))
    np.testing.assert_allclose(got, [float(textbook.fresnel_dielectric(mpf(x), mpf("1.5"))) for x in c], rtol=4e-15)


@pytest.mark.parametrize("kind", WIDE)
def test_channels(kind: str) -> None:
    """At normal incidence ``((eta - 1)^2 + k^2) / ((eta + 1)^2 + k^2)``, each channel by itself, times the tint."""
    vector = VECTORS[kind]
    eta, k, tint = np.array([0.14, 0.37, 1.47]), np.array([4.54, 2.6, 1.95]), np.array([1.0, 0.5, 0.25])
    p = defaults(
        Metal(), vector, eta=tuple(eta.tolist()), k=tuple(k.tolist()), specular_reflectance=tuple(tint.tolist())
    )
    wo, weight, index = Metal().ideal(p, vector(0, 0, 1), 0)
    want = tint * ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2)
    np.testing.assert_allclose(to_numpy(weight).ravel(), want, rtol=1e-6 if kind == "float32" else 1e-14)
    np.testing.assert_array_equal(to_numpy(wo).ravel(), [0, 0, 1])
    assert index == 1


@pytest.mark.parametrize("kind", WIDE)
def test_finite_at_the_bounds(kind: str) -> None:
    """Nothing at all, a perfect mirror and the largest index among them."""
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    ends = (0.0, 1e-3, 1.0, 20.0)
    rows = [(c, n, k) for c in (1.0, 0.5, 1e-7, 1e-9) for n in ends for k in ends]
    c, n, k = np.array(rows).T
    wi = vector(*np.array([directions.unit(x, 0.4) for x in c]).T)
    eta, kappa = number(n), number(k)
    dr.enable_grad(eta, kappa)
    F = reflectance(wi, eta, kappa)
    assert np.isfinite(to_numpy(F)).all()
    assert ((to_numpy(F) >= 0) & (to_numpy(F) <= 1 + 1e-6)).all()
    dr.backward(dr.sum(F))
    assert np.isfinite(to_numpy(eta.grad)).all() and np.isfinite(to_numpy(kappa.grad)).all()
