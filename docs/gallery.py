"""Make the README's gallery, one ball a model, and Cook's vases: ``.venv/bin/python docs/gallery.py``."""

from __future__ import annotations

import argparse
from typing import Any

import fitting  # before mitsuba: it chooses the libLLVM  # isort: skip  # noqa: F401
import matplotlib
import mitsuba as mi
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from pictures import HERE, STYLE, WIDTH, card, heading
from scipy.interpolate import CubicSpline

import plugins
from fitting.images import to_srgb
from plugins.scenes import stress

Array = npt.NDArray[np.float64]

#: Pixels and samples of a ball, and of the vases.
BALL, BALL_SPP = 224, 512
VASES, VASES_SPP = (880, 520), 512
#: Balls in a row.
COLUMNS = 7
#: Dots an inch: fewer than for drawings, since photographs do not compress.
DOTS = 88

COPPER = {"type": "rgb", "value": [0.62, 0.27, 0.11]}
RED = {"type": "rgb", "value": [0.45, 0.06, 0.04]}
BLUE = {"type": "rgb", "value": [0.06, 0.14, 0.4]}
SAND = {"type": "rgb", "value": [0.62, 0.5, 0.36]}
#: What each ball of the gallery is made of, beside its type: values that show what the model is for.
MATERIALS: dict[str, dict[str, Any]] = {
    "blinnphong": {"diffuse_reflectance": RED, "specular_reflectance": 0.25, "exponent": 60.0},
    "cooktorrance": {"material": "Cu", "m": 0.2, "diffuse_reflectance": 0.0},
    "diffusion": {
        "sigma_s": {"type": "rgb", "value": [2.19, 2.62, 3.0]},
        "sigma_a": {"type": "rgb", "value": [0.0021, 0.0041, 0.0071]},
        "eta": 1.3,
    },
    "glass": {"int_ior": "bk7"},
    "glazed": {"diffuse_reflectance": BLUE, "eta": 1.5},
    "grooved": {"reflectance": {"type": "rgb", "value": [0.5, 0.42, 0.3]}, "spacing": 2.2, "specular_reflectance": 0.3},
    "hanrahankrueger": {
        "sigma_s": {"type": "rgb", "value": [1.6, 3.2, 0.9]},
        "sigma_a": {"type": "rgb", "value": [0.25, 0.02, 0.5]},
        "thickness": 1.0,
        "g": 0.0,
    },
    "kajiyakay": {
        "diffuse_reflectance": {"type": "rgb", "value": [0.16, 0.07, 0.03]},
        "specular_reflectance": 0.08,
        "exponent": 40.0,
    },
    "lambertian": {"reflectance": SAND},
    "metal": {"material": "Au"},
    "mirror": {"specular_reflectance": 0.9},
    "orennayar": {"reflectance": SAND, "sigma": 0.6},
    "phong": {"diffuse_reflectance": RED, "specular_reflectance": 0.25, "exponent": 30.0, "normalization": "modified"},
    "ward": {"diffuse_reflectance": 0.05, "specular_reflectance": 0.7, "alpha_u": 0.06, "alpha_v": 0.3},
}


def sky() -> dict[str, Any]:
    """A studio far away: dark walls, a window with a cross, a strip of light, a bright ceiling."""
    return {"type": "envmap", "bitmap": mi.Bitmap(stress.sky(256))}


def floor(height: float, size: float, tiles: float) -> dict[str, Any]:
    """A chequered floor, y upwards."""
    to = mi.ScalarTransform4f
    squares = {
        "type": "checkerboard",
        "color0": {"type": "rgb", "value": 0.16},
        "color1": {"type": "rgb", "value": 0.42},
        "to_uv": to().scale([tiles, tiles, 1]),
    }
    lie = to().translate([0, height, 0]).rotate([1, 0, 0], -90).scale(size)
    return {"type": "rectangle", "to_world": lie, "bsdf": {"type": "lambertian", "reflectance": squares}}


def ball(material: dict[str, Any]) -> Array:
    """A ball of a material in the studio, linear RGB."""
    to = mi.ScalarTransform4f
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 12},
        "sky": sky(),
        "floor": floor(-1, 6, 8),
        # Its poles are above and below, so that what has a grain has it around the waist.
        "ball": {"type": "sphere", "to_world": to().rotate([1, 0, 0], -90), "bsdf": material},
        "camera": {
            "type": "perspective",
            "fov": 27,
            "to_world": to().look_at([0, 1.4, 4.6], [0, -0.04, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": BALL, "height": BALL},
        },
    })  # fmt: skip
    return np.array(mi.render(scene, spp=BALL_SPP), dtype=np.float64)[..., :3]


