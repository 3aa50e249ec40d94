"""Directions in the local frame: half-vector quantities, reflection, refraction, cosine-weighted sampling.

The half vector is kept unnormalised, ``h = wi + wo``: a sum has the relative error of one rounding, so that
``tan^2 = (h.x^2 + h.y^2) / h.z^2`` never cancels, however sharp the lobe. ``1 - cos^2`` does.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr

from .stable import expm1, log1p, with_gradient


class Half(NamedTuple):
    """The geometry of a pair of directions, symmetric in the two bit for bit.

    ``tan2`` is tan^2 of the angle between the half vector and the normal; ``cos_d``, ``sin2_d`` belong to the angle
    between either direction and the half vector; ``hh`` is |wi + wo|^2; ``hx``, ``hy``, ``hz`` are the components of
    wi + wo.
    """

    tan2: Any
    cos_d: Any
    sin2_d: Any
    hh: Any
    hz: Any
    hx: Any
    hy: Any


def half(wi: Any, wo: Any) -> Half:
    """Half-vector quantities of `wi` and `wo`, without cancellation.

    ``cos_d^2 = |h|^2 / (|h|^2 + |d|^2)`` and ``sin_d^2 = |d|^2 / (|h|^2 + |d|^2)`` with ``h = wi + wo``, ``d = wi -
    wo``: both have full relative accuracy, for grazing and for equal directions, and do not mind a rounded length.
    """
    h, d = wi + wo, wi - wo
    hh, dd = square(h), square(d)
    per, flat = 1 / (hh + dd), 1 / h.z
    x, y = h.x * flat, h.y * flat  # squared last: derivatives of 1 / h.z^2 overflow where both directions graze
    return Half(x * x + y * y, dr.sqrt(hh * per), dd * per, hh, h.z, h.x, h.y)


def square(v: Any) -> Any:
    """|v|^2 as a sum of squares in a fixed order."""
    return v.x * v.x + v.y * v.y + v.z * v.z


def sine2(w: Any) -> Any:
    """The squared sine of the angle between `w` and the normal, from its cosine alone: ``(1 - |z|)(1 + |z|)``.

    ``x^2 + y^2`` would be another number for a direction that is rounded, and not go with the cosine: where the two
    are used in turns, as by Fresnel's formulas, a jump would be left.
    """
    z = abs(w.z)
    return (1 - z) * (1 + z)


def unit(v: Any) -> Any:
    """`v` at length 1."""
    return v * dr.rsqrt(square(v))


def reflect(w: Any) -> Any:
    """The mirror image of `w` about the normal."""
    return type(w)(-w.x, -w.y, w.z)


def reflect_about(w: Any, m: Any) -> Any:
    """The mirror image of `w` about `m`, of whatever length: ``2 (w.m) / |m|^2 m - w``, as long as `w` to rounding.

    It is not brought to unit length: only of two equally long directions is the sum along `m`. At grazing incidence, a
    rounding of the length turns the half vector by that over the cosine.
    """
    return m * (2 * (w.x * m.x + w.y * m.y + w.z * m.z) / square(m)) - w


def refract(w: Any, eta: Any) -> tuple[Any, Any]:
    """Where light from `w`, above or below, goes behind a smooth surface (Snell's law), and whether it does.

    In the surface ``-(w.x, w.y) / eta``; along the normal ``sqrt(1 - s2 / eta^2) = sqrt(eta^2 - 1 + c^2) / eta``,
    whichever does not cancel, from the cosine alone, as Fresnel's formulas: so they agree on which light is refracted.
    The length is then made 1: that of `w` is so to rounding, of which a division by a small index makes more. Under
    total internal reflection the direction is ``-w``, which means nothing.

    Parameters
    ----------
    w : 3-vector
    eta : float
        Relative index of refraction, far side over near side, > 0 [1].

    Returns
    -------
    wo : 3-vector
        Of unit length, on the other side.
    refracts : bool
        False under total internal reflection.

    References
    ----------
    born1999, sec. 1.5.
    """
    s2, eta2 = sine2(w), eta * eta
    direct = 1 - s2 / eta2
    c2 = dr.select(s2 < 0.5, direct, ((eta - 1) * (eta + 1) + w.z * w.z) / eta2)
    c2 = with_gradient(c2, direct)  # of one term, where that of the other form cancels
    refracts = c2 > 0
    c = dr.sqrt(dr.select(refracts, c2, 1))
    wo = unit(type(w)(-w.x / eta, -w.y / eta, dr.select(w.z > 0, -c, c)))
    return dr.select(refracts, wo, -w), refracts


def cosine_hemisphere(u: Any, like: Any) -> Any:
    """A direction with density ``cos / pi`` from `u` in [0, 1)^2, of the type of the 3-vector `like`.

    A disk is sampled in polar form (Malley's method): ``r = sqrt(u.x)``, ``z = sqrt(1 - u.x)``.
    """
    radius, angle = dr.sqrt(u.x), dr.two_pi * u.y
    s, c = dr.sincos(angle)
    return type(like)(radius * c, radius * s, dr.sqrt(dr.maximum(1 - u.x, 0)))


def cosine_power_hemisphere(u: Any, n: Any, like: Any) -> Any:
    """A direction with density ``(n + 1) / (2 pi) cos^n``, of the type of the 3-vector `like`.

    ``cos = (1 - u.x)^(1 / (n + 1))``; the sine is taken from the logarithm of the cosine, so that directions a
    millionth of a radian off the normal come out as they should.

    Parameters
    ----------
    u : 2- or 3-vector
        Uniform in [0, 1)^2.
    n : float
        The exponent, >= 0 [1].
    like : 3-vector
    """
    log_cos = log1p(-u.x) / (n + 1)
    sin = dr.sqrt(-expm1(2 * log_cos))
    s, c = dr.sincos(dr.two_pi * u.y)
    return type(like)(sin * c, sin * s, dr.exp(log_cos))


def about(axis: Any, w: Any) -> Any:
    """The direction `w`, given in a frame whose third axis is the unit vector `axis`, ``axis.z >= 0``.

    The other two axes complete it without a branch and without a division by 0.

    References
    ----------
    duff2017.
    """
    a = 1 / (1 + axis.z)
    b = -axis.x * axis.y * a
    first = type(axis)(1 - axis.x * axis.x * a, b, -axis.x)
    second = type(axis)(b, 1 - axis.y * axis.y * a, -axis.y)
    out = first * w.x + second * w.y + axis * w.z
    return out * dr.rsqrt(square(out))
