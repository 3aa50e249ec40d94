"""D, G and F against the textbook in 60 digits, and against published numbers."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import fresnel, geometry, microfacet, stable
from tests.brdf.arrays import EPS, VECTORS, call, error, precision, single, to_numpy
from tests.brdf.slopes import slope
from tests.oracles import directions, textbook

ROUGHNESS = (1e-3, 0.01, 0.1, 0.3, 0.5, 1.0, 1.5)
#: Relative index of refraction: near 1, water, glass, diamond, large, and from inside.
INDICES = (1 + 2.0**-20, 1.000277, 1.01, 1.333, 1.5, 2.419, 10.0, 1 / 1.5, 0.99)

vectors = pytest.mark.parametrize("kind", VECTORS)


def tolerance(kind: str, float32: float, float64: float) -> float:
    """Of a scalar type too: there Dr.Jit stores float32 but computes with Python's floats."""
    return float32 if precision(kind) == "float32" else float64


@pytest.fixture(scope="module")
def pairs() -> tuple[Any, Any, Any, list[textbook.Pair]]:
    wi, wo, m = (single(a) for a in directions.grid(ROUGHNESS))
    return wi, wo, m, [textbook.Pair(i, o) for i, o in zip(wi, wo, strict=True)]


@vectors
def test_beckmann_d(kind: str, pairs: Any) -> None:
    wi, wo, m, p = pairs
    want = np.array([float(textbook.beckmann_d(q.nh, mpf(r))) for q, r in zip(p, m, strict=True)])
    peak = np.array([float(textbook.beckmann_peak(q.nh, mpf(r))) for q, r in zip(p, m, strict=True)])
    got = call(lambda i, o, r: microfacet.beckmann_d(geometry.half(i, o).tan2, r), VECTORS[kind], wi, wo, m)
    assert error(got, want, peak).max() < tolerance(kind, 5e-6, 1e-14)
    got = call(lambda i, o, r: microfacet.beckmann_pdf(geometry.half(i, o).tan2, r), VECTORS[kind], wi, wo, m)
    assert error(got, want * [float(q.nh) for q in p], peak).max() < tolerance(kind, 5e-6, 1e-14)


@vectors
def test_beckmann_published(kind: str) -> None:
    """Mitsuba 3's test_microfacet.py: m = 0.1, theta = i pi/19, computed in float32: its last figure is 7e-6 off."""
    theta = np.arange(4) * np.pi / 19
    tan2, m = np.tan(theta) ** 2, np.full(4, 0.1)
    rtol = 1e-5
    d = call(microfacet.beckmann_d, VECTORS[kind], tan2, m)
    np.testing.assert_allclose(d, [31.8309879, 2.07673073, 3.02855828e-4, 1.01591990e-11], rtol)
    pdf = call(microfacet.beckmann_pdf, VECTORS[kind], tan2, m)
    np.testing.assert_allclose(pdf, [31.8309879, 2.04840684, 2.86446273e-4, 8.93474877e-12], rtol)
    d = call(microfacet.beckmann_d, VECTORS[kind], np.tan(np.array([0.1])) ** 2, np.array([0.1]))
    np.testing.assert_allclose(d, [11.86709118], 1e-6)


@vectors
def test_vcavity(kind: str, pairs: Any) -> None:
    wi, wo, _, p = pairs

    def g(i: Any, o: Any) -> Any:
        h = geometry.half(i, o)
        return microfacet.vcavity_g(i.z, o.z, h.hh, h.hz)

    def over_cosines(i: Any, o: Any) -> Any:
        h = geometry.half(i, o)
        return microfacet.vcavity_g_over_cosines(i.z, o.z, h.hh, h.hz)

    want = np.array([float(textbook.vcavity_g(q)) for q in p])
    assert error(call(g, VECTORS[kind], wi, wo), want, 1).max() < tolerance(kind, 1e-6, 2e-15)
    want = np.array([float(textbook.vcavity_g(q) / (4 * q.ni * q.no)) for q in p])
    assert error(call(over_cosines, VECTORS[kind], wi, wo), want, 1).max() < tolerance(kind, 1e-6, 2e-15)


