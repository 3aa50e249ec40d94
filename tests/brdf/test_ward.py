"""Ward: value, gradient and sampling against the textbook in 60 digits, and what its variants reflect."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import defaults
from brdf.models.ward import Ward
from tests.brdf import lobes
from tests.brdf.arrays import EPS, VECTORS, Array, single, to_numpy
from tests.brdf.lobes import WIDE
from tests.oracles import directions
from tests.oracles import lobes as textbook

VARIANTS = ("ward", "duer", "balanced")
ALPHAS = ["alpha_u", "alpha_v"]

variants = pytest.mark.parametrize("variant", VARIANTS)


def grid(roughness: tuple[float, ...] = (1e-3, 0.01, 0.1, 0.5, 1.5), seed: int = 1) -> tuple[Array, ...]:
    """Every second pair is a third as rough along x, every third along y."""
    wi, wo, m = (single(a)[::3] for a in directions.grid(roughness, seed))
    k = np.arange(len(m))
    return wi, wo, single(np.where(k % 2, m / 3, m)), single(np.where(k % 3, m, m / 3))


@pytest.fixture(scope="module")
def oracle() -> dict[Any, Any]:
    wi, wo, u, v = grid()
    made: dict[Any, Any] = {"grid": (wi, wo, u, v)}
    pairs = list(zip(wi.tolist(), wo.tolist(), strict=True))
    half = [[mpf(a) + mpf(b) for a, b in zip(i, o, strict=True)] for i, o in pairs]
    for by, name in enumerate(ALPHAS):
        gaussian = [
            textbook.derivatives(lambda u, v, *h: textbook.ward_gaussian(h, u, v), (a, b, *h), by)
            for a, b, h in zip(u.tolist(), v.tolist(), half, strict=True)
        ]
        for variant, rest in textbook.WARD.items():
            made[variant, name] = [
                scaled(g, float(rest(h, mpf(i[2]), mpf(o[2]))))
                for g, h, (i, o) in zip(gaussian, half, pairs, strict=True)
            ]
    return made


def scaled(g: textbook.Derivatives, by: float) -> textbook.Derivatives:
    """Times a factor of the two cosines, whose logarithm changes by no more than twice that of either."""
    value, slope, value_scale, slope_scale = (x * by for x in g)
    return textbook.Derivatives(value, slope, value_scale + 2 * value, slope_scale + 2 * abs(slope))


@variants
@pytest.mark.parametrize("by", [0, 1], ids=ALPHAS)
@pytest.mark.parametrize("kind", WIDE)
def test_value_and_gradient(kind: str, by: int, variant: str, oracle: dict[Any, Any]) -> None:
    wi, wo, *alphas = oracle["grid"]
    value, slope = lobes.holds(Ward(variant=variant), ALPHAS, by, kind, wi, wo, alphas, oracle[variant, ALPHAS[by]])
    assert value < 3
    assert slope < 2


@variants
@pytest.mark.parametrize("by", [0, 1], ids=ALPHAS)
def test_gradient_is_the_central_difference(by: int, variant: str) -> None:
    wi, wo, *alphas = grid((0.1, 0.3, 1.0), seed=3)
    lobes.against_differences(Ward(variant=variant), ALPHAS, by, wi, wo, alphas)


@variants
@pytest.mark.parametrize("kind", VECTORS)
def test_reciprocal_bit_for_bit(kind: str, variant: str) -> None:
    wi, wo, *alphas = grid((0.5, 1.0))
    lobes.symmetric(Ward(variant=variant), ALPHAS, kind, wi, wo, alphas)


@pytest.mark.parametrize(
    ("variant", "alphas", "table"),
    [
        ("ward", (0.15, 0.15), [0.9376, 0.6598, 0.2972, 0.1561]),
        ("balanced", (0.15, 0.15), [0.9775, 0.9648, 0.8779, 0.8029]),
        ("ward", (0.1, 0.3), [0.8774, 0.6157, 0.2692, 0.1160]),
        ("balanced", (0.1, 0.3), [0.9500, 0.9444, 0.8945, 0.7922]),
        ("duer", (0.15, 0.15), [None, None, None, 1.007]),
        ("duer", (0.5, 0.5), [None, None, None, 1.214]),
    ],
)
def test_albedo(variant: str, alphas: tuple[float, float], table: list[float]) -> None:
    """mu = 1, .7, .3, .1, seen along the local x axis: quadrature of the formula, in float64, by other code. By both ways of
    sampling."""
    vector = VECTORS["float64"]
    p = lobes.white(vector, **{name: vector(a).x for name, a in zip(ALPHAS, alphas, strict=True)})
    for mu, want in zip((1.0, 0.7, 0.3, 0.1), table, strict=True):
        # At grazing, few directions by the cosine meet the lobe.
        for weights, close in zip(lobes.sampling(Ward(variant=variant), p, mu, azimuth=0.0), (2e-3, 0.02), strict=True):
            value, error = lobes.mean(weights)
            assert want is None or value == pytest.approx(want, abs=4 * error + 5e-4)
            assert error < close


@pytest.mark.parametrize("alpha", [0.02, 0.15, 0.5, 1.5])
def test_balanced_conserves_energy(alpha: float) -> None:
    vector = VECTORS["float64"]
    p = lobes.white(vector, alpha_u=vector(alpha).x, alpha_v=vector(alpha / 3).x)
    for mu in (1.0, 0.7, 0.3, 0.1, 0.03, 1.7e-3):
        value, error = lobes.mean(lobes.sampling(Ward(variant="balanced"), p, mu)[0])
        assert value <= 1 + 4 * error


@pytest.mark.parametrize(("variant", "mu", "reason"), [("ward", 1.745e-3, "1.48"), ("duer", 0.1, "1.21")])
def test_declared_excess(variant: str, mu: float, reason: str) -> None:
    """Duer's reflects 1.214 at mu = .1, Ward's 1.4836 at 89.9 degrees (quadrature): at one of the trials, and as the reason
    says."""
    vector = VECTORS["float64"]
    model = Ward(variant=variant)
    assert reason in model.faults()["energy"]
    most = 0.0
    for trial in Ward.trials:
        p = defaults(model, vector, **{**trial, "diffuse_reflectance": 0.0})
        value, error = lobes.mean(lobes.sampling(model, p, mu)[0])
        most = max(most, value - 5 * error)
    assert most > 1
    assert most == pytest.approx(float(reason), rel=0.03)


@variants
@pytest.mark.parametrize("alpha", [0.02, 0.15, 0.5])
@pytest.mark.parametrize("mu", [1.0, 0.7, 0.1, 0.01])
def test_weights(mu: float, alpha: float, variant: str) -> None:
    """Bounded as the model says, and steadier than the cosine's where the lobe is sharp."""
    vector = VECTORS["float64"]
    p = lobes.white(vector, alpha_u=vector(alpha).x, alpha_v=vector(alpha).x)
    own, plain = lobes.sampling(Ward(variant=variant), p, mu)
    lobes.report(f"ward {variant} alpha {alpha:g} mu {mu:g}", own, plain)
    bound = {"balanced": 1, "ward": max(1, 0.25 / mu**0.5), "duer": max(1, 0.25 / mu)}[variant]
    assert own.max() <= bound * (1 + 1e-12)
    if alpha < 0.5:
        assert own.var() < 0.5 * plain.var()


