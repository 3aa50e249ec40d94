"""Derivatives by differences, with what they are uncertain by."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Steps tried, each smaller by this factor.
STEPS, FACTOR = 7, 1.7
#: The largest step, as a share of the value, or of this where the value is 0.
REACH = 0.05
#: A value nearer to a bound than this share of itself is moved away from it only.
NEAR = 1e-3
#: Points at which the value is looked at to see its rounding, and their distance as a share of the largest step.
PROBES, APART = 3, 2.0**-20


class Step(NamedTuple):
    """The largest step, and the side to which the value may be moved: 0 is both, else +1 or -1."""

    reach: float
    side: int


def step(value: float, bounds: tuple[float, float] = (-math.inf, math.inf)) -> Step:
    """How far `value` may be moved within its bounds."""
    size = REACH * (abs(value) or 1.0)
    down, up = value - bounds[0], bounds[1] - value
    if value == 0 and not math.isfinite(bounds[0]):
        down = 0.0  # of an unknown parameter that is 0, what is less is likely to mean nothing
    if down < NEAR * abs(value) or down == 0:
        return Step(min(size, 0.9 * up), 1)
    if up < NEAR * abs(value) or up == 0:
        return Step(min(size, 0.9 * down), -1)
    return Step(min(size, 0.9 * down, 0.9 * up), 0)


def derivative(value: Callable[[float], Array], size: Step, roundoff: float) -> tuple[Array, Array]:
    """``d value(t) / dt`` at 0 by Ridders' method, entry by entry.

    Differences with ever smaller steps, extrapolated to step 0; of all extrapolations that is taken whose error,
    estimated from its neighbours and from the rounding of the values, is smallest.

    Parameters
    ----------
    value : callable
        Of a step of the parameter: an array.
    size : Step
    roundoff : float
        The relative rounding of the values [1].

    Returns
    -------
    (array, array)
        The derivative, and an estimate of its error.

    References
    ----------
    ridders1982.
    """
    here = value(0.0)
    noise = np.maximum(4 * roundoff * np.abs(here), scatter(value, size, here))
    steps = [size.reach / FACTOR**k for k in range(STEPS)]
    best, error = np.zeros_like(here), np.full_like(here, np.inf)
    rows: list[list[Array]] = []
    with np.errstate(invalid="ignore", over="ignore"):
        for k, h in enumerate(steps):
            ahead, behind = (size.side or 1) * h, 0.0 if size.side else -h
            row = [(value(ahead) - (here if size.side else value(behind))) / (ahead - behind)]
            for j in range(k):
                gain = FACTOR ** ((1 if size.side else 2) * (j + 1)) - 1
                row.append(row[j] + (row[j] - rows[k - 1][j]) / gain)
                off = np.maximum(np.abs(row[-1] - row[j]), np.abs(row[-1] - rows[k - 1][j])) + 2 * noise / h
                better = off < error
                best, error = np.where(better, row[-1], best), np.where(better, off, error)
            rows.append(row)
    return best, error


def scatter(value: Callable[[float], Array], size: Step, here: Array) -> Array:
    """How much the value jumps from one representable parameter to the next: its rounding, whatever it comes from."""
    tiny = APART * size.reach
    points = [here] + [value((size.side or 1) * tiny * (i + 1)) for i in range(PROBES)]
    second = [np.abs(a - 2 * b + c) for a, b, c in zip(points, points[1:], points[2:], strict=False)]
    return np.max(second, axis=0)
