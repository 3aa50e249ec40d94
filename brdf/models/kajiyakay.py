"""Kajiya and Kay's reflection from a thread."""

from __future__ import annotations

from typing import Any

import drjit as dr

from .. import geometry
from ..model import Lobe, Model, Values
from ..param import colour, number
from ..stable import cosine_integral, cosine_power


class KajiyaKay(Model):
    """``f = (diffuse_reflectance sin_o + specular_reflectance c^exponent) / cos_o`` for threads along the local x axis.

    ``sin_o`` is the sine of the angle between the thread and the light at `wo`; ``c`` the cosine of the angle by which
    `wo` misses the cone about the thread into which a thin cylinder reflects `wi`: ``c = sin_i sin_o - wi.x wo.x``, and
    no lobe where ``c <= 0``. All of the cone is equally bright.

    A thread has no normal. What is seen of it, ``f cos_o``, is the two terms as Kajiya and Kay print them, so that the
    cosine of the surface is divided out. It is no physical BRDF: not reciprocal (the light's angles alone appear in
    ``sin_o / cos_o``), and not bounded by the light that arrives (a hemisphere of light gives
    ``diffuse_reflectance pi^2 / 2``).

    Sampled without singular weights: the diffuse term by ``sin_o``, with constant weight; the other by ``c^exponent``
    across the cone and evenly round it, with weights at most ``specular_reflectance`` times the integral of
    ``c^exponent`` times pi.

    Notes
    -----
    The two directions of the paper's lobe are those of rays, one of them towards the thread; here both point away,
    hence the minus in ``c``. That there is a surface at all, which hides half of the cone, is ours.

    References
    ----------
    kajiya1989.
    """

    name = "kajiyakay"
    summary = "threads, hair or brushed fibres along the local x axis: a highlight on a cone; not physical"
    source = ("kajiya1989",)
    params = (
        colour("diffuse_reflectance", 0.5, "factor of sin_o, the light that a thread scatters evenly"),
        colour("specular_reflectance", 0.4, "factor of the highlight on the cone"),
        number("exponent", 30.0, (0.0, 1e6), "sharpness: the power of the cosine to the cone", scale="log"),
    )
    lobes = (Lobe.DIFFUSE, Lobe.GLOSSY)
    trials = (
        {},
        {"exponent": 1.0, "specular_reflectance": 1.0},
        {"exponent": 300.0},
    )

    @property
    def anisotropic(self) -> bool:
        return True

    def faults(self) -> dict[str, str]:
        return {
            "reciprocity": "both terms are divided by the cosine of the light alone, and sin_o is of the light alone",
            "energy": "the diffuse term reflects diffuse_reflectance pi^2 / 2; the maximum of the lobe is 1 throughout",
            "coupling": "each of the two terms exceeds 1 by itself, and they are added",
            "peak": "the cone holds the mirror direction at any incidence: there is no off-specular peak",
        }

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        return p.diffuse_reflectance * (sine(wo) / wo.z), p.specular_reflectance * (lobe(p.exponent, wi, wo) / wo.z)

    def sample(self, p: Values, wi: Any, u: Any, lobe: int) -> Any:
        s, c = dr.sincos(dr.two_pi * u.y)
        if lobe == 0:
            # The abscissa of a point in a disk is distributed as the cosine of an angle of density sin^2.
            x = dr.sqrt(u.x) * c
            sin = dr.sqrt((1 - u.x) + u.x * (s * s))
        else:
            # Seen along one axis, a lobe cos^n about a direction is cos^n of the angle that is left.
            w = geometry.cosine_power_hemisphere(u, p.exponent, wi)
            length = dr.rsqrt(w.x * w.x + w.z * w.z)
            off_cos, off_sin, sin_i = w.z * length, w.x * length, sine(wi)
            x = -wi.x * off_cos - sin_i * off_sin
            sin = sin_i * off_cos - wi.x * off_sin
        s, c = dr.sincos(dr.pi * u.z)
        return type(wi)(x, sin * c, sin * s)

    def pdf(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        sin = sine(wo)
        across = lobe(p.exponent, wi, wo) / cosine_integral(p.exponent)
        return sin * (2 * dr.inv_pi * dr.inv_pi), across * (dr.inv_pi / sin)

    def choose(self, p: Values, wi: Any) -> tuple[Any, Any]:
        sin = dr.sqrt(wi.y * wi.y + wi.z * wi.z + 1 / (1 + p.exponent))
        diffuse = dr.mean(p.diffuse_reflectance) * (0.5 * dr.pi)
        return diffuse, dr.mean(p.specular_reflectance) * (cosine_integral(p.exponent) * sin)


def sine(w: Any) -> Any:
    """Sine of the angle between `w` and the thread."""
    return dr.sqrt(w.y * w.y + w.z * w.z)


def lobe(n: Any, wi: Any, wo: Any) -> Any:
    """``c^n``; 0 where ``c <= 0``. The angles to the thread are those of two vectors in a half plane through it."""
    sin_i, sin_o = sine(wi), sine(wo)
    near = dr.square(wo.x + wi.x) + dr.square(sin_o - sin_i)
    return cosine_power(near, sin_i * sin_o - wi.x * wo.x, n)
