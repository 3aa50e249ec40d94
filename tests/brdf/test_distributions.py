"""D, Smith's G1 and their sampling, of each distribution, isotropic and not; F of a conductor: against the textbook in
60 digits, closed forms and published numbers."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import fresnel, geometry, microfacet
from brdf.stable import expm1
from tests.brdf.arrays import EPS, VECTORS, call, error, precision, single, to_numpy
from tests.oracles import directions, optics, textbook

ROUGHNESS = (1e-3, 0.01, 0.1, 0.3, 1.0)
NAMES = tuple(microfacet.DISTRIBUTIONS)
WIDE = ("float32", "float64")

names = pytest.mark.parametrize("name", NAMES)
vectors = pytest.mark.parametrize("kind", VECTORS)


def tolerance(kind: str, float32: float, float64: float) -> float:
    return float32 if precision(kind) == "float32" else float64


def d_uv(name: str) -> Any:
    """D of a pair of directions and two roughnesses."""

    def d(i: Any, o: Any, u: Any, v: Any) -> Any:
        g = geometry.half(i, o)
        m = microfacet.roughness_of_normal(g, u, v)
        a = microfacet.DISTRIBUTIONS[name].d_half(g.tan2, m) * dr.sqrt((m / u) * (m / v))
        return a * a * dr.inv_pi

    return d


@pytest.fixture(scope="module")
def pairs() -> tuple[Any, Any, Any, list[textbook.Pair]]:
    wi, wo, m = (single(a) for a in directions.grid(ROUGHNESS))
    return wi, wo, m, [textbook.Pair(i, o) for i, o in zip(wi, wo, strict=True)]


def half(p: textbook.Pair) -> list[Any]:
    return [a + b for a, b in zip(p.i, p.o, strict=True)]


@names
@vectors
def test_d(kind: str, name: str, pairs: Any) -> None:
    wi, wo, m, p = pairs
    want = np.array([float(textbook.ISOTROPIC[name](q.nh, mpf(r))) for q, r in zip(p, m, strict=True)])

    def d(i: Any, o: Any, r: Any) -> Any:
        a = microfacet.DISTRIBUTIONS[name].d_half(geometry.half(i, o).tan2, r)
        return a * a * dr.inv_pi

    peak = np.array([float(textbook.beckmann_peak(q.nh, mpf(r))) for q, r in zip(p, m, strict=True)])
    assert error(call(d, VECTORS[kind], wi, wo, m), want, peak).max() < tolerance(kind, 5e-6, 1e-14)


@names
@pytest.mark.parametrize("kind", WIDE)
def test_d_of_two_roughnesses(kind: str, name: str, pairs: Any) -> None:
    """Value, and derivatives by reverse mode in both roughnesses; with both alike it is the isotropic one."""
    wi, wo, m, p = pairs
    u, v = m, single(m * np.where(np.arange(len(m)) % 2, 0.3, 0.7))
    oracle = textbook.DISTRIBUTION[name]
    want = np.array([float(oracle(half(q), mpf(a), mpf(b))) for q, a, b in zip(p, u, v, strict=True)])
    peak = np.array([float(1 / (mpmath.pi * a * b * q.nh**4)) for q, a, b in zip(p, u, v, strict=True)])
    vector = VECTORS[kind]
    assert error(call(d_uv(name), vector, wi, wo, u, v), want, peak).max() < tolerance(kind, 2e-5, 4e-14)

    number = dr.value_t(vector)
    at = number(u), number(v)
    dr.enable_grad(*at)
    dr.backward(dr.sum(d_uv(name)(vector(*wi.T), vector(*wo.T), *at)))
    for i, (got, scale) in enumerate(zip(at, (u, v), strict=True)):
        slope = [
            float(mpmath.diff(lambda *x, q=q: oracle(half(q), *x), (mpf(a), mpf(b)), (1 - i, i)))
            for q, a, b in zip(p, u, v, strict=True)
        ]
        floor = 2 * np.maximum(want, 1e-6 * peak) / scale
        off = np.abs(to_numpy(got.grad) - slope) / np.maximum(np.abs(slope), floor)
        assert off.max() < tolerance(kind, 5e-5, 1e-13)

    same = call(d_uv(name), vector, wi, wo, u, u)
    want = np.array([float(textbook.ISOTROPIC[name](q.nh, mpf(r))) for q, r in zip(p, m, strict=True)])
    assert error(same, want, peak).max() < tolerance(kind, 2e-5, 4e-14)


def test_published_anisotropic() -> None:
    """Mitsuba 3's test_microfacet.py: Beckmann, (.1, .3), theta = i pi/19 along y, computed in float32."""
    theta = np.arange(7) * np.pi / 19
    h = np.stack([0 * theta, np.sin(theta), np.cos(theta)], axis=1)
    got = call(d_uv("beckmann"), VECTORS["float64"], h, h, np.full(7, 0.1), np.full(7, 0.3))
    want = [10.6103287, 8.22650051, 3.57923722, 0.684863329, 0.0326460004, 1.0196423e-4, 5.87322635e-10]
    np.testing.assert_allclose(got, want, rtol=2e-5)


