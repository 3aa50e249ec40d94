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

    from plugins.scene import Scene

#: Error that --effects auto may make.
TOLERANCE = 0.005
#: With --noise alone, samples a pixel there may be at most.
MOST_SPP = 2**20


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.xml", help="A Mitsuba scene.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="OUT.exr", help="The picture, .exr or .png.")],
    spp: Annotated[int | None, typer.Option(min=1, help="Samples a pixel. Default: what the scene says.")] = None,
    noise: Annotated[
        float | None,
        typer.Option(metavar="X", help="Render until the noise is this fraction of a pixel; with --spp as the most."),
    ] = None,
    effects: Annotated[
        str | None,
        typer.Option(
            metavar="auto|all|classic|LIST",
            help="Simulate only these cells of the lecture's table (brdf plan): all that the scene calls for, but for "
            "what is below --tolerance; all; what a classic ray tracer does; or names with commas, -NAME to leave one "
            "out. Default: the scene's own integrator.",
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="X",
            help="What --effects auto may leave out, if a pilot pays: RMS error relative to a pixel. Default: 0.005.",
        ),
    ] = None,
    layers: Annotated[bool, typer.Option("--layers", help="A layer a cell, in an EXR; they add up.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, other noise.")] = 0,
    sensor: Annotated[str | None, typer.Option(metavar="ID", help="The sensor of that id. Default: the first.")] = None,
    variant: Annotated[str, typer.Option(help="The variant of Mitsuba.")] = "llvm_ad_rgb",
    define: Annotated[
        list[str],
        typer.Option("-D", metavar="NAME=VALUE", help="A value for $NAME in the scene."),
    ] = [],  # noqa: B006  (typer reads it, nobody changes it)
    as_json: Json = False,
) -> int:
    """Render a scene with our models in it, and only the effects that it calls for.

    Ctrl-C writes what is there so far.
    """
    defaults = dict(pair(d, "-D", "NAME=VALUE") for d in define)
    if out.suffix.lower() not in (".exr", ".png"):
        raise UsageError(f"--out {out}: a picture is written as .exr or .png. Name it with one of them.")
    if not out.parent.is_dir():
        raise DataError(f"--out {out}: there is no folder {out.parent}. Make it first.")
    if layers and out.suffix.lower() != ".exr":
        raise UsageError(f"--layers: {out} has no room for them. Name it .exr.")
    for name, given in (("noise", noise), ("tolerance", tolerance)):
        if given is not None and not 0 < given < float("inf"):
            raise UsageError(f"--{name} {given:g}: expected a number above 0, as 0.01 for 1 %.")
    if tolerance is not None and effects not in (None, "auto"):
        raise UsageError("--tolerance is for --effects auto: other cells are rendered as named.")
    if effects is None and (layers or tolerance is not None):
        effects = "auto"
    if variant.startswith("llvm"):
        llvm.require()
    import mitsuba as mi

    from fitting.images import write

    if variant not in mi.variants():
        raise UsageError(f"--variant {variant}: there is no such variant. There are: {', '.join(mi.variants())}.")
    if effects is not None and not (variant.startswith("llvm") and "polarized" not in variant):
        raise UsageError(f"--effects: the variant {variant} will not do. Take llvm_ad_rgb.")
    try:
        mi.set_variant(variant)
    except ImportError as error:
        raise NoBackend(f"--variant {variant}: {error}") from error
    from plugins.scene import load

    from ..interrupt import interruptible
    from ..rendering import render

    start = time.perf_counter()
    loaded = load(scene, **defaults)
    name, camera = find_sensor(loaded, sensor)
    count = spp or (MOST_SPP if noise is not None else camera.sampler().sample_count())
    integrator: Any = None  # `mi.load_dict` is declared to return any object
    cells = None
    if effects is not None:
        from .. import planning

        width, height = camera.film().crop_size()
        settings, cells = planning.choose(
            loaded, camera, effects, TOLERANCE if tolerance is None else tolerance, count * width * height, seed
        )
        integrator = mi.load_dict({**settings, "layers": layers})
    with progress_bar() as bar, interruptible() as pressed:
        task = bar.add_task("render", total=count if noise is None else None)
        done = render(
            loaded.scene,
            camera,
            count,
            seed,
            integrator=integrator,
            noise=noise,
            progress=lambda spent, total: bar.update(task, completed=spent, total=total),
            pressed=pressed,
        )
    shown = [i for i, channel in enumerate(done.channels) if not layers or in_layer(channel, cells)]
    write(out, done.picture[..., shown], [done.channels[i] for i in shown])
    height, width = done.picture.shape[:2]
    interrupted = pressed()
    result = {
        "out": str(out),
        "width": width,
        "height": height,
        "sensor": name,
        "spp": done.spp,
        "noise": done.noise,
        "effects": cells,
        "seed": seed,
        "variant": variant,
        "interrupted": interrupted,
        "seconds": time.perf_counter() - start,
    }
    if as_json:
        print_json(result)
    else:
        told = "" if done.noise is None else f", noise {100 * done.noise:.2g} %"
        print(f"{out}: {width} x {height}, {done.spp} samples a pixel{told}, {result['seconds']:.1f} s")
        if cells is not None:
            say(cells)
        if interrupted:
            print("Interrupted: the picture has fewer samples than were asked for.")
        elif not done.reached:
            print(f"The noise is not {100 * (noise or 0):.2g} % yet. Give more samples (--spp).")
    return 130 if interrupted else 0 if done.reached else 1


def in_layer(channel: str, cells: dict[str, Any] | None) -> bool:
    """Whether a channel is of the picture itself, or of a cell that was rendered."""
    cell = channel.rpartition(".")[0]
    return not cell or cells is None or cell in cells["rendered"]


def say(cells: dict[str, Any]) -> None:
    """Which cells were rendered, and what was not."""
    print(f"Simulated: {', '.join(cells['rendered'])}.")
    for key, why in (("left_out", "as asked"), ("dropped", "as the pilot found them to be worth little")):
        if cells[key]:
            print(f"Left out {why}: {', '.join(cells[key])}.")
    if cells["error"] is not None:
        error, se = 100 * cells["error"], 100 * cells["error_se"]
        print(f"Predicted error without them: {error:.2g} ± {se:.1g} % of a pixel (RMS).")


def find_sensor(scene: Scene, name: str | None) -> tuple[str, mi.Sensor]:
    """The sensor of that name, or the first."""
    if not scene.sensors:
        raise DataError(f"{scene.path}: the scene has no sensor. Give it a <sensor>.")
    if name is None:
        return next(iter(scene.sensors.items()))
    if name not in scene.sensors:
        raise UsageError(f"--sensor {name}: there is no such sensor. There are: {', '.join(scene.sensors)}.")
    return name, scene.sensors[name]