@pytest.mark.parametrize("kind", WIDE)
def test_density_and_directions(kind: str) -> None:
    """Unit directions; at normal incidence the half vector's slopes are Gaussian, of variance ``alpha^2 / 2`` each."""
    vector = VECTORS[kind]
    model, count = Ward(), 1 << 16
    u = vector(*np.random.default_rng(9).random((3, count)).astype(np.float32))
    for alphas in ((1e-4, 1e-3), (0.3, 0.1), (1.5, 1e-4)):
        p = lobes.white(vector, **{name: vector(a).x for name, a in zip(ALPHAS, alphas, strict=True)})
        wo = to_numpy(model.sample(p, vector(0, 0, 1), u, 1))
        np.testing.assert_allclose(np.linalg.norm(wo, axis=0), 1, atol=8 * EPS[kind])
        up = wo[2] > -0.999  # beyond, the slope is lost
        for side, alpha in zip(wo[:2], alphas, strict=True):
            slope = side[up] / (1 + wo[2][up])
            assert (slope**2).mean() == pytest.approx(alpha**2 / 2, rel=5 * np.sqrt(2 / count) + 1e-5)


def test_turns_with_the_axes() -> None:
    """What alpha_u is along x, alpha_v is along y; and it is seen from along x, not from along y."""
    vector = VECTORS["float64"]
    wi, wo = vector(0.36, 0.48, 0.8), vector(-0.28, 0, 0.96)
    turned = [vector(-w.y, w.x, w.z) for w in (wi, wo)]
    for variant in VARIANTS:
        model = Ward(variant=variant)
        assert model.anisotropic
        a = model.f(defaults(model, vector, alpha_u=0.2, alpha_v=0.4), wi, wo)[1]
        b = model.f(defaults(model, vector, alpha_u=0.4, alpha_v=0.2), *turned)[1]
        c = model.f(defaults(model, vector, alpha_u=0.4, alpha_v=0.2), wi, wo)[1]
        np.testing.assert_allclose(to_numpy(a), to_numpy(b), rtol=1e-15)
        assert (np.abs(to_numpy(a) / to_numpy(c) - 1) > 0.1).all()
    # At normal incidence the slope is tan of half the angle: 1/7 for wo.z = .96. e / (4 sqrt(.96)), Ward's equation 5b.
    p = defaults(Ward(), vector, alpha_u=0.2, alpha_v=0.4, specular_reflectance=1.0)
    want = np.exp(-((1 / 7 / 0.2) ** 2)) / (4 * np.pi * 0.08 * np.sqrt(0.96))
    np.testing.assert_allclose(to_numpy(Ward().f(p, vector(0, 0, 1), wo)[1]).ravel(), want, rtol=1e-13)


