"""Draw what a scene calls for, or print what simulating nothing else saves: ``.venv/bin/python docs/effects.py``."""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

import fitting  # before mitsuba: it chooses the libLLVM  # isort: skip  # noqa: F401
import matplotlib
import mitsuba as mi
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from pictures import HERE, INK, SOFT, STYLE, WIDTH, card, heading

import plugins
from fitting import planning, rendering
from fitting.images import to_srgb
from plugins.effects import pilot, table
from plugins.scene import Scene, load
from plugins.scenes import FOLDER

#: The noise up to which pictures are rendered, and the most samples a pixel.
NOISE, MOST = 0.02, 2**14
#: Side and samples a pixel of the pictures that an error is measured with.
SMALL, MANY = 32, 8192
#: Samples a pixel of the layers.
LAYERS_SPP = 1024
#: Dots an inch: pictures of light are large files.
SMALL_DOTS = 120
#: Of the picture's difference from that by `path`, what is shown white: relative to a pixel.
DIFFERENCE = 0.2


def main() -> None:
    """Write effects.png and cells.png beside this file, or print the prices."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--price", action="store_true", help="the time at equal error, against path")
    if parser.parse_args().price:
        sys.path.insert(0, str(HERE.parent))
        from tests.bench import effects

        print(effects.table())
        return
    mi.set_variant("llvm_ad_rgb")
    plugins.register()
    with matplotlib.rc_context(STYLE):
        for name, draw in (("effects.png", compared), ("cells.png", cells)):
            draw().savefig(HERE / name, dpi=SMALL_DOTS, transparent=True)


def compared() -> Figure:
    """Glass and a mirror: all by `path`, what is called for, the difference, and the classic cells."""
    loaded = load(FOLDER / "effects" / "glass.xml")
    camera = loaded.scene.sensors()[0]
    white = 1.0
    figure = card(2.75)
    whole: Any = None
    for place, (asked, title) in enumerate(
        ((None, "everything, by path"), ("auto", "what it calls for"), ("classic", "what is easy"))
    ):
        picture, seconds, spp, told = rendered(loaded, camera, asked)
        if whole is None:
            whole, white = picture, pilot.white_of({"": picture})
        said = f"{seconds:.2g} s, {spp} samples a pixel"
        print(f"{title}: {said}; {told}")
        at = place + (place == 2)
        show(figure, at, title, to_srgb(picture / white), said)
        if asked == "auto":
            relative = np.abs(picture - whole).mean(axis=-1) / pilot.scale(whole, white)[..., 0]
            shade = np.repeat(np.clip(relative / DIFFERENCE, 0, 1)[..., None], 3, axis=-1)
            show(figure, 2, "difference", shade, f"white: {100 * DIFFERENCE:.0f} % of a pixel")
    print(f"error of what is easy, measured: {100 * error_of(loaded, camera, 'classic'):.1f} %")
    return figure


def error_of(loaded: Scene, camera: Any, asked: str) -> float:
    """The error that leaving out cells makes, from two small pictures of many samples."""
    pictures = []
    with pilot.shrunk(camera, SMALL):
        for some in ("all", asked):
            settings, about = planning.choose(loaded, camera, some, 0.0, 0, 0)
            integrator: Any = mi.load_dict(settings)
            pictures.append(rendering.render(loaded.scene, camera, MANY, integrator=integrator).picture[..., :3])
    return pilot.difference(*pictures, about["white"])


def rendered(loaded: Scene, camera: Any, asked: str | None) -> tuple[npt.NDArray[Any], float, int, str]:
    """The picture, seconds (kernels compiled), samples a pixel, and what was left out."""
    integrator: Any = None  # `mi.load_dict` is declared to return any object
    told = ""
    if asked is not None:
        width, height = camera.film().crop_size()
        settings, about = planning.choose(loaded, camera, asked, 0.0, MOST * width * height, 0)
        integrator = mi.load_dict(settings)
        told = ", ".join(about["rendered"])
        if about["error"] is not None:
            told += f"; predicted error {100 * about['error']:.1f} +- {100 * about['error_se']:.1f} %"
    for _ in range(2):  # the first compiles
        start = time.perf_counter()
        done = rendering.render(loaded.scene, camera, MOST, integrator=integrator, noise=NOISE)
        seconds = time.perf_counter() - start
    return done.picture[..., :3].astype(np.float64), seconds, done.spp, told


def show(figure: Figure, place: int, title: str, picture: npt.NDArray[Any], below: str) -> None:
    """A picture under its title, with a line below."""
    side = 0.22
    left = 0.012 + 0.245 * place + 0.01
    axes = figure.add_axes((left, 0.12, side, side * WIDTH / 2.75))
    axes.set_axis_off()
    axes.imshow(np.clip(picture, 0, 1))
    figure.text(left + side / 2, 0.93, title, ha="center", va="center", color=INK)
    figure.text(left + side / 2, 0.07, below, ha="center", va="center", color=SOFT, fontsize=8.5)


def cells() -> Figure:
    """The lecture's table of a scene that calls for all of it: a picture a cell, on one scale."""
    loaded = load(FOLDER / "effects" / "all.xml")
    camera = loaded.scene.sensors()[0]
    plan = planning.static(loaded)
    layers, _ = planning.with_effects(loaded, camera, plan)
    found = planning.by_cell(layers(loaded.scene, LAYERS_SPP, 0, 256))
    white = pilot.white_of(found)
    height = 6.9
    figure = card(height)
    side, gap = 0.21, 0.012
    for c, column in enumerate(table.COLUMNS):
        heading(figure, 0.1 + (side + gap) * c + side / 2, column, 0.955)
    for r, row in enumerate(table.ROWS):
        bottom = 0.65 - (side * WIDTH / height + 0.02) * r
        figure.text(0.055, bottom + side * WIDTH / height / 2, row, ha="center", va="center", color=SOFT)
        for c, column in enumerate(table.COLUMNS):
            axes = figure.add_axes((0.1 + (side + gap) * c, bottom, side, side * WIDTH / height))
            axes.set_axis_off()
            name = f"{row}.{column}"
            if name == table.EMPTY:
                axes.text(0.5, 0.5, "measure zero", ha="center", va="center", color=SOFT, fontsize=9)
            else:
                axes.imshow(to_srgb(found[name] / white))
    return figure


if __name__ == "__main__":
    main()
