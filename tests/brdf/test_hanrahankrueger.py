"""Hanrahan and Krueger's layer: value, gradient, reciprocity, energy and sampling, against an integral over depth and the
closed form in 60 digits."""

from __future__ import annotations

from functools import partial
from typing import Any

import drjit as dr
import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import Model, Values, defaults, evaluate
from brdf.models.hanrahankrueger import HanrahanKrueger
from tests.brdf.arrays import EPS, VECTORS, Array, call, precision, single, to_numpy
from tests.brdf.slopes import quotient
from tests.oracles import directions, layer

MODEL = HanrahanKrueger()
NAMES = ("sigma_s", "sigma_a", "thickness", "g", "eta")
REFLECTED, TRANSMITTED, STRAIGHT = 0, 1, 2
WIDE = ("float32", "float64")
COSINES = (1.0, 0.999, 0.9, 0.5, 0.1, 0.01, 1e-4)
#: What an exponential leaves below this is rounded to 0 in float32.
DARK = 1e-30

wide = pytest.mark.parametrize("kind", WIDE)
vectors = pytest.mark.parametrize("kind", VECTORS)


def values(like: Any, *numbers: Any) -> Values:
    """Parameters in the order of `NAMES`, the coefficients grey. Opaque: one kernel serves all numbers."""
    colour = like if isinstance(like, type) else type(like)
    if dr.is_jit_v(colour):
        numbers = tuple(dr.opaque(dr.value_t(colour), x) if isinstance(x, int | float) else x for x in numbers)
    p = Values(**dict(zip(NAMES, numbers, strict=True)))
    p.sigma_s, p.sigma_a = colour(p.sigma_s), colour(p.sigma_a)
    return p


def f(wi: Any, wo: Any, *numbers: Any) -> Any:
    return evaluate(MODEL, values(wi, *numbers), wi, wo).x


def seen(vector: Any, mu: float, azimuth: float = 0.0, above: int = 1) -> Any:
    """One direction, opaque."""
    w = vector(*(directions.unit(mu, azimuth) * [1, 1, above]).tolist())
    dr.make_opaque(w)
    return w


def passes(wi: Any, *numbers: Any) -> Any:
    """The weight of what goes straight on."""
    return MODEL.ideal(values(wi, *numbers), wi, STRAIGHT).weight.x


class Oracle:
    """Pairs of directions on the same side and on opposite ones, from above and below, some of equal cosines, parameters
    over decades with their ends, and the closed form with its derivatives."""

    def __init__(self, kind: str) -> None:
        rng = np.random.default_rng(1)
        rows = []
        for a in COSINES:
            for b in COSINES:
                for side in (1, -1):
                    above = rng.choice([1, -1])
                    azimuth = rng.choice([0.0, 1e-3, 1.0, np.pi, rng.uniform(0, 6)])
                    wi = directions.unit(a, 0.3) * [1, 1, above]
                    wo = directions.unit(b, 0.3 + azimuth) * [1, 1, above * side]
                    sigma_a = rng.choice([0.0, 10 ** rng.uniform(-3, 2)])
                    g, eta = rng.choice([-0.9, -0.3, 0.0, 0.3, 0.9]), rng.choice([1.0, 1.01, 1.333, 1.5, 3.0])
                    rows.append((*wi, *wo, 10 ** rng.uniform(-3, 2), sigma_a, 10 ** rng.uniform(-3, 1), g, eta))
        table = np.array(rows)
        table[:, 6:] = single(table[:, 6:])
        if kind == "float32":  # what is not of unit length to its own rounding has no angle
            table = single(table)
        self.wi, self.wo, self.p = table[:, :3], table[:, 3:6], table[:, 6:].T
        self.value, self.slopes = self.of(lambda i: partial(layer.scattered, self.wi[i], self.wo[i]))
        sigma_s, sigma_a, thickness, g, eta = self.p
        steep = np.maximum(*(np.sqrt(1 - (1 - w[:, 2] ** 2) / eta**2) for w in (self.wi, self.wo)))
        #: Relative change of the value for relative changes of the inputs, at most: by the exponent and by the phase.
        crossing = self.wi[:, 2] * self.wo[:, 2] < 0
        self.condition = 1 + crossing * (sigma_s + sigma_a) * thickness / steep + np.sqrt(abs(g)) / (1 - abs(g))
        self.lit = self.value > DARK

    def of(self, function: Any) -> tuple[Array, dict[str, Array]]:
        """Values and derivatives; of a parameter at its end by differences to the inside."""
        value, slopes = [], {name: [] for name in NAMES}
        for i, p in enumerate(self.p.T):
            exact = [mpf(x) for x in p]
            value.append(function(i)(*exact))
            for k, name in enumerate(NAMES):

                def one(x: Any, k: int = k, exact: Any = exact, i: int = i) -> Any:
                    return function(i)(*exact[:k], x, *exact[k + 1 :])

                at_end = (name, exact[k]) in (("sigma_a", 0), ("eta", 1))
                slopes[name].append(mpmath.diff(one, exact[k], direction=1 if at_end else 0))
        return np.array(value, dtype=float), {k: np.array(v, dtype=float) for k, v in slopes.items()}


