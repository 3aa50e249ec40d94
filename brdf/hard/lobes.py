"""Models with a lobe, and rough diffuse ones, under their choices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..models.blinnphong import BlinnPhong
from ..models.cooktorrance import CookTorrance
from ..models.kajiyakay import KajiyaKay
from ..models.lambertian import Lambertian
from ..models.orennayar import OrenNayar
from ..models.phong import Phong
from ..models.ward import Ward
from .formulas import ALBEDO, BLACK, CONDUCTOR, FACETS, SHARP, WO, Formula, Limits, whole
from .grid import HARD, METAL, Array, among

LOBE = {"diffuse_reflectance": BLACK, "specular_reflectance": ALBEDO}


def cooktorrance_width(p: Mapping[str, Array]) -> Array:
    """The smaller roughness."""
    return p["m"] if "m" in p else np.minimum(p["m_u"], p["m_v"])


def cooktorrance(**choices: str) -> Formula:
    """Under some choices."""
    model = CookTorrance(**choices)
    metal = model.fresnel == "conductor"
    rough = among(HARD["roughness up to 1" if model.distribution == "blinn" else "roughness"])
    draws = {**LOBE, "m": rough, "m_u": rough, "m_v": rough}
    draws |= METAL if metal else {"eta": among(HARD["index above 1"])}
    return whole(model, CONDUCTOR if metal else FACETS, draws, cooktorrance_width)


#: A product of two numbers.
PRODUCT = Limits(1, 1)
#: Oren and Nayar's `full` is a difference of two fits where it is nearly black.
FITS = Limits(8, 16)
POWER = {**LOBE, "exponent": among(HARD["exponent"])}
SLOPES = {**LOBE, "alpha_u": among(HARD["roughness"]), "alpha_v": among(HARD["roughness"])}
FACET = {"reflectance": ALBEDO, "sigma": among(HARD["angle"])}


def blinn_width(p: Mapping[str, Array]) -> Array:
    """Slope of the half vector at which ``cos^exponent`` is 1/e."""
    return np.sqrt(2 / (p["exponent"] + 2))


def phong_width(p: Mapping[str, Array]) -> Array:
    """About the mirror direction, of which the half vector makes half the angle."""
    return 0.5 * blinn_width(p)


def kajiyakay() -> Formula:
    """Half the directions are turned about the thread, to all sides of the cone, where it is as bright.

    Limits: the lobe is Phong's, of two angles to the thread; the square root that each takes halves the error of its
    argument and adds a rounding, no more than the sums of three products in Phong's own.
    """
    mirror = whole(KajiyaKay(), FACETS, POWER, phong_width)

    def points(rng: np.random.Generator, n: int) -> Mapping[str, Array]:
        found = dict(mirror.points(rng, n))
        y, z = (found[name] for name in WO[1:])
        sin, turn = np.hypot(y, z), rng.uniform(0, np.pi, n)
        turned = rng.random(n) < 0.5
        return {
            **found,
            "wo.y": np.where(turned, sin * np.cos(turn), y),
            "wo.z": np.where(turned, sin * np.sin(turn), z),
        }

    return replace(mirror, points=points)


def wide(p: Mapping[str, Array]) -> Array:
    """Without a lobe."""
    return np.ones_like(p["reflectance"])


def ward_width(p: Mapping[str, Array]) -> Array:
    """The smaller roughness."""
    return np.minimum(p["alpha_u"], p["alpha_v"])


LOBES = [
    cooktorrance(),
    cooktorrance(fresnel="schlick", masking="smith", distribution="ggx", roughness="anisotropic"),
    cooktorrance(fresnel="constant", masking="none", distribution="blinn", normalization="cook"),
    cooktorrance(fresnel="conductor", masking="smith", roughness="anisotropic", normalization="ngan"),
    cooktorrance(fresnel="conductor"),
    cooktorrance(masking="smith"),
    *(whole(Phong(normalization=kind), FACETS, POWER, phong_width) for kind in ("classic", "modified")),
    *(whole(BlinnPhong(normalization=kind), SHARP, POWER, blinn_width) for kind in ("exact", "common")),
    *(whole(Ward(variant=kind), SHARP, SLOPES, ward_width) for kind in ("ward", "duer", "balanced")),
    kajiyakay(),
    *(whole(OrenNayar(variant=kind), FITS, FACET, wide) for kind in ("full", "fast")),
    whole(Lambertian(), PRODUCT, {"reflectance": ALBEDO}, wide),
]
