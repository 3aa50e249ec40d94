"""The derivative of a small picture in every parameter of a BSDF, by one integrator, in a process of its own.

After a call of automatic differentiation that fails, a process is not to be trusted. It is run as ``python -m
plugins.checks.render_worker``, reads a `Request` as JSON from standard input, and writes JSON to standard output.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import sys
from typing import Any, TypedDict

import plugins  # isort: skip  (libLLVM before Mitsuba)
import drjit as dr
import mitsuba as mi
import numpy as np

from brdf.checks.differences import step

from .subject import differentiable

#: The picture is this wide and high.
SIZE = 16
#: Samples a pixel, of the picture and of its derivative.
SPP, SPP_GRAD = 1024, 1024
#: A path has no more than this many segments: through a sphere of glass, to the floor, to the light.
DEPTH = 4
#: The parameter is moved by this share of the largest step of `differences`: 2 % of its value.
MOVED = 0.4


class Request(TypedDict):
    """What is to be done.

    ``bsdf`` is a dictionary for ``mi.load_dict`` or XML text; ``models`` are classes to register, as (module,
    qualified name, file); ``setup`` are modules that are imported once the variant is set; ``bounds`` are those of some
    parameters by their keys.
    """

    variant: str
    bsdf: dict[str, Any] | str
    models: list[list[str]]
    setup: list[str]
    integrator: str
    bounds: dict[str, list[float]]
    seeds: list[int]


def main() -> None:
    """Answer one request."""
    request: Request = json.load(sys.stdin)
    try:
        answer: dict[str, Any] = {"rows": run(request)}
    except Exception as error:  # whatever Mitsuba or a plugin of somebody else's raises is the answer
        answer = {"error": " ".join(f"{type(error).__name__}: {error}".split())}
    json.dump(answer, sys.stdout)


def run(request: Request) -> dict[str, dict[str, list[float]]]:
    """By parameter: its value, and for each seed the derivative of the mean of the picture by automatic
    differentiation, by differences with the same random numbers, and the mean itself."""
    mi.set_variant(request["variant"])
    plugins.register(*(find_model(*where) for where in request["models"]))
    for module in request["setup"]:
        importlib.import_module(module)
    made = make_bsdf(request["bsdf"])
    if request["integrator"] == "raytree" and not mi.has_flag(made.flags(), mi.BSDFFlags.Delta):
        return {}  # the lamp of the scene shines on it from an area, which the classic cells leave out
    scene: Any = mi.load_dict(scene_with(made, request["integrator"]))
    params = mi.traverse(scene)
    prefix = "ball.bsdf."
    keys = [key for key in differentiable(params) if key.startswith(prefix)]
    rows: dict[str, dict[str, list[float]]] = {
        key.removeprefix(prefix): {"automatic": [], "differences": [], "mean": [], "value": []} for key in keys
    }
    if not keys:
        return rows
    base = {key: type(params[key])(params[key]) for key in keys}
    for key in keys:
        rows[key.removeprefix(prefix)]["value"] = [float(np.max(np.abs(np.asarray(base[key], dtype=float))))]
    for seed in request["seeds"]:
        here = mean(mi.render(scene, spp=SPP, seed=seed))
        for key in keys:
            row = rows[key.removeprefix(prefix)]
            low, high = request["bounds"].get(key.removeprefix(prefix), (-np.inf, np.inf))
            row["differences"].append(difference(scene, params, key, base[key], (low, high), here, seed))
            row["mean"].append(here)
    for seed in request["seeds"]:
        for key, slope in zip(keys, automatic(scene, params, keys, base, seed), strict=True):
            rows[key.removeprefix(prefix)]["automatic"].append(slope)
    return rows


def find_model(module: str, name: str, file: str) -> Any:
    """A class by its module, or by the file it is in."""
    try:
        found = importlib.import_module(module)
    except ImportError:
        spec = importlib.util.spec_from_file_location(module, file)
        if spec is None or spec.loader is None:
            raise
        found = importlib.util.module_from_spec(spec)
        sys.modules[module] = found
        spec.loader.exec_module(found)
    for part in name.split("."):
        found = getattr(found, part)
    return found


def make_bsdf(given: dict[str, Any] | str) -> mi.BSDF:
    """A BSDF from a dictionary or from XML."""
    made = mi.load_string(given) if isinstance(given, str) else mi.load_dict(given)
    if isinstance(made, list):
        made = made[0]
    return made


def scene_with(bsdf: mi.BSDF, integrator: str) -> dict[str, Any]:
    """A sphere of the BSDF on a grey floor, under a broad lamp and a faint sky."""
    to = mi.ScalarTransform4f
    depth = {} if integrator == "direct" else {"max_depth": DEPTH, "rr_depth": 99}
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}}
    return {
        "type": "scene",
        "integrator": {"type": integrator, **depth},
        "sky": {"type": "constant", "radiance": 0.2},
        "lamp": {
            "type": "rectangle",
            "to_world": to().look_at([2, 3, 2], [0, 0, 0], [0, 0, 1]).scale(1.2),
            "emitter": {"type": "area", "radiance": 5.0},
        },
        "ball": {"type": "sphere", "bsdf": bsdf},
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
    }


def mean(image: Any) -> float:
    """The mean of a picture, added up in float64."""
    return float(np.asarray(image, dtype=np.float64).mean())


def difference(
    scene: mi.Scene,
    params: mi.SceneParameters,
    key: str,
    base: Any,
    bounds: tuple[float, float],
    here: float,
    seed: int,
) -> float:
    """The derivative of the mean along all components of a parameter, with the same random numbers throughout."""
    plain = np.asarray(base, dtype=float)
    size = min((step(float(x), bounds) for x in (plain.min(), plain.max())), key=lambda s: (s.side == 0, s.reach))
    h = MOVED * size.reach

    def at(t: float) -> float:
        params[key] = moved(base, t)
        params.update()
        return mean(mi.render(scene, spp=SPP, seed=seed))

    if size.side == 0:
        slope = (at(h) - at(-h)) / (2 * h)
    else:
        slope = size.side * (-3 * here + 4 * at(size.side * h) - at(size.side * 2 * h)) / (2 * h)
    params[key] = type(base)(base)
    params.update()
    return slope


def moved(base: Any, t: float) -> Any:
    """A parameter with `t` added to every component; one that stays stored, so that no kernel is compiled anew."""
    if dr.is_tensor_v(base):
        return type(base)(np.asarray(base) + np.float32(t))
    out = base + t
    dr.make_opaque(out)
    return out


def automatic(scene: Any, params: mi.SceneParameters, keys: list[str], base: dict[str, Any], seed: int) -> list[float]:
    """The derivatives of the mean in all parameters at once."""
    for key in keys:
        value = type(base[key])(base[key])
        dr.enable_grad(value)
        params[key] = value
    params.update()
    attached = {key: params[key] for key in keys}
    image = mi.render(scene, params, spp=SPP, spp_grad=SPP_GRAD, seed=seed, seed_grad=seed + 100_003)
    if not dr.grad_enabled(image):
        return [0.0] * len(keys)
    try:
        dr.backward(dr.mean(image, axis=None))
    except RuntimeError as error:
        if "does not depend on" not in str(error):  # as that of a cell which does not show the ball
            raise
        return [0.0] * len(keys)
    slopes = [float(np.asarray(dr.grad(attached[key]), dtype=np.float64).sum()) for key in keys]
    for key in keys:
        params[key] = type(base[key])(base[key])
    params.update()
    return slopes


if __name__ == "__main__":
    main()