def test_variants_agree_at_the_mirror_direction_of_normal_incidence() -> None:
    """All are 1 / (4 pi alpha^2) there."""
    vector = VECTORS["float64"]
    n = vector(0, 0, 1)
    for variant in VARIANTS:
        model = Ward(variant=variant)
        p = defaults(model, vector, alpha_u=0.2, alpha_v=0.3, specular_reflectance=(1.0, 0.5, 0.25))
        want = np.array([1, 0.5, 0.25]) / (4 * np.pi * 0.06)
        np.testing.assert_allclose(to_numpy(model.f(p, n, n)[1]).ravel(), want, rtol=1e-14)


@variants
@pytest.mark.parametrize("kind", WIDE)
def test_hostile_inputs(kind: str, variant: str) -> None:
    model = Ward(variant=variant)
    lobes.nothing_below_the_horizon(model, kind, alpha_u=0.2, alpha_v=0.4)
    lobes.finite_everywhere(model, kind, alpha_u=(1e-4, 1e-4, 0.1, 1.5, 1.5), alpha_v=(1e-4, 1.5, 0.1, 1e-4, 1.5))


def test_faults() -> None:
    assert set(Ward().faults()) == set(Ward(variant="duer").faults()) == {"energy", "coupling"}
    assert set(Ward(variant="balanced").faults()) == {"coupling"}


def test_the_oracle_is_the_gaussian_of_the_slopes() -> None:
    """By angles and by slopes: ``tan^2 (cos^2 / u^2 + sin^2 / v^2) = (x / (z u))^2 + (y / (z v))^2``."""
    h = [mpf("0.3"), mpf("-0.2"), mpf("1.1")]
    slopes = (h[0] / h[2] / mpf("0.2")) ** 2 + (h[1] / h[2] / mpf("0.5")) ** 2
    want = mpmath.exp(-slopes) / (4 * mpmath.pi * mpf("0.2") * mpf("0.5"))
    assert mpmath.almosteq(textbook.ward_gaussian(h, mpf("0.2"), mpf("0.5")), want, 1e-50)
