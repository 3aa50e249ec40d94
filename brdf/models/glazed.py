"""Diffuse base under a smooth dielectric coat: glazed tiles, varnish, polished plastic."""

from __future__ import annotations

from typing import Any

import drjit as dr

from .. import fresnel, geometry
from ..model import Ideal, Lobe, Model, Values
from ..param import choice, colour, number


class Glazed(Model):
    """Mirror ``specular_reflectance F``, and below it ``f = diffuse (1 - F_i) (1 - F_o) / (pi eta^2 (1 - diffuse K))``.

    Light crosses the coat on its way in and out, and between them meets it from inside again and again: K is the mean
    reflectance of the coat from inside. Reciprocity says ``eta^2 (1 - K) = 1 - mean F``, whatever the law of F, so that
    ``1 - diffuse K`` is ``(1 - diffuse) + diffuse (1 - mean F) / eta^2``, a sum of positive terms. The two lobes are
    coupled: a white base reflects all that arrives, under any coat; a black one leaves the mirror.

    With ``fresnel="constant"`` F is that of normal incidence, ``((eta - 1)/(eta + 1))^2``, at all angles.

    References
    ----------
    saunderson1942; wolff1994; schlick1994.
    """

    name = "glazed"
    summary = "diffuse base under a clear, smooth coat: glazed tile, varnish, polished plastic"
    source = ("saunderson1942", "wolff1994", "schlick1994")
    params = (
        number(
            "eta",
            1.5,
            (1 + 2.0**-20, 10.0),
            "index of refraction of the coat, inside over outside",
            scale="log_minus_one",
            hint="eta is inside over outside; a coat seen from air has eta > 1.",
        ),
        colour("diffuse_reflectance", 0.5, "albedo of the base, without the coat"),
        colour("specular_reflectance", 1.0, "tint of the mirror reflection; 1 is physical"),
        choice(
            "fresnel", ("exact", "schlick", "constant"), "F of the coat: exact, Schlick's, or that of normal incidence"
        ),
    )
    lobes = (Lobe.MIRROR, Lobe.DIFFUSE)
    trials = ({}, {"diffuse_reflectance": 1.0}, {"diffuse_reflectance": 0.0}, {"eta": 3.0})

    fresnel: str

    def ideal(self, p: Values, wi: Any, lobe: int) -> Ideal:
        return Ideal(geometry.reflect(wi), p.specular_reflectance * self.reflectance(p, wi))

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        # each by its own eta: the square of a large one underflows in its derivative
        through = (self.transmittance(p, wi) / p.eta) * (self.transmittance(p, wo) / p.eta)
        return 0.0, self.base(p) * through * dr.inv_pi

    def choose(self, p: Values, wi: Any) -> tuple[Any, Any]:
        diffuse = dr.mean(self.base(p)) * self.transmittance(p, wi) * self.leaves(p)
        return dr.mean(p.specular_reflectance) * self.reflectance(p, wi), diffuse

    def faults(self) -> dict[str, str]:
        return {
            "gradient_prb": "prb takes derivatives from eval: where the mirror was sampled it finds the diffuse lobe's"
        }

    def base(self, p: Values) -> Any:
        """``diffuse / (1 - diffuse K)``: what the base sends up for what has come in through the coat."""
        kd = p.diffuse_reflectance
        return kd / ((1 - kd) + kd * self.leaves(p))

    def leaves(self, p: Values) -> Any:
        """``1 - K``: the fraction of even light inside that leaves."""
        return (1 - self.mean_reflectance(p)) / p.eta / p.eta

    def reflectance(self, p: Values, w: Any) -> Any:
        """F of the coat for one direction."""
        match self.fresnel:
            case "exact":
                return fresnel.fresnel_dielectric(w.z, geometry.sine2(w), p.eta)
            case "schlick":
                return fresnel.fresnel_schlick(w.z, geometry.sine2(w), p.eta)
            case _:
                return dr.square(fresnel.amplitude_at_normal(p.eta))

    def transmittance(self, p: Values, w: Any) -> Any:
        """1 - F."""
        match self.fresnel:
            case "exact":
                return fresnel.transmittance_dielectric(w.z, geometry.sine2(w), p.eta)
            case "schlick":
                return fresnel.transmittance_schlick(w.z, geometry.sine2(w), p.eta)
            case _:
                return fresnel.transmittance_at_normal(p.eta)

    def mean_reflectance(self, p: Values) -> Any:
        """F of the coat for light from all directions outside."""
        match self.fresnel:
            case "exact":
                return fresnel.fresnel_dielectric_mean(p.eta)
            case "schlick":
                return fresnel.fresnel_schlick_mean(p.eta)
            case _:
                return dr.square(fresnel.amplitude_at_normal(p.eta))
