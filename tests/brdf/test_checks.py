"""The checks find what is wrong, and pass what is right."""

from __future__ import annotations

from typing import Any

import drjit as dr
import drjit.llvm.ad as wide
import numpy as np
import pytest

from brdf import Model, UsageError, defaults, evaluate
from brdf.checks import CHECKS, Finding, ModelSubject, Result, check_model, judge
from brdf.checks.differences import Step, derivative, step
from brdf.checks.domain import around, integral
from brdf.checks.energy import albedo, cosine_weight, lobe_weight, stratified
from brdf.checks.reciprocity import reciprocity
from brdf.checks.result import at_least, at_most, not_asked, worst
from brdf.models.cooktorrance import CookTorrance
from tests import toys
from tests.models import named, variations
from tests.oracles import directions

VECTORS = [wide.Array3f, wide.Array3f64]
WI, WO = directions.hemisphere(500, 1), directions.hemisphere(500, 2)


#: Models that take long to compile: tried with the slow tests.
HEAVY = {"grooved"}


@pytest.mark.parametrize(
    "model",
    [pytest.param(m, id=named(m), marks=[pytest.mark.slow] if m.name in HEAVY else []) for m in variations()],
)
def test_every_model_ends_as_it_declares(model: Model) -> None:
    """All checks without a renderer, at all its trials: what is declared to fail does, and nothing else."""
    for name, result in check_model(model).items():
        assert result.expected, (name, result)


@pytest.mark.parametrize("vector", VECTORS)
def test_what_is_not_reciprocal(vector: Any) -> None:
    """``f = wi.z`` differs by ``|wi.z - wo.z| / max``; the pair given is where it differs most."""
    difference, (i, o) = reciprocity(lambda a, b: a.z + 0 * b.z, vector(*WI.T), vector(*WO.T))
    expected = np.abs(WI[:, 2] - WO[:, 2]) / np.maximum(WI[:, 2], WO[:, 2])
    assert difference == pytest.approx(expected.max(), rel=1e-6)
    np.testing.assert_allclose(i, WI[np.argmax(expected)], rtol=1e-6)
    np.testing.assert_allclose(o, WO[np.argmax(expected)], rtol=1e-6)


def test_one_channel_is_enough() -> None:
    vector = wide.Array3f64

    def f(a: Any, b: Any) -> Any:
        return wide.Array3f64(1, 1, 1 + 1e-3 * a.z)

    assert 0 < reciprocity(f, vector(*WI.T), vector(*WO.T))[0] < 1e-3


def test_not_finite_is_not_reciprocal() -> None:
    vector = wide.Array3f
    difference, (i, _) = reciprocity(lambda a, b: dr.select(a.z > 0.999, dr.nan, 1.0), vector(0, 0, 1), vector(*WO.T))
    assert difference == np.inf
    assert i == (0, 0, 1)


def test_floor() -> None:
    """What is far below the peak may be left out, and black is no difference."""
    vector = wide.Array3f64
    wi, wo = vector(*WI.T), vector(*WO.T)

    def f(a: Any, b: Any) -> Any:
        return dr.select(a.z * b.z > 0.5, 1.0, 1e-9 * a.z)

    assert reciprocity(f, wi, wo)[0] > 0.5
    assert reciprocity(f, wi, wo, floor=1e-6)[0] == 0
    assert reciprocity(lambda a, b: 0 * a.z, wi, wo)[0] == 0


@pytest.mark.parametrize("vector", VECTORS)
def test_albedo_of_a_power(vector: Any) -> None:
    """``f = wo.z^2`` reflects 2 pi / 4, in the channel that reflects most."""
    weight = cosine_weight(lambda a, b: vector(0.5, 1, 0.25) * b.z * b.z)
    value, error = albedo(weight, 0.4, vector)
    assert value == pytest.approx(np.pi / 2, abs=4 * error)
    assert 0 < error < 1e-3
    assert albedo(cosine_weight(lambda a, b: vector(0.25)), 0.4, vector) == (pytest.approx(np.pi / 4, rel=1e-6), 0)


@pytest.mark.parametrize(
    ("masking", "table"),
    [("vcavity", [0.9956, 0.9555, 0.9220, 0.9661]), ("smith", [0.9997, 0.9658, 0.9002, 0.9314])],
)
def test_published_albedo(masking: str, table: list[float]) -> None:
    """F = 1, m = .3, mu = 1, .7, .3, .1, with 4 digits; both ways of sampling."""
    vector = wide.Array3f64
    model = CookTorrance(fresnel="constant", masking=masking)
    p = defaults(model, vector, m=0.3, diffuse_reflectance=0.0)
    for mu, want in zip((1.0, 0.7, 0.3, 0.1), table, strict=True):
        for weight in (lobe_weight(model, p), cosine_weight(lambda a, b: evaluate(model, p, a, b))):
            value, error = albedo(weight, mu, vector)
            assert value == pytest.approx(want, abs=4 * error + 1e-4)
            assert error < 0.02


def test_standard_error() -> None:
    """Over many seeds the spread is what is stated."""
    vector = wide.Array3f64
    weight = cosine_weight(lambda a, b: dr.select(b.x > 0.3, 2.0, 0.1))
    runs = np.array([albedo(weight, 1.0, vector, side=16, seed=s) for s in range(60)])
    assert runs[:, 0].std(ddof=1) == pytest.approx(np.sqrt((runs[:, 1] ** 2).mean()), rel=0.35)


