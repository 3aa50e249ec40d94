"""Quadrature rules against roots and integrals in closed form."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf.models.grooved import POINTS
from brdf.quadrature import even_rule, gauss_legendre
from tests.brdf.arrays import EPS


@pytest.mark.parametrize("n", POINTS)
def test_points_and_weights(n: int) -> None:
    """The roots of Legendre's polynomial, and ``2 / ((1 - x^2) P'(x)^2)``."""
    for x, w in zip(*gauss_legendre(n), strict=True):
        root = mpmath.findroot(lambda t: mpmath.legendre(n, t), mpf(x))
        slope = n * mpmath.legendre(n - 1, root) / (1 - root**2)
        assert x == pytest.approx(float(root), rel=EPS["float64"])
        assert w == pytest.approx(float(2 / ((1 - root**2) * slope**2)), rel=4e-15)


def points(rule: list[tuple[float, ...]], crowded: bool) -> tuple[Any, Any]:
    """Points and weights over the whole interval."""
    x, w, shift, more = np.array(rule).T
    x, w = x + crowded * shift, w + crowded * more
    return np.concatenate([x, -x]), np.concatenate([w, w])


def test_a_lobe_in_the_middle() -> None:
    """``integral of exp(-(x/s)^2) = sqrt(pi) s erf(1/s)``, which as many points of Gauss and Legendre's get worse."""
    s = 0.2
    want = float(mpmath.sqrt(mpmath.pi) * s * mpmath.erf(1 / mpf(s)))
    x, w = points(even_rule(22, 1), False)
    y, v = np.polynomial.legendre.leggauss(22)
    even, gauss = (abs(float(u @ np.exp(-((t / s) ** 2))) - want) for t, u in ((x, w), (y, v)))
    assert even < 0.1 * gauss


@pytest.mark.parametrize(("n", "p", "kind"), [(POINTS[0], 1, "float32"), (POINTS[1], 3, "float64")])
@pytest.mark.parametrize("q", [1.5, 2.5])
def test_a_kink_at_the_ends(n: int, p: int, kind: str, q: float) -> None:
    """``integral of (1 - x^2)^q = sqrt(pi) gamma(q + 1) / gamma(q + 3/2)``, for which the points crowd: to what is rounded
    in the precision that the rule is for, and in adding up here."""
    want = float(mpmath.sqrt(mpmath.pi) * mpmath.gamma(q + 1) / mpmath.gamma(mpf(q) + 1.5))
    both = (points(even_rule(n, p), crowded) for crowded in (False, True))
    plain, crowded = (abs(float(w @ (1 - x * x) ** q) / want - 1) for x, w in both)
    assert crowded <= EPS[kind] / 2 + n * EPS["float64"] / 2 < plain
