"""``brdf fit``: parameters of materials from pictures."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from brdf.errors import UsageError

from .output import Json, print_json

if TYPE_CHECKING:
    from ..solution import Solution, Step


class SolverName(StrEnum):
    """What ``--solver`` takes."""

    lm = "lm"
    lbfgs = "lbfgs"
    adam = "adam"
    gd = "gd"


class MethodName(StrEnum):
    """What ``--method`` takes."""

    auto = "auto"
    exact = "exact"
    rendered = "rendered"


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.xml", help="A Mitsuba scene with the material in it.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results; made if missing.")],
    target: Annotated[
        list[str],
        typer.Option("--target", "-t", metavar="CAMERA=IMAGE", help="A picture, and the sensor that took it."),
    ] = [],  # noqa: B006  (typer reads it, nobody changes it)
    fit: Annotated[
        list[str],
        typer.Option("--fit", "-f", metavar="ID.PARAM[=START]", help="A parameter to fit; a colour's START is R,G,B."),
    ] = [],  # noqa: B006
    solver: Annotated[SolverName, typer.Option(help="lm: Levenberg-Marquardt.")] = SolverName.lm,
    mask: Annotated[
        list[str], typer.Option(metavar="[CAMERA=]IMAGE", help="White where a picture is to be used.")
    ] = [],  # noqa: B006
    spp: Annotated[
        int | None, typer.Option(help="Samples a pixel. Default: as many as the error bars ask for.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of all random numbers.")] = 0,
    iterations: Annotated[int | None, typer.Option(help="At most so many in each run of the solver.")] = None,
    method: Annotated[MethodName, typer.Option(help="How pictures are predicted.")] = MethodName.auto,
    define: Annotated[list[str], typer.Option("-D", metavar="NAME=VALUE", help="A value for $NAME in the scene.")] = [],  # noqa: B006
    as_json: Json = False,
) -> int:
    """Fit parameters of materials in a scene to pictures of it, with error bars."""
    targets = once("--target", [pair(t, "--target", "CAMERA=IMAGE") for t in target])
    parameters = once("--fit", [wanted(f) for f in fit])
    defaults = once("-D", [pair(d, "-D", "NAME=VALUE") for d in define])
    masks = once("--mask", [pair(m, "--mask", "CAMERA=IMAGE") if "=" in m else (only(targets), m) for m in mask])

    from .. import output
    from ..run import fit as run

    output.ready(out, [scene, *targets.values(), *masks.values()])
    solution = run(
        scene,
        targets,
        parameters,
        solver=solver.value,
        masks=masks,
        spp=spp,
        seed=seed,
        max_iterations=iterations,
        method=method.value,
        progress=printer(),
        defaults=defaults,
    )
    written = output.write(solution, out)
    if as_json:
        print_json({**solution.to_json(), "command": output.command(solution.settings)})
    else:
        print(summary(solution))
        materials = ", ".join(str(path) for path in written if path.name.startswith("material"))
        print(f"Look at {out / 'report.html'}; the material is {materials}.")
    return 130 if solution.interrupted else 0 if solution.converged else 1


def pair(text: str, option: str, form: str) -> tuple[str, str]:
    """Split ``NAME=VALUE``."""
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise UsageError(f"{option} {text!r} is not of the form {form}.")
    return name, value


def once(option: str, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """As a dictionary; a name given twice is an error, not overwritten."""
    out = dict(pairs)
    if len(out) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise UsageError(f"{option} {twice} is given twice. Give it once.")
    return out


def wanted(text: str) -> tuple[str, Any]:
    """Split ``ID.PARAM[=START]``."""
    name, equals, start = text.partition("=")
    if not equals:
        return name, None
    try:
        if not start:
            raise ValueError
        return name, [float(part) for part in start.split(",")]
    except ValueError:
        raise UsageError(f"--fit {text!r}: the start {start!r} is not a number, nor R,G,B.") from None


def only(targets: dict[str, str]) -> str:
    """The sensor that a mask without a name belongs to."""
    if len(targets) != 1:
        raise UsageError("--mask IMAGE goes with one target. With several, name the sensor: --mask CAMERA=IMAGE.")
    return next(iter(targets))


def printer() -> Any:
    """Prints each iteration on standard error; None if that is not a terminal."""
    if not sys.stderr.isatty():
        return None

    def show(step: Step) -> None:
        values = "  ".join(f"{name} {' '.join(f'{v:.5g}' for v in value)}" for name, value in step.values.items())
        print(
            f"{step.iteration:4d}  {step.stage:15s}  loss {step.loss:.6g}  {values}  {step.seconds:.1f} s",
            file=sys.stderr,
        )

    return show


def summary(solution: Solution) -> str:
    """The result as a text of a few lines."""
    rows = []
    parts = {name: solution.parameters[name] for name in solution.parameters}
    for name, e in parts.items():
        for i, component in enumerate([name] if e.kind == "number" else [f"{name}.{c}" for c in "rgb"]):
            unit = "" if e.unit == "1" else f" {e.unit}"
            rows.append((component, f"{e.value[i]:.6g}{unit}", f"{e.sd[i]:.2g}", f"{e.low[i]:.6g} to {e.high[i]:.6g}"))
    head = ("parameter", "value", "sd", "95 % interval")
    widths = [max(len(row[k]) for row in [head, *rows]) for k in range(4)]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in [head, *rows]]
    lines += ["", f"{solution.status} ({solution.seconds:.1f} s, residual {100 * solution.rms:.3g} % of the picture)"]
    lines += [f"{name}: {c.sentence}" for name, c in solution.checks.items()]
    lines += [f"Note: {remark}" for remark in solution.remarks]
    return "\n".join(lines)
