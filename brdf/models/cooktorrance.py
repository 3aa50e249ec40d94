"""Cook and Torrance's microfacet reflection over a diffuse base."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import drjit as dr

from .. import fresnel, geometry, microfacet
from ..model import Lobe, Model, Values
from ..param import Param, choice, colour, number

#: What the specular lobe is multiplied with to be as each has it. All but Walter's reflect more than arrives.
NORMALIZATION = {"walter": 1.0, "cook": 4.0, "ngan": 4 / math.pi}

#: Blinn's exponent ``2 / m^2 - 2`` is not negative up to here.
BLINN_M_MAX = 1.0

#: Aluminium, in linear sRGB: the measured spectra that Mitsuba has under the name Al.
ALUMINIUM_ETA, ALUMINIUM_K = (1.657, 0.880, 0.521), (9.224, 6.270, 4.837)

#: `eta` of a conductor: a colour, and it may be below 1.
CONDUCTOR_ETA = colour(
    "eta",
    ALUMINIUM_ETA,
    "index of refraction, inside over outside",
    bounds=(0.0, 20.0),
    scale="log",
    hint="eta is the real part of a metal's index; the imaginary part is k.",
)


class CookTorrance(Model):
    """``f = diffuse_reflectance / pi + specular_reflectance F D G / (4 cos_i cos_o)``.

    The two lobes are not coupled: near grazing their sum can reflect more than arrives. Built only from ``wi + wo``,
    ``|wi - wo|^2``, and the smaller and larger cosine, it is reciprocal bit for bit.

    The constant is 1/4 with ``normalization="walter"``, by which facets reflect what they receive. Cook and Torrance
    print ``F D G / (pi cos_i cos_o)`` with Beckmann's D less its 1/pi, which is 4 times as much (in the version of 1981
    their D has a 1/4, and it is as Walter's). Ngan, Durand and Matusik keep both 1/pi: 4/pi times as much. Fitted to
    pictures, a published `specular_reflectance` goes with the constant that it was fitted with.

    With ``roughness="anisotropic"`` facets have the roughness `m_u` along x and `m_v` along y, Kajiya's anisotropic
    surface.

    Facet normals are sampled as seen from `wi`: with Smith's masking of GGX (Heitz 2018), else in V-cavities (Heitz and
    d'Eon 2014). So with ``masking="vcavity"`` of any distribution and ``masking="smith"`` of GGX no sample weighs more
    than ``specular_reflectance``. With Smith's masking of Beckmann's facets a weight is at most ``sqrt(pi)`` times the
    tangent of the facet's angle over the roughness: 7, since a random number in float32 gives no larger tangent.

    References
    ----------
    cook1982; torrance1967 (G); walter2007 (the constant 1/4, GGX); blinn1977 (the power of a cosine); ngan2005;
    kajiya1985 (anisotropy); heitz2014; heitz2018; dupuy2023.
    """

    name = "cooktorrance"
    summary = "rough metal, plastic, paint: facets of a distribution, masking, Fresnel, over a diffuse base"
    source = (
        "cook1982",
        "torrance1967",
        "walter2007",
        "blinn1977",
        "ngan2005",
        "kajiya1985",
        "heitz2014",
        "heitz2018",
        "dupuy2023",
    )
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
        number("m_u", 0.3, (1e-4, 1.5), "roughness along x, if anisotropic", scale="log"),
        number("m_v", 0.1, (1e-4, 1.5), "roughness along y, if anisotropic", scale="log"),
        number(
            "eta",
            1.5,
            (1 + 2.0**-20, 10.0),
            "index of refraction, inside over outside",
            scale="log_minus_one",
            hint="eta is inside over outside; a dielectric seen from air has eta > 1.",
        ),
        colour("k", ALUMINIUM_K, "extinction of a conductor, inside over outside", bounds=(0.0, 20.0), scale="log"),
        choice(
            "fresnel",
            ("exact", "schlick", "constant", "conductor"),
            "F of a facet: exact for a dielectric, Schlick's, or 1; exact for a conductor",
        ),
        choice("masking", ("vcavity", "smith", "none"), "G: V-shaped cavities (Cook and Torrance's), Smith's, or 1"),
        choice(
            "distribution", ("beckmann", "ggx", "blinn"), "D: distribution of facet normals; Blinn's with n = 2/m² - 2"
        ),
        choice("roughness", ("isotropic", "anisotropic"), "one roughness m, or m_u along x and m_v along y"),
        choice(
            "normalization",
            ("walter", "cook", "ngan"),
            "1/4 conserves energy; as Cook and Torrance print it 4 times that, as Ngan et al. 4/π",
        ),
    )
    lobes = (Lobe.DIFFUSE, Lobe.GLOSSY)
    trials = (
        {},
        {"m": 0.005, "m_u": 0.005, "m_v": 0.01},
        {"m": 1.0, "m_u": 1.0, "m_v": 0.7, "diffuse_reflectance": 0.5},
    )

    fresnel: str
    masking: str
    distribution: str
    roughness: str
    normalization: str

    def parameters(self) -> tuple[Param, ...]:
        unused = {"m"} if self.anisotropic else {"m_u", "m_v"}
        unused |= {"constant": {"eta", "k"}, "conductor": set()}.get(self.fresnel, {"k"})
        return tuple(self.declared(p) for p in super().parameters() if p.name not in unused)

    def declared(self, p: Param) -> Param:
        """A parameter as it is under the choices made."""
        if p.name == "eta" and self.fresnel == "conductor":
            return CONDUCTOR_ETA
        if p.name == "diffuse_reflectance" and self.fresnel == "conductor":
            return dataclasses.replace(p, default=(0.0, 0.0, 0.0))  # nothing comes back from within a metal
        if p.name in ("m", "m_u", "m_v") and self.distribution == "blinn":
            return dataclasses.replace(p, bounds=(p.bounds[0], BLINN_M_MAX))
        return p

    @property
    def anisotropic(self) -> bool:
        return self.roughness == "anisotropic"

    def faults(self) -> dict[str, str]:
        found = {
            "coupling": "the diffuse base does not know what the facets reflect: at grazing both reflect in full",
        }
        if self.normalization != "walter":
            found["energy"] = f"the constant of {self.normalization} is more than the 1/4 by which energy is conserved"
        elif self.masking == "none":
            found["energy"] = "without masking, facets that hide each other reflect all the same"
        elif self.masking == "smith" and self.distribution == "blinn" and self.fresnel in ("constant", "conductor"):
            found["energy"] = "Beckmann's masking stands in for Blinn's, which from m = 0.5 on is less than needed"
        return found

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        g = geometry.half(wi, wo)
        a = self.d_half(p, g)
        match self.masking:
            case "vcavity":
                v = microfacet.vcavity_g_over_cosines(wi.z, wo.z, g.hh, g.hz)
            case "smith":
                v = self.smith_g1(p, wi) * self.smith_g1(p, wo) / (4 * wi.z * wo.z)
            case _:
                v = 1 / (4 * wi.z * wo.z)
        specular = (a * v) * (a * dr.inv_pi) * self.facet_reflectance(p, g.cos_d, g.sin2_d)
        tint = p.specular_reflectance * NORMALIZATION[self.normalization]
        return p.diffuse_reflectance * dr.inv_pi, tint * specular

    def d_half(self, p: Values, g: geometry.Half) -> Any:
        """The square root of pi D."""
        distribution = microfacet.DISTRIBUTIONS[self.distribution]
        if not self.anisotropic:
            return distribution.d_half(g.tan2, p.m)
        m = microfacet.roughness_of_normal(g, p.m_u, p.m_v)
        return distribution.d_half(g.tan2, m) * dr.sqrt((m / p.m_u) * (m / p.m_v))

    def smith_g1(self, p: Values, w: Any) -> Any:
        """Smith's masking of one direction."""
        m = microfacet.roughness_of_view(w, p.m_u, p.m_v) if self.anisotropic else p.m
        return microfacet.DISTRIBUTIONS[self.distribution].g1(w, m)

    def facet_reflectance(self, p: Values, c: Any, s2: Any) -> Any:
        """Fresnel reflectance of a facet met at cosine `c`, squared sine `s2`."""
        match self.fresnel:
            case "exact":
                return fresnel.fresnel_dielectric(c, s2, p.eta)
            case "schlick":
                return fresnel.fresnel_schlick(c, s2, p.eta)
            case "conductor":
                return fresnel.fresnel_conductor(c, s2, p.eta, p.k)
            case _:
                return 1.0

    def sample(self, p: Values, wi: Any, u: Any, lobe: int) -> Any:
        if lobe == 0:
            return geometry.cosine_hemisphere(u, wi)
        if self.smith_visible:
            m_u, m_v = (p.m_u, p.m_v) if self.anisotropic else (p.m, p.m)
            return geometry.reflect_about(wi, microfacet.ggx_visible(u, wi, m_u, m_v))
        return geometry.reflect_about(wi, microfacet.vcavity_visible(self.facet(p, u, wi), wi, u.z))

    @property
    def smith_visible(self) -> bool:
        """Whether facets are sampled as Smith's masking lets them be seen, rather than in V-cavities."""
        return self.masking == "smith" and self.distribution == "ggx"

    def facet(self, p: Values, u: Any, like: Any) -> Any:
        """A facet normal with density ``D cos``."""
        tangent = microfacet.DISTRIBUTIONS[self.distribution].tangent
        if self.anisotropic:
            c, s, m = microfacet.azimuth(u.y, p.m_u, p.m_v)
        else:
            (s, c), m = dr.sincos(dr.two_pi * u.y), p.m
        return microfacet.facet(tangent(u.x, m), c, s, like)

    def pdf(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        g = geometry.half(wi, wo)
        a = self.d_half(p, g)
        if self.smith_visible:
            v = self.smith_g1(p, wi) / (4 * wi.z)
        else:
            v = microfacet.vcavity_g1_over_cosine(wi.z, g.hh, g.hz)
        return wo.z * dr.inv_pi, (a * v) * (a * dr.inv_pi)

    def choose(self, p: Values, wi: Any) -> tuple[Any, Any]:
        c2 = wi.z * wi.z
        smooth = self.facet_reflectance(p, wi.z, dr.maximum(1 - c2, 0))
        if self.fresnel == "conductor":
            return dr.mean(p.diffuse_reflectance), dr.mean(p.specular_reflectance * smooth)
        return dr.mean(p.diffuse_reflectance), dr.mean(p.specular_reflectance) * smooth
