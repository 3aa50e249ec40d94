"""Figures and limits of checks as they are read."""

from __future__ import annotations

import math

from brdf.checks import Result

#: Digits of a figure; more where figure and limit would look the same.
DIGITS, MOST = 3, 10


def pair(result: Result) -> tuple[str, str]:
    """Figure and limit; each empty if there is none."""
    given = [result.figure, result.limit]
    if None in given:
        return number(result.figure, DIGITS), number(result.limit, DIGITS)
    for digits in range(DIGITS, MOST):
        shown = [number(x, digits) for x in given]
        if shown[0] != shown[1] or given[0] == given[1]:
            break
    return shown[0], shown[1]


def number(x: float | None, digits: int) -> str:
    """``0.123``, ``1.2e-05``, ``infinite``."""
    if x is None:
        return ""
    return f"{x:.{digits}g}" if math.isfinite(x) else "undefined" if math.isnan(x) else "infinite"


def sign(result: Result) -> str:
    """Whether the figure must be at most the limit, or at least."""
    assert result.figure is not None and result.limit is not None
    return "≥" if (result.figure < result.limit) != result.passed and result.figure != result.limit else "≤"


def figure(result: Result) -> str:
    """``1.02``."""
    return pair(result)[0]


def limit(result: Result) -> str:
    """``≤ 1``."""
    return f"{sign(result)} {pair(result)[1]}" if result.figure is not None and result.limit is not None else ""


def comparison(result: Result) -> str:
    """``1.02, limit ≤ 1``."""
    return f"{figure(result)}, allowed {limit(result)}"
