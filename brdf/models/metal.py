"""Smooth metal: a mirror with the Fresnel reflectance of a conductor."""

from __future__ import annotations

from typing import Any

from .. import fresnel, geometry
from ..model import Ideal, Lobe, Model, Values
from ..param import colour


class Metal(Model):
    """The mirror direction, weighed by ``specular_reflectance F`` with F of a conductor of index ``eta + i k``.

    References
    ----------
    born1999, sec. 14.2.
    """

    name = "metal"
    summary = "polished metal: a mirror with the colour and the angles of its index of refraction"
    source = ("born1999",)
    params = (
        colour(
            "eta",
            (1.66, 0.88, 0.52),
            "index of refraction, real part; the default is about aluminium's",
            bounds=(0.0, 20.0),
            scale="log",
        ),
        colour(
            "k",
            (9.22, 6.27, 4.84),
            "index of refraction, imaginary part: extinction",
            bounds=(0.0, 20.0),
            scale="log",
        ),
        colour("specular_reflectance", 1.0, "tint; 1 is physical"),
    )
    lobes = (Lobe.MIRROR,)
    trials = ({}, {"eta": (0.2, 1.5, 4.0), "k": (3.9, 0.1, 0.0)})

    def ideal(self, p: Values, wi: Any, lobe: int) -> Ideal:
        F = fresnel.fresnel_conductor(wi.z, geometry.sine2(wi), p.eta, p.k)
        return Ideal(geometry.reflect(wi), p.specular_reflectance * F)

    def faults(self) -> dict[str, str]:
        return {
            "gradient_prb": "prb takes derivatives from eval, which is 0 for an ideal lobe: it finds none, and raises"
        }
