"""Grooves: value and gradients against lines traced in the cross-section, limits in closed form, sampling."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
import pytest
from mpmath import mpf

from brdf import Values, defaults, evaluate
from brdf.models.grooved import Grooved, reach
from tests.brdf.arrays import EPS, VECTORS, call, precision, single, to_numpy
from tests.oracles import directions, grooves, layered

WIDE = ("float32", "float64")
#: Kernels with derivatives by the directions, or with sampling, take seconds to compile in float64.
WIDE_SLOW = ("float32", pytest.param("float64", marks=pytest.mark.slow))
NUMBERS: tuple[str, ...] = ("exponent", "spacing", "height")
#: Touching half cylinders; a little apart; sunk in the floor; far apart; shallow.
ROWS = ((2.0, 0.0), (2.5, 0.3), (3.0, 0.9), (8.0, 0.1), (20.0, 0.99))
EXPONENTS = (1.0, 2.0, 3.5, 30.0, 400.0, 1e4)

model = Grooved()


def values(like: Any, exponent: Any, spacing: Any, height: Any, diffuse: float = 1.0, specular: float = 1.0) -> Values:
    vector = like if isinstance(like, type) else type(like)
    return Values(
        exponent=exponent,
        spacing=spacing,
        height=height,
        reflectance=vector(diffuse),
        specular_reflectance=vector(specular),
    )


def cases(count: int, seed: int) -> tuple[Any, ...]:
    """wi, wo (count, 3), exponent, spacing, height (count,), all of which float32 represents. Cosines from 0.01; half the
    pairs are near the mirror direction about some normal of a cylinder."""
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(count):
        spacing, height = ROWS[k % len(ROWS)]
        exponent = EXPONENTS[k // len(ROWS) % len(EXPONENTS)]
        wi, wo = (directions.unit(10 ** rng.uniform(-2, 0), rng.uniform(0, 2 * np.pi)) for _ in range(2))
        if k % 2:
            t = rng.uniform(-1, 1)
            n = np.array([np.sin(t), 0, np.cos(t)])
            near = 2 * (n @ wi) * n - wi + rng.normal(size=3) * 0.5 / np.sqrt(exponent)
            wo = near / np.linalg.norm(near) if near[2] > 0.01 * np.linalg.norm(near) else wo
        rows.append((wi, wo, exponent, spacing, height))
    return tuple(single(a) for a in zip(*rows, strict=True))


@pytest.fixture(scope="module")
def oracle() -> tuple[Any, Any]:
    given = cases(90, 1)
    wi, wo, n, d, h = given
    return given, np.array([grooves.grooved(*row) for row in zip(wi, wo, d, h, n, strict=True)])


def test_the_exact_answers(oracle: Any) -> None:
    """The ends in closed form and the quadrature of the hard points' oracle, against lines that are traced."""
    given, want = oracle
    some = range(0, 90, 7)
    for k in some:
        wi, wo, n, d, h = (a[k] for a in given)
        numbers = {"exponent": mpf(n), "spacing": mpf(d), "height": mpf(h)}
        diffuse, phong = (
            layered.grooved(model, [mpf(x) for x in wi], [mpf(x) for x in wo], Values(**numbers, **tint))
            for tint in ({"reflectance": 1}, {"specular_reflectance": 1})
        )
        np.testing.assert_allclose([float(diffuse), float(phong)], want[k], rtol=1e-10)


def lobe(number: int) -> Any:
    """One lobe of unit reflectance, as a function of directions and the three numbers."""
    return lambda wi, wo, n, d, h: model.f(values(wi, n, d, h), wi, wo)[number].x


@pytest.mark.parametrize("kind", VECTORS)
def test_value(kind: str, oracle: Any) -> None:
    """The diffuse part is closed form, so exact to rounding; the Phong lobe to what its rule is good for."""
    given, want = oracle
    wide = precision(kind) == "float64"
    got = call(lobe(0), VECTORS[kind], *given)
    np.testing.assert_allclose(got, want[:, 0], rtol=2e-14 if wide else 2e-6)
    got = call(lobe(1), VECTORS[kind], *given)
    peak = given[2] + 2
    off = np.abs(got - want[:, 1]) / np.maximum(want[:, 1], 1e-6 * peak)
    assert (want[:, 1] > 1e-6 * peak).sum() > 45
    assert off.max() < (1e-11 if wide else 2e-5)


