"""Kajiya and Kay: value, gradient and sampling against the textbook in 60 digits, and what is not physical about it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpmath import mpf
from scipy.special import beta

from brdf import Values, defaults, evaluate
from brdf.checks.reciprocity import reciprocity
from brdf.models.kajiyakay import KajiyaKay
from tests.brdf import lobes
from tests.brdf.arrays import EPS, VECTORS, Array, single, to_numpy
from tests.brdf.lobes import WIDE
from tests.oracles import directions
from tests.oracles import lobes as textbook

MODEL = KajiyaKay()
#: A lobe of this exponent is about as wide as Beckmann facets of roughness sqrt(2 / n) make it.
EXPONENTS = (0.25, 2.0, 22.0, 200.0, 2e4, 5e5)


def grid(exponents: tuple[float, ...] = EXPONENTS, seed: int = 1) -> tuple[Array, Array, Array]:
    """Half the directions wo are turned about the thread: what is near the mirror direction is then near its cone."""
    wi, wo, m = directions.grid(tuple(np.sqrt(2 / np.array(exponents))), seed)
    turn = np.random.default_rng(seed).uniform(0.1, np.pi - 0.1, len(m))
    sin = np.hypot(wo[:, 1], wo[:, 2])
    turned = np.array([wo[:, 0], sin * np.cos(turn), sin * np.sin(turn)]).T
    wo = np.where((np.arange(len(m)) % 2 == 0)[:, None], turned, wo)
    n = single(2 / single(m) ** 2)
    return single(wi), single(wo), n


@pytest.fixture(scope="module")
def oracle() -> tuple[Array, Array, Array, list[Any]]:
    wi, wo, n = grid()
    made = []
    for i, o, x in zip(wi.tolist(), wo.tolist(), n.tolist(), strict=True):
        i, o = [mpf(c) for c in i], [mpf(c) for c in o]
        c = textbook.cone_cosine(i, o)
        made.append(textbook.derivatives(textbook.phong_classic, (x, o[2], *c), 0) if sum(c) > 0 else None)
    return wi, wo, n, made


@pytest.mark.parametrize("kind", WIDE)
def test_value_and_gradient(kind: str, oracle: tuple[Array, Array, Array, list[Any]]) -> None:
    wi, wo, n, want = oracle
    value, slope = lobes.holds(MODEL, ["exponent"], 0, kind, wi, wo, [n], want)
    assert value < 3
    assert slope < 2


def test_gradient_is_the_central_difference() -> None:
    wi, wo, n = grid((0.5, 5.0, 50.0), seed=3)
    lobes.against_differences(MODEL, ["exponent"], 0, wi, wo, [n])


@pytest.mark.parametrize("n", [0.0, 1.0, 30.0])
def test_what_is_seen(n: float) -> None:
    """``f cos_o = kd sin(t, l) + ks cos(theta_t - theta_r)^n``, from the angles themselves."""
    vector = VECTORS["float64"]
    wi, wo = directions.hemisphere(1000, 1), directions.hemisphere(1000, 2)
    p = defaults(MODEL, vector, diffuse_reflectance=(0.1, 0.2, 0.4), specular_reflectance=(1.0, 0.5, 0.25), exponent=n)
    seen = to_numpy(evaluate(MODEL, p, vector(*wi.T), vector(*wo.T))) * wo[:, 2]
    to_light, reflected = np.arccos(wo[:, 0]), np.pi - np.arccos(wi[:, 0])
    c = np.cos(to_light - reflected)
    want = np.outer([0.1, 0.2, 0.4], np.sin(to_light)) + np.outer([1, 0.5, 0.25], np.where(c > 0, np.abs(c) ** n, 0))
    np.testing.assert_allclose(seen, want, rtol=1e-12)


@pytest.mark.parametrize("n", [1.0, 1e4])
def test_the_cone_is_equally_bright(n: float) -> None:
    """1 at the mirror direction and all round the thread at that angle; less elsewhere."""
    vector = VECTORS["float64"]
    p = lobes.white(vector, exponent=vector(n).x)
    for azimuth in (0.0, 0.5, 1.5):
        wi = directions.unit(0.3, azimuth)
        turn = np.linspace(0.01, np.pi - 0.01, 100)
        sin = np.hypot(wi[1], wi[2])
        wo = np.array([-wi[0] + 0 * turn, sin * np.cos(turn), sin * np.sin(turn)])
        wo = np.concatenate([(wi * [-1, -1, 1])[:, None], wo, directions.hemisphere(500, 3).T], axis=1)
        seen = to_numpy(MODEL.f(p, vector(*wi.tolist()), vector(*wo))[1].x) * wo[2]
        np.testing.assert_allclose(seen[:101], 1, rtol=1e-13)
        assert (seen[101:] < 1).all()


def test_not_reciprocal() -> None:
    """Of the light alone: with wi and wo exchanged the highlight changes by the ratio of cosines, .5 to .9."""
    vector = VECTORS["float64"]
    wi, wo = (vector(*directions.unit(*w).tolist()) for w in ((0.5, 0.0), (0.9, 3.0)))
    p = lobes.white(vector, exponent=vector(30).x)
    assert reciprocity(lambda a, b: evaluate(MODEL, p, a, b), wi, wo)[0] == pytest.approx(1 - 5 / 9, rel=1e-13)


@pytest.mark.parametrize("mu", [1.0, 0.7, 0.1, 1e-3])
@pytest.mark.parametrize("azimuth", [0.0, 1.0])
def test_diffuse_albedo(mu: float, azimuth: float) -> None:
    """``pi^2 / 2``, of which every sample weighs the same: more than arrives for factors above .2."""
    vector = VECTORS["float64"]
    p = Values(diffuse_reflectance=vector(1), specular_reflectance=vector(0), exponent=vector(30).x)
    own, plain = lobes.sampling(MODEL, p, mu, azimuth)
    np.testing.assert_allclose(own, np.pi**2 / 2, rtol=1e-12)
    value, error = lobes.mean(plain)
    assert value == pytest.approx(np.pi**2 / 2, abs=4 * error + 1e-2)


@pytest.mark.parametrize("n", [0.0, 1.0, 30.0, 1000.0])
@pytest.mark.parametrize("mu", [1.0, 0.6, 0.1])
def test_albedo_across_the_thread(mu: float, n: float) -> None:
    """Where `wi` is perpendicular to the thread, ``c = sin_o``, and pi times the integral of ``sin^(n+1)`` is reflected,
    a beta function. For n = 1 that is pi^2 / 2."""
    vector = VECTORS["float64"]
    own, _ = lobes.sampling(MODEL, lobes.white(vector, exponent=vector(n).x), mu, np.pi / 2)
    value, error = lobes.mean(own)
    assert value == pytest.approx(np.pi * beta(0.5, n / 2 + 1), abs=4 * error + 1e-6)
    assert error < 1e-3 * value


@pytest.mark.parametrize("n", [0.0, 1.0, 30.0, 1000.0])
@pytest.mark.parametrize("azimuth", [0.0, 1.0])
@pytest.mark.parametrize("mu", [1.0, 0.7, 0.1, 0.01])
def test_weights(mu: float, azimuth: float, n: float) -> None:
    """Bounded as the model says, and much steadier than the cosine's, which divide by it."""
    vector = VECTORS["float64"]
    own, plain = lobes.sampling(MODEL, lobes.white(vector, exponent=vector(n).x), mu, azimuth)
    lobes.report(f"kajiyakay n {n:g} mu {mu:g} azimuth {azimuth:g}", own, plain)
    assert own.max() <= np.pi * beta(0.5, (n + 1) / 2) * (1 + 1e-12)
    assert own.var() < 0.5 * plain.var()
    value, error = (q for q in lobes.mean(plain))
    assert own.mean() == pytest.approx(value, abs=5 * error + 0.01 * value)


