"""Blinn-Phong: value, gradient and sampling against the textbook in 60 digits, and what its normalisations reflect."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import defaults
from brdf.models.blinnphong import BlinnPhong
from tests.brdf import lobes
from tests.brdf.arrays import EPS, VECTORS, Array, call, single, to_numpy
from tests.brdf.lobes import WIDE
from tests.oracles import directions
from tests.oracles import lobes as textbook

KINDS = ("exact", "common")
#: Beckmann facets of roughness sqrt(2 / n) are about as wide.
EXPONENTS = (0.25, 2.0, 22.0, 200.0, 2e4, 5e5)


def grid(exponents: tuple[float, ...] = EXPONENTS, seed: int = 1) -> tuple[Array, Array, Array]:
    wi, wo, m = (single(a)[::2] for a in directions.grid(tuple(np.sqrt(2 / np.array(exponents))), seed))
    return wi, wo, single(2 / m**2)


@pytest.fixture(scope="module")
def oracle() -> dict[str, Any]:
    wi, wo, n = grid()
    made: dict[str, Any] = {"grid": (wi, wo, n)}
    for name, function in (("exact", textbook.blinn_exact), ("common", textbook.blinn_common)):
        made[name] = [
            textbook.derivatives(by_tangent(function), (x, *tangent(i, o)), 0)
            for i, o, x in zip(wi.tolist(), wo.tolist(), n.tolist(), strict=True)
        ]
    return made


def tangent(wi: Any, wo: Any) -> tuple[Any, Any]:
    h = [mpf(a) + mpf(b) for a, b in zip(wi, wo, strict=True)]
    return mpmath.sqrt(h[0] ** 2 + h[1] ** 2), h[2]


def by_tangent(function: Any) -> Any:
    """Of the two sides of the half vector, which carry the roundings, rather than of its cosine."""
    return lambda n, across, along: function(n, along / mpmath.sqrt(across**2 + along**2))


@pytest.mark.parametrize("normalization", KINDS)
@pytest.mark.parametrize("kind", WIDE)
def test_value_and_gradient(kind: str, normalization: str, oracle: dict[str, Any]) -> None:
    model = BlinnPhong(normalization=normalization)
    wi, wo, n = oracle["grid"]
    value, slope = lobes.holds(model, ["exponent"], 0, kind, wi, wo, [n], oracle[normalization])
    assert value < 3
    assert slope < 2


@pytest.mark.parametrize("normalization", KINDS)
def test_gradient_is_the_central_difference(normalization: str) -> None:
    wi, wo, n = grid((0.5, 5.0, 50.0), seed=3)
    lobes.against_differences(BlinnPhong(normalization=normalization), ["exponent"], 0, wi, wo, [n])


@pytest.mark.parametrize("normalization", KINDS)
@pytest.mark.parametrize("kind", VECTORS)
def test_reciprocal_bit_for_bit(kind: str, normalization: str) -> None:
    wi, wo, n = grid((0.25, 2.0, 22.0))
    lobes.symmetric(BlinnPhong(normalization=normalization), ["exponent"], kind, wi, wo, [n])


@pytest.mark.parametrize(
    ("normalization", "n", "table"),
    [
        ("exact", 0.0, [1, 1, 1, 1]),  # Lambert's
        ("exact", 50.0, [1, 0.5105, 0.1271, 0.0422]),
        ("common", 10.0, [1.075, None, None, None]),
    ],
)
def test_albedo(normalization: str, n: float, table: list[float]) -> None:
    """mu = 1, .7, .3, .1: quadrature of the formula, 4 digits, in float64, by other code. By both ways of sampling."""
    vector = VECTORS["float64"]
    p = lobes.white(vector, exponent=vector(n).x)
    for mu, want in zip((1.0, 0.7, 0.3, 0.1), table, strict=True):
        for weights in lobes.sampling(BlinnPhong(normalization=normalization), p, mu):
            value, error = lobes.mean(weights)
            assert want is None or value == pytest.approx(want, abs=4 * error + 5e-4)
            assert error < 2e-3


@pytest.mark.parametrize("n", [0.0, 0.5, 1.0, 10.0, 300.0])
def test_exact_reflects_all_at_normal_incidence(n: float) -> None:
    """And no more elsewhere: the integral of ``cos_h^n cos_o`` there is 1 / N, with cos_h^2 = (1 + cos_o) / 2."""
    vector = VECTORS["float64"]
    p = lobes.white(vector, exponent=vector(n).x)
    model = BlinnPhong()
    z = (np.arange(100_000) + 0.5) / 100_000
    wo = vector(np.sqrt(1 - z * z), 0, z)
    albedo = 2 * np.pi * np.mean(to_numpy(model.f(p, vector(0, 0, 1), wo)[1].x) * z)
    assert albedo == pytest.approx(1, abs=1e-7)
    for mu in (0.9, 0.5, 0.1, 0.01, 1.7e-3):
        value, error = lobes.mean(lobes.sampling(model, p, mu)[0])
        assert value <= 1 + 4 * error


@pytest.mark.parametrize("normalization", KINDS)
@pytest.mark.parametrize("n", [0.0, 1.0, 30.0, 1000.0])
@pytest.mark.parametrize("mu", [1.0, 0.7, 0.1, 0.01])
def test_weights(mu: float, n: float, normalization: str) -> None:
    """Bounded as the model says, and steadier than the cosine's where the lobe is sharp."""
    vector = VECTORS["float64"]
    p = lobes.white(vector, exponent=vector(n).x)
    own, plain = lobes.sampling(BlinnPhong(normalization=normalization), p, mu)
    lobes.report(f"blinnphong {normalization} n {n:g} mu {mu:g}", own, plain)
    scale = (n + 4) / (n + 2 ** (-n / 2)) if normalization == "exact" else (n + 8) / (n + 2)
    assert own.max() <= scale * (1 + 1e-12)
    if n >= 30 and mu > 0.01:
        assert own.var() < 0.5 * plain.var()


