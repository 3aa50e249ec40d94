"""``brdf plan``: which effects a scene calls for, and what each of them is worth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from brdf import llvm
from brdf.errors import DataError, UsageError

from .fit import once, pair
from .output import Json, print_json, print_table, progress_bar


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.xml", help="A Mitsuba scene.")],
    pilot: Annotated[
        bool, typer.Option("--pilot", help="Render a few small pictures to tell what each cell is worth.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="PLAN.html", help="A page with a picture of each cell. Implies --pilot."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, another pilot.")] = 0,
    sensor: Annotated[str | None, typer.Option(metavar="ID", help="The sensor of that id. Default: the first.")] = None,
    define: Annotated[list[str], typer.Option("-D", metavar="NAME=VALUE", help="A value for $NAME in the scene.")] = [],  # noqa: B006
    as_json: Json = False,
) -> None:
    """Tell which cells of the lecture's table a scene calls for.

    How light arrives (from a point, an area, the environment, other surfaces) against how surfaces answer (diffuse,
    glossy, mirror). What is not called for is exactly zero: it need not be simulated.
    """
    defaults = once("-D", [pair(d, "-D", "NAME=VALUE") for d in define])
    if out is not None:
        if out.suffix.lower() != ".html":
            raise UsageError(f"--out {out}: the plan is written as .html. Name it so.")
        if not out.parent.is_dir():
            raise DataError(f"--out {out}: there is no folder {out.parent}. Make it first.")
    llvm.require()
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    from plugins.scene import load

    from .. import planning
    from .render import find_sensor

    loaded = load(scene, **defaults)
    plan = planning.static(loaded)
    if pilot or out is not None:
        name, camera = find_sensor(loaded, sensor)
        layers, seconds = planning.with_effects(loaded, camera, plan)
        with progress_bar() as bar:
            task = bar.add_task("pilot", total=planning.calls(plan))

            def watched(function: Callable[..., Any]) -> Callable[..., Any]:
                def call(*given: Any) -> Any:
                    result = function(*given)
                    bar.advance(task)
                    return result

                return call

            measured = planning.measured(plan, loaded.scene, watched(layers), watched(seconds), seed)
        plan = {**measured, "sensor": name}
        if out is not None:
            from ..report import plan as page

            pictures = planning.by_cell(layers(loaded.scene, planning.PICTURE_SPP, seed, planning.PICTURE_SIZE))
            page.write(plan, pictures, out)
            plan["out"] = str(out)
    if as_json:
        print_json(plan)
    else:
        show(plan)


def show(plan: dict[str, Any]) -> None:
    """Print the lecture's table, then a line a cell."""
    from plugins.effects.table import CELLS, COLUMNS, EMITTER, ROWS

    cells = plan["cells"]
    depth = "any depth" if plan["max_depth"] < 0 else f"depth {plan['max_depth']} at most"
    print(f"{plan['scene']}, paths of {depth}\n")
    grid = Table("", *COLUMNS, box=None, padding=(0, 2, 0, 0))
    for row in ROWS:
        grid.add_row(row, *(entry(cells[f"{row}.{column}"]) for column in COLUMNS))
    grid.add_row(EMITTER, entry(cells[EMITTER]))
    print_table(grid)
    print("\n· not called for, exactly zero   * easy for a classic ray tracer\n")
    width = max(map(len, CELLS))
    for name in CELLS:
        cell = cells[name]
        print(f"{name:<{width}}  {cell['why']}" + (f": {cell['technique']}" if cell["technique"] else ""))
    if plan["pilot"] is not None:
        numbers = Table("", "share of light", "of time", "error without it", box=None, padding=(0, 2, 0, 0))
        for name in (name for name in CELLS if cells[name]["called_for"]):
            cell = cells[name]
            numbers.add_row(name, of_share(cell), percent(cell["time"]), of_error(cell))
        print()
        print_table(numbers)
        about = plan["pilot"]
        runs = f"{about['runs']} runs of {about['size']} pixels with {about['spp']} samples each"
        print(f"\n{runs}, {about['seconds']:.1f} s.")
        print("Errors are relative to each pixel, root mean square.")


def entry(cell: dict[str, Any]) -> str:
    """A cell of the table in a few characters: its share, or whether it is called for."""
    if not cell["called_for"]:
        return "·"
    return ("yes" if cell["share"] is None else of_share(cell)) + ("*" if cell["easy"] else "")


def of_share(cell: dict[str, Any]) -> str:
    """``12.3 ±0.4 %``."""
    return f"{100 * cell['share']:.1f} ±{100 * cell['share_se']:.1f} %"


def of_error(cell: dict[str, Any]) -> str:
    """``12.3 ±0.4 %``."""
    return f"{100 * cell['drop_error']:.1f} ±{100 * cell['drop_error_se']:.1f} %"


def percent(x: float) -> str:
    """``12 %``."""
    return f"{100 * x:.0f} %"
