"""The formulas of `brdf` in Dr.Jit as text books and renderers have them: to compare with, in accuracy and in price.

Nothing here is for use. Each takes what the stable form takes, and loses the digits that the other keeps: by
``1 - cos^2``, by a power of a cosine, by `acos`, or by a difference of near numbers.

Directions are in the local frame, of unit length to rounding, and above the surface.
"""

from __future__ import annotations

from typing import Any

import drjit as dr


def half_vector(wi: Any, wo: Any) -> tuple[Any, Any]:
    """Of the normalised half vector: the vector, and the cosine between it and `wi` (Cook and Torrance 1982)."""
    h = dr.normalize(wi + wo)
    return h, dr.dot(wi, h)


def tan2_of(c: Any) -> Any:
    """``tan^2 = (1 - cos^2) / cos^2``."""
    c2 = c * c
    return (1 - c2) / c2


def beckmann_d(c: Any, m: Any) -> Any:
    """``exp(-tan^2 / m^2) / (pi m^2 cos^4)`` at the facet's cosine `c` (walter2007, eq. 25)."""
    c2, m2 = c * c, m * m
    return dr.exp(-tan2_of(c) / m2) / (dr.pi * m2 * c2 * c2)


def ggx_d(c: Any, m: Any) -> Any:
    """``m^2 / (pi cos^4 (m^2 + tan^2)^2)`` (walter2007, eq. 33)."""
    c2, m2 = c * c, m * m
    root = c2 * (m2 + tan2_of(c))
    return m2 / (dr.pi * root * root)


def blinn_d(c: Any, m: Any) -> Any:
    """``(n + 2) / (2 pi) cos^n`` with ``n = 2 / m^2 - 2`` (blinn1977; walter2007, eq. 30)."""
    n = 2 / (m * m) - 2
    return (n + 2) / dr.two_pi * dr.power(c, n)


def vcavity_g(c: Any, cos_d: Any, ci: Any, co: Any) -> Any:
    """``min(1, 2 n.h n.v / v.h, 2 n.h n.l / v.h)`` (cook1982)."""
    return dr.minimum(1, dr.minimum(2 * c * ci / cos_d, 2 * c * co / cos_d))


def smith_g1(c: Any, m: Any) -> Any:
    """Smith's masking for Beckmann's distribution, of a direction of cosine `c` (walter2007, eq. 27, left)."""
    a = 1 / (m * dr.sqrt(tan2_of(c)))
    return 2 / (1 + dr.erf(a) + dr.exp(-a * a) / (a * dr.sqrt(dr.pi)))


def smith_g1_rational(c: Any, m: Any) -> Any:
    """The fit that most renderers have in place of `smith_g1`, off by up to 0.3 % (walter2007, eq. 27, right)."""
    a = 1 / (m * dr.sqrt(tan2_of(c)))
    a2 = a * a
    return dr.select(a < 1.6, (3.535 * a + 2.181 * a2) / (1 + 2.276 * a + 2.577 * a2), 1)


def ggx_g1(c: Any, m: Any) -> Any:
    """``2 / (1 + sqrt(1 + m^2 tan^2))`` (walter2007, eq. 34)."""
    return 2 / (1 + dr.sqrt(1 + m * m * tan2_of(c)))


def fresnel_dielectric(c: Any, eta: Any) -> Any:
    """Snell's law, then the two amplitudes (born1999, sec. 1.5)."""
    sin_t = dr.sqrt(1 - c * c) / eta
    cos_t = dr.sqrt(1 - sin_t * sin_t)
    s = (c - eta * cos_t) / (c + eta * cos_t)
    p = (eta * c - cos_t) / (eta * c + cos_t)
    return dr.select(sin_t < 1, 0.5 * (s * s + p * p), 1)


def fresnel_cook(c: Any, eta: Any) -> Any:
    """With ``g^2 = eta^2 + c^2 - 1`` (cook1982)."""
    g2 = eta * eta + c * c - 1
    g = dr.sqrt(g2)
    s = (g - c) / (g + c)
    p = (c * (g + c) - 1) / (c * (g - c) + 1)
    return dr.select(g2 > 0, 0.5 * s * s * (1 + p * p), 1)


def fresnel_conductor(c: Any, eta: Any, k: Any) -> Any:
    """As in renderers, with ``a^2 + b^2`` and `a` of the complex cosine (born1999, sec. 14.2)."""
    c2, eta2, k2 = c * c, eta * eta, k * k
    s2 = 1 - c2
    t0 = eta2 - k2 - s2
    modulus = dr.sqrt(t0 * t0 + 4 * eta2 * k2)
    a = dr.sqrt(0.5 * (modulus + t0))
    t1, t2 = modulus + c2, 2 * a * c
    rs = (t1 - t2) / (t1 + t2)
    t3, t4 = c2 * modulus + s2 * s2, t2 * s2
    return 0.5 * rs * (1 + (t3 - t4) / (t3 + t4))


def fresnel_schlick(c: Any, eta: Any) -> Any:
    """``F0 + (1 - F0) (1 - c)^5`` (schlick1994)."""
    r = (eta - 1) / (eta + 1)
    f0 = r * r
    return f0 + (1 - f0) * dr.power(1 - c, 5.0)


