"""Clear dielectric: reflection, refraction by Snell's law, total internal reflection."""

from __future__ import annotations

from typing import Any

import drjit as dr

from .. import fresnel, geometry
from ..model import Ideal, Lobe, Model, Values
from ..param import colour, number

#: Why a derivative along paths is not that of a picture with borders in it.
EDGES = "borders of lamps and shadows seen through it move with eta, which no derivative along a path sees"


class Glass(Model):
    """A ray is split in two: ``specular_reflectance F`` is mirrored, ``specular_transmittance (1 - F)`` refracted.

    From below the index is ``1 / eta``; past the critical angle all light is mirrored. The refracted direction moves
    with `eta`, and carries that derivative. Weights are of power: radiance also changes by the square of the index,
    which is left to whoever carries it.

    References
    ----------
    whitted1980; born1999, sec. 1.5.
    """

    name = "glass"
    summary = "clear glass, water, diamond: mirror reflection and refraction at a smooth surface"
    source = ("whitted1980", "born1999")
    params = (
        number(
            "eta",
            1.5,
            (0.1, 10.0),
            "index of refraction, inside over outside",
            scale="log",
            hint="eta is inside over outside; a bubble of air in water has eta < 1.",
        ),
        colour("specular_reflectance", 1.0, "tint of the reflected light; 1 is physical"),
        colour("specular_transmittance", 1.0, "tint of the refracted light; 1 is physical"),
    )
    lobes = (Lobe.MIRROR, Lobe.REFRACTION)
    trials = ({}, {"eta": 1 / 1.333}, {"eta": 2.419})

    def ideal(self, p: Values, wi: Any, lobe: int) -> Ideal:
        far = far_index(p, wi)
        c, s2 = abs(wi.z), geometry.sine2(wi)
        if self.lobes[lobe] is Lobe.MIRROR:
            return Ideal(geometry.reflect(wi), p.specular_reflectance * fresnel.fresnel_dielectric(c, s2, far))
        wo, _ = geometry.refract(wi, far)
        return Ideal(wo, p.specular_transmittance * fresnel.transmittance_dielectric(c, s2, far), far)

    def choose(self, p: Values, wi: Any) -> tuple[Any, Any]:
        return dr.mean(self.ideal(p, wi, 0).weight), dr.mean(self.ideal(p, wi, 1).weight)

    def faults(self) -> dict[str, str]:
        return {
            "gradient_path": "path cuts the derivative of the refracted direction, which moves with eta",
            "gradient_prb": "prb takes derivatives from eval, which is 0 for an ideal lobe: it finds none, and raises",
            "gradient_effects": EDGES,
            "gradient_raytree": EDGES,
        }


def far_index(p: Values, wi: Any) -> Any:
    """The index of refraction on the other side of the surface over that on the side of `wi`."""
    return dr.select(wi.z > 0, p.eta, 1 / p.eta)