@names
@vectors
def test_smith(kind: str, name: str, pairs: Any) -> None:
    wi, _, m, p = pairs
    want = np.array([float(textbook.SMITH[name](q.i, mpf(r))) for q, r in zip(p, m, strict=True)])
    got = call(microfacet.DISTRIBUTIONS[name].g1, VECTORS[kind], wi, m)
    assert error(got, want, 1).max() < tolerance(kind, 1e-6, 2e-15)


@names
@pytest.mark.parametrize("kind", WIDE)
def test_smith_of_two_roughnesses(kind: str, name: str, pairs: Any) -> None:
    """Also straight down, where no azimuth is: nothing is masked, and the derivative is 0."""
    wi, _, m, p = pairs
    u, v = m, single(0.3 * m)
    want = [
        float(textbook.SMITH[name](q.i, textbook.roughness_towards(q.i, mpf(a), mpf(b))))
        for q, a, b in zip(p, u, v, strict=True)
    ]
    vector = VECTORS[kind]
    number = dr.value_t(vector)

    def g1(w: Any, a: Any, b: Any) -> Any:
        return microfacet.DISTRIBUTIONS[name].g1(w, microfacet.roughness_of_view(w, a, b))

    assert error(call(g1, vector, wi, u, v), np.array(want), 1).max() < tolerance(kind, 1e-6, 2e-15)
    a, b = dr.opaque(number, 0.2), dr.opaque(number, 0.4)
    dr.enable_grad(a, b)
    down = g1(dr.opaque(vector, (0, 0, 1)), a, b)
    dr.backward(down)
    assert to_numpy(down) == 1 and to_numpy(a.grad) == 0 and to_numpy(b.grad) == 0


def test_ggx_published() -> None:
    """Mitsuba 3's test_microfacet.py: alpha .1, theta = .98 pi/2."""
    theta = 0.98 * np.pi / 2
    w = np.array([[np.sin(theta), 0, np.cos(theta)]])
    assert call(microfacet.ggx_g1, VECTORS["float64"], w, np.array([0.1]))[0] == pytest.approx(0.46130955, rel=1e-6)


def slopes(m: float, steep: float) -> tuple[Any, Any, Any]:
    """Facet normals by quadrature over all slopes, ``t = m x / (1 - x)^steep``; and the solid angle of each."""
    x, wx = np.polynomial.legendre.leggauss(300)
    x, wx = (x + 1) / 2, wx / 2
    tan = m * x / (1 - x) ** steep
    by_x = m * (1 - x) ** (-steep) * (1 + steep * x / (1 - x))
    n = 240
    phi = (np.arange(n) + 0.5) * 2 * np.pi / n
    t, angle = (a.ravel() for a in np.meshgrid(tan, phi, indexing="ij"))
    cos = 1 / np.sqrt(1 + t**2)
    area = np.repeat(wx * by_x, n) * t * cos**3 * 2 * np.pi / n
    return np.array([t * np.cos(angle) * cos, t * np.sin(angle) * cos, cos]), t, area


@pytest.mark.parametrize("two", [(0.1, 0.1), (0.6, 0.6), (0.6, 0.2)])
@names
def test_weak_white_furnace(name: str, two: tuple[float, float]) -> None:
    """``integral D G1 max(v.h, 0) dh = v.n`` for V-cavities whatever the distribution, and for Smith's masking of the
    distribution's own; ``integral D n.h dh = 1``."""
    vector = VECTORS["float64"]
    number = dr.value_t(vector)
    normal, _, area = slopes(max(two), 1.0)
    h = vector(*normal)
    u, v = dr.opaque(number, two[0]), dr.opaque(number, two[1])
    d = d_uv(name)(h, h, u, v)
    dr.eval(h, d)
    assert np.sum(to_numpy(d * h.z) * area) == pytest.approx(1, abs=2e-5)
    for mu in (1.0, 0.7, 0.3, 0.1):
        w = dr.opaque(vector, directions.unit(mu, 0.5).tolist())
        seen = dr.maximum(dr.dot(w, h), 0)
        vcavity = dr.minimum(1, 2 * h.z * w.z / dr.select(seen > 0, seen, 1))
        smith = microfacet.DISTRIBUTIONS[name].g1(w, microfacet.roughness_of_view(w, u, v))
        for which, g1 in (("vcavity", vcavity), ("smith", smith)):
            if (name, which) != ("blinn", "smith"):
                assert to_numpy(d * g1 * seen) @ area / mu == pytest.approx(1, abs=1e-4)


