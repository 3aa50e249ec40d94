"""A BSDF, and pairs of directions, hit points and contexts to ask it with."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from tests.oracles import directions

VARIANTS = ["llvm_ad_rgb", "llvm_ad_mono", "llvm_ad_spectral", "scalar_rgb"]
RED, GREEN, BLUE = 0.1, 0.4, 0.9
TINTED = {
    "type": "cooktorrance",
    "m": 0.2,
    "eta": 1.7,
    "diffuse_reflectance": {"type": "rgb", "value": [RED, GREEN, BLUE]},
    "specular_reflectance": {"type": "rgb", "value": [0.9, 0.8, 0.5]},
}
N = 4000


def spread(m: float = 0.2, n: int = N, seed: int = 1) -> tuple[Any, Any]:
    """Random pairs above the surface, half of them as a lobe of roughness m has them, shape (n, 3)."""
    rng = np.random.default_rng(seed)
    wi, wo = directions.hemisphere(n, seed), directions.hemisphere(n, seed + 1)
    h = np.concatenate([rng.normal(0, m, (n, 2)), np.ones((n, 1))], axis=1)
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    near = 2 * np.sum(wi * h, axis=1, keepdims=True) * h - wi
    return wi, np.where((np.arange(n) % 2 == 0)[:, None] & (near[:, 2:] > 0), near, wo)


def interaction(wi: Any) -> mi.SurfaceInteraction3f:
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = mi.Vector3f(wi.T)
    return si


def array(value: Any) -> Any:
    return np.asarray(value, dtype=np.float64)


def components(bsdf: mi.BSDF) -> list[mi.BSDFContext]:
    made = []
    for i in range(bsdf.component_count()):
        context = mi.BSDFContext()
        context.component = i
        made.append(context)
    return made


def types(*flags: mi.BSDFFlags) -> mi.BSDFContext:
    context = mi.BSDFContext()
    context.type_mask = sum(int(f) for f in flags)
    return context


WI, WO = spread()
