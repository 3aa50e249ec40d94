"""Elementary functions that Dr.Jit lacks, accurate where the plain expression is not, in value and in gradient."""

from __future__ import annotations

from typing import Any

import drjit as dr


def log1p(x: Any) -> Any:
    """``log(1 + x)`` to a few roundings for small `x` (Kahan: ``log(u) x / (u - 1)`` with ``u = 1 + x`` rounded)."""
    u = 1 + x
    d = u - 1
    exact = dr.detach(d) == 0
    value = dr.select(exact, x, dr.log(u) * (x / dr.select(exact, 1, d)))
    return with_gradient(value, dr.log(u))


def expm1(x: Any) -> Any:
    """``exp(x) - 1`` to a few roundings for small `x`: ``2 sinh(x/2) exp(x/2)``."""
    return with_gradient(2 * dr.sinh(x / 2) * dr.exp(x / 2), dr.exp(x))


def with_gradient(value: Any, proxy: Any) -> Any:
    """`value`, with the derivatives of `proxy`."""
    return dr.replace_grad(value, proxy)


def is_double(x: Any) -> bool:
    """Whether `x` is computed in float64: a Dr.Jit float64 array or a Python number."""
    return not dr.is_array_v(x) or dr.type_v(x) == dr.VarType.Float64