@pytest.fixture(scope="module", params=WIDE)
def oracle(request: Any) -> tuple[str, Oracle]:
    return request.param, Oracle(request.param)


def test_value(oracle: tuple[str, Oracle]) -> None:
    precise, o = oracle
    for kind in VECTORS:
        if precision(kind) == precise:
            got = call(f, VECTORS[kind], o.wi, o.wo, *o.p)
            off = np.abs(got - o.value) / (o.value * o.condition)
            assert off[o.lit].max() < 8 * EPS[precise]
            assert (got[~o.lit] < 2 * DARK).all() and (~o.lit).any()


def test_gradient(oracle: tuple[str, Oracle]) -> None:
    """By each parameter, relative to the derivative and to value over parameter."""
    kind, o = oracle
    vector = VECTORS[kind]
    p = [dr.value_t(vector)(x) for x in o.p]
    for x in p:
        dr.enable_grad(x)
    dr.backward(dr.sum(f(vector(*o.wi.T), vector(*o.wo.T), *p)))
    for name, x, at in zip(NAMES, p, o.p, strict=True):
        scale = np.abs(o.slopes[name]) + o.value / np.where(at == 0, 1, np.abs(at))
        off = np.abs(to_numpy(x.grad) - o.slopes[name]) / (scale * o.condition)
        assert off[o.lit].max() < 8 * EPS[kind], name


def test_reciprocal_bit_for_bit(oracle: tuple[str, Oracle]) -> None:
    precise, o = oracle
    for kind in VECTORS:
        if precision(kind) == precise:
            there, back = (call(f, VECTORS[kind], *pair, *o.p) for pair in ((o.wi, o.wo), (o.wo, o.wi)))
            np.testing.assert_array_equal(there, back)


def test_straight(oracle: tuple[str, Oracle]) -> None:
    """Value and derivatives of what passes; it goes on where it came from."""
    kind, o = oracle
    vector = VECTORS[kind]
    want, slopes = o.of(
        lambda i: (
            lambda sigma_s, sigma_a, thickness, g, eta: layer.unscattered(o.wi[i], sigma_s, sigma_a, thickness, eta)
        )
    )
    got = call(passes, vector, o.wi, *o.p)
    sigma_s, sigma_a, thickness, _, eta = o.p
    condition = 1 + (sigma_s + sigma_a) * thickness / np.sqrt(1 - (1 - o.wi[:, 2] ** 2) / eta**2)
    lit = want > DARK
    assert ((np.abs(got - want) / condition)[lit] / want[lit]).max() < 8 * EPS[kind]
    i = vector(*o.wi.T)
    p = [dr.value_t(vector)(x) for x in o.p]
    for x in p:
        dr.enable_grad(x)
    dr.backward(dr.sum(passes(i, *p)))
    for name, x, at in zip(NAMES, p, o.p, strict=True):
        scale = np.abs(slopes[name]) + want / np.where(at == 0, 1, np.abs(at))
        off = (np.abs(to_numpy(x.grad) - slopes[name]) / condition)[lit] / scale[lit]
        assert off.max() < 8 * EPS[kind], name
    wo = MODEL.ideal(values(i, *p), i, STRAIGHT).wo
    np.testing.assert_array_equal(to_numpy(wo), -to_numpy(i))


