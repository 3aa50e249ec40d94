"""The formulas as books print them, in 60 digits: where a stable form must not differ, and shares no code with it.

Directions are triples of any length near 1 (they come rounded to float32 or float64). What a formula means then:
``h = wi + wo``; ``cos^2`` between light and facet is ``|h|^2 / (|h|^2 + |wi - wo|^2)``; ``v.h = |h|/2`` for the unit half
vector. For unit vectors these are identities.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mpmath
from mpmath import mp, mpf

mp.dps = 60

Vector = Sequence[Any]


class Pair:
    """Angles of a pair of directions: ``nh`` cosine of the half vector, ``vh`` cosine between light and facet."""

    def __init__(self, wi: Vector, wo: Vector) -> None:
        i, o = [mpf(c) for c in wi], [mpf(c) for c in wo]
        h = [a + b for a, b in zip(i, o, strict=True)]
        hh = mpmath.fsum(c * c for c in h)
        dd = mpmath.fsum((a - b) ** 2 for a, b in zip(i, o, strict=True))
        self.i, self.o = i, o
        self.ni, self.no = i[2], o[2]
        self.nh = h[2] / mpmath.sqrt(hh)
        self.vh = mpmath.sqrt(hh / (hh + dd))
        self.half_length = mpmath.sqrt(hh) / 2  # v.h, for the V-cavity


def tan(w: Vector) -> Any:
    """Tangent of the angle from the normal."""
    return mpmath.sqrt(w[0] ** 2 + w[1] ** 2) / w[2]


def beckmann_d(nh: Any, m: Any) -> Any:
    theta = mpmath.acos(nh)
    return mpmath.exp(-((mpmath.tan(theta) / m) ** 2)) / (mpmath.pi * m**2 * mpmath.cos(theta) ** 4)


def beckmann_peak(nh: Any, m: Any) -> Any:
    """`beckmann_d` without its exponential: the scale of its value and of rounding in it."""
    return 1 / (mpmath.pi * m**2 * nh**4)


def ggx_d(nh: Any, m: Any) -> Any:
    """Walter et al. 2007, eq. 33."""
    theta = mpmath.acos(nh)
    return m**2 / (mpmath.pi * mpmath.cos(theta) ** 4 * (m**2 + mpmath.tan(theta) ** 2) ** 2)


def blinn_d(nh: Any, m: Any) -> Any:
    """A power of the cosine, of exponent 2/m^2 - 2."""
    n = 2 / m**2 - 2
    return (n + 2) / (2 * mpmath.pi) * nh**n


def beckmann_d_uv(h: Vector, u: Any, v: Any) -> Any:
    """Of a facet normal of any length, roughness u along x and v along y."""
    x, y = h[0] / h[2], h[1] / h[2]
    return mpmath.exp(-((x / u) ** 2) - (y / v) ** 2) * (1 + x * x + y * y) ** 2 / (mpmath.pi * u * v)


def ggx_d_uv(h: Vector, u: Any, v: Any) -> Any:
    """Heitz 2018, of the unit normal: ``1 / (pi u v ((x/u)^2 + (y/v)^2 + z^2)^2)``."""
    length = mpmath.sqrt(mpmath.fsum(c * c for c in h))
    x, y, z = (c / length for c in h)
    return 1 / (mpmath.pi * u * v * ((x / u) ** 2 + (y / v) ** 2 + z**2) ** 2)


def blinn_d_uv(h: Vector, u: Any, v: Any) -> Any:
    """Ashikhmin and Shirley 2000: exponents n_u and n_v, mixed by azimuth, constant ``sqrt((n_u + 2)(n_v + 2))/(2 pi)``."""
    n_u, n_v = 2 / u**2 - 2, 2 / v**2 - 2
    r2 = h[0] ** 2 + h[1] ** 2
    n = (n_u * h[0] ** 2 + n_v * h[1] ** 2) / r2 if r2 else mpf(0)
    cos = h[2] / mpmath.sqrt(r2 + h[2] ** 2)
    return mpmath.sqrt((n_u + 2) * (n_v + 2)) / (2 * mpmath.pi) * cos**n


def vcavity_g(p: Pair) -> Any:
    return min(mpf(1), 2 * p.nh * p.ni / p.half_length, 2 * p.nh * p.no / p.half_length)


def vcavity_g1(p: Pair) -> Any:
    """Masking of `wi` alone."""
    return min(mpf(1), 2 * p.nh * p.ni / p.half_length)


def smith_g1(w: Vector, m: Any) -> Any:
    t = tan(w)
    if t == 0:
        return mpf(1)
    a = 1 / (m * t)
    return 2 / (1 + mpmath.erf(a) + mpmath.exp(-(a**2)) / (a * mpmath.sqrt(mpmath.pi)))


def ggx_g1(w: Vector, m: Any) -> Any:
    """Walter et al. 2007, eq. 34."""
    return 2 / (1 + mpmath.sqrt(1 + (m * tan(w)) ** 2))


def roughness_towards(w: Vector, u: Any, v: Any) -> Any:
    """Heitz 2014: roughness in the plane of a direction."""
    phi = mpmath.atan2(w[1], w[0])
    return mpmath.sqrt((u * mpmath.cos(phi)) ** 2 + (v * mpmath.sin(phi)) ** 2)


def fresnel_dielectric(c: Any, eta: Any) -> Any:
    """Snell's law and the two amplitudes."""
    sin2_t = (1 - c**2) / eta**2
    if sin2_t >= 1:
        return mpf(1)
    cos_t = mpmath.sqrt(1 - sin2_t)
    s = (c - eta * cos_t) / (c + eta * cos_t)
    p = (eta * c - cos_t) / (eta * c + cos_t)
    return (s**2 + p**2) / 2


def fresnel_schlick(c: Any, eta: Any) -> Any:
    f0 = ((eta - 1) / (eta + 1)) ** 2
    return f0 + (1 - f0) * (1 - c) ** 5


FRESNEL: dict[str, Callable[[Any, Any], Any]] = {
    "exact": fresnel_dielectric,
    "schlick": fresnel_schlick,
    "constant": lambda c, eta: mpf(1),
}
MASKING: dict[str, Callable[[Pair, Any], Any]] = {
    "vcavity": lambda p, m: vcavity_g(p),
    "smith": lambda p, m: smith_g1(p.i, m) * smith_g1(p.o, m),
    "none": lambda p, m: mpf(1),
}


DISTRIBUTION: dict[str, Callable[[Vector, Any, Any], Any]] = {
    "beckmann": beckmann_d_uv,
    "ggx": ggx_d_uv,
    "blinn": blinn_d_uv,
}
ISOTROPIC: dict[str, Callable[[Any, Any], Any]] = {"beckmann": beckmann_d, "ggx": ggx_d, "blinn": blinn_d}
#: Smith's masking by the distribution; Beckmann's stands in for Blinn's.
SMITH: dict[str, Callable[[Vector, Any], Any]] = {"beckmann": smith_g1, "ggx": ggx_g1, "blinn": smith_g1}


def cooktorrance_pdf(p: Pair, m: Any, d: Callable[..., Any] = beckmann_d) -> Any:
    """Density of reflections on facets seen from wi, V-cavities [1/sr]."""
    return d(p.nh, m) * vcavity_g1(p) / (4 * p.ni)
