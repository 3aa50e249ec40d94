"""What a parameter accepts, what it says to the rest, and the coordinates a fit moves it in."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brdf import Param, UsageError, choice, colour, number
from brdf.models.cooktorrance import CookTorrance

M, ETA, TINT = (next(p for p in CookTorrance.params if p.name == n) for n in ("m", "eta", "specular_reflectance"))
ANGLE = number("angle", 0.1, (-1.0, 1.0), "an angle", unit="rad")
DENSITY = number("density", 2.0, (0.0, math.inf), "a density", unit="1/mm", scale="log")
EXPONENT = number("exponent", 10.0, (1.0, math.inf), "an exponent", scale="log_minus_one")
SHARE = number("share", 0.25, (-2.0, 6.0), "between two ends", scale="logit")
ALL = (M, ETA, TINT, ANGLE, DENSITY, EXPONENT, SHARE)
names = pytest.mark.parametrize("p", ALL, ids=lambda p: p.name)

M_RANGE = "is outside [1e-4, 1.5]. m is the rms slope; an artist's roughness r is m = r**2."


@pytest.mark.parametrize(
    ("p", "value", "message"),
    [
        (M, 1.7, f"cooktorrance: m = 1.7 {M_RANGE}"),
        (M, 0, f"cooktorrance: m = 0 {M_RANGE}"),
        (M, -0.3, f"cooktorrance: m = -0.3 {M_RANGE}"),
        (M, float("nan"), f"cooktorrance: m = nan {M_RANGE}"),
        (M, float("inf"), f"cooktorrance: m = inf {M_RANGE}"),
        (M, [0.1, 0.2, 9.0], f"cooktorrance: m = 9 {M_RANGE}"),
        (M, "rough", "cooktorrance: m = 'rough' is text. It takes a number in [1e-4, 1.5]."),
        (TINT, (0.1, 1.25, 0.2), "cooktorrance: specular_reflectance = 1.25 is outside [0, 1]."),
        (DENSITY, math.inf, "cooktorrance: density = inf is outside [0, inf)."),
        (DENSITY, -1e-9, "cooktorrance: density = -1e-09 is outside [0, inf)."),
        (choice("masking", ("smith", "none"), ""), "nine", "cooktorrance: masking = 'nine' is not one of smith, none."),
        (choice("masking", ("smith", "none"), ""), 3, "cooktorrance: masking = 3 is not one of smith, none."),
    ],
)
def test_messages(p: Param, value: Any, message: str) -> None:
    with pytest.raises(UsageError) as raised:
        p.check("cooktorrance", value)
    assert str(raised.value) == message


@names
def test_bounds_are_allowed(p: Param) -> None:
    """Both ends, as float64 and as the float32 that a scene stores."""
    for bound in p.bounds:
        if math.isfinite(bound):
            p.check("model", bound)
            p.check("model", float(np.float32(bound)))
    p.check("model", p.default)


@pytest.mark.parametrize("p", [M, ETA, SHARE], ids=lambda p: p.name)
def test_bounds_are_bounds(p: Param) -> None:
    """The float32 beyond either end is not allowed."""
    for bound, away in zip(p.bounds, (-math.inf, math.inf), strict=True):
        with pytest.raises(UsageError):
            p.check("model", float(np.nextafter(np.float32(bound), np.float32(away))))


def test_ranges_as_text() -> None:
    assert M.range_text() == "[1e-4, 1.5]"
    assert DENSITY.range_text() == "[0, inf)"
    assert number("a", 1, (2.5e-4, 1e7), "").range_text() == "[2.5e-4, 1e7]"
    assert number("a", 0, (-1.25e-5, 12.5), "").range_text() == "[-1.25e-5, 12.5]"
    assert choice("a", ("x", "y"), "").range_text() == "x | y"


def test_declarations() -> None:
    assert colour("c", 0.5, "").default == (0.5, 0.5, 0.5)
    assert colour("c", (0.1, 0.2, 0.3), "").default == (0.1, 0.2, 0.3)
    assert choice("c", ("x", "y"), "").default == "x"
    assert ANGLE.unit == "rad"
    assert M.kind == "number" and TINT.kind == "colour"


@pytest.mark.parametrize(
    ("p", "value", "x"),
    [
        (ANGLE, -0.25, -0.25),
        (M, 0.3, math.log(0.3)),
        (ETA, 1.5, math.log(0.5)),
        (TINT, 0.25, math.log(0.25 / 0.75)),
        (SHARE, 0.0, math.log(0.25 / 0.75)),
    ],
)
def test_free_coordinate(p: Param, value: float, x: float) -> None:
    """linear, log v, log(v - 1), logit of the fraction of the way between the bounds."""
    assert p.to_free(value) == pytest.approx(x, rel=1e-14)


@names
@given(t=st.floats(0, 1))
def test_free_and_back(p: Param, t: float) -> None:
    low, high = p.interior()
    value = low + t * (min(high, 100.0) - low)
    assert p.to_value(p.to_free(value)) == pytest.approx(value, rel=1e-9, abs=1e-12)


@names
def test_slope_is_the_central_difference(p: Param) -> None:
    low, high = (float(p.to_free(min(b, 100.0))) for b in p.interior())
    x = np.linspace(low, high, 41)[1:-1]
    h = 1e-5
    quotient = (p.to_value(x + h) - p.to_value(x - h)) / (2 * h)
    np.testing.assert_allclose(p.slope(x), quotient, rtol=1e-5)


@names
def test_ends_are_finite(p: Param) -> None:
    """A start on a bound, or beyond it, becomes a finite coordinate whose value is inside."""
    for bound in p.bounds:
        x = p.to_free(bound if math.isfinite(bound) else 1e30)
        assert np.isfinite(x)
        p.check("model", float(p.to_value(x)))
