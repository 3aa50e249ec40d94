"""`grooved` against real cylinders, traced by Mitsuba: values and derivatives, in standard errors."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import plugins
from tests.oracles import directions
from tests.oracles.tracedgrooves import mean_and_error, traced

#: Spacing and height: touching half cylinders, a little apart, sunk in the floor, far apart, and between.
ROWS = ((2.0, 0.0), (2.5, 0.3), (3.0, 0.9), (8.0, 0.1), (5.0, 0.6))
EXPONENTS = (1.0, 10.0, 100.0)
#: Both sides compute in float32: the tracer in angles and in powers of a cosine, one rounding of which counts `exponent`
#: times.
ROUNDING = 4 * 2.0**-24


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def pairs(count: int, seed: int, lowest: float = 0.05) -> tuple[Any, Any]:
    """Directions of uniform cosine; a third of the pairs near the mirror direction about a normal of a cylinder."""
    rng = np.random.default_rng(seed)
    wi, wo = ([directions.unit(rng.uniform(lowest, 1), rng.uniform(0, 2 * np.pi)) for _ in range(count)] for _ in "io")
    for k in range(0, count, 3):
        t = rng.uniform(-1, 1)
        n = np.array([np.sin(t), 0, np.cos(t)])
        near = 2 * (n @ wi[k]) * n - wi[k] + rng.normal(size=3) * 0.1
        near /= np.linalg.norm(near)
        wo[k] = near if near[2] > lowest else wo[k]
    return np.array(wi), np.array(wo)


def material(exponent: float | None, spacing: float, height: float) -> Any:
    """A plugin with one lobe of unit reflectance: Phong's of this exponent, or for None the diffuse one."""
    return mi.load_dict(
        {
            "type": "grooved",
            "spacing": spacing,
            "height": height,
            "exponent": exponent or 1.0,
            "reflectance": float(exponent is None),
            "specular_reflectance": float(exponent is not None),
        }
    )


def f(bsdf: Any, wi: Any, wo: Any) -> mi.Float:
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = mi.Vector3f(wi.T)
    return bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(wo.T)).x / mi.Float(wo[:, 2])


def scores(
    row: tuple[float, float], wi: Any, wo: Any, exponents: tuple[float, ...], samples: int, seed: int
) -> tuple[Any, Any]:
    """Differences in standard errors, shape (1 + exponents, pairs), and the model's values."""
    mean, error = mean_and_error(traced(wi, wo, *row, exponents, samples, seed))
    model = np.array([np.asarray(f(material(e, *row), wi, wo)) for e in (None, *exponents)])
    rounding = ROUNDING * np.array([1.0, *exponents])[:, None] * model
    return (model - mean) / np.sqrt(error**2 + rounding**2 + 1e-9**2), model


@pytest.mark.parametrize("row", ROWS)
def test_the_traced_row(row: tuple[float, float]) -> None:
    """Every pair within 5 standard errors, and all together as standard errors are: about a third of a thousandth."""
    wi, wo = pairs(45, 1)
    z, model = scores(row, wi, wo, EXPONENTS, 256, 2)
    assert np.abs(z).max() < 5
    for lobe, value in zip(z, model, strict=True):
        assert 0.6 < np.sqrt(np.mean(lobe[value > 1e-3] ** 2)) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("row", [*ROWS, (2.0, 0.7), (12.0, 0.0), (20.0, 0.99), (2.2, 0.95)])
def test_the_traced_row_in_detail(row: tuple[float, float]) -> None:
    """More pairs, down to cosines of 0.02, sharper lobes, and a tenth of the standard error."""
    wi, wo = pairs(240, 3, 0.02)
    z, model = scores(row, wi, wo, (*EXPONENTS, 1000.0), 1500, 4)
    assert np.abs(z).max() < 5.5
    for exponent, lobe, value in zip((0.0, *EXPONENTS, 1000.0), z, model, strict=True):
        # In a sharp lobe the allowance for rounding is larger than the standard error.
        assert 0.75 * (exponent < 50) < np.sqrt(np.mean(lobe[value > 1e-3] ** 2)) < 1.25


@pytest.mark.parametrize("name", ["spacing", "height"])
@pytest.mark.parametrize("exponent", [None, 10.0], ids=["diffuse", "phong"])
def test_derivatives_of_the_traced_row(exponent: float | None, name: str) -> None:
    """The ends of what is seen and lit move with both. The difference of traced rows, by the same lines of sight, at a step
    and at half of it: the error of second order is extrapolated away."""
    row = {"spacing": 3.0, "height": 0.4}
    step = 0.01
    wi, wo = pairs(30, 5)
    lobe = 0 if exponent is None else 1
    exponents = () if exponent is None else (exponent,)

    def moved(by: float) -> dict[str, float]:
        return {**row, name: row[name] + by}

    def quotient(by: float) -> Any:
        sides = (moved(s) for s in (-by, by))
        low, high = (traced(wi, wo, r["spacing"], r["height"], exponents, 2048, 6)[lobe] for r in sides)
        return (high - low) / (2 * by)

    mean, error = mean_and_error((4 * quotient(step / 2) - quotient(step)) / 3)
    bsdf = material(exponent, **row)
    params = mi.traverse(bsdf)
    key = f"{name}.value"
    dr.enable_grad(params[key])
    params.update()
    value = f(bsdf, wi, wo)
    dr.forward(params[key])
    slope = np.asarray(dr.grad(value))
    # Where the edge of a shadow passes from the floor to a cylinder there is a kink, and a difference is of both sides.
    sides = [np.asarray(f(material(exponent, **moved(s)), wi, wo)) for s in (-step, step)]
    bend = np.abs(sides[0] + sides[1] - 2 * np.asarray(value)) / (2 * step)
    scale = np.sqrt(error**2 + bend**2 + 1e-9**2)
    off = np.abs(slope - mean) / scale
    assert off.max() < 5
    assert np.sqrt(np.mean(off**2)) < 1.5
    assert (np.abs(slope) > 5 * scale).sum() >= 8