@names
@pytest.mark.parametrize("kind", WIDE)
@pytest.mark.parametrize("m", [1e-3, 0.1, 1.0])
def test_tangents(kind: str, m: float, name: str) -> None:
    """The closed-form inverse of the cumulative distribution, from the first normals to the last."""
    number = dr.value_t(VECTORS[kind])
    u = single(
        np.concatenate([(np.arange(512) + 0.5) / 512, 2.0 ** -np.arange(12.0, 25), 1 - 2.0 ** -np.arange(10, 24)])
    )
    got = to_numpy(microfacet.DISTRIBUTIONS[name].tangent(number(u), number(m)))
    r = float(np.float32(m)) if kind == "float32" else m
    want = {
        "beckmann": lambda x: r * mpmath.sqrt(-mpmath.log1p(-x)),
        "ggx": lambda x: r * mpmath.sqrt(x / (1 - x)),
        "blinn": lambda x: mpmath.tan(mpmath.acos((1 - x) ** (mpf(r) ** 2 / 2))),
    }[name]
    np.testing.assert_allclose(got, [float(want(mpf(x))) for x in u], rtol=12 * EPS[kind])


def test_azimuth() -> None:
    """Evenly spaced `u` fall on azimuths with density ``m^2 / (2 pi m_u m_v)``."""
    number = dr.value_t(VECTORS["float64"])
    u = np.linspace(0, 1, 4001)[:-1]
    c, s, m = (to_numpy(a) for a in microfacet.azimuth(number(u), number(0.2), number(0.6)))
    np.testing.assert_allclose(c * c + s * s, 1, rtol=1e-14)
    phi = np.unwrap(np.arctan2(s, c))
    density = (u[2:] - u[:-2]) / (phi[2:] - phi[:-2])
    np.testing.assert_allclose(density, (m**2 / (2 * np.pi * 0.2 * 0.6))[1:-1], rtol=1e-4)
    np.testing.assert_allclose(1 / m**2, (c / 0.2) ** 2 + (s / 0.6) ** 2, rtol=1e-13)


@pytest.mark.parametrize("kind", WIDE)
@pytest.mark.parametrize("cos", [1.0, 0.5, 1e-2, 1e-5])
@pytest.mark.parametrize("two", [(1e-4, 1e-4), (0.3, 0.05), (1.0, 1.0)])
def test_ggx_visible(kind: str, cos: float, two: tuple[float, float]) -> None:
    """Finite, of unit length, never facing away; their mean is that of the density ``D G1 (w.h) / w.n``."""
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    n = 1 << 17
    u = vector(*np.random.default_rng(5).random((3, n)))
    w = dr.opaque(vector, single(directions.unit(cos, 0.6)).tolist())
    h = to_numpy(microfacet.ggx_visible(u, w, dr.opaque(number, two[0]), dr.opaque(number, two[1])))
    assert np.isfinite(h).all()
    np.testing.assert_allclose(np.linalg.norm(h, axis=0), 1, atol=8 * EPS[kind])
    assert (h[2] > 0).all()
    assert (to_numpy(w).ravel() @ h >= -8 * EPS[kind]).all()
    if cos < 0.5 or two[0] < 0.1:
        return  # too sharp for the quadrature below
    normal, _, area = slopes(max(two), 1.0)
    one = [normal.T, normal.T, np.full(len(area), two[0]), np.full(len(area), two[1])]
    seen = np.maximum(to_numpy(w).ravel() @ normal, 0)
    density = call(d_uv("ggx"), VECTORS["float64"], *one) * seen
    mean = (normal * density * area).sum(axis=1) / (density * area).sum()
    spread = h.std(axis=1)
    assert (np.abs(h.mean(axis=1) - mean) < 4.5 * spread / np.sqrt(n) + 1e-4).all()


