"""Small scenes that call for different cells of the lecture's table, as dictionaries for ``mi.load_dict``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi

import plugins.scenes

SKY = str(Path(plugins.scenes.__file__).parent / "sky.exr")


def rgb(*value: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(value) if len(value) > 1 else [value[0]] * 3}


def camera(
    size: int, fov: float = 40, at: tuple[float, ...] = (0, 0, 0), eye: tuple[float, ...] = (0, -4, 2.5)
) -> dict[str, Any]:
    return {
        "type": "perspective",
        "fov": fov,
        "to_world": mi.ScalarTransform4f().look_at(list(eye), list(at), [0, 0, 1]),
        "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
        "sampler": {"type": "independent"},
    }


def plane(bsdf: dict[str, Any], z: float = -1, scale: float = 6) -> dict[str, Any]:
    to = mi.ScalarTransform4f().translate([0, 0, z]).scale([scale, scale, 1])
    return {"type": "rectangle", "to_world": to, "bsdf": bsdf}


def ball(bsdf: dict[str, Any], x: float = 0, y: float = 0, z: float = 0, radius: float = 1) -> dict[str, Any]:
    return {"type": "sphere", "center": [x, y, z], "radius": radius, "bsdf": bsdf}


def point(x: float, y: float, z: float, *value: float) -> dict[str, Any]:
    return {"type": "point", "position": [x, y, z], "intensity": rgb(*value)}


def lamp(x: float, y: float, z: float, size: float, *value: float) -> dict[str, Any]:
    to = mi.ScalarTransform4f().look_at([x, y, z], [0, 0, 0], [0, 1, 0.1]).scale([size, size, 1])
    return {"type": "rectangle", "to_world": to, "emitter": {"type": "area", "radiance": rgb(*value)}}


def checker() -> dict[str, Any]:
    board = {"type": "checkerboard", "color0": rgb(0.2), "color1": rgb(0.7), "to_uv": mi.ScalarTransform4f().scale(8)}
    return {"type": "diffuse", "reflectance": board}


DIFFUSE: dict[str, Any] = {"type": "diffuse", "reflectance": rgb(0.5)}


def rough_plastic(alpha: float = 0.1) -> dict[str, Any]:
    return {"type": "roughplastic", "alpha": alpha, "diffuse_reflectance": rgb(0.5, 0.2, 0.1)}


def one_point(size: int = 32) -> dict[str, Any]:
    bsdf = {"type": "roughconductor", "material": "Au", "alpha": 0.2}
    return {"type": "scene", "sensor": camera(size), "ball": ball(bsdf), "light": point(2, -3, 4, 30)}


def many_points(size: int = 32, number: int = 4) -> dict[str, Any]:
    out = {"type": "scene", "sensor": camera(size), "ball": ball(rough_plastic()), "floor": plane(DIFFUSE)}
    for i in range(number):
        x, y = -3 + 6 * ((i * 0.618) % 1), -3 + 6 * ((i * 0.755 + 0.3) % 1)
        out[f"light{i}"] = point(x, y, 4, 60 / number * (1 + i % 3), 60 / number, 40 / number)
    return out


def area_mirror(size: int = 32) -> dict[str, Any]:
    return {
        "type": "scene",
        "sensor": camera(size),
        "plastic": ball(rough_plastic(), x=-1.1),
        "mirror": ball({"type": "conductor", "material": "Ag"}, x=1.1),
        "floor": plane(DIFFUSE),
        "lamp": lamp(1, -2, 4, 0.8, 12),
    }


def glass_mirror(size: int = 32) -> dict[str, Any]:
    return {
        "type": "scene",
        "sensor": camera(size, fov=30),
        "glass": ball({"type": "glass", "eta": 1.5}, x=-1.05),
        "mirror": ball({"type": "metal", "eta": rgb(0.2, 0.9, 1.4), "k": rgb(3.9, 2.5, 1.9)}, x=1.05),
        "floor": plane(checker()),
        "light": point(1, -3, 4, 40),
    }


def glossy_sky(size: int = 32) -> dict[str, Any]:
    return {
        "type": "scene",
        "sensor": camera(size),
        "ball": ball(rough_plastic()),
        "sky": {"type": "envmap", "filename": SKY},
    }


def cornell(size: int = 32) -> dict[str, Any]:
    out = mi.cornell_box()
    out["sensor"]["film"] = camera(size)["film"]
    out["sensor"]["sampler"] = {"type": "independent"}
    del out["integrator"]
    return out


def all_cells(size: int = 32) -> dict[str, Any]:
    return {
        "type": "scene",
        "sensor": camera(size),
        "plastic": ball(rough_plastic(), x=-1.1),
        "glazed": ball({"type": "glazed", "diffuse_reflectance": rgb(0.2, 0.5, 0.3)}, x=1.1),
        "glass": ball({"type": "glass"}, y=-1.3, z=-0.5, radius=0.5),
        "floor": plane(DIFFUSE),
        "light": point(-2, -3, 4, 10),
        "lamp": lamp(1, -2, 4, 0.8, 4),
        "lamp2": lamp(-3, 1, 3, 0.5, 4, 2, 1),
        "sky": {"type": "constant", "radiance": rgb(0.2, 0.25, 0.3)},
    }


#: name: scene, and the depth to which EFFECTS of it are simulated.
SCENES = {
    "one_point": (one_point, 2),
    "four_points": (many_points, 2),
    "area_mirror": (area_mirror, 5),
    "glass_mirror": (glass_mirror, 8),
    "glossy_sky": (glossy_sky, 3),
    "cornell": (cornell, 6),
    "all_cells": (all_cells, 5),
}
