"""Rough diffuse surfaces as their authors print them, by angles, in 60 digits; shares no code with brdf."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mpmath
from mpmath import mp, mpf

mp.dps = 60

Vector = Sequence[Any]


def angles(wi: Vector, wo: Vector) -> tuple[Any, Any, Any]:
    """The two angles from the normal, and the azimuth between the directions, which may be of any length."""
    i, o = ([mpf(c) for c in w] for w in (wi, wo))
    theta_i, theta_o = (mpmath.atan2(mpmath.hypot(w[0], w[1]), w[2]) for w in (i, o))
    return theta_i, theta_o, mpmath.atan2(i[1], i[0]) - mpmath.atan2(o[1], o[0])


def orennayar(variant: str, wi: Vector, wo: Vector, reflectance: Any, sigma: Any) -> Any:
    theta_i, theta_o, phi = angles(wi, wo)
    alpha, beta, pi = max(theta_i, theta_o), min(theta_i, theta_o), mpmath.pi
    c: Any = mpmath.cos(phi)
    # The printed decimals as they are, not as the float64 next to them.
    half, c1, c2, c3, double = mpf("0.5"), mpf("0.33"), mpf("0.09"), mpf("0.125"), mpf("0.13")
    s2 = sigma**2
    first = 1 - half * s2 / (s2 + c1)
    second = mpf("0.45") * s2 / (s2 + c2)
    if variant == "fast":
        return reflectance / pi * (first + second * max(c, 0) * mpmath.sin(alpha) * mpmath.tan(beta))
    second *= mpmath.sin(alpha) - ((2 * beta / pi) ** 3 if c < 0 else 0)
    third = c3 * s2 / (s2 + c2) * (4 * alpha * beta / pi**2) ** 2
    once = first + c * second * mpmath.tan(beta) + (1 - abs(c)) * third * mpmath.tan((alpha + beta) / 2)
    twice = mpf("0.17") * s2 / (s2 + double) * (1 - c * (2 * beta / pi) ** 2)
    return reflectance / pi * once + reflectance**2 / pi * twice
