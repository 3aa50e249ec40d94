"""A wall of hard cases: from a mirror to matt, from hardly any index to 10, glass in glass, lit at grazing incidence.

Each column is one material, one of whose parameters grows from ball to ball downwards. ``python -m
plugins.scenes.stress`` writes ``stress.xml``, for ``brdf render``, and ``sky.exr``, what is around it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import mitsuba as mi
import numpy as np

from . import FOLDER

M = (1e-4, 1e-3, 0.01, 0.03, 0.1, 0.25, 0.5, 1.0)
ETA = (1.0001, 1.001, 1.01, 1.1, 1.33, 1.5, 2.4, 10.0)
#: Of a ball in glass of 1.5, over that glass: 2/3 is a bubble of air.
INNER = (0.1, 0.4, 2 / 3, 0.99, 0.9999, 1.0001, 1.1, 6.6667)
EXPONENT = (1e6, 1e5, 1e4, 1e3, 100.0, 10.0, 1.0, 0.0)
THICKNESS = (1e-4, 0.01, 0.1, 0.3, 1.0, 3.0, 30.0, 1e6)
Dict = dict[str, Any]

#: By column: what a ball is made of, the parameter that grows, and its values from the top.
COLUMNS: dict[str, tuple[Dict, str, tuple[float, ...]]] = {
    "metal": ({"type": "cooktorrance", "material": "Au", "distribution": "ggx", "masking": "smith"}, "m", M),
    "plastic": ({"type": "cooktorrance", "diffuse_reflectance": (0.42, 0.05, 0.04)}, "m", M),
    "paint": (
        {"type": "cooktorrance", "diffuse_reflectance": (0.04, 0.16, 0.4), "m": 0.1, "masking": "smith"},
        "eta",
        ETA,
    ),
    "brushed": (
        {
            "type": "ward",
            "variant": "balanced",
            "diffuse_reflectance": 0.03,
            "specular_reflectance": 0.7,
            "alpha_v": 0.15,
        },
        "alpha_u",
        M,
    ),
    "phong": (
        {"type": "phong", "normalization": "modified", "diffuse_reflectance": (0.06, 0.28, 0.1)},
        "exponent",
        EXPONENT,
    ),
    "glazed": ({"type": "glazed", "diffuse_reflectance": (0.5, 0.3, 0.05)}, "eta", ETA),
    "glass": ({"type": "glass"}, "eta", ETA),
    "nested": ({"type": "glass"}, "eta", INNER),
    "leaf": (
        {"type": "hanrahankrueger", "sigma_s": (2.0, 4.0, 1.0), "sigma_a": (0.1, 0.0, 0.3)},
        "thickness",
        THICKNESS,
    ),
}
#: The last column: one ball each of the other models.
OTHERS: dict[str, Dict] = {
    "satin": {
        "type": "cooktorrance", "roughness": "anisotropic", "m_u": 1e-4, "m_v": 1.0, "eta": (0.2, 0.9, 1.1),
        "k": (3.9, 2.4, 2.2),
    },
    "silver": {"type": "metal", "eta": (0.001, 0.1, 0.15), "k": (20.0, 3.1, 1e-6)},
    "mirror": {"type": "mirror", "specular_reflectance": 0.9},
    "blinn": {"type": "blinnphong", "diffuse_reflectance": (0.3, 0.05, 0.25), "exponent": 1e6},
    "record": {"type": "grooved", "reflectance": 0.05, "exponent": 1e4, "spacing": 2.0, "height": 0.999},
    "hair": {"type": "kajiyakay", "diffuse_reflectance": 0.05, "specular_reflectance": 0.3, "exponent": 300.0},
    "clay": {"type": "orennayar", "reflectance": (0.6, 0.3, 0.2), "sigma": 1.5},
    "milk": {"type": "diffusion", "sigma_a": 1e-6},
}  # fmt: skip
ROWS = len(M)
#: Radii of a ball, and of what is inside a nested one.
RADIUS, INSIDE = 0.43, 0.26


class Ball(NamedTuple):
    """One ball of the wall: its id, what it is made of, and where it is."""

    id: str
    bsdf: Dict
    at: tuple[float, float, float]
    radius: float = RADIUS


def balls() -> Iterator[Ball]:
    """All balls, column by column, from the top."""
    width = len(COLUMNS)
    for column, (name, (material, parameter, values)) in enumerate(COLUMNS.items()):
        for row, value in enumerate(values):
            at = (column - 0.5 * width, 0.5 * (ROWS - 1) - row, 0.0)
            if name == "nested":
                yield Ball(f"around{row}", {"type": "glass", "eta": 1.5}, at)
                yield Ball(f"{name}{row}", {**material, parameter: value}, at, INSIDE)
            else:
                yield Ball(f"{name}{row}", {**material, parameter: value}, at)
    for row, (name, material) in enumerate(OTHERS.items()):
        yield Ball(name, material, (0.5 * width, 0.5 * (ROWS - 1) - row, 0.0))


def xml() -> str:
    """The scene as XML."""
    root = ElementTree.fromstring(ROOM)
    for ball in balls():
        shape = ElementTree.SubElement(root, "shape", type="sphere", id=ball.id)
        ElementTree.SubElement(shape, "point", {"name": "center", **dict(zip("xyz", map(repr, ball.at), strict=True))})
        ElementTree.SubElement(shape, "float", name="radius", value=repr(ball.radius))
        bsdf = ElementTree.SubElement(shape, "bsdf", type=ball.bsdf["type"])
        for key, value in list(ball.bsdf.items())[1:]:
            if isinstance(value, tuple):
                ElementTree.SubElement(bsdf, "rgb", name=key, value=", ".join(map(repr, value)))
            else:
                kind = "string" if isinstance(value, str) else "float"
                ElementTree.SubElement(bsdf, kind, name=key, value=str(value))
    ElementTree.indent(root, "    ")
    return ElementTree.tostring(root, encoding="unicode") + "\n"


#: All but the balls.
ROOM = """\
<scene version="3.0.0">
    <default name="width" value="1000"/>
    <default name="height" value="800"/>
    <integrator type="path">
        <integer name="max_depth" value="12"/>
    </integrator>
    <sensor type="perspective" id="camera">
        <float name="fov" value="24"/>
        <transform name="to_world">
            <lookat origin="0, 0, 24.5" target="0, 0, 0" up="0, 1, 0"/>
        </transform>
        <sampler type="independent">
            <integer name="sample_count" value="256"/>
        </sampler>
        <film type="hdrfilm">
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
            <rfilter type="box"/>
        </film>
    </sensor>
    <emitter type="envmap" id="sky">
        <string name="filename" value="sky.exr"/>
    </emitter>
    <emitter type="point" id="grazing">
        <point name="position" x="-11" y="9" z="4"/>
        <rgb name="intensity" value="300, 290, 270"/>
    </emitter>
    <shape type="rectangle" id="strip">
        <transform name="to_world">
            <scale x="0.6" y="5"/>
            <lookat origin="7.5, 0, -1.2" target="0, 0, -0.2" up="0, 1, 0"/>
        </transform>
        <emitter type="area">
            <rgb name="radiance" value="3, 4.2, 6"/>
        </emitter>
    </shape>
    <shape type="rectangle" id="wall">
        <transform name="to_world">
            <scale value="12"/>
            <translate z="-2"/>
        </transform>
        <bsdf type="lambertian" id="plaster">
            <texture type="checkerboard" name="reflectance">
                <rgb name="color0" value="0.07"/>
                <rgb name="color1" value="0.12"/>
                <transform name="to_uv">
                    <scale x="24" y="24"/>
                </transform>
            </texture>
        </bsdf>
    </shape>