@pytest.mark.parametrize("kind", WIDE)
def test_directions_along_the_grooves(kind: str) -> None:
    """The lobe is then broad across them, however sharp: it may fall to rounding just within a right angle, where the rule
    has most to do, or not at all. And below an exponent of some 6 its end is a kink that float64 sees."""
    rows = []
    for n in (1.0, 1.7, 2.9, 3.1, 5.9, 6.1, 30.0, 517.0):
        for k, fall in enumerate((12, 16, 18, 22, 36, 38, 45, 80)):  # within a right angle, to exp(-fall)
            width = min(np.sqrt(0.5 * fall / n), 0.9)
            wi, wo = np.array([0, 1, width]), np.array([0.3 * width, -1, width])
            rows.append((wi / np.linalg.norm(wi), wo / np.linalg.norm(wo), n, 2.5, (0.0, 0.3, 0.9)[k % 3]))
    given = tuple(single(a) for a in zip(*rows, strict=True))
    want = []
    for wi, wo, n, d, h in zip(*given, strict=True):
        tint = {"exponent": mpf(n), "spacing": mpf(d), "height": mpf(h), "specular_reflectance": 1}
        want.append(float(layered.grooved(model, [mpf(x) for x in wi], [mpf(x) for x in wo], Values(**tint))))
    got = call(lobe(1), VECTORS[kind], *given)
    assert (np.abs(got / np.array(want) - 1) < 4 * EPS[kind]).all()


@pytest.mark.parametrize("number", [0, 1], ids=["diffuse", "phong"])
@pytest.mark.parametrize("name", NUMBERS)
def test_gradient_is_the_central_difference(name: str, number: int) -> None:
    """In float64, the ends that move with spacing and height among it."""
    wi, wo, *rest = cases(3000, 2)
    given = dict(zip(NUMBERS, rest, strict=True))
    given["spacing"] = np.maximum(given["spacing"], 2 + 1e-4)  # a difference has two sides
    given["height"] = np.clip(given["height"], 1e-4, 0.998)
    step = 1e-5
    low, high = ({**given, name: given[name] * (1 + s)} for s in (-step, step))
    quotient = call(lobe(number), VECTORS["float64"], wi, wo, *high.values())
    quotient = quotient - call(lobe(number), VECTORS["float64"], wi, wo, *low.values())
    quotient /= high[name] - low[name]
    for kind in WIDE:
        vector = VECTORS[kind]
        p = {key: dr.value_t(vector)(v) for key, v in given.items()}
        dr.enable_grad(p[name])
        if number == 0 and name == "exponent":
            assert not dr.grad_enabled(lobe(number)(vector(*wi.T), vector(*wo.T), *p.values()))
            continue
        f = lobe(number)(vector(*wi.T), vector(*wo.T), *p.values())
        dr.backward(dr.sum(f))
        got, value = to_numpy(p[name].grad), to_numpy(f)
        scale = np.abs(quotient) + value / given[name] + 1e-6 * given["exponent"]
        off = np.abs(got - quotient) / scale
        # Where an arc's end passes from one rule to another, the difference straddles a kink.
        limit = 1e-5 if kind == "float64" else 3e-4
        assert np.quantile(off, 0.995) < limit
        assert np.median(off) < limit / 100
    if number == 0 and name == "exponent":
        assert (quotient == 0).all()
    else:
        assert (np.abs(quotient) > 1e-3 * value / given[name]).mean() > 0.25


