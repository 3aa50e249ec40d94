"""Microfacet bricks: distributions of normals (`D`) and masking-shadowing (`G`).

A distribution is given by the square root of pi D (`beckmann_d_half`, `ggx_d_half`, `blinn_d_half`), the tangents of
its normals (`beckmann_tangent`, ...) and Smith's masking (`smith_g1`, `ggx_g1`): `DISTRIBUTIONS` has them by name. Each
is anisotropic with a roughness that depends on the azimuth: see `roughness_of_normal` and `roughness_of_view`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr

from .geometry import Half
from .stable import EXPONENT_CAP, expm1, is_double, log1p, with_gradient

#: A squared length in the surface up to which a vector of about unit length is the normal: far below rounding for any
#: roughness, and derivatives of what is divided by its square root stay finite.
LEVEL = 1e-30
#: (float32, float64) From here on erf(a) is 1 and exp(-a^2) far below rounding.
ERF_CAP = (6.0, 12.0)


def beckmann_d_half(tan2: Any, m: Any) -> Any:
    """The square root of pi D: ``A = exp(-tan^2 / (2 m^2)) (1 + tan^2) / m``, and ``D = A^2 / pi``.

    Kept apart because ``(1 + tan^2)^2`` overflows before the exponential brings it back: see `beckmann_d`.
    """
    r = 1 / m
    e = dr.minimum(tan2 * r * r, EXPONENT_CAP[is_double(tan2)])  # the derivative of tan2 / (m m) overflows sooner
    return dr.exp(-0.5 * e) * (1 + tan2) * r


def beckmann_d(tan2: Any, m: Any) -> Any:
    """Beckmann's distribution of facet normals.

    ``D = exp(-tan^2 / m^2) / (pi m^2 cos^4)``

    Parameters
    ----------
    tan2 : float
        Squared tangent of the angle between facet normal and surface normal, >= 0 [1].
    m : float
        Roughness: the rms slope, > 0 [1].

    Returns
    -------
    float
        [1/sr]; ``integral of D cos over the hemisphere = 1``.

    References
    ----------
    beckmann1963; walter2007, eq. 25; cook1982.
    """
    a = beckmann_d_half(tan2, m)
    return a * a * dr.inv_pi


def beckmann_tangent(u: Any, m: Any) -> Any:
    """The tangent of a facet's angle from `u` in [0, 1): ``m sqrt(-log(1 - u))``."""
    return m * dr.sqrt(-log1p(-u))


def beckmann_sample(u: Any, m: Any, like: Any) -> Any:
    """A facet normal with density `beckmann_pdf`, of the type of the 3-vector `like`.

    ``tan = m sqrt(-log(1 - u.x))`` with log1p; sine and cosine from the tangent, so that normals a millionth of a
    radian off the surface normal come out as they should.

    References
    ----------
    walter2007, eq. 28, 29.
    """
    s, c = dr.sincos(dr.two_pi * u.y)
    return facet(beckmann_tangent(u.x, m), c, s, like)


def beckmann_pdf(tan2: Any, m: Any) -> Any:
    """The density of `beckmann_sample` with respect to solid angle of the normal: ``D cos`` [1/sr]."""
    return beckmann_d(tan2, m) * dr.rsqrt(1 + tan2)


def ggx_d_half(tan2: Any, m: Any) -> Any:
    """The square root of pi D of Trowbridge and Reitz's distribution, known as GGX.

    ``D = m^2 / (pi cos^4 (m^2 + tan^2)^2)``, so ``A = 1 / (m cos^2 + sin^2 / m)``, both from the tangent. Written so,
    nothing on the way, nor in its derivative, is larger than the last.

    Parameters
    ----------
    tan2 : float
        Squared tangent of the angle between facet normal and surface normal, >= 0 [1].
    m : float
        Roughness, > 0 [1]: the slope at which the density of slopes is a quarter of its largest.

    References
    ----------
    trowbridge1975; walter2007, eq. 33.
    """
    cos2 = 1 / (1 + tan2)
    return 1 / (m * cos2 + tan2 * cos2 / m)


def ggx_tangent(u: Any, m: Any) -> Any:
    """The tangent of a facet's angle from `u` in [0, 1): ``m sqrt(u / (1 - u))`` (walter2007, eq. 35)."""
    return m * dr.sqrt(u / (1 - u))


def blinn_d_half(tan2: Any, m: Any) -> Any:
    """The square root of pi D of Blinn's distribution, a power of the cosine.

    ``D = (n + 2) / (2 pi) cos^n`` with ``n = 2 / m^2 - 2``, the exponent that matches Beckmann's distribution of
    roughness `m`. As an exponential: ``A = exp(-(1/m^2 - 1) log(1 + tan^2) / 2) / m``.

    Parameters
    ----------
    tan2 : float
        Squared tangent of the angle between facet normal and surface normal, >= 0 [1].
    m : float
        Roughness, in (0, 1] [1]: above 1 the exponent is negative. At 1 all normals are equally dense.

    References
    ----------
    blinn1977; walter2007 (Phong's distribution: the constant, and the exponent that matches).
    """
    r = 1 / m
    e = log1p(tan2) * r * r * ((1 - m) * (1 + m))
    return dr.exp(-0.5 * dr.minimum(e, EXPONENT_CAP[is_double(tan2)])) * r


