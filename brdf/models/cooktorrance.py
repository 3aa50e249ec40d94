"""Cook and Torrance's microfacet reflection over a diffuse base."""

from __future__ import annotations

from typing import Any

import drjit as dr

from .. import fresnel, geometry, microfacet
from ..model import Lobe, Model, Values
from ..param import Param, choice, colour, number


class CookTorrance(Model):
    """``f = diffuse_reflectance / pi + specular_reflectance F D G / (4 cos_i cos_o)``.

    The two lobes are not coupled: near grazing their sum can reflect more than arrives. Built only from ``wi + wo``,
    ``|wi - wo|^2``, and the smaller and larger cosine, it is reciprocal bit for bit. Facet normals are sampled as seen
    from `wi` (Heitz and d'Eon 2014, V-cavities), so that with ``masking="vcavity"`` no sample weighs more than
    ``specular_reflectance``.

    References
    ----------
    cook1982; torrance1967 (G); walter2007 (the constant 1/4); heitz2014.
    """

    name = "cooktorrance"
    summary = "rough metal, plastic, paint: Beckmann facets, masking, Fresnel, over a diffuse base"
    source = ("cook1982", "torrance1967", "walter2007", "heitz2014")
    params = (
        colour("diffuse_reflectance", 0.5, "albedo of the diffuse base"),
        colour("specular_reflectance", 1.0, "tint of the specular lobe; 1 is physical for a dielectric"),
        number(
            "m",
            0.3,
            (1e-4, 1.5),
            "Beckmann roughness: rms slope of the facets",
            scale="log",
            hint="m is the rms slope; an artist's roughness r is m = r**2.",
        ),
        number(
            "eta",
            1.5,
            (1 + 2.0**-20, 10.0),
            "index of refraction, inside over outside",
            scale="log_minus_one",
            hint="eta is inside over outside; a dielectric seen from air has eta > 1.",
        ),
        choice("fresnel", ("exact", "schlick", "constant"), "F of a facet: exact for a dielectric, Schlick's, or 1"),
        choice("masking", ("vcavity", "smith", "none"), "G: V-shaped cavities (Cook and Torrance's), Smith's, or 1"),
        choice("distribution", ("beckmann",), "D: distribution of facet normals"),
    )
    lobes = (Lobe.DIFFUSE, Lobe.GLOSSY)

    fresnel: str
    masking: str
    distribution: str

    def parameters(self) -> tuple[Param, ...]:
        unused = {"eta"} if self.fresnel == "constant" else set()
        return tuple(p for p in super().parameters() if p.name not in unused)

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        g = geometry.half(wi, wo)
        a = microfacet.beckmann_d_half(g.tan2, p.m)
        match self.masking:
            case "vcavity":
                v = microfacet.vcavity_g_over_cosines(wi.z, wo.z, g.hh, g.hz)
            case "smith":
                v = microfacet.smith_g1(wi, p.m) * microfacet.smith_g1(wo, p.m) / (4 * wi.z * wo.z)
            case _:
                v = 1 / (4 * wi.z * wo.z)
        specular = (a * v) * (a * dr.inv_pi) * self.facet_reflectance(p, g.cos_d, g.sin2_d)
        return p.diffuse_reflectance * dr.inv_pi, p.specular_reflectance * specular

    def facet_reflectance(self, p: Values, c: Any, s2: Any) -> Any:
        """Fresnel reflectance of a facet met at cosine `c`, squared sine `s2`."""
        match self.fresnel:
            case "exact":
                return fresnel.fresnel_dielectric(c, s2, p.eta)
            case "schlick":
                return fresnel.fresnel_schlick(c, p.eta)
            case _:
                return 1.0

    def sample(self, p: Values, wi: Any, u: Any, lobe: int) -> Any:
        if lobe == 0:
            return geometry.cosine_hemisphere(u, wi)
        h = microfacet.vcavity_visible(microfacet.beckmann_sample(u, p.m, wi), wi, u.z)
        return geometry.reflect_about(wi, h)

    def pdf(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        g = geometry.half(wi, wo)
        a = microfacet.beckmann_d_half(g.tan2, p.m)
        v = microfacet.vcavity_g1_over_cosine(wi.z, g.hh, g.hz)
        return wo.z * dr.inv_pi, (a * v) * (a * dr.inv_pi)

    def choose(self, p: Values, wi: Any) -> tuple[Any, Any]:
        c2 = wi.z * wi.z
        smooth = self.facet_reflectance(p, wi.z, dr.maximum(1 - c2, 0))
        return dr.mean(p.diffuse_reflectance), dr.mean(p.specular_reflectance) * smooth