@pytest.mark.parametrize("name", ["spacing", "height"])
def test_gradient_is_that_of_the_traced_row(name: str, oracle: Any) -> None:
    """By differences of the oracle, which knows no ends."""
    given, _ = oracle
    chosen = [k for k in range(len(given[0])) if given[3][k] > 2 and given[2][k] < 100][:12]
    wi, wo, *rest = (a[chosen] for a in given)
    step, number = 1e-4, NUMBERS.index(name)
    sides = []
    for s in (step, -step):
        n, d, h = (a + s * (k == number) for k, a in enumerate(rest))
        sides.append(np.array([grooves.grooved(*row) for row in zip(wi, wo, d, h, n, strict=True)]))
    quotient, value = (sides[0] - sides[1]) / (2 * step), 0.5 * (sides[0] + sides[1])
    for k in (0, 1):
        vector = VECTORS["float64"]
        p = {key: dr.value_t(vector)(v) for key, v in zip(NUMBERS, rest, strict=True)}
        dr.enable_grad(p[name])
        dr.backward(dr.sum(lobe(k)(vector(*wi.T), vector(*wo.T), *p.values())))
        off = np.abs(to_numpy(p[name].grad) - quotient[:, k])
        assert (off <= 1e-5 * (np.abs(quotient[:, k]) + value[:, k])).all()
        assert (np.abs(quotient[:, k]) > 0.01 * value[:, k]).sum() >= 4


@pytest.mark.parametrize("kind", VECTORS)
def test_reciprocal_bit_for_bit(kind: str) -> None:
    wi, wo, *rest = cases(2000 if kind in WIDE else 200, 3)

    def f(i: Any, o: Any, n: Any, d: Any, h: Any) -> Any:
        return evaluate(model, values(i, n, d, h, 0.3, 0.5), i, o).x

    there, back = (call(f, VECTORS[kind], *pair, *rest) for pair in ((wi, wo), (wo, wi)))
    assert (there > 0).all()
    assert (there == back).all()


@pytest.mark.parametrize("kind", WIDE_SLOW)
def test_mirrored(kind: str) -> None:
    """The row is its own mirror image across and along the grooves; turned by a right angle it is not itself."""
    wi, wo, *rest = cases(500, 4)

    def f(turn: Any) -> Any:
        function = lambda i, o, n, d, h: evaluate(model, values(i, n, d, h, 0.3, 0.5), i, o).x  # noqa: E731
        return call(function, VECTORS[kind], turn(wi), turn(wo), *rest)

    same = f(lambda w: w)
    np.testing.assert_allclose(f(lambda w: w * [-1, 1, 1]), same, rtol=64 * EPS[kind])
    np.testing.assert_allclose(f(lambda w: w * [1, -1, 1]), same, rtol=64 * EPS[kind])
    turned = f(lambda w: w[:, [1, 0, 2]] * [1, -1, 1])
    assert (np.abs(turned - same) > 0.05 * same).mean() > 0.5


@pytest.mark.parametrize("kind", WIDE_SLOW)
def test_nothing_below_the_horizon(kind: str) -> None:
    """Exactly 0, in value and gradient, where either direction is at or below it."""
    wi, wo, *rest = cases(200, 5)
    wi[:50, 2] *= -1
    wo[50:100, 2] *= -1
    wi[100:150, 2] *= -1
    wo[100:150, 2] *= -1
    wi[150:170, 2] = 0
    wo[170:, 2] = 0
    vector = VECTORS[kind]
    i, o = vector(*wi.T), vector(*wo.T)
    p = values(i, *(dr.value_t(vector)(v) for v in rest))
    given = [*vars(p).values(), i, o]
    dr.enable_grad(*given)
    f = evaluate(model, p, i, o)
    assert (to_numpy(f) == 0).all()
    dr.backward(dr.sum(f, axis=None))
    for g in given:
        assert (to_numpy(dr.grad(g)) == 0).all()


