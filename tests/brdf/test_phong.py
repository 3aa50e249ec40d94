"""Phong: value, gradient and sampling against the textbook in 60 digits, and the faults of the classic form."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
import pytest
from mpmath import mpf

from brdf import UsageError, defaults, evaluate
from brdf.checks.energy import albedo, cosine_weight
from brdf.checks.reciprocity import reciprocity
from brdf.models.phong import Phong
from tests.brdf import lobes
from tests.brdf.arrays import EPS, VECTORS, Array, call, single, to_numpy
from tests.brdf.lobes import WIDE
from tests.oracles import directions
from tests.oracles import lobes as textbook

KINDS = ("classic", "modified")
#: A lobe of this exponent is about as wide as Beckmann facets of roughness sqrt(2 / n) make it.
EXPONENTS = (0.25, 2.0, 22.0, 200.0, 2e4, 5e5)


def grid(exponents: tuple[float, ...] = EXPONENTS, seed: int = 1) -> tuple[Array, Array, Array]:
    wi, wo, m = (single(a)[::2] for a in directions.grid(tuple(np.sqrt(2 / np.array(exponents))), seed))
    return wi, wo, single(2 / m**2)


@pytest.fixture(scope="module")
def oracle() -> dict[str, Any]:
    wi, wo, n = grid()
    made: dict[str, Any] = {"grid": (wi, wo, n)}
    for name, function in (("classic", textbook.phong_classic), ("modified", textbook.phong_modified)):
        made[name] = []
        for i, o, x in zip(wi.tolist(), wo.tolist(), n.tolist(), strict=True):
            i, o = [mpf(c) for c in i], [mpf(c) for c in o]
            a = textbook.phong_cosine(i, o)
            made[name].append(textbook.derivatives(function, (x, o[2], *a), 0) if sum(a) > 0 else None)
    return made


@pytest.mark.parametrize("normalization", KINDS)
@pytest.mark.parametrize("kind", WIDE)
def test_value_and_gradient(kind: str, normalization: str, oracle: dict[str, Any]) -> None:
    wi, wo, n = oracle["grid"]
    value, slope = lobes.holds(
        Phong(normalization=normalization), ["exponent"], 0, kind, wi, wo, [n], oracle[normalization]
    )
    assert value < 3
    assert slope < 2


@pytest.mark.parametrize("normalization", KINDS)
def test_gradient_is_the_central_difference(normalization: str) -> None:
    wi, wo, n = grid((0.5, 5.0, 50.0), seed=3)
    lobes.against_differences(Phong(normalization=normalization), ["exponent"], 0, wi, wo, [n])


@pytest.mark.parametrize("kind", VECTORS)
def test_modified_is_reciprocal_bit_for_bit(kind: str, oracle: dict[str, Any]) -> None:
    wi, wo, n = oracle["grid"]
    lobes.symmetric(Phong(normalization="modified"), ["exponent"], kind, wi, wo, [n])


def test_classic_is_not_reciprocal() -> None:
    """``f(wi, wo) / f(wo, wi) = cos_i / cos_o``, here .5 / .9, so that the difference is at least 1 - 5/9."""
    vector = VECTORS["float64"]
    p = lobes.white(vector, exponent=vector(30).x)
    wi, wo = (vector(*directions.unit(*w).tolist()) for w in ((0.5, 0.0), (0.9, 3.0)))
    f = [to_numpy(evaluate(Phong(), p, a, b).x)[0] for a, b in ((wi, wo), (wo, wi))]
    assert f[0] / f[1] == pytest.approx(0.5 / 0.9, rel=1e-14)
    assert reciprocity(lambda a, b: evaluate(Phong(), p, a, b), wi, wo)[0] == pytest.approx(1 - 5 / 9, rel=1e-13)


@pytest.mark.parametrize("n", [1.0, 30.0, 1e4])
@pytest.mark.parametrize("mu", [1.0, 0.7, 0.1, 0.01])
def test_classic_is_seen_as_phong_shades(mu: float, n: float) -> None:
    """``f cos_o = a^n``: 1 in the mirror direction whatever the incidence, and nowhere more."""
    vector = VECTORS["float64"]
    p = lobes.white(vector, exponent=vector(n).x)
    wi = directions.unit(mu, 0.5)
    wo = np.concatenate([[wi * [-1, -1, 1]], directions.hemisphere(2000, 4)])
    seen = to_numpy(evaluate(Phong(), p, vector(*wi.tolist()), vector(*wo.T)).x) * wo[:, 2]
    a = wo @ (wi * [-1, -1, 1])
    np.testing.assert_allclose(seen, np.where(a > 0, np.maximum(a, 0) ** n, 0), rtol=1e-14 * (1 + n), atol=1e-15)
    assert seen[0] == pytest.approx(1, rel=1e-14)
    assert np.argmax(seen) == 0


@pytest.mark.parametrize("n", [0.0, 1.0, 30.0, 1000.0])
def test_classic_albedo(n: float) -> None:
    """``2 pi / (n + 1)`` at normal incidence: pi for n = 1, more than arrives. By its own sampling, and by the cosine."""
    vector = VECTORS["float64"]
    own, plain = lobes.sampling(Phong(), lobes.white(vector, exponent=vector(n).x), 1.0)
    np.testing.assert_allclose(own, 2 * np.pi / (n + 1), rtol=1e-12)
    value, error = lobes.mean(plain)
    assert value == pytest.approx(2 * np.pi / (n + 1), abs=4 * error + 1e-3)


@pytest.mark.parametrize(
    ("n", "table"),
    [
        (1.0, [1, 0.7501, 0.4827, 0.3699]),
        (10.0, [1, 0.7003, 0.3253, 0.1792]),
        (50.0, [1, 0.7000, 0.3007, 0.1196]),
    ],
)
def test_modified_albedo(n: float, table: list[float]) -> None:
    """mu = 1, .7, .3, .1: quadrature of the formula, 4 digits, in float64, by other code."""
    vector = VECTORS["float64"]
    p = lobes.white(vector, exponent=vector(n).x)
    for mu, want in zip((1.0, 0.7, 0.3, 0.1), table, strict=True):
        for weights in lobes.sampling(Phong(normalization="modified"), p, mu):
            value, error = lobes.mean(weights)
            assert value == pytest.approx(want, abs=4 * error + 1e-4)
            assert error < 2e-3


@pytest.mark.parametrize("normalization", KINDS)
@pytest.mark.parametrize("n", [0.0, 1.0, 30.0, 1000.0])
@pytest.mark.parametrize("mu", [1.0, 0.7, 0.1, 0.01])
def test_weights(mu: float, n: float, normalization: str) -> None:
    """Bounded as the model says, and steadier than the cosine's where the lobe is sharp."""
    vector = VECTORS["float64"]
    p = lobes.white(vector, exponent=vector(n).x)
    own, plain = lobes.sampling(Phong(normalization=normalization), p, mu)
    lobes.report(f"phong {normalization} n {n:g} mu {mu:g}", own, plain)
    bound = 2 * np.pi / (n + 1) if normalization == "classic" else (n + 2) / (n + 1)
    assert own.max() <= bound * (1 + 1e-12)
    if n >= 30:
        assert own.var() < 0.5 * plain.var()


