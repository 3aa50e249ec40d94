"""Fresnel reflectance of a smooth facet.

Those of one direction take ``(c, s2)``: cosine and squared sine of the angle between light and facet normal, as a pair:
``1 - c^2`` computed inside would lose the digits that decide at grazing and at the critical angle. Means are over all
directions.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from .stable import atanh_rest, is_double, with_gradient

#: (float32, float64) The square of an index so small that F is 1; the square of this has an inverse, for a derivative.
VANISHING = (3e-19, 1e-150)

#: Below this ``R_s`` F is taken from itself, above it from ``1 - F``: F is then between .35 and .7.
RS_MIDDLE = 0.7
#: And below this ``1 - F`` from F: it is then at least .65, and loses nothing.
RS_SMALL = 0.35


def fresnel_dielectric(c: Any, s2: Any, eta: Any) -> Any:
    """Unpolarised reflectance of a smooth dielectric.

    ``g^2 = eta^2 - s2``, ``F = 1/2 ((g - c)/(g + c))^2 (1 + ((c (g + c) - 1)/(c (g - c) + 1))^2)`` (Cook and Torrance
    1982), in a form whose relative error stays at a few roundings, in value and in gradient, from ``eta -> 1`` to
    grazing:

    - ``g^2`` from ``eta^2 - s2`` or ``(eta^2 - 1) + c^2``, whichever does not cancel;
    - the amplitude ``r_s = (g - c)/(g + c) = (eta^2 - 1)/(c + g)^2``;
    - ``r_p / r_s = (c g - s2)/(c g + s2)``;
    - near 1, ``1 - T`` with the transmittance written as a sum of positive terms, so that its gradient does not cancel.

    Parameters
    ----------
    c, s2 : float
        Cosine (>= 0) and squared sine of the angle of incidence [1].
    eta : float
        Relative index of refraction, inside over outside, > 0 [1].

    Returns
    -------
    float
        In [0, 1]; 0 for ``eta = 1``, 1 at grazing and under total internal reflection.

    References
    ----------
    cook1982, eq. for F; born1999, sec. 1.5.
    """
    reflects, low, part = smaller(c, s2, eta, RS_MIDDLE)
    return dr.select(reflects, 1, dr.select(low, part, 1 - part))


def transmittance_dielectric(c: Any, s2: Any, eta: Any) -> Any:
    """Unpolarised transmittance of a smooth dielectric: the fraction of the power that crosses the surface.

    ``1 - fresnel_dielectric``, but towards grazing, where it goes to 0 with the cosine, not as that difference.

    Parameters
    ----------
    c, s2 : float
        Cosine (>= 0) and squared sine of the angle of incidence [1].
    eta : float
        Relative index of refraction, far side over near side, > 0 [1].

    Returns
    -------
    float
        In [0, 1]; 0 at grazing and under total internal reflection.

    References
    ----------
    born1999, sec. 1.5.
    """
    reflects, low, part = smaller(c, s2, eta, RS_SMALL)
    return dr.select(reflects, 0, dr.select(low, 1 - part, part))


def smaller(c: Any, s2: Any, eta: Any, below: float) -> tuple[Any, Any, Any]:
    """Whether all is reflected; if not, whether ``F`` is small, and then ``F``, else ``1 - F``, without a difference.

    It is small where ``R_s < below``, of which F is at least half and at most all. Both have the denominators
    ``(c + g)^2`` and ``(c g + s2)^2``, since ``eta^2 c + g = (c + g) (c g + s2)``.

    No comparison holds with NaN, so conditions are written such that NaN goes where it is computed with.
    """
    k = (eta - 1) * (eta + 1)
    g2 = dr.select(s2 < 0.5, eta * eta - s2, k + c * c)
    reflects = g2 <= 0
    g = dr.sqrt(dr.select(reflects, 1, g2))
    cg = c * g
    a, q = 1 / (c + g), 1 / (cg + s2)
    rs = k * a * a
    low = rs * rs < below
    ratio = dr.select(low, cg - s2, eta) * q
    return reflects, low, dr.select(low, 0.5 * rs * rs, 2 * cg * (a * a)) * (1 + ratio * ratio)


def fresnel_conductor(c: Any, s2: Any, eta: Any, k: Any) -> Any:
    """Unpolarised reflectance of a smooth conductor of complex index ``eta + i k``.

    ``n = eta + i k``, ``(a + i b)^2 = n^2 - s2``, ``R_s = |(a + i b - c) / (a + i b + c)|^2``, ``R_p / R_s =
    |((a + i b) c - s2) / ((a + i b) c + s2)|^2``, ``F = (R_s + R_p) / 2``. Numerator times denominator is ``n^2 - 1 =
    (n - 1)(n + 1)`` and ``n^2 c^2 - s2``: divided by these, only the denominators are left, sums of positive terms in
    which `b` is in ``a^2 + b^2`` alone. `a` is from a sum, or ``eta k / b``. Where F is near 1, as that of metals and
    at grazing, it is ``1 - T``, with
    ``T = 2 a c (1 + (a^2 + b^2 + s2) / ((a c + s2)^2 + b^2 c^2)) / ((a + c)^2 + b^2)``.

    Parameters
    ----------
    c, s2 : float
        Cosine (>= 0) and squared sine of the angle of incidence [1].
    eta, k : float or colour
        Real and imaginary part of the index of refraction, inside over outside, >= 0 [1].

    Returns
    -------
    as eta and k
        In [0, 1]; with ``k = 0`` that of `fresnel_dielectric`.

    References
    ----------
    born1999, sec. 14.2.
    """
    k2, c2, product = k * k, c * c, 2 * eta * k
    less, more, square = eta - 1, eta + 1, (eta - k) * (eta + k)
    t = dr.select(s2 < 0.5, square - s2, less * more - k2 + c2)
    positive = t >= 0
    vanishing = VANISHING[is_double(t)]
    modulus2 = t * t + product * product
    mirror = modulus2 <= vanishing * vanishing  # selected, not a floor: its derivative, masked by 0, would be infinite
    modulus = dr.sqrt(dr.select(mirror, 1, modulus2))
    w2 = 2 * (modulus + dr.select(positive, t, -t))
    ac = c * (dr.rsqrt(w2) * dr.select(positive, w2, 2 * product))  # 2 a c
    s = 1 / (modulus + c2 + ac)
    p = 1 / dr.maximum(modulus * c2 + s2 * (s2 + ac), vanishing)  # eta and k next to 0 at normal incidence
    rs = ((less * less + k2) * s) * ((more * more + k2) * s)
    low = rs < RS_MIDDLE
    x, y = (square * c2 - s2) * p, product * c2 * p
    part = dr.select(low, 0.5 * rs, ac * s) * (1 + dr.select(low, x * x + y * y, (modulus + s2) * p))
    return dr.select(mirror, 1, dr.select(low, part, 1 - part))


def fresnel_schlick(c: Any, s2: Any, eta: Any) -> Any:
    """Schlick's approximation ``F0 + (1 - F0)(1 - c)^5`` with ``F0 = ((eta - 1)/(eta + 1))^2``.

    ``1 - F0`` is a product, and ``1 - c`` is ``s2 / (1 + c)`` where it would cancel. The derivative is that of ``(1 -
    c)^5 + F0 (1 - (1 - c)^5)``, the bracket as `c` times a sum. There is no total internal reflection in it.

    Parameters
    ----------
    c, s2 : float
        Cosine (>= 0) and squared sine of the angle of incidence [1].
    eta : float
        Relative index of refraction, > 0 [1].

    References
    ----------
    schlick1994, eq. 15.
    """
    r = amplitude_at_normal(eta)
    x = less_cosine(c, s2)
    x2 = x * x
    x5 = x2 * x2 * x
    return with_gradient(r * r + transmittance_at_normal(eta) * x5, x5 + r * r * less_fifth_power(c, x))


def transmittance_schlick(c: Any, s2: Any, eta: Any) -> Any:
    """``1 - fresnel_schlick = (1 - F0) (1 - (1 - c)^5)``, without a difference at grazing; ``1 - F0`` as a product.

    Parameters
    ----------
    c, s2 : float
        Cosine (>= 0) and squared sine of the angle of incidence [1].
    eta : float
        Relative index of refraction, > 0 [1].

    References
    ----------
    schlick1994, eq. 15.
    """
    return transmittance_at_normal(eta) * less_fifth_power(c, less_cosine(c, s2))


def amplitude_at_normal(eta: Any) -> Any:
    """``(eta - 1)/(eta + 1)``, the amplitude reflected at normal incidence; its square is F0."""
    # d/d eta of 1 - 2/(eta + 1): no difference of near numbers
    return with_gradient((eta - 1) / (eta + 1), -2 / (eta + 1))


def transmittance_at_normal(eta: Any) -> Any:
    """``4 eta / (1 + eta)^2``, which is ``1 - F0``."""
    half, r = 2 / (1 + eta), amplitude_at_normal(eta)
    return with_gradient(eta * half * half, -r * r)


def less_cosine(c: Any, s2: Any) -> Any:
    """``1 - c``: from the sine where that difference cancels, else as it is, which keeps the sine's roundings out."""
    return dr.select(c < 0.5, 1 - c, s2 / (1 + c))