def cooktorrance(wi: Any, wo: Any, m: Any, fresnel: Any, masking: str = "vcavity") -> Any:
    """``D G F / (4 cos_i cos_o)`` (cook1982, walter2007).

    Parameters
    ----------
    fresnel : callable
        F by the cosine to the facet.
    masking : str
        "vcavity" or "smith", of Beckmann's facets; "rational", as "smith" by the fit; "ggx", Smith's of GGX facets.
    """
    h, cos_d = half_vector(wi, wo)
    ci, co = wi.z, wo.z
    if masking == "vcavity":
        G = vcavity_g(h.z, cos_d, ci, co)
    else:
        g1 = {"smith": smith_g1, "rational": smith_g1_rational, "ggx": ggx_g1}[masking]
        G = g1(ci, m) * g1(co, m)
    D = ggx_d(h.z, m) if masking == "ggx" else beckmann_d(h.z, m)
    return D * G * fresnel(cos_d) / (4 * ci * co)


def phong(wi: Any, wo: Any, n: Any) -> Any:
    """``(n + 2) / (2 pi) a^n``, `a` the cosine to the mirror direction (lafortune1994)."""
    r = type(wi)(-wi.x, -wi.y, wi.z)
    return (n + 2) / dr.two_pi * dr.power(dr.maximum(dr.dot(wo, r), 0), n)


def blinnphong(wi: Any, wo: Any, n: Any) -> Any:
    """``(n + 2)(n + 4) / (8 pi (2^(-n/2) + n)) cos_h^n`` (blinn1977)."""
    h, _ = half_vector(wi, wo)
    return (n + 2) * (n + 4) / (8 * dr.pi * (dr.power(2.0, -n / 2) + n)) * dr.power(h.z, n)


def ward(wi: Any, wo: Any, alpha_u: Any, alpha_v: Any) -> Any:
    """By the angles of the half vector, with the factor that conserves energy (ward1992, eq. 5a; geisler2010)."""
    h, _ = half_vector(wi, wo)
    delta, phi = dr.acos(h.z), dr.atan2(h.y, h.x)
    spread = dr.square(dr.cos(phi) / alpha_u) + dr.square(dr.sin(phi) / alpha_v)
    gaussian = dr.exp(-dr.square(dr.tan(delta)) * spread) / (dr.pi * alpha_u * alpha_v)
    cosines = dr.square(wi.z + wo.z)
    return gaussian * 2 * (1 + dr.dot(wi, wo)) / (cosines * cosines)


def orennayar(wi: Any, wo: Any, reflectance: Any, sigma: Any) -> Any:
    """The full model by its angles (oren1994, eq. 30, 31)."""
    theta_i, theta_o = dr.acos(wi.z), dr.acos(wo.z)
    alpha, beta = dr.maximum(theta_i, theta_o), dr.minimum(theta_i, theta_o)
    cos_phi = dr.cos(dr.atan2(wi.y, wi.x) - dr.atan2(wo.y, wo.x))
    s2 = sigma * sigma
    b = 2 * beta / dr.pi
    c1, some = 1 - 0.5 * s2 / (s2 + 0.33), s2 / (s2 + 0.09)
    c2 = 0.45 * some * (dr.sin(alpha) - dr.select(cos_phi < 0, b * b * b, 0))
    c3 = 0.125 * some * dr.square(4 * alpha * beta / (dr.pi * dr.pi))
    once = c1 + c2 * cos_phi * dr.tan(beta) + c3 * (1 - abs(cos_phi)) * dr.tan((alpha + beta) / 2)
    twice = 0.17 * s2 / (s2 + 0.13) * (1 - cos_phi * b * b)
    return reflectance / dr.pi * (once + reflectance * twice)


def hanrahankrueger(wi: Any, wo: Any, sigma_s: Any, sigma_a: Any, thickness: Any, g: Any, eta: Any) -> Any:
    """Reflected and transmitted single scattering, for both of `wi` and `wo` above (hanrahan1993, eq. 4, 5).

    Of the second, `wo` is turned below. For equal cosines it is 0/0.
    """
    (i, ti), (o, to) = refracted(wi, eta), refracted(wo, eta)
    sigma_t = sigma_s + sigma_a
    tau = sigma_t * thickness
    sides = ti * to / (eta * eta) * sigma_s / sigma_t
    across, along = i.x * o.x + i.y * o.y, i.z * o.z
    up = henyey_greenstein(across + along, g) * (1 - dr.exp(-tau * (1 / i.z + 1 / o.z))) / (i.z + o.z)
    lost = dr.exp(-tau / i.z) - dr.exp(-tau / o.z)
    down = henyey_greenstein(across - along, g) * lost / (i.z - o.z)
    return sides * up, sides * down


def refracted(w: Any, eta: Any) -> tuple[Any, Any]:
    """The direction inside that belongs to `w`, on the same side, and the transmittance (born1999, sec. 1.5)."""
    sin_t = dr.sqrt(1 - w.z * w.z) / eta
    return type(w)(w.x / eta, w.y / eta, dr.sqrt(1 - sin_t * sin_t)), 1 - fresnel_dielectric(w.z, eta)


def henyey_greenstein(c: Any, g: Any) -> Any:
    """The phase of two directions away from where light is scattered, `c` the cosine between them (henyey1941)."""
    d: Any = dr.power(1 + g * g + 2 * g * c, 1.5)
    return (1 - g * g) / (4 * dr.pi * d)
