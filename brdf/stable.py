"""Elementary functions that Dr.Jit lacks, accurate where the plain expression is not, in value and in gradient."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr

#: ``2 j / (2 j + 1)!`` from j = 1: the last, for h = 1, is below rounding in float64.
REST_SERIES = tuple(2 * j / math.factorial(2 * j + 1) for j in range(1, 10))


def log1p(x: Any) -> Any:
    """``log(1 + x)`` to a few roundings for small `x` (Kahan: ``log(u) x / (u - 1)`` with ``u = 1 + x`` rounded)."""
    u = 1 + x
    d = u - 1
    exact = dr.detach(d) == 0
    value = dr.select(exact, x, dr.log(u) * (x / dr.select(exact, 1, d)))
    return with_gradient(value, dr.log(u))


def atanh_rest(x: Any) -> Any:
    """``(atanh(x) - x) / x^3`` for `x` in [0, 1), 1/3 at 0.

    With ``h = atanh(x)`` the difference is ``(h cosh h - sinh h) / cosh h``, whose numerator is a series of positive
    terms, ``sum over j of 2 j h^(2 j + 1) / (2 j + 1)!``; above h = 1 the plain difference loses nothing.
    """
    positive = x > 0
    some = dr.select(positive, x, 1e-3)  # any: the limit takes its place
    h = 0.5 * log1p(2 * some / (1 - some))
    h2 = h * h
    series = 0.0
    for term in reversed(REST_SERIES):
        series = series * h2 + term
    ratio = h / some
    small = series * ratio * ratio * ratio * dr.sqrt((1 - some) * (1 + some))
    large = (h - some) / (some * some * some)
    return dr.select(positive, dr.select(h < 1, small, large), 1 / 3)


def with_gradient(value: Any, proxy: Any) -> Any:
    """`value`, with the derivatives of `proxy`."""
    return dr.replace_grad(value, proxy)


def is_double(x: Any) -> bool:
    """Whether `x` is computed in float64: a Dr.Jit float64 array or a Python number."""
    return not dr.is_array_v(x) or dr.type_v(x) == dr.VarType.Float64