</scene>
"""


def sky(height: int = 128) -> np.ndarray[Any, np.dtype[np.float32]]:
    """What is around, radiance: a dim room, a window with a cross, a strip of light, a bright ceiling."""
    width = 2 * height
    y, x = np.mgrid[0:height, 0:width] / height  # y from the zenith down; x once around is 2
    light = np.zeros((height, width, 3), dtype=np.float32)
    light += (0.10 + 0.22 * np.clip(0.5 - y, 0, 1))[..., None] * np.array([0.85, 0.95, 1.1])
    window = (np.abs(x - 1.28) < 0.13) & (np.abs(y - 0.3) < 0.12)
    cross = (np.abs(x - 1.28) < 0.008) | (np.abs(y - 0.3) < 0.008)
    light[window & ~cross] = (14.0, 13.2, 12.0)
    light[(np.abs(x - 0.66) < 0.03) & (np.abs(y - 0.42) < 0.22)] = (3.2, 4.0, 5.2)
    light[y < 0.08] = 2.0
    return light


def main(folder: Path) -> None:
    """Write the scene and what is around it."""
    mi.set_variant("llvm_ad_rgb")
    (folder / "stress.xml").write_text(xml(), encoding="utf-8")
    half = mi.Bitmap(sky()).convert(component_format=mi.Struct.Type.Float16)
    half.write(str(folder / "sky.exr"))
    print(folder / "stress.xml", folder / "sky.exr")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER, help="where they go; default: %(default)s")
    main(parser.parse_args().folder)
