"""Models with a lobe, and rough diffuse ones, under their choices."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..models.cooktorrance import CookTorrance
from .formulas import ALBEDO, BLACK, CONDUCTOR, FACETS, Formula, whole
from .grid import HARD, METAL, Array, among


def cooktorrance_width(p: Mapping[str, Array]) -> Array:
    """The smaller roughness."""
    return p["m"] if "m" in p else np.minimum(p["m_u"], p["m_v"])


def cooktorrance(**choices: str) -> Formula:
    """Under some choices."""
    model = CookTorrance(**choices)
    metal = model.fresnel == "conductor"
    rough = among(HARD["roughness up to 1" if model.distribution == "blinn" else "roughness"])
    draws = {"m": rough, "m_u": rough, "m_v": rough, "diffuse_reflectance": BLACK, "specular_reflectance": ALBEDO}
    draws |= METAL if metal else {"eta": among(HARD["index above 1"])}
    return whole(model, CONDUCTOR if metal else FACETS, draws, cooktorrance_width)


LOBES = [
    cooktorrance(),
    cooktorrance(fresnel="schlick", masking="smith", distribution="ggx", roughness="anisotropic"),
    cooktorrance(fresnel="constant", masking="none", distribution="blinn", normalization="cook"),
    cooktorrance(fresnel="conductor", masking="smith", roughness="anisotropic", normalization="ngan"),
    cooktorrance(fresnel="conductor"),
    cooktorrance(masking="smith"),
]
