"""``brdf render``: a picture of a scene."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from brdf import llvm
from brdf.errors import DataError, NoBackend, UsageError

from .fit import pair
from .output import Json, print_json, progress_bar

if TYPE_CHECKING:
    import mitsuba as mi
    import numpy as np
    import numpy.typing as npt

    from plugins.scene import Scene

#: Samples taken at once: few enough that their state fits in memory, many enough to keep all cores busy.
SAMPLES_PER_PASS = 2**23


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.xml", help="A Mitsuba scene.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="OUT.exr", help="The picture, .exr or .png.")],
    spp: Annotated[int | None, typer.Option(min=1, help="Samples a pixel. Default: what the scene says.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, other noise.")] = 0,
    sensor: Annotated[str | None, typer.Option(metavar="ID", help="The sensor of that id. Default: the first.")] = None,
    variant: Annotated[str, typer.Option(help="The variant of Mitsuba.")] = "llvm_ad_rgb",
    define: Annotated[
        list[str],
        typer.Option("-D", metavar="NAME=VALUE", help="A value for $NAME in the scene."),
    ] = [],  # noqa: B006  (typer reads it, nobody changes it)
    as_json: Json = False,
) -> None:
    """Render a scene with our models in it."""
    defaults = dict(pair(d, "-D", "NAME=VALUE") for d in define)
    if out.suffix.lower() not in (".exr", ".png"):
        raise UsageError(f"--out {out}: a picture is written as .exr or .png. Name it with one of them.")
    if not out.parent.is_dir():
        raise DataError(f"--out {out}: there is no folder {out.parent}. Make it first.")
    if variant.startswith("llvm"):
        llvm.require()
    import mitsuba as mi

    from fitting.images import write

    if variant not in mi.variants():
        raise UsageError(f"--variant {variant}: there is no such variant. There are: {', '.join(mi.variants())}.")
    try:
        mi.set_variant(variant)
    except ImportError as error:
        raise NoBackend(f"--variant {variant}: {error}") from error
    from plugins.scene import load

    start = time.perf_counter()
    loaded = load(scene, **defaults)
    name, camera = find_sensor(loaded, sensor)
    count = spp or camera.sampler().sample_count()
    picture = render(loaded.scene, camera, count, seed)
    write(out, picture, [channel.name for channel in camera.film().bitmap().struct_()])
    height, width = picture.shape[:2]
    result = {
        "out": str(out),
        "width": width,
        "height": height,
        "sensor": name,
        "spp": count,
        "seed": seed,
        "variant": variant,
        "seconds": time.perf_counter() - start,
    }
    if as_json:
        print_json(result)
    else:
        print(f"{out}: {width} x {height}, {count} samples a pixel, {result['seconds']:.1f} s")


def find_sensor(scene: Scene, name: str | None) -> tuple[str, mi.Sensor]:
    """The sensor of that name, or the first."""
    if not scene.sensors:
        raise DataError(f"{scene.path}: the scene has no sensor. Give it a <sensor>.")
    if name is None:
        return next(iter(scene.sensors.items()))
    if name not in scene.sensors:
        raise UsageError(f"--sensor {name}: there is no such sensor. There are: {', '.join(scene.sensors)}.")
    return name, scene.sensors[name]


def render(scene: mi.Scene, sensor: mi.Sensor, spp: int, seed: int) -> npt.NDArray[np.float32]:
    """Render in passes that fit in memory.

    What the passes add up to is the film's weighted sums, not its pixels, so that their number does not show.

    Returns
    -------
    array, shape (height, width, channels)
    """
    import mitsuba as mi
    import numpy as np

    film: Any = sensor.film()
    width, height = film.crop_size()
    passes = min(spp, -(-spp * width * height // SAMPLES_PER_PASS))
    seeds = np.random.SeedSequence(seed).generate_state(passes)  # seeds next to each other share no pass
    total: Any = 0.0
    with progress_bar() as bar:
        for i in bar.track(range(passes), description="render"):
            mi.render(scene, sensor=sensor, spp=spp * (i + 1) // passes - spp * i // passes, seed=int(seeds[i]))
            total = total + np.asarray(film.develop(raw=True), dtype=np.float64)
    film.clear()
    film.put_block(mi.ImageBlock(mi.TensorXf(total.astype(np.float32)), film.crop_offset()))
    return np.array(film.develop(), dtype=np.float32)
