"""Elementary functions that Dr.Jit lacks, accurate where the plain expression is not, in value and in gradient."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr

#: (float32, float64) exp(-x) is 0 from here on: a cap that keeps ``0 * inf`` out of its derivative.
EXPONENT_CAP = (400.0, 2980.0)
#: `cosine_integral`: steps of its recurrence, and levels of its continued fraction, that give float64 its last digit.
INTEGRAL_STEPS, INTEGRAL_LEVELS = 6, 6
#: (float32, float64) `mean_decay`: terms whose last, for x = 1/2, is below rounding, and so is that of its derivative.
DECAY_TERMS = (9, 15)
#: ``2 j / (2 j + 1)!`` from j = 1: the last, for h = 1, is below rounding in float64.
REST_SERIES = tuple(2 * j / math.factorial(2 * j + 1) for j in range(1, 10))


def log1p(x: Any) -> Any:
    """``log(1 + x)`` to a few roundings, also for small `x`."""
    return log_near_one(1 + x, x)


def log_near_one(u: Any, x: Any) -> Any:
    """``log(u)`` to a few roundings, where ``u = 1 + x`` is rounded and `x` is not: ``log(u) + (x - (u - 1))``.

    The bracket is exactly what the rounding took. The series has it over `u`: up to ``u = 2`` this makes less than a
    rounding, and beyond the bracket itself does.
    """
    log = dr.log(u)
    return with_gradient(log + dr.select(u < 2, x - (u - 1), 0), log)


def expm1(x: Any) -> Any:
    """``exp(x) - 1`` to a few roundings for small `x`: ``2 sinh(x/2) exp(x/2)``."""
    half = 0.5 * x
    return with_gradient(2 * dr.sinh(half) * dr.exp(half), dr.exp(x))


def cosine_power(near: Any, dot: Any, n: Any) -> Any:
    """``cos^n`` of the angle between two vectors a and b of the same length, however large `n`; 0 from 90 degrees on.

    ``cos = 1 - near / (near + 2 dot)``, so that ``log(cos)`` keeps its accuracy for small angles, where a power of the
    dot product would lose `n` times its rounding. For large angles, where that difference would cancel,
    ``cos = 2 dot / (near + 2 dot)``.

    Parameters
    ----------
    near : float
        ``|a - b|^2``, as a sum of squares.
    dot : float
        ``a.b``, as a sum of products.
    n : float
        The exponent, >= 0 [1].

    Returns
    -------
    float
        In [0, 1]; the same with a and b exchanged, bit for bit. NaN where `dot` or `n` is.
    """
    below = dot <= 0  # not for NaN
    twice = dr.select(below, 1, 2 * dot)
    per = 1 / (near + twice)
    away = near * per
    small = away < 0.5
    cos = dr.select(small, 1 - away, twice * per)
    log = dr.log(cos)
    log = with_gradient(log + dr.select(small, (1 - cos) - away, 0), log)  # as in log1p
    e = dr.maximum(n * log, -EXPONENT_CAP[is_double(dot)])
    return dr.select(below & (n >= 0), 0, dr.exp(e))  # neither holds with NaN, which stays


def cosine_integral(n: Any) -> Any:
    """The integral of ``cos^n`` from -90 to 90 degrees, ``sqrt(pi) gamma((n + 1) / 2) / gamma(n / 2 + 1)``.

    ``W(n) = 2 sqrt(pi / (x + 1 / (2 x + 9 / (2 x + 25 / (2 x + ...)))))`` with ``x = 2 n + 1``, Bauer's continued
    fraction, taken where it converges fast: ``W(n) = (n + 2) / (n + 1) W(n + 2)`` leads there. (A difference of two
    logarithms of gamma loses as many digits as `n` has.)

    Parameters
    ----------
    n : float
        The exponent, >= 0 [1].
    """
    x = 2 * (n + 2 * INTEGRAL_STEPS) + 1
    rest = 2 * x
    for k in range(INTEGRAL_LEVELS, 0, -1):
        rest = 2 * x + (2 * k + 1) ** 2 / rest
    w = 2 * dr.sqrt(dr.pi / (x + 1 / rest))
    for k in range(INTEGRAL_STEPS):
        w *= 1 + 1 / (n + 2 * k + 1)
    return w


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


def cube_remainder_of_sine(x: Any) -> Any:
    """``(x - sin x) / x^3`` to a few roundings, 1/6 at 0: by its series below 1, where the difference cancels."""
    x2 = x * x
    series = 0.0
    for k in range(8, -1, -1):  # the next term is below 1e-18
        series = series * x2 + (-1) ** k / math.factorial(2 * k + 3)
    small = x2 < 1
    away = dr.select(small, 1, x)
    return dr.select(small, series, (away - dr.sin(away)) / (away * away * away))


def mean_decay(x: Any) -> Any:
    """``(1 - exp(-x)) / x``, the mean of exp(-t) for t from 0 to x, for `x` in [0, 1/2], where the difference cancels.

    A series, nested: ``1 - x/2 (1 - x/3 (1 - x/4 (...)))``.
    """
    total: Any = 1.0
    for k in range(DECAY_TERMS[is_double(x)], 0, -1):
        total = 1 - x * (total * (1 / (k + 1)))
    return total


def decay(x: Any) -> Any:
    """``exp(-x)`` for `x` >= 0, however large: its derivative is then 0, never ``0 * inf``."""
    return dr.exp(-dr.minimum(x, EXPONENT_CAP[is_double(x)]))


def with_gradient(value: Any, proxy: Any) -> Any:
    """`value`, with the derivatives of `proxy`."""
    return dr.replace_grad(value, proxy)


def is_double(x: Any) -> bool:
    """Whether `x` is computed in float64: a Dr.Jit float64 array or a Python number."""
    return not dr.is_array_v(x) or dr.type_v(x) == dr.VarType.Float64
