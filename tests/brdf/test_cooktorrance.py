"""Cook-Torrance: value, gradient, density and sampling against the textbook in 60 digits."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import Values, defaults, evaluate
from brdf.models.cooktorrance import CookTorrance
from tests.brdf.arrays import EPS, VECTORS, call, error, precision, single, to_numpy
from tests.oracles import directions, textbook

Pair = textbook.Pair

ROUGHNESS = (1e-3, 0.01, 0.1, 0.3, 0.5, 1.0, 1.5)
INDICES = (1.01, 1.333, 1.5, 2.419, 10.0)
FRESNEL = ("exact", "schlick", "constant")
MASKING = ("vcavity", "smith", "none")
WIDE = ("float32", "float64")

choices = pytest.mark.parametrize(("fresnel", "masking"), [(f, g) for f in FRESNEL for g in MASKING])


class Oracle:
    """D, G, F and their derivatives for each pair, once; a model is a product of three."""

    def __init__(self) -> None:
        wi, wo, m = (single(a) for a in directions.grid(ROUGHNESS))
        self.wi, self.wo, self.m = wi, wo, m
        self.eta = single([INDICES[i % len(INDICES)] for i in range(len(m))])
        self.pairs = [Pair(i, o) for i, o in zip(wi, wo, strict=True)]
        self.d = self.both(lambda p, x: textbook.beckmann_d(p.nh, x), m)
        self.peak = np.array([textbook.beckmann_peak(p.nh, mpf(x)) for p, x in zip(self.pairs, m, strict=True)])
        self.g = {name: self.both(function, m) for name, function in textbook.MASKING.items()}
        self.f = {name: self.both(lambda p, x, f=f: f(p.vh, x), self.eta) for name, f in textbook.FRESNEL.items()}
        self.cosines = np.array([4 * p.ni * p.no for p in self.pairs])

    def both(self, function: Any, at: Any) -> tuple[Any, Any]:
        """Value and derivative, as object arrays of mpmath numbers."""
        value = [function(p, mpf(x)) for p, x in zip(self.pairs, at, strict=True)]
        slope = [mpmath.diff(lambda y, p=p: function(p, y), mpf(x)) for p, x in zip(self.pairs, at, strict=True)]
        return np.array(value), np.array(slope)


@pytest.fixture(scope="module")
def oracle() -> Oracle:
    return Oracle()


def specular(model: CookTorrance) -> Any:
    """The specular lobe alone, of white tint, as a function of directions, m and eta."""
    return lambda wi, wo, m, eta: model.f(values(wi, m=m, eta=eta), wi, wo)[1].x


def values(like: Any, m: Any, eta: Any = 1.5, diffuse: float = 0.0) -> Values:
    colour = type(like)
    return Values(m=m, eta=eta, diffuse_reflectance=colour(diffuse), specular_reflectance=colour(1))


@choices
@pytest.mark.parametrize("kind", VECTORS)
def test_value(kind: str, fresnel: str, masking: str, oracle: Oracle) -> None:
    o = oracle
    rest = o.g[masking][0] * o.f[fresnel][0] / o.cosines
    want, peak = (o.d[0] * rest).astype(float), (o.peak * rest).astype(float)
    got = call(specular(CookTorrance(fresnel=fresnel, masking=masking)), VECTORS[kind], o.wi, o.wo, o.m, o.eta)
    assert error(got, want, peak).max() < (5e-6 if precision(kind) == "float32" else 1e-14)


@choices
@pytest.mark.parametrize("kind", WIDE)
def test_gradient(kind: str, fresnel: str, masking: str, oracle: Oracle) -> None:
    o = oracle
    model = CookTorrance(fresnel=fresnel, masking=masking)
    (d, d_m), (g, g_m), (f, f_eta) = o.d, o.g[masking], o.f[fresnel]
    want = {"m": (d_m * g + d * g_m) * f / o.cosines, "eta": d * g * f_eta / o.cosines}
    peak = o.peak * g * f / o.cosines
    scale = {"m": 2 * peak / o.m, "eta": peak / o.eta}
    limit = {"m": 2e-5 if kind == "float32" else 4e-14, "eta": 1e-5 if kind == "float32" else 2e-14}
    for name in ("m", "eta") if fresnel != "constant" else ("m",):
        got = slopes(specular(model), kind, name, o.wi, o.wo, o.m, o.eta)
        off = error(got, want[name].astype(float), scale[name].astype(float))
        # d/dm changes sign where tan^2 = m^2, so its relative error has no bound: 99 in 100 points, and all to 100 times.
        assert np.quantile(off, 0.99) < limit[name]
        assert off.max() < 100 * limit[name]


def slopes(function: Any, kind: str, name: str, wi: Any, wo: Any, m: Any, eta: Any) -> Any:
    """Derivative by reverse-mode differentiation, each point on its own."""
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    p = {"m": number(m), "eta": number(eta)}
    dr.enable_grad(p[name])
    dr.backward(dr.sum(function(vector(*wi.T), vector(*wo.T), p["m"], p["eta"])))
    return to_numpy(p[name].grad)


@pytest.mark.parametrize("fresnel", ["exact", "schlick"])
@pytest.mark.parametrize("masking", MASKING)
@pytest.mark.parametrize("name", ["m", "eta"])
def test_gradient_is_the_central_difference(name: str, masking: str, fresnel: str) -> None:
    """In float64, of the whole model: the difference quotient is good to (step)^2 and to rounding over step."""
    wi, wo, m = directions.grid((0.1, 0.3, 1.0), seed=3)
    eta = np.full_like(m, 1.7)
    function = specular(CookTorrance(fresnel=fresnel, masking=masking))
    step = 1e-6
    low, high = {"m": m, "eta": eta}, {"m": m, "eta": eta}
    low, high = {**low, name: low[name] * (1 - step)}, {**high, name: high[name] * (1 + step)}
    quotient = call(function, VECTORS["float64"], wi, wo, high["m"], high["eta"])
    quotient = quotient - call(function, VECTORS["float64"], wi, wo, low["m"], low["eta"])
    quotient /= high[name] - low[name]
    value = call(function, VECTORS["float64"], wi, wo, m, eta)
    got = slopes(function, "float64", name, wi, wo, m, eta)
    assert (np.abs(got - quotient) <= 2e-6 * (np.abs(quotient) + value / low[name])).all()


def test_bricks_are_chosen() -> None:
    """Nine models that differ."""
    w = np.array([[0.96, 0.0, 0.28]])
    v = np.array([[0.48, 0.64, 0.6]])
    seen = {
        round(
            float(
                call(
                    specular(CookTorrance(fresnel=f, masking=g)), VECTORS["float64"], w, v, np.ones(1), np.full(1, 1.5)
                )[0]
            ),
            9,
        )
        for f in FRESNEL
        for g in MASKING
    }
    assert len(seen) == 9


@choices
@pytest.mark.parametrize("kind", VECTORS)
def test_reciprocal_bit_for_bit(kind: str, fresnel: str, masking: str, oracle: Oracle) -> None:
    model = CookTorrance(fresnel=fresnel, masking=masking)

    def f(wi: Any, wo: Any, m: Any, eta: Any) -> Any:
        return evaluate(model, values(wi, m, eta, diffuse=0.3), wi, wo).x

    o = oracle
    there, back = (call(f, VECTORS[kind], *pair, o.m, o.eta) for pair in ((o.wi, o.wo), (o.wo, o.wi)))
    assert (there > 0).all()
    assert (there == back).all()


@pytest.mark.parametrize("masking", MASKING)
@pytest.mark.parametrize("kind", WIDE)
def test_nothing_below_the_horizon(kind: str, masking: str) -> None:
    """Exactly 0, in value and gradient, where either direction is at or below it."""
    n = 200
    wi, wo = directions.hemisphere(n, 1), directions.hemisphere(n, 2)
    wi[:50, 2] *= -1
    wo[50:100, 2] *= -1
    wi[100:150, 2] *= -1
    wo[100:150, 2] *= -1
    wi[150:170, 2] = 0
    wo[170:, 2] = 0
    model = CookTorrance(masking=masking)
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    i, o = vector(*wi.T), vector(*wo.T)
    p = values(i, number(np.full(n, 0.2)), number(np.full(n, 1.5)), diffuse=0.5)
    dr.enable_grad(p.m, p.eta, p.diffuse_reflectance, p.specular_reflectance, i, o)
    f = evaluate(model, p, i, o)
    assert (to_numpy(f) == 0).all()
    dr.backward(dr.sum(f, axis=None))
    for given in (p.m, p.eta, p.diffuse_reflectance, p.specular_reflectance, i, o):
        assert (to_numpy(dr.grad(given)) == 0).all()


@choices
@pytest.mark.parametrize("kind", WIDE)
def test_finite_everywhere(kind: str, fresnel: str, masking: str) -> None:
    """Value, density and gradients at hostile inputs: every roughness and index allowed, cosines down to 1e-12, directions
    equal, opposite, at the mirror direction and a little off it."""
    m0, eta0 = (next(p.bounds for p in CookTorrance.params if p.name == name) for name in ("m", "eta"))
    cosines = [1.0, 1 - 1e-7, 0.999, 0.5, 1e-2, 1e-4, 1e-7, 1e-12]
    rows = [
        (directions.unit(a, 0.3), directions.unit(b, 0.3 + turn), m, eta)
        for a in cosines
        for b in cosines
        for turn in (0, 1e-6, np.pi / 2, np.pi - 1e-6, np.pi)
        for m in (m0[0], 1e-3, 0.1, m0[1])
        for eta in (eta0[0], 1.000277, 1.5, eta0[1])
    ]
    wi, wo, m, eta = (np.array(a) for a in zip(*rows, strict=True))
    model = CookTorrance(fresnel=fresnel, masking=masking)
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    i, o = vector(*wi.T), vector(*wo.T)
    p = values(i, number(m), number(eta), diffuse=0.5)
    dr.enable_grad(p.m, p.eta)
    f = evaluate(model, p, i, o)
    density = model.pdf(p, i, o)[1]
    assert np.isfinite(to_numpy(f)).all()
    assert np.isfinite(to_numpy(density)).all()
    for given in (p.m, p.eta) if fresnel != "constant" else (p.m,):
        dr.forward(given, flags=dr.ADFlag.ClearVertices)
        assert np.isfinite(to_numpy(f.x.grad)).all()
        dr.clear_grad(f)
    dr.backward(dr.sum(f.x))
    assert np.isfinite(to_numpy(p.m.grad)).all()
    assert np.isfinite(to_numpy(p.eta.grad)).all()


@pytest.mark.parametrize("kind", VECTORS)
def test_density(kind: str, oracle: Oracle) -> None:
    o = oracle
    model = CookTorrance()
    want = np.array([float(textbook.cooktorrance_pdf(p, mpf(x))) for p, x in zip(o.pairs, o.m, strict=True)])
    peaks = [textbook.cooktorrance_pdf(p, mpf(x), textbook.beckmann_peak) for p, x in zip(o.pairs, o.m, strict=True)]
    peak = np.array(peaks, dtype=float)
    got = call(lambda i, w, m: model.pdf(values(i, m), i, w)[1], VECTORS[kind], o.wi, o.wo, o.m)
    assert error(got, want, peak).max() < (5e-6 if precision(kind) == "float32" else 1e-14)
    got = call(lambda i, w, m: model.pdf(values(i, m), i, w)[0], VECTORS[kind], o.wi, o.wo, o.m)
    np.testing.assert_allclose(got, o.wo[:, 2] / np.pi, rtol=4 * EPS[precision(kind)])


@pytest.mark.parametrize("kind", WIDE)
@pytest.mark.parametrize("m", [1e-4, 0.02, 0.3, 1.5])
@pytest.mark.parametrize("cos", [1.0, 0.7, 0.1, 1e-3])
def test_sampled_weight_is_at_most_one(kind: str, m: float, cos: float) -> None:
    """Unit directions, a positive density, and ``f cos / pdf = F G / G1 <= 1`` for V-cavities."""
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    model = CookTorrance(fresnel="constant")
    n = 1 << 16
    u = vector(*np.random.default_rng(9).random((3, n)))
    wi = vector(*directions.unit(cos, 1.0).tolist())
    p = values(wi, number(m))
    wo = model.sample(p, wi, u, 1)
    length = np.linalg.norm(to_numpy(wo), axis=0)
    np.testing.assert_allclose(length, 1, atol=8 * EPS[kind])
    up = to_numpy(wo)[2] > 0
    f, density = to_numpy(evaluate(model, p, wi, wo).x), to_numpy(model.pdf(p, wi, wo)[1])
    assert np.isfinite(f).all()
    assert (density[up] > 0).mean() > 0.9999
    good = up & (density > 0)
    weight = f[good] * to_numpy(wo)[2][good] / density[good]
    assert weight.max() <= 1 + 32 * EPS[kind]


@pytest.mark.parametrize(
    ("masking", "m", "table"),
    [
        ("vcavity", 0.1, [1.0000, 1.0000, 0.9807, 0.9342]),
        ("vcavity", 0.3, [0.9956, 0.9555, 0.9220, 0.9661]),
        ("vcavity", 0.6, [0.7976, 0.8278, 0.9229, 0.9742]),
        ("smith", 0.1, [1.0000, 1.0000, 0.9864, 0.9123]),
        ("smith", 0.3, [0.9997, 0.9658, 0.9002, 0.9314]),
        ("smith", 0.6, [0.8559, 0.8333, 0.8884, 0.9341]),
    ],
)
@pytest.mark.parametrize("kind", WIDE)
def test_directional_albedo(kind: str, masking: str, m: float, table: list[float]) -> None:
    """F = 1, mu = 1, .7, .3, .1: published with 4 digits; here by quadrature over the half vector's slopes."""
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    model = CookTorrance(fresnel="constant", masking=masking)
    radius, angle = (np.arange(800) + 0.5) * 6 * m / 800, (np.arange(240) + 0.5) * 2 * np.pi / 240
    tan, phi = (a.ravel() for a in np.meshgrid(radius, angle, indexing="ij"))
    cos = 1 / np.sqrt(1 + tan**2)
    h = np.array([tan * np.cos(phi) * cos, tan * np.sin(phi) * cos, cos])
    area = tan * cos**3 * (6 * m / 800) * (2 * np.pi / 240)
    for mu, want in zip((1.0, 0.7, 0.3, 0.1), table, strict=True):
        wi = directions.unit(mu, 0.0)
        wh = wi @ h
        wo = 2 * wh * h - wi[:, None]
        i, o = vector(*wi.tolist()), vector(*wo)
        f = to_numpy(evaluate(model, values(i, number(m)), i, o).x)
        albedo = np.sum((f * wo[2] * 4 * wh * area)[(wh > 0) & (wo[2] > 0)])
        assert albedo == pytest.approx(want, abs=6e-5)


def test_diffuse_base_and_tint() -> None:
    """Lobes add up; each is proportional to its reflectance, channel by channel."""
    vector = VECTORS["float64"]
    model = CookTorrance()
    wi, wo = vector(0.6, 0, 0.8), vector(0, -0.6, 0.8)
    p = defaults(model, vector, diffuse_reflectance=(0.1, 0.2, 0.4), specular_reflectance=(1.0, 0.5, 0.25))
    diffuse, glossy = (to_numpy(lobe).ravel() for lobe in model.f(p, wi, wo))
    np.testing.assert_allclose(diffuse, np.array([0.1, 0.2, 0.4]) / np.pi, rtol=1e-15)
    np.testing.assert_allclose(glossy / glossy[0], [1.0, 0.5, 0.25], rtol=1e-15)
    np.testing.assert_array_equal(to_numpy(evaluate(model, p, wi, wo)).ravel(), diffuse + glossy)
