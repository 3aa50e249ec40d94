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

    h = [abs(v) * STEP if v else STEP_AT_ZERO for v in x]
    f, n = at(), range(len(x))
    one = [at(i) for i in n]
    d = [(one[i] - f) / h[i] for i in n]
    value_scale = abs(f) + mpmath.fsum(abs(x[i] * d[i]) for i in n)
    slopes, scales = [], []
    for p in by:
        moves = [abs(x[i] * (at(p, i) - one[p] - one[i] + f) / (h[p] * h[i])) for i in n if x[i]]
        slope = d[p]
        if not x[p] and abs(2 * (at(p, part=mpf(1) / 2) - f) / h[p]) < 0.75 * abs(slope):
            slope = mpf(0)  # it shrinks with its step: that is all it is
        slopes.append(slope)
        about = abs(f / x[p]) if x[p] else mpf(0)
        # A derivative that is 0 at 0 is known: the steps that are left in its moves are not.
        scales.append(abs(slope) + mpmath.fsum(moves) + about if x[p] or slope else mpf(0))
    return Jet(f, value_scale, slopes, scales)