def test_too_bright_is_seen() -> None:
    """Nine tenths diffuse under a full Fresnel lobe: more than arrives, at grazing."""
    vector = wide.Array3f
    model = CookTorrance(masking="none")
    value, error = albedo(lobe_weight(model, defaults(model, vector, diffuse_reflectance=0.9)), 0.1, vector)
    assert value > 1 + 5 * error


def test_strata() -> None:
    u = stratified(8, 3, 1).reshape(3, 3, 64)
    assert ((u >= 0) & (u < 1)).all()
    for batch in u.transpose(1, 0, 2):
        assert len({(int(a * 8), int(b * 8)) for a, b in batch[:2].T}) == 64
        assert len({int(c * 64) for c in batch[2]}) == 64


def test_results() -> None:
    """The worst of several; what is declared; and plain values."""
    good, bad = at_most(0.1, 1.0, "no", {"a": 1}), at_most(2.0, 1.0, "too much", {"w": np.array([1.0, np.inf])})
    none = not_asked("nothing there")
    assert (good.passed, good.reason) == (True, "") and not bad.passed
    assert worst([none, good, bad]) is bad and worst([none, good]) is good
    assert not at_most(np.nan, 1.0, "", {}).passed and not at_least(np.nan, 1.0, "", {}).passed
    assert at_most(0.0, 0.0, "", {}).passed and not at_most(1.0, 0.0, "", {}).passed
    assert at_least(0.3, 0.1, "", {}).passed and not at_least(0.05, 0.1, "", {}).passed

    result = judge("energy", [good, bad])
    assert (result.passed, result.expected, result.reason) == (False, False, "too much")
    assert result.as_dict() == {
        "passed": False, "expected": False, "figure": 2.0, "limit": 1.0, "reason": "too much", "case": {"w": [1.0, None]},
    }  # fmt: skip
    declared = judge("energy", [bad], "it is bright")
    assert (declared.expected, declared.reason, declared.case["found"]) == (True, "it is bright", "too much")
    undue = judge("energy", [good], "it is bright")
    assert undue.passed and not undue.expected and "it is bright" in undue.reason
    assert judge("energy", [good], "it is bright", must_occur=False).expected
    assert isinstance(none, Finding) and isinstance(undue, Result) and "energy" in CHECKS


def test_check_model() -> None:
    found = check_model(toys.Paper)
    assert all(r.passed and r.expected for r in found.values())
    assert found["energy"].figure == pytest.approx(0.4, abs=1e-9)
    assert found["coupling"].figure == pytest.approx(0.9, abs=0.002)
    assert check_model(toys.Paper, {"reflectance": 0.6}, only=["energy"])["energy"].figure == pytest.approx(0.6)
    with pytest.raises(UsageError, match=r"^there is no check 'gradient_path'"):
        check_model(toys.Paper, only=["gradient_path"])


def test_differences() -> None:
    """Of a smooth function to many digits, with an error that covers; within the bounds; and of a noisy one."""
    x = np.linspace(0.5, 3, 50)
    value, error = derivative(lambda t: np.sin(3 * (x + t)), Step(0.05, 0), 2.0**-53)
    assert np.abs(value - 3 * np.cos(3 * x)).max() < 1e-9
    assert (np.abs(value - 3 * np.cos(3 * x)) <= 3 * error).all()
    value, error = derivative(lambda t: np.sqrt(x + t), Step(0.05, 1), 2.0**-53)
    np.testing.assert_allclose(value, 0.5 / np.sqrt(x), rtol=1e-6)
    value, error = derivative(lambda t: np.float32(1000 + np.sin(x + t)).astype(float), Step(0.05, 0), 2.0**-24)
    assert (np.abs(value - np.cos(x)) <= 3 * error).all()
    assert step(0.5, (0.0, 1.0)) == Step(0.025, 0)
    assert step(1.0, (0.0, 1.0)).side == -1 and step(0.0, (0.0, 1.0)).side == 1 and step(0.0).side == 1
    assert step(1e-3, (1e-4, 1.0)).reach < 9e-4


@pytest.mark.parametrize("m", [1e-3, 0.1, 1.0])
def test_a_domain_holds_a_lobe(m: float) -> None:
    """There and back again; the sphere's solid angle; and the density of a lobe however sharp."""
    subject = ModelSubject(CookTorrance(), m=m)
    vector = subject.vector
    wi = directions.unit(0.4, 0.3)
    (domain,) = around(subject, wi, 1)
    x, y = dr.meshgrid(*(dr.linspace(wide.Float64, -0.99, 0.99, 50) for _ in range(2)))
    again = domain.point(domain.direction(x, y))
    assert dr.max(abs(again[0] - x) + abs(again[1] - y))[0] < 1e-6
    if m == 1.0:  # a sharp lobe leaves few points for the rest of the sphere
        total, _ = integral(lambda w: 1 + 0 * w.z, [domain], vector)
        assert total[0] == pytest.approx(4 * np.pi, rel=0.02)
    given = vector(*wi.tolist())
    total, change = integral(lambda w: subject.pdf(given, w, 1), [domain], vector)
    lost = (np.asarray(subject.draw(given, vector(np.random.default_rng(1).random((3, 1 << 16))), 1).pdf) == 0).mean()
    assert total[0] + lost == pytest.approx(1, abs=0.01 + change)
