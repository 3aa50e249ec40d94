"""Bricks of smooth surfaces: transmittance, refraction, mean reflectance; against books in many digits."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import drjit as dr
import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import fresnel, geometry, stable
from tests.brdf.arrays import EPS, VECTORS, call, precision, single, to_numpy
from tests.brdf.slopes import slope
from tests.oracles import directions, optics, textbook

WIDE = ("float32", "float64")
vectors = pytest.mark.parametrize("kind", VECTORS)
wide = pytest.mark.parametrize("kind", WIDE)

#: From a millionth above 1 to 10, rounded to float32, which float64 represents as well.
INDICES = single(1 + np.geomspace(1e-6, 9, 40))
COSINES = single([1e-7, 1e-5, 1e-3, 0.02, 0.2, 0.5, 0.7, 0.9, 0.999, 1])


def off(got: Any, want: Any) -> float:
    return float((np.abs(got - want) / np.abs(want)).max())


def limit(kind: str, float32: float, float64: float) -> float:
    return float32 if precision(kind) == "float32" else float64


def rounded(kind: str, a: Any) -> Any:
    return single(a) if precision(kind) == "float32" else np.array(a)


def incidence(kind: str, indices: Any) -> tuple[Any, Any, Any]:
    """Cosines, squared sines and indices; not within 1 % of the critical angle, where a rounding decides."""
    c, eta = (a.ravel() for a in np.meshgrid(COSINES, single(indices)))
    critical = np.sqrt(np.maximum(1 - eta**2, 0))
    keep = np.abs(c - critical) > 1e-2 * critical
    c, eta = c[keep], eta[keep]
    s2 = np.array([float(1 - mpf(x) ** 2) for x in c])
    return c, single(s2) if precision(kind) == "float32" else s2, eta


@vectors
def test_transmittance(kind: str) -> None:
    """``1 - F`` to a few roundings, also where F is nearly 1; 0 under total internal reflection."""
    c, s2, eta = incidence(kind, [1.000277, 1.333, 1.5, 10, 1 / 1.5, 0.99])
    want = np.array([float(1 - textbook.fresnel_dielectric(mpf(x), mpf(n))) for x, n in zip(c, eta, strict=True)])
    got = call(fresnel.transmittance_dielectric, VECTORS[kind], c, s2, eta)
    through = want > 0
    assert off(got[through], want[through]) < limit(kind, 1.5e-6, 3e-15)
    assert (got[~through] == 0).all() and (~through).any()
    both = got + call(fresnel.fresnel_dielectric, VECTORS[kind], c, s2, eta)
    np.testing.assert_allclose(both, 1, atol=4 * EPS[precision(kind)])

    want = np.array([float(1 - textbook.fresnel_schlick(mpf(x), mpf(n))) for x, n in zip(c, eta, strict=True)])
    assert off(call(fresnel.transmittance_schlick, VECTORS[kind], c, s2, eta), want) < limit(kind, 1.5e-6, 3e-15)


@wide
@pytest.mark.parametrize("law", ["dielectric", "schlick"])
def test_gradient_of_transmittance(kind: str, law: str) -> None:
    c, s2, eta = incidence(kind, [1.000277, 1.333, 1.5, 10])
    number = dr.value_t(VECTORS[kind])
    oracle = textbook.FRESNEL["exact" if law == "dielectric" else law]
    want = [float(-mpmath.diff(lambda n, x=x: oracle(mpf(x), n), mpf(e))) for x, e in zip(c, eta, strict=True)]
    function = getattr(fresnel, f"transmittance_{law}")
    got = slope(lambda n: function(number(c), number(s2), n), kind, eta)
    scale = 1 / eta  # of a transmittance of 1: it changes sign
    off = np.abs(got - want) / np.maximum(np.abs(want), 1e-6 * scale)
    assert off.max() < limit(kind, 2e-5, 5e-14)


@wide
def test_sine2(kind: str) -> None:
    """To a rounding of the sum and one of the product, and no cancellation. In NumPy, which keeps to what is written:
    Dr.Jit's compiler makes one operation of ``1 - z * z``, where the processor has it, and that is as exact."""
    eps = EPS[kind]
    z = (1 - np.geomspace(eps, 1, 200)).astype(kind)
    z = np.concatenate([z, -z])
    got = geometry.sine2(SimpleNamespace(z=z))
    assert got.dtype == kind
    want = np.array([float(1 - mpf(float(x)) ** 2) for x in z])
    np.testing.assert_allclose(got.astype(float), want, rtol=eps)