def test_integral_over_depth() -> None:
    """What is scattered at each depth, added up: no closed form."""
    o = Oracle("float64")
    some = np.flatnonzero(o.lit)[::4]
    want = [float(layer.scattered_over_depth(o.wi[i], o.wo[i], *(mpf(x) for x in o.p[:, i]))) for i in some]
    got = call(f, VECTORS["float64"], o.wi[some], o.wo[some], *o.p[:, some])
    np.testing.assert_allclose(got, want, rtol=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_gradient_is_the_central_difference(name: str) -> None:
    """Of the reflected, the transmitted and the straight light, in float64, at ordinary settings."""
    vector = VECTORS["float64"]
    wi, wo = directions.hemisphere(60, 1), directions.hemisphere(60, 2)
    wi, wo = wi[wi[:, 2] > 0.1], wo[wi[:, 2] > 0.1]
    start: dict[str, float] = dict(zip(NAMES, (0.7, 0.2, 0.9, -0.4, 1.4), strict=True))
    at = np.full(len(wi), start[name])
    for down in (1, -1):
        i, o = vector(*wi.T), vector(*(wo * [1, 1, down]).T)
        for function in (partial(f, i, o), partial(passes, i)) if name != "g" else (partial(f, i, o),):

            def one(x: Any, function: Any = function) -> Any:
                return function(*(x if n == name else start[n] for n in NAMES))

            x = dr.value_t(vector)(at)
            dr.enable_grad(x)
            dr.backward(dr.sum(one(x)))
            want = quotient(one, at) + 0 * at
            np.testing.assert_allclose(to_numpy(x.grad), want, rtol=1e-7, atol=1e-9)


@wide
def test_directional_albedo(kind: str) -> None:
    """Isotropic, infinite, without sides and absorption: ``1/2 (1 - mu log(1 + 1/mu))``, and 4 published digits."""
    for mu, published in zip((1.0, 0.7, 0.3, 0.1), (0.1534, 0.1894, 0.2800, 0.3801), strict=True):
        got = albedo(kind, mu, REFLECTED, sigma_s=1.0, sigma_a=0.0, thickness=1e6, g=0.0, eta=1.0)
        assert got == pytest.approx(0.5 * (1 - mu * np.log1p(1 / mu)), rel=1e-5 if kind == "float32" else 1e-9)
        assert got == pytest.approx(published, abs=6e-5)
        assert albedo(kind, mu, TRANSMITTED, sigma_s=1.0, sigma_a=0.0, thickness=1e6, g=0.0, eta=1.0) == 0


@pytest.mark.parametrize("g", [0.0, 0.6])
@pytest.mark.parametrize("thickness", [1e-3, 1.0, 1e6])
@pytest.mark.parametrize("eta", [1.0, 1.5])
def test_no_more_than_arrives(eta: float, thickness: float, g: float) -> None:
    """Reflected, transmitted and straight light together; without sides and absorption a thin layer loses next to none."""
    p = {"sigma_s": 1.0, "sigma_a": 0.0, "thickness": thickness, "g": g, "eta": eta}
    vector = VECTORS["float64"]
    for mu in (1.0, 0.5, 0.05):
        scattered = [albedo("float64", mu, lobe, **p) for lobe in (REFLECTED, TRANSMITTED)]
        straight = to_numpy(passes(seen(vector, mu), *p.values())).item()
        assert sum(scattered) + straight < 1
        if eta == 1 and thickness == 1e-3 and mu == 1:
            # What is scattered again: 1 - exp(-tau / mu) of the light is scattered once, .6 % of that once more.
            assert sum(scattered) + straight == pytest.approx(1, abs=1e-5)


def albedo(kind: str, mu: float, lobe: int, **p: float) -> float:
    """By Gauss-Legendre in the square root of the cosine, and equal steps in azimuth."""
    vector = VECTORS[kind]
    x, w = np.polynomial.legendre.leggauss(150)
    root, weight = (x + 1) / 2, w / 2
    phi = (np.arange(128) + 0.5) * 2 * np.pi / 128
    cos, angle = (a.ravel() for a in np.meshgrid(root**2, phi, indexing="ij"))
    area = np.repeat(2 * root * weight, 128) * 2 * np.pi / 128
    sin = np.sqrt((1 - cos) * (1 + cos))
    side = -1 if lobe == TRANSMITTED else 1
    i, o = seen(vector, mu), vector(sin * np.cos(angle), sin * np.sin(angle), side * cos)
    return float(np.sum(to_numpy(f(i, o, *p.values())) * cos * area))


@pytest.mark.parametrize("g", [-0.95, -0.4, 0.0, 0.5, 0.9])
@pytest.mark.parametrize("eta", [1.0, 1.5])
@pytest.mark.parametrize("lobe", [REFLECTED, TRANSMITTED])
def test_sampling(lobe: int, eta: float, g: float) -> None:
    """The mean weight is that of cosine sampling, and no weight is much larger; directions of unit length, on their side."""
    vector = VECTORS["float64"]
    n = 1 << 14
    u = vector(*np.random.default_rng(3).random((3, n)))
    p = values(vector, 1.0, 0.1, 0.5, g, eta)
    for mu, above in ((1.0, 1), (0.5, -1)):
        wi = seen(vector, mu, 0.4, above)
        wo = MODEL.sample(p, wi, u, lobe)
        w = to_numpy(wo)
        np.testing.assert_allclose(np.linalg.norm(w, axis=0), 1, rtol=1e-14)
        assert (np.sign(w[2]) == above * (1 if lobe == REFLECTED else -1)).all()
        weight = to_numpy(evaluate(MODEL, p, wi, wo).x * abs(wo.z) / MODEL.pdf(p, wi, wo)[lobe])
        weak = g > 0 if lobe == REFLECTED else g < 0  # little light, which grows towards grazing
        assert weight.max() < (64 if weak else 8) * weight.mean()
        q = vector(*np.random.default_rng(4).random((3, 16 * n)))
        cosine = Model.sample(MODEL, p, wi, q, lobe)
        want = to_numpy(evaluate(MODEL, p, wi, cosine).x) * np.pi
        error = np.hypot(weight.std() / np.sqrt(n), want.std() / np.sqrt(16 * n))
        assert abs(weight.mean() - want.mean()) < 4.5 * error


@pytest.mark.parametrize(("mu", "eta", "lobe"), [(0.5, 1.5, TRANSMITTED), (1e-3, 1.0, REFLECTED)])
def test_a_peak_is_sampled_better_than_by_the_cosine(mu: float, eta: float, lobe: int) -> None:
    """g = .95, seen at 60 degrees through sides of 1.5; and from grazing, where it reaches over to the side of `wi`."""
    vector = VECTORS["float64"]
    u = vector(*np.random.default_rng(3).random((3, 1 << 16)))
    p = values(vector, 1.0, 0.1, 1.0, 0.95, eta)
    wi = seen(vector, mu)
    spread = []
    for wo, density in (
        (MODEL.sample(p, wi, u, lobe), lambda w: MODEL.pdf(p, wi, w)[lobe]),
        (Model.sample(MODEL, p, wi, u, lobe), lambda w: abs(w.z) / np.pi),
    ):
        weight = to_numpy(f(wi, wo, 1.0, 0.1, 1.0, 0.95, eta) * abs(wo.z) / density(wo))
        spread.append(weight.std() / weight.mean())
    assert spread[0] < spread[1] / 10


@wide
def test_finite_everywhere(kind: str) -> None:
    """Value, density, chance and every derivative, at the ends of every parameter and hostile pairs of directions."""
    bounds = {p.name: p.bounds for p in MODEL.params}
    cosines = (1.0, 1 - 1e-7, 0.5, 1e-4, 1e-7, 1e-12)
    pairs = [
        (directions.unit(a, 0.3), directions.unit(b, 0.3 + c) * [1, 1, side])
        for a in cosines
        for b in cosines
        for c in (0.0, 1e-9, 1.0, np.pi)
        for side in (1, -1)
    ]
    ends = np.array(np.meshgrid(*(bounds[name] for name in NAMES))).reshape(5, -1).T
    ends = np.concatenate([ends, [[1.0, 0.1, 1.0, 0.0, 1.5], [1.0, 0.1, 1.0, 0.5, 1.0]]])
    wi, wo = (np.repeat(np.array(w), len(ends), axis=0) for w in zip(*pairs, strict=True))
    p = np.tile(ends, (len(pairs), 1)).T
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    i, o = vector(*wi.T), vector(*wo.T)
    x = [number(a) for a in p]
    dr.enable_grad(x, i, o)
    made = values(i, *x)
    everything = f(i, o, *x) + passes(i, *x)
    assert (to_numpy(everything) >= 0).all()
    dr.backward(dr.sum(everything))
    for given in (everything, *MODEL.pdf(made, i, o)[:2], *MODEL.choose(made, i), *(dr.grad(a) for a in (*x, i, o))):
        assert np.isfinite(to_numpy(given)).all()


@vectors
def test_seen_from_below(kind: str) -> None:
    """Both sides are alike, bit for bit; nothing in the surface."""
    vector = VECTORS[kind]
    i, o = vector(0.6, 0, 0.8), vector(0, 0.28, 0.96)
    p = defaults(MODEL, vector, sigma_s=(0.5, 1.0, 2.0), g=0.3)
    flip = vector(1, 1, -1)
    for wo in (o, o * flip):
        up, down = evaluate(MODEL, p, i, wo), evaluate(MODEL, p, i * flip, wo * flip)
        np.testing.assert_array_equal(to_numpy(up), to_numpy(down))
        assert (to_numpy(up) > 0).all()
    np.testing.assert_array_equal(
        to_numpy(MODEL.ideal(p, i, STRAIGHT).weight), to_numpy(MODEL.ideal(p, i * flip, STRAIGHT).weight)
    )
    assert (to_numpy(evaluate(MODEL, p, i, vector(1, 0, 0))) == 0).all()


@vectors
def test_clear_and_empty(kind: str) -> None:
    """What does not scatter passes ``T^2 exp(-sigma_a thickness / mu)``; no thickness, no light but ``T^2``."""
    vector = VECTORS[kind]
    i, o = vector(0, 0, 1), vector(0, 0.6, 0.8)
    clear = defaults(MODEL, vector, sigma_s=0.0, sigma_a=0.5, thickness=2.0, eta=1.5)
    empty = defaults(MODEL, vector, thickness=0.0, eta=1.5)
    assert (to_numpy(evaluate(MODEL, clear, i, o)) == 0).all() and (to_numpy(evaluate(MODEL, empty, i, o)) == 0).all()
    rtol = 4 * EPS[precision(kind)]
    np.testing.assert_allclose(to_numpy(MODEL.ideal(clear, i, STRAIGHT).weight), 0.96**2 * np.exp(-1), rtol=rtol)
    np.testing.assert_allclose(to_numpy(MODEL.ideal(empty, i, STRAIGHT).weight), 0.96**2, rtol=rtol)
