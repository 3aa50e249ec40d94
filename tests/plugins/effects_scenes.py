"""Small scenes that call for different cells of the lecture's table, as dictionaries for ``mi.load_dict``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

import plugins.scenes

SKY = str(Path(plugins.scenes.__file__).parent / "sky.exr")


def rgb(*value: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(value) * (1 if len(value) > 1 else 3)}


def camera(size: int, fov: float = 40) -> dict[str, Any]:
    return {
        "type": "perspective",
        "fov": fov,
        "to_world": mi.ScalarTransform4f().look_at([0, -4, 2.5], [0, 0, 0], [0, 0, 1]),
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


def masked(size: int = 32) -> dict[str, Any]:
    """Panes that let a part of the light pass, before a diffuse ball, a glazed one, and lamps."""
    grey = {"type": "mask", "opacity": 0.4, "nested": DIFFUSE}
    glass = {"type": "mask", "opacity": 0.7, "nested": {"type": "glass"}}
    tile = {"type": "mask", "opacity": 0.6, "nested": {"type": "glazed"}}
    out = area_mirror(size)
    out["pane"] = {"type": "rectangle", "to_world": pane(-0.8, -1.5, 0, 0.8), "bsdf": grey}
    out["sphere"] = ball(glass, x=0.9, y=-1.4, z=-0.3, radius=0.5)
    out["tile"] = ball(tile, x=0, y=-1.6, z=-0.6, radius=0.3)
    out["nothing"] = ball({"type": "null"}, y=-2.2, z=0.6, radius=0.3)
    out["sky"] = {"type": "constant", "radiance": rgb(0.3)}
    out["light"] = point(-2, -3, 4, 10)
    return out


def thin(size: int = 32) -> dict[str, Any]:
    out = glass_mirror(size)
    out["pane"] = {"type": "rectangle", "to_world": pane(0, -1.6, 0, 1), "bsdf": {"type": "thindielectric"}}
    return out


def pane(x: float, y: float, z: float, scale: float) -> Any:
    return mi.ScalarTransform4f().translate([x, y, z]).rotate([1, 0, 0], 80).scale([scale, scale, 1])


def bumpy(size: int = 32) -> dict[str, Any]:
    """A mesh with a texture and bumps, seen from both sides, and one with a normal map."""
    y, x = np.mgrid[0:32, 0:32] / 32 * 2 * np.pi
    height = (0.5 + 0.2 * np.sin(2 * x) * np.cos(3 * y)).astype(np.float32)
    bumps = {"type": "bitmap", "bitmap": mi.Bitmap(height[..., None]), "raw": True}
    out = many_points(size, 2)
    two_sides = {"type": "twosided", "bsdf": {"type": "bumpmap", "map": bumps, "scale": 0.3, "bsdf": rough_plastic()}}
    out["ball"] = {
        "type": "cube",
        "to_world": mi.ScalarTransform4f().rotate([0, 0, 1], 30).scale(0.7),
        "bsdf": two_sides,
    }
    tilted = {"type": "normalmap", "normalmap": {"type": "rgb", "value": [0.6, 0.5, 0.95]}, "bsdf": checker()}
    out["floor"] = plane(tilted)
    out["lamp"] = lamp(1, -2, 4, 0.8, 6)
    return out


def many_lamps(size: int = 32) -> dict[str, Any]:
    """Lamps of very different power, and a sky."""
    out = area_mirror(size)
    for i in range(6):
        out[f"lamp{i}"] = lamp(-2.5 + i, 1 - 0.5 * i, 2.5, 0.1 + 0.1 * i, 2.0**i)
    out["sky"] = {"type": "constant", "radiance": rgb(0.1)}
    return out


def shiny_lamp(size: int = 32) -> dict[str, Any]:
    """A ball that shines and reflects at once, and a light for it to reflect."""
    out = area_mirror(size)
    out["plastic"]["emitter"] = {"type": "area", "radiance": rgb(0.3, 0.2, 0.1)}
    out["mirror"]["emitter"] = {"type": "area", "radiance": rgb(0.1)}
    out["light"] = point(-2, -3, 4, 10)
    return out


#: name: scene, and the depth to which EFFECTS of it are simulated.
SCENES = {
    "one_point": (one_point, 2),
    "four_points": (many_points, 2),
    "area_mirror": (area_mirror, 5),
    "glass_mirror": (glass_mirror, 8),
    "glossy_sky": (glossy_sky, 3),
    "cornell": (cornell, 6),
    "all_cells": (all_cells, 5),
    "textured_mesh": (bumpy, 4),
}
