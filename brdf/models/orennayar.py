"""Oren and Nayar's rough diffuse reflection."""

from __future__ import annotations

from typing import Any

import drjit as dr

from .. import geometry
from ..model import Lobe, Model, Values
from ..param import choice, colour, number
from ..stable import with_gradient

#: 2 / pi: an angle up to 90 degrees as a fraction of that.
PER_RIGHT_ANGLE = 2 / dr.pi


class OrenNayar(Model):
    """V-shaped cavities of Lambertian facets with Gaussian slopes: flatter than Lambert's, brightest back towards `wi`.

    With `alpha` and `beta` the larger and the smaller angle from the normal, `phi` the azimuth between the directions::

        full  reflectance / pi (C1 + C2 cos(phi) tan(beta) + C3 (1 - |cos(phi)|) tan((alpha + beta) / 2))
              + .17 reflectance^2 / pi sigma^2 / (sigma^2 + .13) (1 - cos(phi) (2 beta / pi)^2)
        fast  reflectance / pi (C1 + C2 max(cos(phi), 0) tan(beta))

        C1 = 1 - .5 sigma^2 / (sigma^2 + .33)
        C2 = .45 sigma^2 / (sigma^2 + .09) (sin(alpha) - ((2 beta / pi)^3 if cos(phi) < 0 else 0))
        C3 = .125 sigma^2 / (sigma^2 + .09) (4 alpha beta / pi^2)^2

    The second line of `full` is the light that facets exchange. Both are fits to integrals. A white surface reflects
    more than arrives, towards grazing and in `full` up to 5 % too much. Where sigma is above .66, the surface dark, and
    both directions graze on opposite sides, `full` as printed is negative; here it is 0.

    Both are reciprocal, and bit for bit: they are built from the larger and the smaller of two, sums, and products.

    References
    ----------
    oren1994: the model with its coefficients and interreflection (full), the qualitative model (fast).
    """

    name = "orennayar"
    summary = "rough diffuse surfaces: clay, plaster, cloth, the full moon"
    source = ("oren1994",)
    params = (
        colour("reflectance", 0.5, "albedo of a facet"),
        number(
            "sigma",
            0.3,
            (0.0, 1.5),
            "roughness: standard deviation of the angle of the facets' slope",
            scale="logit",
            unit="rad",
            hint="sigma is an angle in radians; 1.5 is 86 degrees.",
        ),
        choice("variant", ("full", "fast"), "the fit with interreflection, or its two main terms"),
    )
    lobes = (Lobe.DIFFUSE,)
    trials = ({}, {"reflectance": 1.0, "sigma": 0.2}, {"reflectance": 0.1, "sigma": 1.5})

    variant: str

    def faults(self) -> dict[str, str]:
        return {"energy": "a fit with no bound on its albedo: a white surface reflects more than arrives at grazing"}

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any]:
        i, o = (w * dr.rsqrt(geometry.square(w)) for w in (wi, wo))
        si, so = sine(i), sine(o)
        sin_a, sin_b, cos_a, cos_b = dr.maximum(si, so), dr.minimum(si, so), dr.minimum(i.z, o.z), dr.maximum(i.z, o.z)
        across = i.x * o.x + i.y * o.y  # cos(phi) sin(alpha) sin(beta), so no 0/0 where there is no azimuth
        s2 = p.sigma * p.sigma
        flat, slope = 1 - 0.5 * saturation(s2, 0.33), 0.45 * saturation(s2, 0.09)
        toward = across / cos_b
        if self.variant == "fast":
            return (p.reflectance * dr.inv_pi * (flat + slope * dr.maximum(toward, 0)),)

        a, (b, rest) = right_angles(sin_a, cos_a)[0], right_angles(sin_b, cos_b)
        # sin(alpha) - b^3 as (1 - b^3) - (1 - sin(alpha)): where both graze each bracket is small and tan(beta) large.
        drop = rest * (1 + b * (1 + b)) - cos_a * cos_a / (1 + sin_a)
        away = toward / dr.select(sin_a > 0, sin_a, 1) * drop
        ui, uo = azimuth(i, si), azimuth(o, so)
        cos_phi, sin_phi = ui[0] * uo[0] + ui[1] * uo[1], ui[0] * uo[1] - ui[1] * uo[0]
        aside = sin_phi * sin_phi / (1 + abs(cos_phi))  # 1 - |cos(phi)|
        half_tan = (si + so) / (i.z + o.z)  # tan((alpha + beta) / 2)
        ab = a * b
        single = flat + slope * (dr.select(across < 0, away, toward) + ab * ab * aside * half_tan / 3.6)
        double = 0.17 * saturation(s2, 0.13) * (1 - cos_phi * b * b)
        return (p.reflectance * dr.inv_pi * dr.maximum(single + p.reflectance * double, 0),)


def saturation(x: Any, half: float) -> Any:
    """``x / (x + half)`` with the derivative of ``1 - half / (x + half)``, which does not cancel."""
    return with_gradient(x / (x + half), -half / (x + half))


def sine(w: Any) -> Any:
    """The sine of the angle between the unit vector `w` and the normal; on the normal 0, with derivative 0."""
    s2 = w.x * w.x + w.y * w.y
    return dr.select(s2 > 0, dr.sqrt(dr.select(s2 > 0, s2, 1)), 0)


def right_angles(s: Any, c: Any) -> tuple[Any, Any]:
    """An angle up to 90 degrees as a fraction of that, and what is left of 1, each with all its digits.

    By the smaller of sine and cosine: `dr.atan2` in float32 is off by up to 12 roundings.
    """
    low = PER_RIGHT_ANGLE * dr.asin(dr.minimum(s, c))
    return dr.select(s < c, low, 1 - low), dr.select(s < c, 1 - low, low)


def azimuth(w: Any, s: Any) -> tuple[Any, Any]:
    """The projection of `w` on the surface, of length 1 (`s` is its length); on the normal 0, which has no azimuth."""
    some = dr.select(s > 0, s, 1)
    return w.x / some, w.y / some