@pytest.mark.parametrize("kind", WIDE)
def test_density_and_directions(kind: str) -> None:
    """Unit directions, distributed about the mirror direction: the mean cosine to it is (n + 1) / (n + 2)."""
    vector = VECTORS[kind]
    model, count = Phong(), 1 << 16
    u = vector(*np.random.default_rng(9).random((3, count)).astype(np.float32))
    for n in (0.0, 30.0, 1e4, 1e6):
        wi = directions.unit(0.7, 1.0)
        p = lobes.white(vector, exponent=vector(n).x)
        wo = to_numpy(model.sample(p, vector(*wi.tolist()), u, 1))
        np.testing.assert_allclose(np.linalg.norm(wo, axis=0), 1, atol=8 * EPS[kind])
        away = np.sum((wo - (wi * [-1, -1, 1])[:, None]) ** 2, axis=0) / 2  # 1 - cos
        sd = np.sqrt((n + 1) / (n + 3)) / (n + 2)
        assert away.mean() == pytest.approx(1 / (n + 2), abs=5 * sd / np.sqrt(count) + 1e-6 / (n + 2))


def test_lobes_and_tint() -> None:
    vector = VECTORS["float64"]
    wi, wo = vector(0.6, 0, 0.8), vector(-0.28, 0, 0.96)
    p = defaults(Phong(), vector, diffuse_reflectance=(0.1, 0.2, 0.4), specular_reflectance=(1.0, 0.5, 0.25))
    diffuse, glossy = (to_numpy(lobe).ravel() for lobe in Phong().f(p, wi, wo))
    np.testing.assert_allclose(diffuse, np.array([0.1, 0.2, 0.4]) / np.pi, rtol=1e-15)
    # a = .6 * .28 + .8 * .96 = .936, to the default power of 30, over cos_o = .96
    np.testing.assert_allclose(glossy, np.array([1, 0.5, 0.25]) * 0.936**30 / 0.96, rtol=1e-13)


