"""Declaration of one parameter of a reflection model: what it is, what it may be, how a fit moves it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .errors import UsageError

Kind = Literal["number", "colour", "choice"]
Scale = Literal["linear", "log", "log_minus_one", "logit"]
Array = npt.NDArray[np.float64]

#: A free variable is kept this far inside an end of a ``logit`` range, where the transform is infinite.
LOGIT_MARGIN = 1e-6


@dataclass(frozen=True)
class Param:
    """One parameter of a model. Make it with `number`, `colour` or `choice`.

    Attributes
    ----------
    name : str
        As in XML, in Python and on the command line.
    default : float, tuple of 3 floats, or str
        A number, a linear RGB colour, or one of `options`.
    bounds : (float, float)
        Smallest and largest value allowed, both included; for each component of a colour.
    unit : str
        ``"1"`` for a pure number, else as printed: ``"rad"``, ``"1/mm"``.
    scale : {"linear", "log", "log_minus_one", "logit"}
        The coordinate in which a fit takes its steps.
    meaning : str
        One line for the tables.
    kind : {"number", "colour", "choice"}
    options : tuple of str
        What a choice may be.
    hint : str
        Ends the message for a value outside the bounds: what people confuse it with.
    """

    name: str
    default: Any
    bounds: tuple[float, float] = (0.0, math.inf)
    unit: str = "1"
    scale: Scale = "linear"
    meaning: str = ""
    kind: Kind = "number"
    options: tuple[str, ...] = ()
    hint: str = ""

    def check(self, owner: str, value: Any) -> None:
        """Raise `UsageError` unless `value` is allowed.

        Parameters
        ----------
        owner : str
            Named first in the message: the model, or the id of a material in a scene.
        value : float, sequence of floats, or str
        """
        if self.kind == "choice":
            if value not in self.options:
                raise UsageError(f"{owner}: {self.name} = {value!r} is not one of {', '.join(self.options)}.")
            return
        if isinstance(value, str):
            raise UsageError(
                f"{owner}: {self.name} = {value!r} is text. It takes a {self.kind} in {self.range_text()}."
            )
        components = np.atleast_1d(np.asarray(value, dtype=float))
        low, high = (single(b) for b in self.bounds)
        inside = (
            (single(components) >= low) & (single(components) <= high) & np.isfinite(components)
        )  # NaN fails as well
        bad = components[~inside]
        if bad.size:
            shown = f"{bad[0]:.9g}"
            hint = f" {self.hint}" if self.hint else ""
            raise UsageError(f"{owner}: {self.name} = {shown} is outside {self.range_text()}.{hint}")

    def range_text(self) -> str:
        """The allowed range as text: ``[1e-4, 1.5]``."""
        if self.kind == "choice":
            return " | ".join(self.options)
        low, high = (tidy(b) for b in self.bounds)
        return f"[{low}, {high}{')' if math.isinf(self.bounds[1]) else ']'}"

    def to_free(self, value: npt.ArrayLike) -> Array:
        """The coordinate of a fit: ``x = value``, ``log(value)``, ``log(value - 1)`` or ``log(v / (1 - v))``.

        Values are moved to the nearest point where the transform is finite.
        """
        v = np.clip(np.asarray(value, dtype=float), *self.interior())
        match self.scale:
            case "linear":
                return v
            case "log":
                return np.log(v)
            case "log_minus_one":
                return np.log(v - 1.0)
            case "logit":
                t = (v - self.bounds[0]) / (self.bounds[1] - self.bounds[0])
                return np.log(t / (1.0 - t))

    def to_value(self, x: npt.ArrayLike) -> Array:
        """The inverse of `to_free`."""
        x = np.asarray(x, dtype=float)
        match self.scale:
            case "linear":
                return x
            case "log":
                return np.exp(x)
            case "log_minus_one":
                return 1.0 + np.exp(x)
            case "logit":
                return self.bounds[0] + (self.bounds[1] - self.bounds[0]) / (1.0 + np.exp(-x))

    def slope(self, x: npt.ArrayLike) -> Array:
        """``d value / d x``, for the chain rule and for error bars."""
        x = np.asarray(x, dtype=float)
        match self.scale:
            case "linear":
                return np.ones_like(x)
            case "log":
                return np.exp(x)
            case "log_minus_one":
                return np.exp(x)
            case "logit":
                e = np.exp(-np.abs(x))
                return (self.bounds[1] - self.bounds[0]) * e / (1.0 + e) ** 2

    def interior(self) -> tuple[float, float]:
        """The bounds a fit keeps to: those declared, less what the transform cannot reach."""
        low, high = self.bounds
        if self.scale == "logit":
            margin = LOGIT_MARGIN * (high - low)
            return low + margin, high - margin
        if self.scale == "log" and low <= 0.0:
            return 1e-12 * (high if math.isfinite(high) else 1.0), high
        if self.scale == "log_minus_one" and low <= 1.0:
            return 1.0 + 2.0**-20, high
        return low, high


def number(
    name: str,
    default: float,
    bounds: tuple[float, float],
    meaning: str,
    *,
    scale: Scale = "linear",
    unit: str = "1",
    hint: str = "",
) -> Param:
    """A real parameter."""
    return Param(name, float(default), bounds, unit, scale, meaning, "number", (), hint)


def colour(
    name: str,
    default: float | Sequence[float],
    meaning: str,
    *,
    bounds: tuple[float, float] = (0.0, 1.0),
    scale: Scale = "logit",
    unit: str = "1",
    hint: str = "",
) -> Param:
    """A reflectance or another spectral quantity: a number, linear RGB, or a spectrum."""
    rgb = (float(default),) * 3 if isinstance(default, int | float) else tuple(float(c) for c in default)
    return Param(name, rgb, bounds, unit, scale, meaning, "colour", (), hint)


def choice(name: str, options: Sequence[str], meaning: str) -> Param:
    """One of a few words; the first is the default."""
    return Param(name, options[0], meaning=meaning, kind="choice", options=tuple(options))


def single(value: npt.ArrayLike) -> Any:
    """`value` rounded to float32: a bound admits the float32 next to it, which is what a scene stores."""
    return np.asarray(value, dtype=np.float32)


def tidy(value: float) -> str:
    """A bound as people write it: ``1e-4``, not ``0.0001``."""
    if value == 0 or 1e-3 <= abs(value) < 1e6 or math.isinf(value):
        return f"{value:.7g}"
    digits, exponent = f"{value:.6e}".split("e")
    return f"{digits.rstrip('0').rstrip('.')}e{int(exponent)}"