@pytest.mark.parametrize("kind", WIDE)
def test_density_and_directions(kind: str) -> None:
    """Unit directions; across the cone ``sin^2`` of what is missed has the mean ``1 / (n + 2)`` of cos^n."""
    vector = VECTORS[kind]
    count = 1 << 16
    u = vector(*np.random.default_rng(9).random((3, count)).astype(np.float32))
    for n in (0.0, 30.0, 1e4, 1e6):
        p = lobes.white(vector, exponent=vector(n).x)
        wi = directions.unit(0.7, 1.2)
        for lobe in (0, 1):
            wo = to_numpy(MODEL.sample(p, vector(*wi.tolist()), u, lobe))
            np.testing.assert_allclose(np.linalg.norm(wo, axis=0), 1, atol=8 * EPS[kind])
        if n >= 30:  # a wider lobe leaves the half plane
            sin_i, sin_o = np.hypot(wi[1], wi[2]), np.hypot(wo[1], wo[2])
            off = wo[0] * sin_i + wi[0] * sin_o
            assert (off**2).mean() == pytest.approx(1 / (n + 2), rel=5 * np.sqrt(2 / count) + 1e-5)


def test_along_x() -> None:
    """The same turned about the thread, but for the cosine of the surface; not the same turned about the normal."""
    assert MODEL.anisotropic
    vector = VECTORS["float64"]
    p = defaults(MODEL, vector)
    wi, wo = vector(0.36, 0.48, 0.8), vector(-0.28, 0, 0.96)
    rolled = vector(-0.28, 0.6 * 0.96, 0.8 * 0.96)
    turned = [vector(-w.y, w.x, w.z) for w in (wi, wo)]
    seen = [to_numpy(evaluate(MODEL, p, a, b) * b.z) for a, b in ((wi, wo), (wi, rolled), turned)]
    np.testing.assert_allclose(seen[0], seen[1], rtol=1e-14)
    assert (np.abs(seen[2] / seen[0] - 1) > 0.1).all()


@pytest.mark.parametrize("kind", WIDE)
def test_hostile_inputs(kind: str) -> None:
    lobes.nothing_below_the_horizon(MODEL, kind, exponent=20.0)
    lobes.finite_everywhere(MODEL, kind, exponent=(0.0, 1e-6, 30.0, 1e6))


def test_faults_occur() -> None:
    assert set(MODEL.faults()) == {"reciprocity", "energy", "coupling", "peak"}
    vector = VECTORS["float64"]
    p = defaults(MODEL, vector, specular_reflectance=0.0)
    assert lobes.sampling(MODEL, p, 1.0)[0].mean() == pytest.approx(0.5 * np.pi**2 / 2)  # 2.47 by the default of .5