def blinn_tangent(u: Any, m: Any) -> Any:
    """The tangent of a facet's angle from `u` in [0, 1): ``cos = (1 - u)^(1/(n + 2))``, and ``n + 2 = 2 / m^2``."""
    return dr.sqrt(expm1(-m * m * log1p(-u)))


def facet(tan: Any, c: Any, s: Any, like: Any) -> Any:
    """The unit normal at angle of tangent `tan`, azimuth of cosine `c` and sine `s`, of the type of `like`."""
    cos = dr.rsqrt(1 + tan * tan)
    sin = tan * cos
    return type(like)(sin * c, sin * s, cos)


def roughness_of_normal(g: Half, m_u: Any, m_v: Any) -> Any:
    """The roughness that an anisotropic distribution has at the azimuth of a facet normal.

    ``1 / m^2 = cos_phi^2 / m_u^2 + sin_phi^2 / m_v^2``. With it each distribution here is anisotropic as its authors
    have it: ``D(tan2, m) m^2 / (m_u m_v)``, whose integral is again 1.

    Parameters
    ----------
    g : Half
        The facet normal is ``(hx, hy, hz)``, of any length. On the surface normal, where no azimuth is, it is 1: `D`
        does not depend on it there.
    m_u, m_v : float
        Roughness along x and y, > 0 [1].

    References
    ----------
    ashikhmin2000 (Blinn's, between two exponents); heitz2018 (GGX).
    """
    r2, q = g.hx * g.hx + g.hy * g.hy, dr.square(g.hx / m_u) + dr.square(g.hy / m_v)
    tilted = r2 > LEVEL
    return dr.sqrt(dr.select(tilted, r2, 1)) / dr.sqrt(dr.select(tilted, q, 1))  # r2 / q overflows in a derivative


def roughness_of_view(w: Any, m_u: Any, m_v: Any) -> Any:
    """The roughness of an anisotropic surface in the plane of a direction, which is what masks it.

    ``m^2 = cos_phi^2 m_u^2 + sin_phi^2 m_v^2`` at the azimuth of `w`: the slopes in a plane have that variance. It is
    1 on the normal, where nothing is masked.

    References
    ----------
    heitz2014.
    """
    r2, q = w.x * w.x + w.y * w.y, dr.square(m_u * w.x) + dr.square(m_v * w.y)
    tilted = r2 > LEVEL
    return dr.sqrt(dr.select(tilted, q, 1)) / dr.sqrt(dr.select(tilted, r2, 1))


def azimuth(u: Any, m_u: Any, m_v: Any) -> tuple[Any, Any, Any]:
    """Cosine and sine of a facet's azimuth from `u` in [0, 1), and its `roughness_of_normal`.

    The density is ``m^2 / (2 pi m_u m_v)``: a circle stretched by the two.
    """
    s, c = dr.sincos(dr.two_pi * u)
    x, y = m_u * c, m_v * s
    m = dr.sqrt(x * x + y * y)
    return x / m, y / m, m


def vcavity_g(ci: Any, co: Any, hh: Any, hz: Any) -> Any:
    """Masking and shadowing of V-shaped cavities, of whatever roughness.

    ``G = min(1, 2 n.h n.v / v.h, 2 n.h n.l / v.h)``; with ``h = wi + wo`` unnormalised the smaller of the two is
    ``4 hz min(ci, co) / |h|^2``.

    Parameters
    ----------
    ci, co : float
        Cosines of the two directions, > 0.
    hh, hz : float
        ``|wi + wo|^2`` and ``(wi + wo).z``: see `geometry.half`.

    References
    ----------
    torrance1967; cook1982.
    """
    return dr.minimum(1, 4 * hz * dr.minimum(ci, co) / hh)


def vcavity_g_over_cosines(ci: Any, co: Any, hh: Any, hz: Any) -> Any:
    """``G / (4 ci co)``, never dividing by the product of two small cosines."""
    low, high = dr.minimum(ci, co), dr.maximum(ci, co)
    hidden = 4 * hz * low < hh
    return dr.select(hidden, hz, 0.25) / dr.select(hidden, hh, low) / high


