"""Elementary functions that Dr.Jit lacks, accurate where the plain expression is not, in value and in gradient."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr


def log1p(x: Any) -> Any:
    """``log(1 + x)`` to a few roundings for small `x` (Kahan: ``log(u) x / (u - 1)`` with ``u = 1 + x`` rounded)."""
    u = 1 + x
    d = u - 1
    exact = dr.detach(d) == 0
    value = dr.select(exact, x, dr.log(u) * (x / dr.select(exact, 1, d)))
    return with_gradient(value, dr.log(u))


def cube_remainder_of_sine(x: Any) -> Any:
    """``(x - sin x) / x^3`` to a few roundings, 1/6 at 0: by its series below 1, where the difference cancels."""
    x2 = x * x
    series = 0.0
    for k in range(8, -1, -1):  # the next term is below 1e-18
        series = series * x2 + (-1) ** k / math.factorial(2 * k + 3)
    small = x2 < 1
    away = dr.select(small, 1, x)
    return dr.select(small, series, (away - dr.sin(away)) / (away * away * away))


def with_gradient(value: Any, proxy: Any) -> Any:
    """`value`, with the derivatives of `proxy`."""
    return dr.replace_grad(value, proxy)


def is_double(x: Any) -> bool:
    """Whether `x` is computed in float64: a Dr.Jit float64 array or a Python number."""
    return not dr.is_array_v(x) or dr.type_v(x) == dr.VarType.Float64
