"""Models as an outsider might write them: of each kind of lobe one, and some with something wrong."""

from __future__ import annotations

from typing import Any

import drjit as dr

from brdf import Ideal, Lobe, Model, colour, number


class Paper(Model):
    """A sheet that lets light through: diffuse on both sides, and some of it straight."""

    name = "paper"
    summary = "a thin sheet of paper"
    source = ("nobody",)
    params = (
        colour("reflectance", 0.4, "goes back"),
        colour("transmittance", 0.3, "goes through, and spreads"),
        colour("straight", 0.2, "goes through as it came"),
    )
    lobes = (Lobe.DIFFUSE, Lobe.DIFFUSE_TRANSMISSION, Lobe.STRAIGHT)

    def f(self, p: Any, wi: Any, wo: Any) -> Any:
        return p.reflectance * dr.inv_pi, p.transmittance * dr.inv_pi, 0.0

    def ideal(self, p: Any, wi: Any, lobe: int) -> Ideal:
        return Ideal(-wi, p.straight)


class Uncoupled(Model):
    """Declares what it breaks."""

    name = "uncoupled"
    summary = "two diffusers that know nothing of each other"
    source = ("nobody",)
    params = (number("reflectance", 0.7, (0.0, 1.0), "of each"),)
    lobes = (Lobe.DIFFUSE, Lobe.DIFFUSE)

    def f(self, p: Any, wi: Any, wo: Any) -> Any:
        return p.reflectance * dr.inv_pi, p.reflectance * dr.inv_pi

    def faults(self) -> dict[str, str]:
        return {"coupling": "the two lobes are added"}


class Pious(Uncoupled):
    """Declares what does not occur."""

    name = "pious"

    def faults(self) -> dict[str, str]:
        return {"coupling": "the two lobes are added", "reciprocity": "it is only said to be so"}


class DoubleDensity(Model):
    """Its density is that of nothing: twice the cosine over pi."""

    name = "doubledensity"
    params = (number("reflectance", 0.5, (0.0, 1.0), "albedo"),)

    def f(self, p: Any, wi: Any, wo: Any) -> Any:
        return (p.reflectance * dr.inv_pi,)

    def pdf(self, p: Any, wi: Any, wo: Any) -> Any:
        return (2 * wo.z * dr.inv_pi,)


class OneSided(Model):
    """Knows the viewer alone."""

    name = "onesided"
    params = (number("reflectance", 0.5, (0.0, 1.0), "albedo seen from above"),)

    def f(self, p: Any, wi: Any, wo: Any) -> Any:
        return (p.reflectance * wi.z * dr.inv_pi,)


class Ragged(Model):
    """Is not a number at grazing angles."""

    name = "ragged"
    params = (number("reflectance", 0.5, (0.0, 1.0), "albedo"),)

    def f(self, p: Any, wi: Any, wo: Any) -> Any:
        return (dr.select(dr.minimum(wi.z, wo.z) < 1e-6, dr.nan, p.reflectance * dr.inv_pi),)


class HalfAttached(Model):
    """``f = exp(-2 depth) / (2 pi)``, of which half forgets its gradient."""

    name = "halfattached"
    params = (number("depth", 0.3, (0.0, 5.0), "how deep"),)

    def f(self, p: Any, wi: Any, wo: Any) -> Any:
        return (dr.exp(-p.depth) * dr.detach(dr.exp(-p.depth)) * (0.5 * dr.inv_pi),)


class Glowing(Model):
    """Reflects more than arrives."""

    name = "glowing"
    params = (number("reflectance", 1.3, (0.0, 2.0), "albedo"),)

    def f(self, p: Any, wi: Any, wo: Any) -> Any:
        return (p.reflectance * dr.inv_pi,)


class Blocked(Model):
    """Samples only one half of what it reflects."""

    name = "blocked"
    params = (number("reflectance", 0.5, (0.0, 1.0), "albedo"),)

    def f(self, p: Any, wi: Any, wo: Any) -> Any:
        return (p.reflectance * dr.inv_pi,)

    def sample(self, p: Any, wi: Any, u: Any, lobe: int) -> Any:
        wo = super().sample(p, wi, u, lobe)
        return type(wo)(abs(wo.x), wo.y, wo.z)

    def pdf(self, p: Any, wi: Any, wo: Any) -> Any:
        return (dr.select(wo.x >= 0, 2 * wo.z * dr.inv_pi, 0),)
