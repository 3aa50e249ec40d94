"""The lobes of Phong, Blinn, Ward, and Kajiya and Kay as their papers print them, in 60 digits.

Directions are triples of any length near 1 (they come rounded). What an angle between two of them means then:
``cos = 2 a.b / (|a|^2 + |b|^2)``; for unit vectors that is the dot product. Half vectors are used by their slopes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mpmath
from mpmath import mp, mpf

mp.dps = 60

Vector = Sequence[Any]


def phong_cosine(wi: Vector, wo: Vector) -> list[Any]:
    """Between wo and the mirror direction of wi: the terms of its sum, each of which carries a rounding."""
    return cosine((-wi[0], -wi[1], wi[2]), wo)


def cone_cosine(wi: Vector, wo: Vector) -> list[Any]:
    """Of the angle by which wo misses the cone about the x axis, from the two angles to that axis."""
    return cosine((-wi[0], sine_x(wi)), (wo[0], sine_x(wo)))


def cosine(a: Vector, b: Vector) -> list[Any]:
    return [2 * x * y / (square(a) + square(b)) for x, y in zip(a, b, strict=True)]


def square(a: Vector) -> Any:
    return mpmath.fsum(x * x for x in a)


def sine_x(w: Vector) -> Any:
    return mpmath.sqrt(w[1] ** 2 + w[2] ** 2)


def phong_classic(n: Any, co: Any, *a: Any) -> Any:
    return mpmath.fsum(a) ** n / co


def phong_modified(n: Any, co: Any, *a: Any) -> Any:
    return (n + 2) / (2 * mpmath.pi) * mpmath.fsum(a) ** n


def blinn_exact(n: Any, nh: Any) -> Any:
    return (n + 2) * (n + 4) / (8 * mpmath.pi * (mpf(2) ** (-n / 2) + n)) * nh**n


def blinn_common(n: Any, nh: Any) -> Any:
    return (n + 8) / (8 * mpmath.pi) * nh**n


def ward_gaussian(h: Vector, u: Any, v: Any) -> Any:
    """By the angles of the half vector: Ward's equation 5a, without the cosines."""
    if h[0] == 0 and h[1] == 0:
        return 1 / (4 * mpmath.pi * u * v)
    phi = mpmath.atan2(h[1], h[0])
    delta = mpmath.acos(h[2] / mpmath.sqrt(square(h)))
    spread = mpmath.cos(phi) ** 2 / u**2 + mpmath.sin(phi) ** 2 / v**2
    return mpmath.exp(-(mpmath.tan(delta) ** 2) * spread) / (4 * mpmath.pi * u * v)


WARD: dict[str, Callable[[Vector, Any, Any], Any]] = {
    "ward": lambda h, ci, co: 1 / mpmath.sqrt(ci * co),
    "duer": lambda h, ci, co: 1 / (ci * co),
    "balanced": lambda h, ci, co: 4 * square(h) / h[2] ** 4,
}


class Derivatives(NamedTuple):
    """Of a function of some arguments: its value, its derivative by one of them, and what rounding may do to each.

    ``value_scale = |f| + sum_i |x_i df/dx_i|``, and so for the derivative: in units of a rounding of each argument.
    """

    value: float
    slope: float
    value_scale: float
    slope_scale: float


def derivatives(function: Callable[..., Any], arguments: Sequence[Any], by: int) -> Derivatives:
    """The derivative by argument number `by`, which must not be 0."""
    x = [mpf(a) for a in arguments]
    n = len(x)

    def d(*orders: int) -> Any:
        order = [sum(1 for o in orders if o == i) for i in range(n)]
        return mpmath.diff(function, tuple(x), tuple(order))

    value, slope = function(*x), d(by)
    first = mpmath.fsum(abs(x[i] * d(i)) for i in range(n) if x[i])
    second = mpmath.fsum(abs(x[i] * d(by, i)) for i in range(n) if x[i])
    return Derivatives(
        *(float(q) for q in (value, slope, abs(value) + first, abs(slope) + second + abs(value / x[by])))
    )