def smith_g1(w: Any, m: Any) -> Any:
    """Smith's masking of one direction for Beckmann's distribution, exact.

    ``G1 = 2 / (1 + erf(a) + exp(-a^2) / (a sqrt(pi)))`` with ``a = 1 / (m tan)``. (Most renderers use a rational fit,
    off by up to 0.3 %, whose derivative jumps at a = 1.6 and is 0 above.)

    Parameters
    ----------
    w : 3-vector
        The direction, ``w.z > 0``.
    m : float
        Roughness, > 0 [1].

    References
    ----------
    smith1967; walter2007, sec. 5.1.
    """
    r = dr.sqrt(dr.maximum(w.x * w.x + w.y * w.y, LEVEL))
    a = w.z / dr.maximum(m * r, w.z / ERF_CAP[is_double(w.z)])  # capped before the division: it would overflow
    e = dr.exp(-a * a) * dr.rsqrt(dr.pi)
    total = 1 + dr.erf(a) + e / a
    # The three terms of d total / d a cancel to one, so it is given in closed form.
    total = with_gradient(total, -dr.detach(e / (a * a)) * a)
    return 2 / total


def ggx_g1(w: Any, m: Any) -> Any:
    """Smith's masking of one direction for GGX: ``2 / (1 + sqrt(1 + m^2 tan^2))``.

    Parameters
    ----------
    w : 3-vector
        The direction, ``w.z > 0``.
    m : float
        Roughness, > 0 [1].

    References
    ----------
    smith1967; walter2007, eq. 34.
    """
    slope = m / w.z
    return 2 / (1 + dr.sqrt(1 + slope * slope * (w.x * w.x + w.y * w.y)))


def ggx_visible(u: Any, w: Any, m_u: Any, m_v: Any) -> Any:
    """A facet normal of GGX as seen from `w`.

    Stretched by the roughness the surface is a hemisphere, its normals as seen from `w` the halves between `w` and
    directions uniform on the sphere above ``-w.z``. Height and radius are sums of positive terms.

    Parameters
    ----------
    u : 2-vector
        Uniform in [0, 1)^2.
    w : 3-vector
        The direction from which facets are seen, ``w.z > 0``.
    m_u, m_v : float
        Roughness along x and y, > 0 [1].

    Returns
    -------
    3-vector
        With density ``D G1 max(w.h, 0) / w.z``, `G1` Smith's; never facing away from `w`.

    References
    ----------
    heitz2018 (the density); dupuy2023 (the sphere).
    """
    x, y, z = m_u * w.x, m_v * w.y, w.z
    scale = dr.rsqrt(x * x + y * y + z * z)
    x, y, z = x * scale, y * scale, z * scale
    below, above = u.x * (1 + z), (1 - u.x) * (1 + z)  # from the top down, and from -z up
    radius = dr.sqrt(below * (above + (x * x + y * y) / (1 + z)))
    s, c = dr.sincos(dr.two_pi * u.y)
    h = type(w)(m_u * (radius * c + x), m_v * (radius * s + y), above)
    return h * dr.rsqrt(h.x * h.x + h.y * h.y + h.z * h.z)


def vcavity_visible(h: Any, w: Any, u: Any) -> Any:
    """A facet normal as seen from `w`: `h`, or the other wall of its V-cavity, in proportion to their projected areas.

    Parameters
    ----------
    h : 3-vector
        A facet normal from the distribution of normals (density ``D cos``).
    w : 3-vector
        The direction from which facets are seen, ``w.z > 0``.
    u : float
        Uniform in [0, 1).

    Returns
    -------
    3-vector
        With density ``D G1 max(w.h, 0) / w.z``, ``G1 = min(1, 2 n.h n.w / w.h)``; never facing away from `w`.

    References
    ----------
    heitz2014 (V-cavities).
    """
    across, along = w.x * h.x + w.y * h.y, w.z * h.z
    here, there = dr.maximum(along + across, 0), dr.maximum(along - across, 0)
    flip = dr.select(u * (here + there) >= here, -1.0, 1.0)
    return type(h)(h.x * flip, h.y * flip, h.z)


def vcavity_g1_over_cosine(c: Any, hh: Any, hz: Any) -> Any:
    """``G1 / (4 c)`` of one direction of cosine `c`: times `D`, the density of reflections on `vcavity_visible` facets.

    ``G1 = min(1, 2 n.h n.w / w.h) = min(1, 4 hz c / |h|^2)``, as in `vcavity_g`.
    """
    return dr.minimum(0.25 / c, hz / hh)


class Distribution(NamedTuple):
    """A distribution of facet normals: ``D = d_half(tan2, m)^2 / pi``, tangents sampled by ``tangent(u, m)`` with
    density ``D cos``, and Smith's masking ``g1(w, m)``."""

    d_half: Callable[[Any, Any], Any]
    tangent: Callable[[Any, Any], Any]
    g1: Callable[[Any, Any], Any]


#: By name. Blinn's has no closed form of Smith's masking: Beckmann's stands in, as walter2007 advises for Phong's.
DISTRIBUTIONS = {
    "beckmann": Distribution(beckmann_d_half, beckmann_tangent, smith_g1),
    "ggx": Distribution(ggx_d_half, ggx_tangent, ggx_g1),
    "blinn": Distribution(blinn_d_half, blinn_tangent, smith_g1),
}