@vectors
def test_smith(kind: str, pairs: Any) -> None:
    wi, _, m, p = pairs
    want = np.array([float(textbook.smith_g1(q.i, mpf(r))) for q, r in zip(p, m, strict=True)])
    got = call(microfacet.smith_g1, VECTORS[kind], wi, m)
    assert error(got, want, 1).max() < tolerance(kind, 1e-6, 2e-15)


def test_smith_published() -> None:
    """Mitsuba prints .67333597 at alpha .1, theta = .98 pi/2, from a rational fit that is off by up to 0.3 %."""
    theta = 0.98 * np.pi / 2
    w = np.array([[np.sin(theta), 0, np.cos(theta)]])
    got = call(microfacet.smith_g1, VECTORS["float64"], w, np.array([0.1]))[0]
    assert got == pytest.approx(0.67333597, rel=3e-3)


def facets(kind: str) -> tuple[Any, Any, Any]:
    """Cosines from grazing to normal, and squared sines, each rounded, and indices; cosines not within 1e-3 of the
    critical angle, where a rounding of the input decides the branch."""
    cosines = np.concatenate(
        [10.0 ** np.arange(-7, 0), np.linspace(0.05, 0.95, 19), 1 - 10.0 ** np.arange(-6.0, -1), [1.0]]
    )
    c, eta = (a.ravel() for a in np.meshgrid(cosines, INDICES))
    c, eta = single(c), single(eta)
    critical = np.sqrt(np.maximum(1 - eta**2, 0))
    away = np.abs(c - critical) > 1e-3 * critical
    c, eta = c[away], eta[away]
    s2 = np.array([float(1 - mpf(x) ** 2) for x in c])
    return c, single(s2) if precision(kind) == "float32" else s2, eta


@vectors
def test_fresnel(kind: str) -> None:
    c, s2, eta = facets(kind)
    want = np.array([float(textbook.fresnel_dielectric(mpf(x), mpf(n))) for x, n in zip(c, eta, strict=True)])
    got = call(fresnel.fresnel_dielectric, VECTORS[kind], c, s2, eta)
    assert (np.abs(got - want) / want).max() < tolerance(kind, 1.5e-6, 3e-15)
    want = np.array([float(textbook.fresnel_schlick(mpf(x), mpf(n))) for x, n in zip(c, eta, strict=True)])
    got = call(fresnel.fresnel_schlick, VECTORS[kind], c, s2, eta)
    assert (np.abs(got - want) / want).max() < tolerance(kind, 1.5e-6, 3e-15)


@vectors
def test_fresnel_published(kind: str) -> None:
    """Glass from air and from inside; the critical angle is 41.8103 degrees; at Brewster's angle F = r_s^2 / 2."""
    vector = VECTORS[kind]

    def at(degrees: list[float], eta: float) -> Any:
        a = np.radians(degrees)
        return call(fresnel.fresnel_dielectric, vector, np.cos(a), np.sin(a) ** 2, np.full(len(a), eta))

    rtol = tolerance(kind, 2e-6, 2e-9)
    table = [0.04, 0.0502399110, 0.0891867128, 0.2530605630, 0.3877043547, 0.6127996453]
    np.testing.assert_allclose(at([0, 45, 60, 75, 80, 85], 1.5), table, rtol)
    np.testing.assert_allclose(at([10, 30, 41], 1 / 1.5), [0.0400829592, 0.0551901673, 0.3797512660], rtol)
    np.testing.assert_allclose(at([41.82, 60, 89], 1 / 1.5), 1)
    np.testing.assert_allclose(at([56.309932474020215], 1.5), 0.3846153846153846**2 / 2, tolerance(kind, 2e-6, 1e-14))
    assert (at([0, 30, 80], 1.0) == 0).all()


def test_schlick_distance() -> None:
    """The largest error of Schlick's approximation, by index [FACTS: 2 digits]."""
    c = np.linspace(0, 1, 20001)
    for eta, largest in ((1.1, 0.21), (1.33, 0.060), (1.5, 0.036), (2.0, 0.044), (2.5, 0.082), (3.0, 0.125)):
        n = np.full_like(c, eta)
        exact = call(fresnel.fresnel_dielectric, VECTORS["float64"], c, 1 - c * c, n)
        off = np.abs(call(fresnel.fresnel_schlick, VECTORS["float64"], c, 1 - c * c, n) - exact).max()
        assert off == pytest.approx(largest, rel=0.03)


