"""Blinn's lobe of the half vector, over a diffuse base."""

from __future__ import annotations

from typing import Any

import drjit as dr

from .. import geometry, microfacet
from ..model import Lobe, Model, Values
from ..param import choice, colour, number
from ..stable import EXPONENT_CAP, is_double, log1p


class BlinnPhong(Model):
    """``f = diffuse_reflectance / pi + specular_reflectance N cos_h^exponent``, ``cos_h`` of the half vector.

    ``normalization="exact"``: ``N = (n + 2) (n + 4) / (8 pi (n + 2^(-n/2)))`` with ``n = exponent``, which reflects
    ``specular_reflectance`` at normal incidence and less elsewhere. ``"common"``: ``N = (n + 8) / (8 pi)``, which many
    renderers take for it, and which reflects up to 7.5 % too much.

    Written in ``tan^2`` of the half vector, ``cos_h^n = exp(-n/2 log(1 + tan^2))``: accurate for any exponent, and
    reciprocal bit for bit. Half vectors are sampled as seen from `wi` (Heitz and d'Eon 2014, V-cavities), so that no
    sample weighs more than ``specular_reflectance 8 pi N / (n + 2)``: 4 times for ``n = 0``, once for a sharp lobe.

    References
    ----------
    blinn1977; akenine2008 (N, common); heitz2014 (sampling).
    """

    name = "blinnphong"
    summary = "glossy highlight by the half vector, as in real-time graphics, over a diffuse base"
    source = ("blinn1977", "akenine2008", "heitz2014")
    params = (
        colour("diffuse_reflectance", 0.5, "albedo of the diffuse base"),
        colour("specular_reflectance", 0.4, "albedo of the lobe at normal incidence"),
        number("exponent", 30.0, (0.0, 1e6), "sharpness: the power of the half vector's cosine", scale="log"),
        choice("normalization", ("exact", "common"), "N: exact, or the usual (n+8)/(8 pi), which reflects too much"),
    )
    lobes = (Lobe.DIFFUSE, Lobe.GLOSSY)
    trials = (
        {},
        {"exponent": 1.0, "specular_reflectance": 1.0},
        {"exponent": 10.0, "specular_reflectance": 1.0},
        {"exponent": 300.0},
    )

    normalization: str

    def faults(self) -> dict[str, str]:
        found = {
            "coupling": "the lobe is added to a diffuse base that does not give way to it",
            "peak": "the lobe is a function of the half vector alone, largest where that is the normal: it has no "
            "off-specular peak",
        }
        if self.normalization == "common":
            found["energy"] = "(n + 8) / (8 pi) is too large between its ends: the albedo is 1.075 for n = 10"
        return found

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        n = p.exponent
        lobe = power(geometry.half(wi, wo).tan2, n)
        if self.normalization == "exact":
            scale = (n + 2) * (0.125 * dr.inv_pi) * ((n + 4) / (n + dr.exp2(-0.5 * n)))
        else:
            scale = (n + 8) * (0.125 * dr.inv_pi)
        return p.diffuse_reflectance * dr.inv_pi, p.specular_reflectance * (lobe * scale)

    def sample(self, p: Values, wi: Any, u: Any, lobe: int) -> Any:
        if lobe == 0:
            return geometry.cosine_hemisphere(u, wi)
        h = geometry.cosine_power_hemisphere(u, p.exponent + 1, wi)  # by area: D cos_h
        return geometry.reflect_about(wi, microfacet.vcavity_visible(h, wi, u.z))

    def pdf(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        g = geometry.half(wi, wo)
        D = power(g.tan2, p.exponent) * ((p.exponent + 2) * (0.5 * dr.inv_pi))
        return wo.z * dr.inv_pi, D * microfacet.vcavity_g1_over_cosine(wi.z, g.hh, g.hz)

    def choose(self, p: Values, wi: Any) -> tuple[Any, Any]:
        # From 1 for a flat lobe to the squared cosine for a sharp one.
        glossy = (1 + p.exponent * wi.z * wi.z) / (1 + p.exponent)
        return dr.mean(p.diffuse_reflectance), dr.mean(p.specular_reflectance) * glossy


def power(tan2: Any, n: Any) -> Any:
    """``cos^n`` from the squared tangent: ``1 - cos`` would cancel, and a power of it lose `n` times its rounding."""
    return dr.exp(-dr.minimum(0.5 * n * log1p(tan2), EXPONENT_CAP[is_double(tan2)]))