@vectors
@pytest.mark.parametrize("eta", [1.000277, 1.333, 1.5, 10.0, 1 / 1.5, 0.99])
@pytest.mark.parametrize("side", [1, -1])
def test_refract(kind: str, eta: float, side: int) -> None:
    """Snell's law, from both sides, of unit length."""
    eta = float(np.float32(eta))
    w = rounded(kind, [directions.unit(c, 2.0) for c in COSINES]) * [1, 1, side]
    got = call(lambda v, n: geometry.refract(v, n)[0], VECTORS[kind], w, np.full(len(w), eta))
    want = [optics.refracted([mpf(x) for x in v], mpf(eta)) for v in w]
    through = np.array([mpmath.im(o[2]) == 0 for o in want])
    want = np.array([[float(mpmath.re(x)) for x in o] for o in want])
    got = got if got.shape == want.shape else got.T
    assert through.any()
    cos_t = np.abs(want[through, 2:])
    assert (np.abs(got - want)[through] < 4 * EPS[precision(kind)] / cos_t).all()  # what a rounding of the input does
    np.testing.assert_allclose(np.linalg.norm(got, axis=1), 1, atol=4 * EPS[precision(kind)])
    assert (np.sign(got[:, 2]) == -side).all()
    np.testing.assert_array_equal(got[~through], -w[~through])


@vectors
@pytest.mark.parametrize(
    ("angle", "eta", "want"),
    [(45, 1.5, 28.1255057020557), (10, 1 / 1.5, 15.098086605159006), (80, 1.5, 41.03641052520335)],
)
def test_snell_published(kind: str, angle: float, eta: float, want: float) -> None:
    """Degrees, to 14 digits."""
    a = np.radians(angle)
    w = np.array([[np.sin(a), 0, np.cos(a)]])
    wo = call(lambda v, n: geometry.refract(v, n)[0], VECTORS[kind], w, np.array([eta])).ravel()
    assert np.degrees(np.arctan2(-wo[0], -wo[2])) == pytest.approx(want, rel=limit(kind, 1e-6, 1e-14))


@wide
@pytest.mark.parametrize("component", [0, 2])
def test_gradient_of_refraction(kind: str, component: int) -> None:
    """``d wo / d eta``, relative to itself: near the normal too, where its third component is nearly 0."""
    vector = VECTORS[kind]
    for eta in (1.000277, 1.5, 10.0, 1 / 1.2):
        at = single(np.full(7, eta))
        w = rounded(kind, [directions.unit(c, 0.0) for c in (0.6, 0.7, 0.9, 0.99, 0.999999, 1 - 1e-10, 1.0)])
        want = [
            float(mpmath.diff(lambda n, v=v: optics.refracted([mpf(x) for x in v], n)[component], mpf(at[0])))
            for v in w
        ]
        got = slope(lambda n, w=w: geometry.refract(vector(*w.T), n)[0][component], kind, at)
        np.testing.assert_allclose(got, want, rtol=limit(kind, 5e-6, 2e-14))


@wide
def test_refraction_at_grazing(kind: str) -> None:
    """The cosine keeps its digits where the sine, rounded, does not have them: ``cos_t^2 = (eta^2 - 1 + cos^2) / eta^2``, of
    a vector that is then brought to unit length."""
    w = single([directions.unit(c, 0.0) for c in (1e-1, 1e-2, 1e-3, 1e-4)])
    for eta in single([1 + 2.0**-20, 1.000277, 1.5]):
        z = call(lambda v, n: geometry.refract(v, n)[0].z, VECTORS[kind], w, np.full(len(w), eta))
        cos = [mpmath.sqrt((mpf(eta) ** 2 - 1 + mpf(c) ** 2) / mpf(eta) ** 2) for c in w[:, 2]]
        want = [float(c / mpmath.hypot(c, mpf(v[0]) / mpf(eta))) for c, v in zip(cos, w, strict=True)]
        np.testing.assert_allclose(-z, want, rtol=4 * EPS[kind])