@pytest.mark.parametrize("kind", ["float32", "float64"])
@pytest.mark.parametrize("m", [0.1, 0.3, 0.6])
def test_weak_white_furnace(kind: str, m: float) -> None:
    """``integral D(h) G1(v, h) max(v.h, 0) dh = v.n``: facets as seen from v fill what v sees."""
    vector = VECTORS[kind]
    # h by slopes: dh = cos^3 d slope; Gauss-Legendre in radius (to where exp(-t^2/m^2) is nothing), equal steps in angle.
    t, wt = np.polynomial.legendre.leggauss(400)
    t, wt = (t + 1) * 3.5 * m, wt * 3.5 * m
    angle = (np.arange(720) + 0.5) * 2 * np.pi / 720
    tan, phi = (a.ravel() for a in np.meshgrid(t, angle, indexing="ij"))
    cos = 1 / np.sqrt(1 + tan**2)
    weight = np.repeat(wt, 720) * tan * cos**3 * 2 * np.pi / 720
    h = vector(tan * np.cos(phi) * cos, tan * np.sin(phi) * cos, cos)
    number = dr.value_t(vector)
    d = microfacet.beckmann_d(number(tan**2), number(m))
    for mu in (1.0, 0.7, 0.3, 0.1):
        v = vector(float(np.sqrt(1 - mu**2)), 0, mu)
        vh = dr.dot(v, h)
        vcavity = dr.minimum(1, 2 * h.z * v.z / dr.select(vh > 0, vh, 1))
        for g1 in (vcavity, microfacet.smith_g1(v, number(m))):
            seen = float(np.sum(to_numpy(d * g1 * dr.maximum(vh, 0)) * weight))
            assert seen / mu == pytest.approx(1, abs=2e-5)


@vectors
def test_log1p(kind: str) -> None:
    x = np.concatenate([-(10.0 ** np.arange(-12, -0.5, 0.5)), 10.0 ** np.arange(-12, 3, 0.5), [0.0, -0.999]])
    x = single(x)
    got = call(lambda v: stable.log1p(v), VECTORS[kind], x)
    want = np.log1p(x)
    assert (np.abs(got - want) <= 4 * EPS[precision(kind)] * np.abs(want)).all()
    if kind.endswith("scalar"):
        return
    v = dr.value_t(VECTORS[kind])(x)
    dr.enable_grad(v)
    dr.backward(dr.sum(stable.log1p(v)))
    np.testing.assert_allclose(to_numpy(v.grad), 1 / (1 + x), rtol=4 * EPS[precision(kind)])


@vectors
def test_expm1(kind: str) -> None:
    x = np.concatenate([-(10.0 ** np.arange(-12, 1.5, 0.5)), 10.0 ** np.arange(-12, 1.5, 0.5), [0.0]])
    x = single(x)
    got = call(lambda v: stable.expm1(v), VECTORS[kind], x)
    assert (np.abs(got - np.expm1(x)) <= 4 * EPS[precision(kind)] * np.abs(np.expm1(x))).all()
    if kind.endswith("scalar"):
        return
    v = dr.value_t(VECTORS[kind])(x)
    dr.enable_grad(v)
    dr.backward(dr.sum(stable.expm1(v)))
    np.testing.assert_allclose(to_numpy(v.grad), np.exp(x), rtol=4 * EPS[precision(kind)])


@vectors
def test_cosine_integral(kind: str) -> None:
    """A beta function. ``W(0) = pi``, ``W(1) = 2``, ``W(2) = pi / 2``."""
    n = single([0, 1, 2, 0.1, 0.5, 3.7, 10, 50, 1e3, 1e4, 1e6])
    got = call(lambda v: stable.cosine_integral(v), VECTORS[kind], n)
    want = np.array([float(mpmath.beta(mpf(0.5), (mpf(x) + 1) / 2)) for x in n])
    np.testing.assert_allclose(want[:3], [np.pi, 2, np.pi / 2], rtol=1e-15)
    # Six factors and a root, half a rounding or one each.
    np.testing.assert_allclose(got, want, rtol=8 * EPS[precision(kind)])