@pytest.mark.parametrize("kind", WIDE_SLOW)
def test_finite_everywhere(kind: str) -> None:
    """Value, density, sample and gradients at hostile inputs: all bounds, cosines down to 1e-12, along and across the
    grooves, directions equal, opposite, at the mirror direction and a little off it."""
    bounds = {p.name: p.bounds for p in Grooved.params}
    cosines = [1.0, 1 - 1e-7, 0.999, 0.5, 1e-2, 1e-4, 1e-7, 1e-12]
    rows = [
        (directions.unit(a, azimuth), directions.unit(b, azimuth + turn), n, d, h)
        for a in cosines
        for b in cosines
        for azimuth in (0, 0.7, np.pi / 2 - 1e-7, np.pi / 2)
        for turn in (0, 1e-6, np.pi / 2, np.pi)
        for n in (bounds["exponent"][0], 2.5, 1e3, bounds["exponent"][1])
        for d in (bounds["spacing"][0], 3.0, bounds["spacing"][1])
        for h in (bounds["height"][0], 0.5, bounds["height"][1])
    ]
    wi, wo, *rest = (np.array(a) for a in zip(*rows, strict=True))
    vector = VECTORS[kind]
    i, o = vector(*wi.T), vector(*wo.T)
    p = values(i, *(dr.value_t(vector)(v) for v in rest))
    given = [p.exponent, p.spacing, p.height, i, o]
    dr.enable_grad(*given)
    f = evaluate(model, p, i, o)
    for found in (f, model.pdf(p, i, o)[1], model.sample(p, i, vector(0, 0.3, 0.999), 1)):
        assert np.isfinite(to_numpy(found)).all()
    assert (to_numpy(f) >= 0).all()
    dr.backward(dr.sum(f.x))
    for g in given:
        assert np.isfinite(to_numpy(dr.grad(g))).all()


@pytest.mark.parametrize("kind", WIDE)
@pytest.mark.parametrize(("spacing", "height"), ROWS)
@pytest.mark.parametrize("cos", [1.0, 0.3, 1e-3, 1e-7])
def test_along_the_grooves(cos: float, spacing: float, height: float, kind: str) -> None:
    """Nothing is hidden: ``pi f = (spacing - 2 sin r + r + sin r cos r) / spacing``, ``cos r = height``, whatever the
    angles; and across, the light of the mirror direction comes from the floor and from the top alone."""
    rim = np.arccos(height)
    want = (spacing - 2 * np.sin(rim) + rim + np.sin(rim) * height) / spacing / np.pi
    vector = VECTORS[kind]
    for azimuth in (np.pi / 2, -np.pi / 2):
        wi, wo = (vector(0, float(np.sin(azimuth) * np.sqrt(1 - c * c)), c) for c in (cos, 0.4))
        got = to_numpy(evaluate(model, values(wi, 10.0, spacing, height, specular=0.0), wi, wo).x)
        assert got[0] == pytest.approx(want, rel=32 * EPS[kind])


@pytest.mark.parametrize("kind", WIDE)
@pytest.mark.parametrize("spacing", [2.0, 5.0, 20.0])
def test_grazing_across_the_grooves(spacing: float, kind: str) -> None:
    """Only the tops count. At elevation e, back where it came from, ``pi f = (2/3) sqrt(2 spacing / e)`` to relative
    sqrt(e); opposite, ``pi f = 4 e / (3 spacing)`` to relative e^2."""
    vector = VECTORS[kind]
    e = 1e-10
    wi, back = vector(1, 0, e), vector(-1, 0, e)
    p = values(wi, 10.0, spacing, 0.5, specular=0.0)
    got = np.pi * to_numpy(evaluate(model, p, wi, wi).x)[0]
    assert got == pytest.approx(2 / 3 * np.sqrt(2 * spacing / e), rel=1e-4)
    got = np.pi * to_numpy(evaluate(model, p, wi, back).x)[0]
    assert got == pytest.approx(4 * e / (3 * spacing), rel=64 * EPS[kind])


def test_every_line_of_sight_ends() -> None:
    """The floor and the arc that a direction reaches, as seen from it, make up the whole period."""
    wi, _, _, d, h = cases(2000, 6)
    vector = VECTORS["float64"]
    w = vector(*wi.T)
    p = Values(spacing=dr.value_t(vector)(d), height=dr.value_t(vector)(h))
    r = reach(p, w)
    low, high = to_numpy(r.low), to_numpy(r.high)
    tan = wi[:, 0] / wi[:, 2]
    arc = (np.sin(high) - np.sin(low)) + tan * (np.cos(low) - np.cos(high))
    np.testing.assert_allclose(to_numpy(r.floor(p)) + arc / d, 1, rtol=1e-13)
    assert (low <= 0).all() and (high >= 0).all()


SETTINGS = [
    (directions.unit(cos, azimuth), n, d, h)
    for n, d, h in ((1.0, 2.5, 0.3), (30.0, 2.0, 0.0), (1000.0, 4.0, 0.7), (30.0, 20.0, 0.99))
    for cos in (1.0, 0.5, 0.02)
    for azimuth in (0.0, 0.5, np.pi / 2)
]


