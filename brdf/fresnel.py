"""Fresnel reflectance of a smooth facet.

All take ``(c, s2)``: cosine and squared sine of the angle between light and facet normal, as a pair: ``1 - c^2``
computed inside would lose the digits that decide at grazing and at the critical angle.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from .stable import with_gradient


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
    k = (eta - 1) * (eta + 1)
    g2 = dr.select(s2 < 0.5, eta * eta - s2, k + c * c)
    refracts = g2 > 0
    g = dr.sqrt(dr.select(refracts, g2, 1))
    sum_cg = c + g
    rs = k / (sum_cg * sum_cg)
    cg = c * g
    ratio = (cg - s2) / (cg + s2)
    low = rs * rs * (1 + ratio * ratio) * 0.5
    a, b = 1 / sum_cg, eta / (eta * eta * c + g)  # squared last: the squares of a quotient overflow in a derivative
    high = 1 - 2 * cg * (a * a + b * b)
    return dr.select(refracts, dr.select(low < 0.5, low, high), 1)


def fresnel_schlick(c: Any, eta: Any) -> Any:
    """Schlick's approximation ``F0 + (1 - F0)(1 - c)^5`` with ``F0 = ((eta - 1)/(eta + 1))^2``.

    Written as ``(1 - c)^5 + F0 (1 - (1 - c)^5)``, the bracket as ``c`` times a sum of positive terms, so that neither
    the value nor its derivative in eta cancels at grazing. There is no total internal reflection in it.

    Parameters
    ----------
    c : float
        Cosine of the angle of incidence, in [0, 1] [1].
    eta : float
        Relative index of refraction, > 0 [1].

    References
    ----------
    schlick1994, eq. 15.
    """
    r = (eta - 1) / (eta + 1)
    r = with_gradient(r, -2 / (eta + 1))  # d/d eta of 1 - 2/(eta + 1): no difference of near numbers
    x = 1 - c
    x2 = x * x
    return x2 * x2 * x + r * r * (c * (1 + x * (1 + x * (1 + x * (1 + x)))))