@wide
def test_total_internal_reflection_is_harmless(kind: str) -> None:
    vector = VECTORS[kind]
    w = np.array([directions.unit(c, 1.0) for c in (1e-12, 1e-3, 0.5)])
    number = dr.value_t(vector)
    eta = number(np.full(3, 0.5))
    dr.enable_grad(eta)
    wo, refracts = geometry.refract(vector(*w.T), eta)
    assert not to_numpy(refracts).any()
    dr.backward(dr.sum(wo, axis=None))
    assert (to_numpy(eta.grad) == 0).all()


@vectors
def test_mean_published(kind: str) -> None:
    """Table of diffuse Fresnel reflectances, 6 digits: outside and inside."""
    table = {1.5: 0.091778, 1 / 1.5: 0.596346, 1.33: 0.065931, 1.3: 0.061132, 1 / 1.3: 0.444457}
    got = call(fresnel.fresnel_dielectric_mean, VECTORS[kind], np.array(list(table)))
    np.testing.assert_allclose(got, list(table.values()), atol=6e-7)
    assert call(fresnel.fresnel_dielectric_mean, VECTORS[kind], np.array([1.0])) == 0


@vectors
def test_mean(kind: str) -> None:
    """Of all directions by quadrature of Snell's law and the amplitudes."""
    eta = single([1.01, 1.5, 10, 0.99, 1 / 1.5, 0.1])
    want = [float(optics.mean(textbook.fresnel_dielectric, mpf(n))) for n in eta]
    assert off(call(fresnel.fresnel_dielectric_mean, VECTORS[kind], eta), want) < limit(kind, 1e-6, 4e-15)
    want = [float(optics.mean(textbook.fresnel_schlick, mpf(n))) for n in eta[:3]]
    assert off(call(fresnel.fresnel_schlick_mean, VECTORS[kind], eta[:3]), want) < limit(kind, 1e-6, 4e-15)


@wide
def test_mean_and_its_gradient(kind: str) -> None:
    """The closed form as printed, in 60 digits: it loses 36 of them at a millionth above 1."""
    got = call(fresnel.fresnel_dielectric_mean, VECTORS[kind], INDICES)
    assert off(got, [float(optics.fresnel_mean_closed(mpf(n))) for n in INDICES]) < limit(kind, 1e-6, 4e-15)
    want = [float(mpmath.diff(optics.fresnel_mean_closed, mpf(n))) for n in INDICES]
    assert off(slope(fresnel.fresnel_dielectric_mean, kind, INDICES), want) < limit(kind, 1e-6, 4e-15)


@wide
def test_gradient_of_the_mean_from_inside(kind: str) -> None:
    eta = single(1 / INDICES)

    def inside(n: Any) -> Any:
        return 1 - (1 - optics.fresnel_mean_closed(1 / n)) * n**2

    got = call(fresnel.fresnel_dielectric_mean, VECTORS[kind], eta)
    assert off(got, [float(inside(mpf(n))) for n in eta]) < limit(kind, 1e-6, 4e-15)
    want = [float(mpmath.diff(inside, mpf(n))) for n in eta]
    assert off(slope(fresnel.fresnel_dielectric_mean, kind, eta), want) < limit(kind, 2e-6, 8e-15)


@vectors
def test_atanh_rest(kind: str) -> None:
    x = single(np.concatenate([10.0 ** np.arange(-6, 0), np.linspace(0.2, 0.99, 20)]))
    want = [float((mpmath.atanh(mpf(v)) - mpf(v)) / mpf(v) ** 3) for v in x]
    assert off(call(stable.atanh_rest, VECTORS[kind], x), want) < limit(kind, 2e-6, 4e-15)
    assert call(stable.atanh_rest, VECTORS[kind], np.zeros(1)) == pytest.approx(1 / 3)