def less_fifth_power(c: Any, x: Any) -> Any:
    """``1 - (1 - c)^5`` as `c` times a sum of positive terms; ``x = 1 - c``."""
    return c * (1 + x * (1 + x * (1 + x * (1 + x))))


def fresnel_dielectric_mean(eta: Any) -> Any:
    """Reflectance of a smooth dielectric for light that comes evenly from all directions: ``2 integral of F c dc``.

    With the amplitude ``v = (g - c)/(g + c)`` of `fresnel_dielectric` in place of the cosine the integrand is rational:
    ``k/8 integral from r to 1 of (1 + q^2)(1 - v^2) dv``, where ``k = eta^2 - 1``, ``r = (eta - 1)/(eta + 1)`` and
    ``q = (k (1 - v)/(2 v) - 1)/(1 + k (1 - v)/2)``. The closed form is Walsh's, here in powers of `r`, and with
    ``(atanh r - r)/r^3`` in place of ``log eta``: nothing large is left to cancel, neither near ``eta = 1``, where the
    mean is ``(eta - 1)/3``, nor above.

    From inside, where part of the light is totally reflected, it follows from reciprocity:
    ``mean(1/eta) = 1 - (1 - mean(eta))/eta^2``, whatever the law of F outside.

    Parameters
    ----------
    eta : float
        Relative index of refraction, far side over near side, > 0 [1].

    Returns
    -------
    float
        In [0, 1); .0918 for 1.5, .5963 for 1/1.5, 0 for 1.

    References
    ----------
    walsh1926; egan1979.
    """
    inside = eta < 1
    r = amplitude_at_normal(eta)
    r = dr.select(inside, -r, r)  # that of 1/eta
    some = dr.select(r > 0, r, 1)
    r2 = r * r
    plus, minus = 1 + r2, 1 - r2
    smooth = minus * minus * (1 + atanh_rest(r) * (plus + 4 * r2 / plus)) * 0.5
    logs = -dr.log(some) - 0.5 * (1 - r) * (1 - r * (2 + r))
    ratio = (1 + r) / plus
    bracket = (2 + r) / 3 + 4 * r / (plus * plus) + ratio * ratio * (smooth - 4 * r * logs / plus)
    outside = 0.5 * r * bracket
    return dr.select(inside, (1 - eta) * (1 + eta) + eta * eta * outside, outside)


def fresnel_schlick_mean(eta: Any) -> Any:
    """``2 integral of F c dc = (1 + 20 F0)/21`` of Schlick's approximation, from outside.

    Parameters
    ----------
    eta : float
        Relative index of refraction, > 0 [1].

    References
    ----------
    schlick1994, eq. 15.
    """
    r = amplitude_at_normal(eta)
    return (1 + 20 * r * r) / 21
