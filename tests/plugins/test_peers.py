"""The table of what can be fitted of Mitsuba's own BSDFs: its names are right, and their derivatives are."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from brdf import Param
from plugins import peers, scene


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")


def rgb(*value: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(value)}


TINT = rgb(0.9, 0.8, 0.7)
METAL = {"eta": rgb(1.2, 1.0, 0.8), "k": rgb(5.0, 4.0, 3.0)}
#: For each plugin, ways to write it in which every entry of its table occurs.
GIVEN: dict[str, list[dict[str, Any]]] = {
    "diffuse": [{"reflectance": TINT}],
    "roughconductor": [
        {"alpha": 0.2, "specular_reflectance": TINT, **METAL},
        {"alpha_u": 0.2, "alpha_v": 0.3, "distribution": "ggx", **METAL},
    ],
    "roughdielectric": [
        {"alpha": 0.2, "int_ior": 1.5, "specular_reflectance": TINT, "specular_transmittance": TINT},
        {"alpha_u": 0.2, "alpha_v": 0.3, "int_ior": 1.5},
    ],
    "principled": [
        {
            "base_color": TINT,
            "roughness": 0.4,
            "eta": 1.5,
            "spec_tint": 0.2,
            "sheen": 0.3,
            "sheen_tint": 0.4,
            "clearcoat": 0.4,
            "clearcoat_gloss": 0.3,
            "flatness": 0.2,
            "anisotropic": 0.3,
            "metallic": 0.3,
            "spec_trans": 0.2,
        },
        {"base_color": TINT, "roughness": 0.4, "specular": 0.5},
    ],
}
CASES = [
    (plugin, p, given)
    for plugin, ways in GIVEN.items()
    for given in ways
    for p in peers.TABLE[plugin]
    if p.name in given or (plugin == "roughdielectric" and p.name == "eta")
]


def test_the_cases_are_the_whole_table() -> None:
    assert {(plugin, p.name) for plugin, p, _ in CASES} == {
        (n, p.name) for n, table in peers.TABLE.items() for p in table
    }


def load(plugin: str, given: dict[str, Any]) -> mi.BSDF:
    return mi.load_dict({"type": plugin, **given})


@pytest.mark.parametrize(("plugin", "param", "given"), CASES, ids=lambda c: getattr(c, "name", None) or str(c)[:12])
def test_forward_derivative_against_differences(plugin: str, param: Param, given: dict[str, Any]) -> None:
    """Over directions above the surface, and for `roughdielectric` below it as well, of ``eval``."""
    bsdf = load(plugin, given)
    params, key = scene.leaf(bsdf, param.name)
    kind = type(params[key])
    start = np.array(params[key]).ravel()
    param.check(plugin, start)

    count, rng = 4000, np.random.default_rng(1)
    z = rng.uniform(0.2, 1.0, (2, count))
    angle = rng.uniform(0.0, 2.0 * np.pi, (2, count))
    xyz = np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z]).astype(np.float32)
    if plugin == "roughdielectric":  # seen from outside: seen from inside there is a kink at the critical angle
        xyz[2, 1] *= np.where(np.arange(count) % 2, 1, -1)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi, wo = mi.Vector3f(xyz[:, 0]), mi.Vector3f(xyz[:, 1])

    def value(step: Any) -> Any:
        params[key] = kind(*[float(v) for v in start]) + kind(step)
        params.update()
        return bsdf.eval(mi.BSDFContext(), si, wo)

    t = mi.Float(0.0)
    dr.enable_grad(t)
    out = value(t)
    dr.forward(t)
    forward = np.array(dr.grad(out), float)
    h = 0.01 * start.mean()
    one, two = (np.array(value(s * h), float) - np.array(value(-s * h), float) for s in (1, 2))
    differences = (8 * one - two) / (12 * h)
    assert np.abs(differences).max() > 0
    # What is left is float32 in the differences: most, 0.7 %, for the weakest lobe, the tint of the sheen. For the
    # roughdielectric, eta one step on can make a direction one that no facet refracts to: 1 in 1000 is left out.
    error = np.abs(forward - differences)
    keep = error <= np.quantile(error, 0.999)
    assert np.sqrt((error[keep] ** 2).sum() / (differences**2).sum()) < 0.01


def test_defaults_are_within_bounds() -> None:
    for plugin, table in peers.TABLE.items():
        for p in table:
            if (plugin, p.name) != ("roughconductor", "eta"):  # 0 by default: a perfect mirror
                p.check(plugin, p.default)