@pytest.mark.parametrize("kind", WIDE)
def test_density_and_directions(kind: str) -> None:
    """Unit directions; at normal incidence the half vector's 1 - cos has the mean 1 / (n + 3) of ``cos^(n + 1)``."""
    vector = VECTORS[kind]
    model, count = BlinnPhong(), 1 << 16
    u = vector(*np.random.default_rng(9).random((3, count)).astype(np.float32))
    for n in (0.0, 30.0, 1e4, 1e6):
        p = lobes.white(vector, exponent=vector(n).x)
        wo = to_numpy(model.sample(p, vector(0, 0, 1), u, 1))
        np.testing.assert_allclose(np.linalg.norm(wo, axis=0), 1, atol=8 * EPS[kind])
        side = np.hypot(wo[0], wo[1])
        away = 2 * np.sin(np.arctan2(side, wo[2]) / 4) ** 2  # 1 - cos of half the angle
        assert away.mean() == pytest.approx(1 / (n + 3), rel=5 / np.sqrt(count) + 1e-6)


def test_lobes_and_tint() -> None:
    vector = VECTORS["float64"]
    wi, wo = vector(0.6, 0, 0.8), vector(-0.28, 0, 0.96)
    p = defaults(BlinnPhong(), vector, diffuse_reflectance=(0.1, 0.2, 0.4), specular_reflectance=(1.0, 0.5, 0.25))
    diffuse, glossy = (to_numpy(lobe).ravel() for lobe in BlinnPhong(normalization="common").f(p, wi, wo))
    np.testing.assert_allclose(diffuse, np.array([0.1, 0.2, 0.4]) / np.pi, rtol=1e-15)
    # h = (.32, 0, 1.76): cos^2 = 3.0976 / 3.2, to half the default power of 30, times (30 + 8) / (8 pi).
    np.testing.assert_allclose(glossy, np.array([1, 0.5, 0.25]) * 38 / (8 * np.pi) * (3.0976 / 3.2) ** 15, rtol=1e-13)


def test_exponent_of_zero() -> None:
    """At its bound, the lobe is 1 / pi everywhere (exact)."""
    wi, wo = directions.hemisphere(500, 1), directions.hemisphere(500, 2)
    got = call(lobes.glossy(BlinnPhong(), ["exponent"]), VECTORS["float64"], wi, wo, np.zeros(500))
    np.testing.assert_allclose(got, 1 / np.pi, rtol=1e-15)


@pytest.mark.parametrize("normalization", KINDS)
@pytest.mark.parametrize("kind", WIDE)
def test_hostile_inputs(kind: str, normalization: str) -> None:
    model = BlinnPhong(normalization=normalization)
    lobes.nothing_below_the_horizon(model, kind, exponent=20.0)
    lobes.finite_everywhere(model, kind, exponent=(0.0, 1e-6, 30.0, 1e6))


def test_faults() -> None:
    assert set(BlinnPhong().faults()) == {"coupling", "peak"}
    assert set(BlinnPhong(normalization="common").faults()) == {"energy", "coupling", "peak"}


def test_energy_of_the_trials() -> None:
    """One shows that the common normalisation reflects too much."""
    vector = VECTORS["float64"]
    found = []
    for trial in BlinnPhong.trials:
        p = defaults(BlinnPhong(normalization="common"), vector, **{**trial, "diffuse_reflectance": 0.0})
        value, error = lobes.mean(lobes.sampling(BlinnPhong(normalization="common"), p, 1.0)[0])
        found.append(value > 1 + 5 * error)
    assert any(found)
