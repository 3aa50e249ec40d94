"""Phong's lobe about the mirror direction, over a diffuse base."""

from __future__ import annotations

from typing import Any

import drjit as dr

from .. import geometry
from ..model import Lobe, Model, Values
from ..param import choice, colour, number
from ..stable import cosine_power


class Phong(Model):
    """``f = diffuse_reflectance / pi + specular_reflectance N a^exponent``, with a lobe only where ``a > 0``.

    ``a = wo.r`` is the cosine between `wo` and the mirror direction ``r`` of `wi`.

    ``normalization="classic"``: ``N = 1 / cos_o``, with the light at `wo`. What is seen, ``f cos_o``, is then
    ``specular_reflectance a^exponent``, as Phong shaded: the maximum of ``a^exponent`` is 1, always in the mirror
    direction. Such a lobe is not reciprocal, and reflects ``2 pi / (exponent + 1)`` of the light at normal incidence:
    more than arrives if the exponent is small.

    ``normalization="modified"``: ``N = (exponent + 2) / (2 pi)``, Lafortune and Willems'. It is reciprocal, bit for
    bit, and conserves energy.

    The third term of Phong's shading, ambient, is light and not material: it is not here. A constant environment of
    radiance L gives it, as ``diffuse_reflectance L``.

    Sampled about the mirror direction with density ``(exponent + 1) / (2 pi) a^exponent``; what falls below the horizon
    weighs nothing. What does not weighs, in units of ``specular_reflectance``, ``2 pi / (exponent + 1)`` (classic), or
    ``(exponent + 2) / (exponent + 1)`` at most (modified).

    References
    ----------
    phong1975; lafortune1994.
    """

    name = "phong"
    summary = "glossy highlight about the mirror direction, as in early computer graphics, over a diffuse base"
    source = ("phong1975", "lafortune1994")
    params = (
        colour("diffuse_reflectance", 0.5, "albedo of the diffuse base"),
        colour("specular_reflectance", 0.4, "factor of the lobe: its albedo at normal incidence, if modified"),
        number("exponent", 30.0, (0.0, 1e6), "sharpness: the power of the cosine to the mirror direction", scale="log"),
        choice(
            "normalization", ("classic", "modified"), "N: Phong's 1 / cos_o, or Lafortune and Willems' (n+2)/(2 pi)"
        ),
    )
    lobes = (Lobe.DIFFUSE, Lobe.GLOSSY)
    trials = (
        {},
        {"exponent": 1.0, "specular_reflectance": 1.0},
        {"exponent": 30.0, "specular_reflectance": 1.0},
    )

    normalization: str

    def faults(self) -> dict[str, str]:
        found = {
            "coupling": "the lobe is added to a diffuse base that does not give way to it",
            "peak": "the lobe is a function of the angle to the mirror direction alone: it has no off-specular peak",
        }
        if self.normalization == "classic":
            found["reciprocity"] = "a^n is divided by the cosine of the light alone"
            found["energy"] = (
                "the maximum is 1 for any exponent: the albedo at normal incidence is 2 pi / (exponent + 1)"
            )
        return found

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        a_n = lobe(p.exponent, wi, wo)
        seen = a_n / wo.z if self.normalization == "classic" else a_n * ((p.exponent + 2) * (0.5 * dr.inv_pi))
        return p.diffuse_reflectance * dr.inv_pi, p.specular_reflectance * seen

    def sample(self, p: Values, wi: Any, u: Any, lobe: int) -> Any:
        if lobe == 0:
            return geometry.cosine_hemisphere(u, wi)
        return geometry.about(geometry.reflect(wi), geometry.cosine_power_hemisphere(u, p.exponent, wi))

    def pdf(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        return wo.z * dr.inv_pi, lobe(p.exponent, wi, wo) * ((p.exponent + 1) * (0.5 * dr.inv_pi))

    def choose(self, p: Values, wi: Any) -> tuple[Any, Any]:
        if self.normalization == "classic":
            glossy = dr.two_pi / (p.exponent + 1)
        else:  # from 1 for a flat lobe to the cosine for a sharp one
            glossy = (1 + p.exponent * wi.z) / (1 + p.exponent)
        return dr.mean(p.diffuse_reflectance), dr.mean(p.specular_reflectance) * glossy


def lobe(n: Any, wi: Any, wo: Any) -> Any:
    """``a^n``, symmetric in `wi` and `wo` bit for bit; 0 where ``a <= 0``."""
    r = geometry.reflect(wi)
    return cosine_power(geometry.square(wo - r), dr.dot(wo, r), n)
