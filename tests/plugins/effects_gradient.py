"""One derivative through `effects`, by itself in a process: ``python -m tests.plugins.effects_gradient NAME|fit [INTEGRATOR]``.

After an exception in a derivative a process is not to be trusted; and each case has kernels of its own. The derivative of
a weighted mean of the picture, in reverse and forward mode, against central differences with common random numbers.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import brdf  # noqa: F401  (chooses libLLVM)

# isort: split
import drjit as dr
import mitsuba as mi
import numpy as np

STEP = 0.01
SEEDS = 6
SAMPLES, SAMPLES_DIFFERENCES = 64, 1024


def scene_of(name: str) -> tuple[dict[str, Any], str, int]:
    """The scene, the parameter, and the depth."""
    from tests.plugins import effects_scenes as s

    y, x = np.mgrid[0:64, 0:64] / 64 * 2 * np.pi
    waves = np.stack([0.5 + 0.3 * np.sin(2 * x), 0.5 + 0.3 * np.cos(2 * y), 0.4 + 0 * x], -1).astype(np.float32)

    def textured(times: float) -> dict[str, Any]:
        to_uv = mi.ScalarTransform4f().scale(times)
        return {
            "type": "diffuse",
            "reflectance": {"type": "bitmap", "bitmap": mi.Bitmap(waves), "raw": True, "to_uv": to_uv},
        }

    glossy = {"type": "cooktorrance", "m": 0.3, "eta": 1.6, "diffuse_reflectance": s.rgb(0.3, 0.2, 0.1)}
    metal = {"type": "metal", "eta": s.rgb(0.2, 0.9, 1.4), "k": s.rgb(3.9, 2.5, 1.9)}
    point, lamp = s.point(2, -3, 4, 30), s.lamp(2, -3, 4, 1, 12)
    sky, even = {"type": "envmap", "filename": s.SKY}, {"type": "constant"}
    back = mi.ScalarTransform4f().translate([0, 3, 0]).rotate([1, 0, 0], 90).scale(100)
    wall = {"type": "rectangle", "to_world": back, "bsdf": textured(20)}
    mirror = {"type": "rectangle", "to_world": back, "bsdf": {"type": "mirror"}}
    floor = s.plane(textured(1))
    small = s.ball(glossy, x=1.2, y=-1.8, z=0.2, radius=0.5)
    behind = s.ball(glossy, x=-1, y=2, radius=0.8)
    glass = {"type": "glass"}
    cases: dict[str, tuple[dict[str, Any], dict[str, Any], str, int]] = {
        "glass eta, even sky": (glass, {"sky": even}, "ball.bsdf.eta.value", 6),
        "glass eta, sky": (glass, {"sky": sky}, "ball.bsdf.eta.value", 6),
        # a point light between glass and wall: nothing casts an edge on what is seen through the glass
        "glass eta, wall": (glass, {"wall": wall, "light": s.point(0, 1.6, 0, 10)}, "ball.bsdf.eta.value", 8),
        "glass eta, mirror": (glass, {"mirror": mirror, "sky": sky}, "ball.bsdf.eta.value", 6),
        "glazed eta, sky": ({"type": "glazed"}, {"sky": sky}, "ball.bsdf.eta.value", 4),
        "glazed reflectance, sky": ({"type": "glazed"}, {"sky": sky}, "ball.bsdf.diffuse_reflectance.value", 4),
        "metal eta, sky": (metal, {"sky": sky}, "ball.bsdf.eta.value", 4),
        "metal k, sky": (metal, {"sky": sky}, "ball.bsdf.k.value", 4),
        "texture, lamp": (glossy, {"floor": floor, "lamp": lamp}, "floor.bsdf.reflectance.data", 5),
        "light of a lamp": (glossy, {"floor": floor, "lamp": lamp}, "lamp.emitter.radiance.value", 4),
        "in a mirror": ({"type": "mirror"}, {"front": small, "lamp": lamp}, "front.bsdf.eta.value", 5),
        "through glass": (glass, {"behind": behind, "lamp": lamp}, "behind.bsdf.eta.value", 7),
        # what an attached chain cannot see: shadows and lamps whose edges move in the glass
        "glass eta, edges": (glass, {"floor": floor, "light": point}, "ball.bsdf.eta.value", 8),
        "glass eta, lamp": (glass, {"floor": floor, "lamp": lamp}, "ball.bsdf.eta.value", 8),
    }
    for parameter in ("m", "eta"):
        for light, held in (("point", {"light": point}), ("lamp", {"lamp": lamp}), ("sky", {"sky": sky})):
            cases[f"cooktorrance {parameter}, {light}"] = (glossy, held, f"ball.bsdf.{parameter}.value", 4)
    bsdf, rest, key, depth = cases[name]
    return {"type": "scene", "sensor": s.camera(32), "ball": s.ball(bsdf), **rest}, key, depth


def measure(name: str, integrator: str = "effects") -> dict[str, list[float]]:
    """Derivatives by seed: `reverse`, `forward` (two, of the first seeds), and `differences`."""
    made, key, depth = scene_of(name)
    scene = mi.load_dict(made)
    params = mi.traverse(scene)
    start = dr.detach(type(params[key])(params[key]))
    tracer = mi.load_dict({"type": integrator, "max_depth": depth, "rr_depth": 100})
    y, x = np.mgrid[0:32, 0:32]
    # weights that differ by pixel, channel and brightness: no error cancels in the mean, and a highlight that only
    # changes its shape has a derivative
    waves = 1 + 0.5 * np.sin(0.3 * x + 0.2 * y)[..., None] * np.array([1, 0.5, -0.5])
    bright = np.array(mi.render(scene, integrator=tracer, spp=SAMPLES, seed=99))
    weights = mi.TensorXf((waves + bright / bright.mean()).astype(np.float32))

    def value(t: Any, seed: int, samples: int) -> Any:
        params[key] = start * (1 + t) if key.endswith("data") else start + t
        params.update()
        return dr.mean(mi.render(scene, params, integrator=tracer, spp=samples, seed=seed) * weights, axis=None)

    out: dict[str, list[float]] = {"reverse": [], "forward": [], "differences": []}
    for seed in range(SEEDS):
        t = mi.Float(0)
        dr.enable_grad(t)
        dr.backward(value(t, seed, SAMPLES))
        out["reverse"].append(float(dr.grad(t)[0]))
    for seed in range(2):
        t = mi.Float(0)
        dr.enable_grad(t)
        image = value(t, seed, SAMPLES)
        dr.forward(t)
        out["forward"].append(float(dr.grad(image).array[0]))
    for seed in range(100, 100 + SEEDS):
        high, low = (float(value(mi.Float(h), seed, SAMPLES_DIFFERENCES).array[0]) for h in (STEP, -STEP))
        out["differences"].append((high - low) / (2 * STEP))
    return out


def fit(integrator: str = "effects") -> list[float]:
    """The index of a glass ball from its picture under a sky, by Adam: values by iteration, from 1.2; the truth is 1.5."""
    made, key, depth = scene_of("glass eta, sky")
    scene = mi.load_dict(made)
    params = mi.traverse(scene)
    reference = mi.render(scene, integrator=mi.load_dict({"type": "path", "max_depth": depth}), spp=1024, seed=777)
    tracer = mi.load_dict({"type": integrator, "max_depth": depth})
    optimiser = mi.ad.Adam(lr=0.02)
    optimiser[key] = mi.Float(1.2)
    params.update(optimiser)
    out = []
    for i in range(80):
        image = mi.render(scene, params, integrator=tracer, spp=16, seed=i)
        # relative, but for what is nearly black
        dr.backward(dr.mean(dr.square((image - reference) / (reference + 0.1)), axis=None))
        optimiser.step()
        optimiser[key] = dr.clip(optimiser[key], 1.01, 3)
        params.update(optimiser)
        out.append(float(optimiser[key][0]))
    return out


if __name__ == "__main__":
    mi.set_variant("llvm_ad_rgb")
    import plugins

    plugins.register()
    print(json.dumps({"values": fit(*sys.argv[2:])} if sys.argv[1] == "fit" else measure(*sys.argv[1:])))
