"""Microfacet bricks: distributions of normals (`D`) and masking-shadowing (`G`)."""

from __future__ import annotations

from typing import Any

import drjit as dr

from .stable import EXPONENT_CAP, is_double, log1p, with_gradient

#: (float32, float64) From here on erf(a) is 1 and exp(-a^2) far below rounding.
ERF_CAP = (6.0, 12.0)


def beckmann_d_half(tan2: Any, m: Any) -> Any:
    """The square root of pi D: ``A = exp(-tan^2 / (2 m^2)) (1 + tan^2) / m``, and ``D = A^2 / pi``.

    Kept apart because ``(1 + tan^2)^2`` overflows before the exponential brings it back: see `beckmann_d`.
    """
    e = dr.minimum(tan2 / m / m, EXPONENT_CAP[is_double(tan2)])  # the derivative of tan2 / (m m) overflows sooner
    return dr.exp(-0.5 * e) * (1 + tan2) / m


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


def beckmann_sample(u: Any, m: Any, like: Any) -> Any:
    """A facet normal with density `beckmann_pdf`, of the type of the 3-vector `like`.

    ``tan = m sqrt(-log(1 - u.x))`` with log1p; sine and cosine from the tangent, so that normals a millionth of a
    radian off the surface normal come out as they should.

    References
    ----------
    walter2007, eq. 28, 29.
    """
    tan = m * dr.sqrt(-log1p(-u.x))
    cos = dr.rsqrt(1 + tan * tan)
    s, c = dr.sincos(dr.two_pi * u.y)
    sin = tan * cos
    return type(like)(sin * c, sin * s, cos)


def beckmann_pdf(tan2: Any, m: Any) -> Any:
    """The density of `beckmann_sample` with respect to solid angle of the normal: ``D cos`` [1/sr]."""
    return beckmann_d(tan2, m) * dr.rsqrt(1 + tan2)


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
    return dr.minimum(1 / (4 * low), hz / hh) / high


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
    r = dr.sqrt(dr.maximum(w.x * w.x + w.y * w.y, 1e-30))
    a = dr.minimum(w.z / (m * r), ERF_CAP[is_double(w.z)])
    e = dr.exp(-a * a) * dr.rsqrt(dr.pi)
    total = 1 + dr.erf(a) + e / a
    # The three terms of d total / d a cancel to one, so it is given in closed form.
    total = with_gradient(total, -dr.detach(e / (a * a)) * a)
    return 2 / total


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