@vectors
def test_cosine_power(kind: str) -> None:
    """Of vectors in a plane at angles down to a millionth, the exponent such that the power is about 1 / e."""
    angle = np.array([0.0, 1e-6, 1e-3, 0.1, 1.0, 1.04, 1.05, 1.5, 1.57])
    a, b = np.array([0.6, 0.0, 0.8]), np.array([0.8, 0.0, -0.6])
    wi = single(np.tile(a, (len(angle), 1)))
    wo = single(np.outer(np.cos(angle), a) + np.outer(np.sin(angle), b))
    n = single(np.minimum(2 / np.maximum(angle, 1e-3) ** 2, 1e6))
    got = call(
        lambda i, o, x: stable.cosine_power(geometry.square(i - o), dr.dot(i, o), x),
        VECTORS[kind],
        wi,
        wo,
        n,
    )
    want = []
    for i, o, x in zip(wi, wo, n, strict=True):
        i, o = [mpf(c) for c in i], [mpf(c) for c in o]
        dot, size = sum(p * q for p, q in zip(i, o, strict=True)), sum(p * p + q * q for p, q in zip(i, o, strict=True))
        want.append(float((2 * dot / size) ** mpf(x)))
    # What a rounding of the angle, or of a product near 90 degrees, does.
    scale = np.array(want) * (1 + n * np.sin(angle) * np.maximum(angle, 1 / np.cos(angle) - 1))
    assert (np.abs(got - want) <= 4 * EPS[precision(kind)] * scale).all()
    opposite = call(lambda i, o, x: stable.cosine_power(4, -1 + 0 * i.x, x), VECTORS[kind], wi, wo, n)
    assert (opposite == 0).all()


@pytest.mark.parametrize("kind", ["float32", "float64"])
@pytest.mark.parametrize("n", [0.0, 1.0, 100.0, 1e6])
def test_cosine_power_hemisphere(kind: str, n: float) -> None:
    """The cosine has the CDF ``1 - cos^(n+1)``, also in the last digits of a sharp lobe's sine."""
    vector = VECTORS[kind]
    u = np.concatenate([(np.arange(4096) + 0.5) / 4096, 1.3 * 2.0 ** -np.arange(12, 25), [0.0]])
    w = to_numpy(geometry.cosine_power_hemisphere(vector(u, (u * 41) % 1, 0), dr.value_t(vector)(n), vector(0)))
    log_cos = np.log1p(-to_numpy(dr.value_t(vector)(u))) / (n + 1)
    np.testing.assert_allclose(np.hypot(w[0], w[1]), np.sqrt(-np.expm1(2 * log_cos)), rtol=8 * EPS[kind])
    np.testing.assert_allclose(np.linalg.norm(w, axis=0), 1, rtol=8 * EPS[kind])
    assert (w[2] > 0).all()


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_about(kind: str) -> None:
    """A rotation that takes the normal to the axis: it keeps lengths and angles, for every axis above the surface."""
    vector = VECTORS[kind]
    axis, w = directions.hemisphere(2000, 6), directions.hemisphere(2000, 7)
    axis[0], axis[1], axis[2] = [0, 0, 1], [1, 0, 0], [-0.8, -0.6, 0]
    turned = to_numpy(geometry.about(vector(*axis.T), vector(*w.T))).T
    close = 16 * EPS[kind]
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1, atol=close)
    np.testing.assert_allclose(np.sum(turned * axis, axis=1), w[:, 2], atol=close)
    basis = [to_numpy(geometry.about(vector(*axis.T), vector(*e))).T for e in np.eye(3).tolist()]
    np.testing.assert_allclose(np.cross(basis[0], basis[1]), basis[2], atol=close)
    np.testing.assert_allclose(sum(w[:, i : i + 1] * e for i, e in enumerate(basis)), turned, atol=close)