def test_expm1() -> None:
    x = single(np.concatenate([10.0 ** np.arange(-12, 2.0), -(10.0 ** np.arange(-12, 2.0)), [0.0]]))
    for kind in VECTORS:
        got, want = call(expm1, VECTORS[kind], x), np.expm1(x)
        assert (np.abs(got - want) <= 8 * EPS[precision(kind)] * np.abs(want)).all()
    v = dr.value_t(VECTORS["float64"])(x)
    dr.enable_grad(v)
    dr.backward(dr.sum(expm1(v)))
    np.testing.assert_allclose(to_numpy(v.grad), np.exp(x), rtol=1e-15)


COSINES = (1.0, 1 - 1e-6, 0.999, 0.9, 0.5, 0.3, 0.1, 0.02, 1e-3, 1e-5, 1e-7)
ETA = (1e-3, 0.04, 0.2, 0.521, 0.99, 1.0, 1.01, 1.657, 4.0, 20.0)
K = (0.0, 1e-3, 0.1, 1.0, 3.0, 9.0, 20.0)


def metals() -> tuple[Any, Any, Any, Any]:
    """Cosine, squared sine (rounded only in float32), and indices, not within 1e-3 of where a lossless one is critical."""
    rows = [(c, n, k) for c in COSINES for n in ETA for k in K]
    c, eta, k = (single(a) for a in np.array(rows).T)
    critical = np.sqrt(np.maximum(1 - eta**2, 0))
    away = (k > 0) | (np.abs(c - critical) > 1e-3 * critical)
    c, eta, k = c[away], eta[away], k[away]
    return c, np.array([float(1 - mpf(x) ** 2) for x in c]), eta, k


@vectors
def test_conductor(kind: str) -> None:
    c, s2, eta, k = metals()
    s2 = single(s2) if precision(kind) == "float32" else s2
    exact = zip(c, eta, k, strict=True)
    want = np.array([float(optics.fresnel_conductor(*(mpf(x) for x in row))) for row in exact])
    got = call(fresnel.fresnel_conductor, VECTORS[kind], c, s2, eta, k)
    # eta = 1, k = 0 reflects nothing: c^2 and s2 as given do not add up to 1 to the last bit
    assert (np.abs(got - want) <= tolerance(kind, 1.5e-6, 3e-15) * want + 1e-30).all()
    assert (got >= 0).all() and (got <= 1).all()


@pytest.mark.parametrize("kind", WIDE)
def test_conductor_gradient(kind: str) -> None:
    """In eta and k, to roundings of the derivative and of F, or 1 - F, over eta or k: down to grazing, where F is nearly 1
    and hardly changes. Finite also where a lossless one is critical."""
    c, s2, eta, k = metals()
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    at = number(eta), number(k)
    dr.enable_grad(*at)
    dr.backward(dr.sum(fresnel.fresnel_conductor(number(c), number(s2), *at)))
    rows = [tuple(mpf(x) for x in row) for row in zip(c, eta, k, strict=True)]
    by_eta = [mpmath.diff(lambda x, r=r: optics.fresnel_conductor(r[0], x, r[2]), r[1]) for r in rows]
    by_k = [  # from above at k = 0
        mpmath.diff(lambda x, r=r: optics.fresnel_conductor(r[0], r[1], x), r[2], direction=0 if r[2] else 1)
        for r in rows
    ]
    absorbed = np.array([float(1 - optics.fresnel_conductor(*r)) for r in rows])
    for got, want, x in ((at[0].grad, by_eta, eta), (at[1].grad, by_k, k)):
        scale = np.abs(np.array(want, dtype=float)) + np.minimum(absorbed, 1 - absorbed) / np.maximum(x, 1e-3)
        off = np.abs(to_numpy(got) - np.array(want, dtype=float)) / np.maximum(scale, 1e-20)
        assert off.max() < 32 * EPS[kind]
    for k0 in (0.0, 1e-20):
        given = dr.opaque(number, 0.6), dr.opaque(number, k0)
        dr.enable_grad(*given)
        f = fresnel.fresnel_conductor(dr.opaque(number, 0.8), dr.detach(given[0] * given[0]), *given)
        dr.backward(f)
        assert all(np.isfinite(to_numpy(x)).all() for x in (f, given[0].grad, given[1].grad))


def test_conductor_without_loss_is_a_dielectric() -> None:
    c, s2, eta, _ = metals()
    vector = VECTORS["float64"]
    a = call(fresnel.fresnel_conductor, vector, c, s2, eta, np.zeros_like(c))
    b = call(fresnel.fresnel_dielectric, vector, c, s2, eta)
    np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-30)
