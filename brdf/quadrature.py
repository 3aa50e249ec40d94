"""Quadrature over an interval: points that are nearly even, or crowd towards ends at which there is a kink."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

import numpy as np

#: The series of arcsin to the ninth power. Gauss and Legendre's points, crowded at the ends, become nearly even by it,
#: as a lobe in the middle needs them, and fewer do.
EVEN = np.polynomial.Polynomial([0, 1, 0, 1 / 6, 0, 3 / 40, 0, 5 / 112, 0, 35 / 1152])


def gauss_legendre(n: int) -> tuple[Any, Any]:
    """Points > 0 and weights of Gauss and Legendre's rule of `n` points, to the last digit.

    NumPy's weights add up, but are off by up to 1e-12, relative, at the ends.
    """
    points, weights = [], []
    for guess in np.polynomial.legendre.leggauss(n)[0][n // 2 :]:
        x, slope = Decimal(float(guess)), Decimal(0)
        for _ in range(2):  # Newton's method, which starts with 16 digits; the second is for the slope
            before, p = Decimal(1), x
            for j in range(2, n + 1):
                before, p = p, ((2 * j - 1) * x * p - (j - 1) * before) / j
            slope = n * (x * p - before) / (x * x - 1)
            x -= p / slope
        points.append(float(x))
        weights.append(float(2 / ((1 - x * x) * slope * slope)))
    return np.array(points), np.array(weights)


def even_rule(n: int, p: int) -> list[tuple[float, ...]]:
    """A rule of `n` points, an even number, for the integral from -1 to 1, symmetric about 0.

    Gauss and Legendre's points, mapped by `EVEN`, and what takes them to the ends: with `shift` and `more` added, a
    power q of the distance from an end is integrated as ``(p + 1) q + p`` is without.

    Parameters
    ----------
    n : int
    p : int
        The points crowd by the integral of ``(1 - x^2)^p`` in place of x.

    Returns
    -------
    list of (x, weight, shift, more)
        For each point ``x > 0``: the weights of all points, those at -x too, add up to 2, and so do ``weight + more``.

    References
    ----------
    hale2008.
    """
    x, w = gauss_legendre(n)
    x, w = EVEN(x) / EVEN(1), w * EVEN.deriv()(x) / EVEN(1)
    crowded = np.polynomial.Polynomial([1, 0, -1]) ** p
    crowded /= crowded.integ()(1)
    return [tuple(map(float, row)) for row in zip(x, w, crowded.integ()(x) - x, w * (crowded(x) - 1), strict=True)]