def gallery() -> Figure:
    """One ball a model."""
    names = list(plugins.registered())
    rows = -(-len(names) // COLUMNS)
    size = 0.955 * WIDTH / COLUMNS
    figure = card(rows * (size + 0.32) + 0.36)
    high = figure.get_figheight()
    for i, name in enumerate(names):
        print(name, flush=True)
        picture = to_srgb(np.clip(0.85 * ball({"type": name, **MATERIALS.get(name, {})}), 0, None))
        left = 0.2 + (i % COLUMNS) * (WIDTH - 0.4) / COLUMNS
        top = high - 0.2 - (i // COLUMNS) * (size + 0.32)
        axes = figure.add_axes((left / WIDTH, (top - 0.27 - size) / high, size / WIDTH, size / high))
        axes.set_axis_off()
        axes.imshow(picture, interpolation="bicubic")
        heading(figure, (left + size / 2) / WIDTH, name, (top - 0.14) / high)
    return figure


def vase(material: dict[str, Any], x: float) -> mi.Object:
    """A vase, a profile turned about the vertical axis."""
    heights = np.array([0.0, 0.06, 0.35, 0.85, 1.35, 1.7, 1.9, 2.1])
    radii = np.array([0.38, 0.44, 0.62, 0.76, 0.47, 0.28, 0.3, 0.46])
    t = np.linspace(0, 1, 240)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(heights), np.diff(radii)))])
    r, y = (CubicSpline(along / along[-1], values)(t) for values in (radii, heights))
    turn = np.linspace(0, 2 * np.pi, 193)
    points = np.stack(
        [x + r[:, None] * np.cos(turn), np.broadcast_to(y[:, None], (len(t), len(turn))), r[:, None] * np.sin(turn)], -1
    ).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(len(t) - 1), np.arange(len(turn) - 1), indexing="ij"))
    a = i * len(turn) + j
    b = a + len(turn)
    faces = np.concatenate([np.stack([a, b, a + 1], 1), np.stack([a + 1, b, b + 1], 1)])
    props = mi.Properties()
    props["mesh_bsdf"] = mi.load_dict({"type": "twosided", "nested": material})
    mesh = mi.Mesh("vase", len(points), len(faces), has_vertex_normals=True, props=props)
    params = mi.traverse(mesh)
    params["vertex_positions"] = points.astype(np.float32).ravel()
    params["faces"] = faces.astype(np.uint32).ravel()
    params.update()
    mesh.recompute_vertex_normals()
    return mesh


def vases() -> Figure:
    """After Cook and Torrance 1981: copper, whose highlight has its colour, and plastic, whose highlight has none."""
    to = mi.ScalarTransform4f
    metal = {"type": "cooktorrance", "material": "Cu", "m": 0.25, "diffuse_reflectance": 0.0}
    plastic = {"type": "cooktorrance", "eta": 1.5, "m": 0.15, "diffuse_reflectance": COPPER}

    grey = {"type": "lambertian", "reflectance": 0.2}

    def lamp(at: list[float], size: float, radiance: float) -> dict[str, Any]:
        place = to().look_at(at, [0, 1, 0], [0, 1, 0]).scale(size)
        return {"type": "rectangle", "to_world": place, "emitter": {"type": "area", "radiance": radiance}}

    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6},
        "left": lamp([-4.2, 4.6, 4.0], 0.5, 42.0),
        "right": lamp([4.6, 3.4, 3.2], 0.45, 34.0),
        "sky": {"type": "constant", "radiance": 0.03},
        "floor": {"type": "rectangle", "to_world": to().rotate([1, 0, 0], -90).scale(12), "bsdf": grey},
        "wall": {"type": "rectangle", "to_world": to().translate([0, 0, -4]).scale(12), "bsdf": grey},
        "metal": vase(metal, -0.95),
        "plastic": vase(plastic, 0.95),
        "camera": {
            "type": "perspective",
            "fov": 38,
            "to_world": to().look_at([0, 1.9, 6.2], [0, 1.02, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": VASES[0], "height": VASES[1]},
        },
    })  # fmt: skip
    picture = to_srgb(np.array(mi.render(scene, spp=VASES_SPP), dtype=np.float64)[..., :3])
    figure = card(WIDTH * VASES[1] / VASES[0] + 0.35)
    high = figure.get_figheight()
    axes = figure.add_axes((0.02, 0.2 / high, 0.96, 0.96 * WIDTH * VASES[1] / VASES[0] / high))
    axes.set_axis_off()
    axes.imshow(picture, interpolation="bicubic")
    for x, text in ((0.3, "metal: F of a conductor, copper"), (0.7, "plastic: F of a dielectric, over a diffuse base")):
        heading(figure, x, text, 1 - 0.2 / high)
    return figure


def main() -> None:
    """Write the pictures beside this file."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    mi.set_variant("llvm_ad_rgb")
    plugins.register()
    with matplotlib.rc_context(STYLE):
        for name, drawing in (("gallery", gallery), ("vases", vases)):
            drawing().savefig(HERE / f"{name}.png", dpi=DOTS, metadata={"Software": None})
            print(HERE / f"{name}.png")


if __name__ == "__main__":
    main()