@pytest.mark.parametrize("n", [0.0, 1e-3])
def test_flat(n: float) -> None:
    """An exponent of 0, at its bound, is a lobe of constant 1 as far as 90 degrees from the mirror direction."""
    wi, wo = directions.hemisphere(500, 1), directions.hemisphere(500, 2)
    a = np.sum(wo * wi * [-1, -1, 1], axis=1)
    got = call(lobes.glossy(Phong(normalization="modified"), ["exponent"]), VECTORS["float64"], wi, wo, np.full(500, n))
    np.testing.assert_allclose(got, np.where(a > 0, (n + 2) / (2 * np.pi) * np.abs(a) ** n, 0), rtol=1e-12)
    with pytest.raises(UsageError, match=r"^phong: exponent = -1 is outside \[0, 1e6\]"):
        defaults(Phong(), VECTORS["float32"], exponent=-1.0)


@pytest.mark.parametrize("normalization", KINDS)
@pytest.mark.parametrize("kind", WIDE)
def test_hostile_inputs(kind: str, normalization: str) -> None:
    model = Phong(normalization=normalization)
    lobes.nothing_below_the_horizon(model, kind, exponent=20.0)
    lobes.finite_everywhere(model, kind, exponent=(0.0, 1e-6, 30.0, 1e6))


@pytest.mark.parametrize("kind", WIDE)
def test_what_is_not_a_number_is_not_taken_for_dark(kind: str) -> None:
    """A direction with a NaN in it gives NaN, as elsewhere: the lobe does not end there."""
    vector = VECTORS[kind]
    model = Phong(normalization="modified")
    for wi, wo in ((vector(np.nan, 0, 1), vector(0, 0, 1)), (vector(0, 0, 1), vector(0, np.nan, 1))):
        dr.make_opaque(wi, wo)  # of constants, Dr.Jit takes 0 times NaN for 0
        assert np.isnan(to_numpy(evaluate(model, defaults(model, vector), wi, wo))).all()


def test_faults() -> None:
    assert set(Phong().faults()) == {"reciprocity", "energy", "coupling", "peak"}
    assert set(Phong(normalization="modified").faults()) == {"coupling", "peak"}


def test_energy_of_the_trials() -> None:
    """The trial of exponent 1 shows it: pi. That of 30 does not: 2 pi / 31."""
    vector = VECTORS["float64"]
    for trial, want in ((Phong.trials[1], np.pi), (Phong.trials[2], 2 * np.pi / 31)):
        p = defaults(Phong(), vector, diffuse_reflectance=0.0, **trial)
        value, error = albedo(cosine_weight(lambda a, b, p=p: evaluate(Phong(), p, a, b)), 1.0, vector)
        assert value == pytest.approx(want, abs=4 * error)
