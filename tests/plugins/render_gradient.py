"""Run by test_render_gradient in a process of its own, since after an AD call that fails a process is not to be trusted.

Arguments: integrator, light. Prints a line for m and for eta: mean and standard error of the derivative of the mean image
by automatic differentiation, then by central differences with common random numbers.
"""

from __future__ import annotations

import sys
from typing import Any

import plugins  # isort: skip  (libLLVM before Mitsuba)
import drjit as dr
import mitsuba as mi
import numpy as np

SEEDS = 6
LIGHTS = {
    "area": {
        "type": "rectangle",
        "to_world": ([2, 3, 1], 0.7),
        "emitter": {"type": "area", "radiance": 8.0},
    },
    "constant": {"type": "constant"},
    "point": {"type": "point", "position": [2, 3, 4], "intensity": 20.0},
}


def main(integrator: str, light: str) -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()
    to = mi.ScalarTransform4f
    lamp: dict[str, Any] = dict(LIGHTS[light])
    if light == "area":
        origin, size = lamp["to_world"]
        lamp["to_world"] = to().look_at(origin, [0, 0, 0], [0, 0, 1]).scale(size)
    film = {"type": "hdrfilm", "width": 12, "height": 12, "rfilter": {"type": "box"}}
    depth = {} if integrator == "direct" else {"max_depth": 3, "rr_depth": 99}
    scene: Any = mi.load_dict({
        "type": "scene",
        "integrator": {"type": integrator, **depth},
        "light": lamp,
        "ball": {
            "type": "sphere",
            "bsdf": {"type": "cooktorrance", "m": 0.3, "eta": 1.8, "diffuse_reflectance": 0.3},
        },
        "floor": {
            "type": "rectangle",
            "to_world": to().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(5),
            "bsdf": {"type": "diffuse"},
        },
        "camera": {
            "type": "perspective",
            "to_world": to().look_at([0, 1, 5], [0, 0, 0], [0, 1, 0]),
            "film": film,
        },
    })  # fmt: skip
    params = mi.traverse(scene)
    for name, value in (("m", 0.3), ("eta", 1.8)):
        key = f"ball.bsdf.{name}.value"
        slopes, quotients = [], []
        for seed in range(SEEDS):
            x = mi.Float(value)
            dr.enable_grad(x)
            params[key] = x
            params.update()
            image = mi.render(scene, params, spp=1024, spp_grad=4096, seed=seed, seed_grad=seed + 100)
            dr.backward(dr.mean(image, axis=None))
            slopes.append(float(x.grad[0]))
            ends = []
            for end in (value * 0.98, value * 1.02):
                params[key] = mi.Float(end)
                params.update()
                ends.append(float(np.asarray(mi.render(scene, spp=4096, seed=seed), dtype=np.float64).mean()))
            quotients.append((ends[1] - ends[0]) / (0.04 * value))
            params[key] = mi.Float(value)
            params.update()
        print(name, *(f(a) for a in (slopes, quotients) for f in (np.mean, standard_error)))


def standard_error(a: list[float]) -> float:
    return float(np.std(a, ddof=1) / np.sqrt(len(a)))


if __name__ == "__main__":
    main(*sys.argv[1:])
