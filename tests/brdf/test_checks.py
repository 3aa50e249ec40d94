"""The checks find what is wrong, and pass what is right."""

from __future__ import annotations

from typing import Any

import drjit as dr
import drjit.llvm.ad as wide
import numpy as np
import pytest

from brdf import builtin, defaults, evaluate
from brdf.checks.energy import albedo, cosine_weight, lobe_weight, stratified
from brdf.checks.reciprocity import reciprocity
from brdf.models.cooktorrance import CookTorrance
from tests.oracles import directions

VECTORS = [wide.Array3f, wide.Array3f64]
WI, WO = directions.hemisphere(500, 1), directions.hemisphere(500, 2)


@pytest.mark.parametrize("vector", VECTORS)
@pytest.mark.parametrize("model", [m() for m in builtin().values()], ids=lambda m: m.name)
def test_our_models_are_reciprocal_and_conserve_energy(model: Any, vector: Any) -> None:
    """Lambertian and V-cavity with its defaults: exactly 0; albedo below 1."""
    p = defaults(model, vector)
    wi, wo = vector(*WI.T), vector(*WO.T)
    difference, _ = reciprocity(lambda a, b: evaluate(model, p, a, b), wi, wo)
    assert difference == 0
    for mu in (1.0, 0.5, 0.02):
        value, error = albedo(lobe_weight(model, p), mu, vector)
        assert 0 < value < 1 + 3 * error


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
