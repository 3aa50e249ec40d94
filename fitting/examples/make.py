"""Make the pictures of the examples: ``python -m fitting.examples.make [FOLDER]``.

Mitsuba's `path` renders them, with 65536 samples a pixel: it picks one of the lamps at random, so that a pixel's noise
is still 0.25 %. Far more is added: 2 % of each pixel and a shot noise, which keeps black black and nothing negative.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mitsuba as mi
import numpy as np

from fitting import images
from fitting.parameters import Parameters, resolve
from plugins import scene as scenes

from . import FOLDER, truth

SAMPLES, PASSES = 1024, 64
#: Standard deviation of a pixel: relative, and of shot noise at the mean of the picture.
RELATIVE, SHOT = 0.02, 0.01
SCENES = {"sphere": "sphere.xml", "aluminium": "conductor.xml"}


def main(folder: Path) -> None:
    """Write ``sphere.exr`` and ``aluminium.exr`` to `folder`."""
    mi.set_variant("llvm_ad_rgb")
    for number, (name, file) in enumerate(SCENES.items()):
        scene = scenes.load(FOLDER / file)
        free = Parameters(resolve(scene, truth()[name]))
        starts = [v for f in free.free if f.start is not None for v in f.start]
        free.place(free.free_of(np.array(starts)))
        clean = np.mean([np.array(mi.render(scene.scene, spp=SAMPLES, seed=i)) for i in range(PASSES)], axis=0)
        lit = clean[clean > 0].mean()
        rng = np.random.default_rng(number + 1)
        sd = np.sqrt((RELATIVE * clean) ** 2 + SHOT**2 * clean * lit)
        images.write(folder / f"{name}.exr", np.maximum(clean + sd * rng.standard_normal(clean.shape), 0))
        print(folder / f"{name}.exr")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER, help="where they go; default: %(default)s")
    main(parser.parse_args().folder)
