"""Derivatives and condition numbers of a formula written in mpmath, by differences in many digits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mpmath
from mpmath import mpf

DIGITS = 120
#: Step of the differences, relative or, at 0, as it is: what they cut off is beyond float64; what they cancel leaves
#: digits.
STEP, STEP_AT_ZERO = mpf(2) ** -90, mpf(2) ** -180
#: A derivative of this size is one of 0. A step smaller by the other tells what is left of a second derivative, which
#: next to the critical angle is large, from a first.
NOTHING, NEARER = mpf(10) ** -45, mpf(2) ** -20


class Jet(NamedTuple):
    """What `Exact` has of one point: value, its scale, derivatives, and their scales."""

    value: Any
    value_scale: Any
    slope: list[Any]
    slope_scale: list[Any]


def jet(function: Callable[..., Any], x: Sequence[Any], by: Sequence[int]) -> Jet:
    """A function of mpmath numbers `x` with its derivatives by some of them. At 0 they are one-sided.

    Call it with ``mpmath.mp.dps`` at least `DIGITS`.
    """

    def at(*steps: int, part: Any = 1) -> Any:
        moved = list(x)
        for i in steps:
            moved[i] += part * h[i]
        return function(*moved)

    def vanishes(p: int) -> bool:
        """Whether the derivative at 0 is but what its step has left: it shrinks with the step."""
        return abs(d[p]) <= NOTHING or abs(at(p, part=NEARER) - f) < abs(d[p] * h[p] * NEARER) / 2

    h = [abs(v) * STEP if v else STEP_AT_ZERO for v in x]
    f, n = at(), range(len(x))
    one = [at(i) for i in n]
    d = [(one[i] - f) / h[i] for i in n]
    value_scale = abs(f) + mpmath.fsum(abs(x[i] * d[i]) for i in n)
    slopes, scales = [], []
    for p in by:
        moves = [abs(x[i] * (at(p, i) - one[p] - one[i] + f) / (h[p] * h[i])) for i in n if x[i]]
        slopes.append(mpf(0) if not x[p] and vanishes(p) else d[p])
        scales.append(abs(slopes[-1]) + mpmath.fsum(moves) + (abs(f / x[p]) if x[p] else 0))
    return Jet(f, value_scale, slopes, scales)