@pytest.mark.parametrize("kind", WIDE_SLOW)
def test_sampled_weight(kind: str) -> None:
    """It is bounded by ``(exponent + 2) / (exponent + 1)``; its mean is the albedo, at most 1; its variance is below that
    of cosine sampling for all but broad lobes, and far below for sharp ones."""
    n = 1 << 14
    weight, cosine = (sampled(kind, SETTINGS, n, 1, by) for by in (1, 0))
    exponent = np.array([s[1] for s in SETTINGS])
    assert (weight.max(axis=1) <= (exponent + 2) / (exponent + 1) * (1 + 1e-5)).all()
    sd = np.sqrt((weight.var(axis=1) + cosine.var(axis=1)) / n)
    assert (np.abs(weight.mean(axis=1) - cosine.mean(axis=1)) < 4 * sd).all()
    assert (weight.mean(axis=1) <= 1 + 4 * weight.std(axis=1) / np.sqrt(n)).all()
    ratio = weight.var(axis=1) / cosine.var(axis=1)
    assert (ratio[exponent > 1] < 0.6).all()
    assert (ratio[exponent > 100] < 0.03).all()


def sampled(kind: str, settings: Any, n: int, number: int, by: int) -> Any:
    """``f cos / pdf`` of lobe `number` at unit reflectance in directions sampled from lobe `by`, shape (settings, n); 0
    below the horizon."""
    vector = VECTORS[kind]
    wi, *rest = (np.repeat(np.array(a), n, axis=0) for a in zip(*settings, strict=True))
    u = single(np.random.default_rng(9).random((3, len(wi)))).clip(0, 1 - 2.0**-24)
    i = vector(*wi.T)
    p = values(i, *(dr.value_t(vector)(a) for a in rest))
    wo = model.sample(p, i, vector(*u), by)
    np.testing.assert_allclose(np.linalg.norm(to_numpy(wo), axis=0), 1, atol=8 * EPS[kind])
    up = wo.z > 0
    safe = dr.select(up, wo, vector(0, 0, 1))
    density = model.pdf(p, i, safe)[by]
    assert (to_numpy(density)[np.asarray(up)] > 0).all()
    weight = dr.select(up, model.f(p, i, safe)[number].x * safe.z / density, 0)
    return to_numpy(weight).reshape(len(settings), n)


def test_diffuse_albedo() -> None:
    """At reflectance 1 it is at most 1, from normal to grazing incidence. What is lost is what a groove throws onto another:
    less in shallow grooves, whose albedo is that of a flat floor."""
    settings = [
        (directions.unit(cos, azimuth), 1.0, d, h)
        for d, h in ROWS
        for cos in (1.0, 0.7, 0.2, 0.01)
        for azimuth in (0.0, 0.8, np.pi / 2)
    ]
    n = 1 << 13
    weight = sampled("float64", settings, n, 0, 0)
    mean = weight.mean(axis=1).reshape(len(ROWS), -1)
    sd = (weight.std(axis=1) / np.sqrt(n)).reshape(len(ROWS), -1)
    assert (mean <= 1 + 4 * sd).all()
    assert (mean[0, :6] < 0.83).all()  # half cylinders that touch, steep incidence
    assert (mean[-1] > 0.99).all()
    assert (mean > 0.7).all()


def test_reflectances() -> None:
    """Each lobe is proportional to its own, channel by channel."""
    vector = VECTORS["float64"]
    wi, wo = vector(0.6, 0, 0.8), vector(0, -0.6, 0.8)
    p = defaults(model, vector, reflectance=(0.1, 0.2, 0.4), specular_reflectance=(1.0, 0.5, 0.25))
    diffuse, glossy = (to_numpy(x).ravel() for x in model.f(p, wi, wo))
    np.testing.assert_allclose(diffuse / diffuse[0], [1, 2, 4], rtol=1e-15)
    np.testing.assert_allclose(glossy / glossy[0], [1, 0.5, 0.25], rtol=1e-15)
    assert diffuse[0] > 0 and glossy[0] > 0
