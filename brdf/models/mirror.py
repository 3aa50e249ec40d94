"""Ideal mirror of constant reflectance."""

from __future__ import annotations

from typing import Any

from .. import geometry
from ..model import Ideal, Lobe, Model, Values
from ..param import colour


class Mirror(Model):
    """All light of one direction goes into its mirror direction, weighed by ``specular_reflectance``.

    References
    ----------
    whitted1980.
    """

    name = "mirror"
    summary = "ideal mirror that reflects the same at every angle"
    source = ("whitted1980",)
    params = (colour("specular_reflectance", 1.0, "fraction of the light that is reflected"),)
    lobes = (Lobe.MIRROR,)

    def ideal(self, p: Values, wi: Any, lobe: int) -> Ideal:
        return Ideal(geometry.reflect(wi), p.specular_reflectance)

    def faults(self) -> dict[str, str]:
        return {
            "gradient_prb": "prb takes derivatives from eval, which is 0 for an ideal lobe: it finds none, and raises"
        }