@vectors
def test_mean_decay(kind: str) -> None:
    """``(1 - exp(-x)) / x`` and its derivative, where both are differences; 1 and -1/2 at 0."""
    x = single([0.0, *10.0 ** np.arange(-12, 0), 0.2, 0.3, 0.4, 0.5])
    exact = [mpf(v) for v in x]
    want = [float((1 - mpmath.exp(-v)) / v) if v else 1.0 for v in exact]
    got = call(stable.mean_decay, VECTORS[kind], x)
    np.testing.assert_allclose(got, want, rtol=4 * EPS[precision(kind)])
    if not kind.endswith("scalar"):
        want = [float((mpmath.exp(-v) * (1 + v) - 1) / v**2) if v else -0.5 for v in exact]
        np.testing.assert_allclose(slope(stable.mean_decay, kind, x), want, rtol=8 * EPS[kind])


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_decay(kind: str) -> None:
    """``exp(-x)``, and 0 in value and derivative where that is nothing, to infinity."""
    x = single([0.0, 1e-3, 1.0, 50.0, 1e4, 1e30, np.inf])
    got, by = call(stable.decay, VECTORS[kind], x), slope(stable.decay, kind, x)
    np.testing.assert_allclose(got, np.exp(-x), rtol=4 * EPS[kind])
    np.testing.assert_array_equal(by, -got)


@vectors
def test_cube_remainder_of_sine(kind: str) -> None:
    """On both sides of where the series ends, and 1/6 at 0."""
    x = single([0.0, 1e-15, 1e-6, 1e-2, 0.5, 0.999, 1.0, 1.001, 2.0, np.pi, 6.0, -0.3, -3.0])
    want = [float((mpf(v) - mpmath.sin(mpf(v))) / mpf(v) ** 3) if v else 1 / 6 for v in x]
    got = call(lambda v: stable.cube_remainder_of_sine(v), VECTORS[kind], x)
    np.testing.assert_allclose(got, want, rtol=8 * EPS[precision(kind)])


@pytest.mark.parametrize("kind", ["float32", "float64"])
@pytest.mark.parametrize("m", [1e-3, 0.1, 1.0])
def test_beckmann_sample(kind: str, m: float) -> None:
    """Slopes of sampled normals: Rayleigh distributed radius, from the very sharp lobe on (its CDF inverted)."""
    vector = VECTORS[kind]
    u = np.concatenate([(np.arange(4096) + 0.5) / 4096, 1.3 * 2.0 ** -np.arange(12, 25), [0.0]])
    h = to_numpy(microfacet.beckmann_sample(vector(u, (u * 41) % 1, 0), dr.value_t(vector)(m), vector(0)))
    u32 = to_numpy(dr.value_t(vector)(u))
    tan = np.hypot(h[0], h[1]) / h[2]
    np.testing.assert_allclose(tan, m * np.sqrt(-np.log1p(-u32)), rtol=8 * EPS[kind])
    np.testing.assert_allclose(np.linalg.norm(h, axis=0), 1, rtol=8 * EPS[kind])


@pytest.mark.parametrize("kind", ["float32", "float64"])
@pytest.mark.parametrize("cos", [1.0, 0.5, 1e-2, 1e-5])
@pytest.mark.parametrize("m", [1e-4, 0.1, 1.0])
def test_visible_normals(kind: str, cos: float, m: float) -> None:
    """Finite, never facing away, and mean slope along the view as the density ``D G1 (v.h) / v.n`` has it."""
    vector = VECTORS[kind]
    rng = np.random.default_rng(5)
    n = 1 << 18
    u = vector(*rng.random((3, n)))
    w = vector(*single(directions.unit(cos, 0.0)).tolist())
    h = microfacet.vcavity_visible(microfacet.beckmann_sample(u, dr.value_t(vector)(m), w), w, u.z)
    assert np.isfinite(to_numpy(h)).all()
    assert (to_numpy(dr.dot(h, w)) >= 0).all()
    slope = to_numpy(-h.x / h.z) / m
    # By quadrature of the slope's density, which is Gaussian with variance m^2/2 times the masking by the other wall.
    x = np.linspace(-6, 6, 20001)
    wx = x[1] - x[0]
    wi = single(directions.unit(cos, 0.0))
    here, there = np.maximum(wi[2] - m * x * wi[0], 0), np.maximum(wi[2] + m * x * wi[0], 0)
    density = np.exp(-(x**2)) / np.sqrt(np.pi) * 2 * here / np.where(here + there > 0, here + there, 1)
    mean = np.sum(wx * density * x)
    assert np.sum(wx * density) == pytest.approx(1, abs=1e-3)
    spread = np.sqrt(np.sum(wx * density * x**2) - mean**2)
    assert abs(slope.mean() - mean) < 4 * spread / np.sqrt(n) + 1e-3
