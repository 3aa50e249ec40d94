"""Small scenes for fits, and pictures of them by Mitsuba alone: nothing of `fitting` takes part in a target."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import numpy.typing as npt

import plugins

Picture = npt.NDArray[np.float64]

#: A rough dielectric over a coloured base. What the file says are placeholders; `-D` and `picture` give other values.
BALL = """<bsdf type="cooktorrance" id="ball">
    <float name="m" value="$m"/> <float name="eta" value="$eta"/> <rgb name="diffuse_reflectance" value="$base"/>
  </bsdf>"""
#: In a scene with `BALL`.
NAMES = (
    '<default name="m" value="0.3"/> <default name="eta" value="1.5"/> <default name="base" value="0.25,0.08,0.04"/>'
)
SPHERE = '<shape type="sphere" id="sphere"><ref id="ball"/></shape>'
KEY = '<emitter type="point" id="key"><point name="position" x="3" y="3" z="4"/><rgb name="intensity" value="30"/></emitter>'
RIM = '<emitter type="point"><point name="position" x="-4" y="1" z="-0.5"/><rgb name="intensity" value="20,22,24"/></emitter>'
SUN = '<emitter type="directional"><vector name="direction" x="1" y="-1" z="-1"/><rgb name="irradiance" value="1.5"/></emitter>'


def camera(
    size: int | tuple[int, int] = 48,
    rfilter: str = "gaussian",
    name: str = "camera",
    origin: str = "0,0,4.2",
    fov: float | str = 30,
    kind: str = "perspective",
    more: str = "",
    film: str = "",
) -> str:
    """A sensor that looks at the origin; `more` goes into the sensor, `film` into its film."""
    width, height = (size, size) if isinstance(size, int) else size
    return f"""<sensor type="{kind}" id="{name}"> <float name="fov" value="{fov}"/> {more}
    <transform name="to_world"><lookat origin="{origin}" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"> <integer name="width" value="{width}"/> <integer name="height" value="{height}"/> {film}
      <rfilter type="{rfilter}"/> </film>
  </sensor>"""


def text(*parts: str, integrator: str = '<integrator type="path"/>') -> str:
    """A scene of these elements."""
    body = "\n  ".join([NAMES, integrator, *parts])
    return f'<?xml version="1.0" encoding="utf-8"?>\n<scene version="3.0.0">\n  {body}\n</scene>\n'


def write(folder: Path, *parts: str, name: str = "scene.xml", **options: str) -> Path:
    """The scene as a file in `folder`."""
    path = folder / name
    path.write_text(text(*parts, **options))
    return path


def standard(folder: Path, size: int = 48, rfilter: str = "gaussian") -> Path:
    """A ball under two lamps."""
    return write(folder, BALL, SPHERE, camera(size, rfilter), KEY, RIM)


def picture(path: Path, spp: int, passes: int = 1, seed: int = 10_000, sensor: int = 0, **values: Any) -> Picture:
    """What Mitsuba makes of the scene with other `values` for its $names."""
    use()
    scene = mi.load_file(str(path), **{k: str(v) for k, v in values.items()})
    images = [
        np.array(mi.render(scene, sensor=sensor, spp=spp, seed=seed + i), dtype=np.float64) for i in range(passes)
    ]
    return np.mean(images, axis=0)[..., :3]


def lamp_by_lamp(folder: Path, parts: tuple[str, ...], lamps: tuple[str, ...], spp: int, **values: Any) -> Picture:
    """The sum of the pictures under each lamp alone: `path` picks one of several at random, which is noise."""
    scenes = [write(folder, *parts, lamp, name=f"lamp{i}.xml") for i, lamp in enumerate(lamps)]
    return np.sum([picture(scene, spp, **values) for scene in scenes], axis=0)


def use() -> None:
    """The variant of all tests here, and our plugins."""
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def noisy(clean: Picture, relative: float, seed: int, floor: float = 0.0) -> Picture:
    """With noise of this standard deviation: relative to each pixel, and `floor` times the picture's mean."""
    rng = np.random.default_rng(seed)
    sd = np.hypot(relative * clean, floor * clean.mean())
    return np.maximum(clean + sd * rng.standard_normal(clean.shape), 0.0)
