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
    from ..solution import Step


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
    precision: Annotated[
        float | None,
        typer.Option(
            help="Half a 95 % interval of m, eta - 1 and the like, as a fraction, that still determines it. "
            "Default: one whose ends differ by a factor 2."
        ),
    ] = None,
    define: Annotated[list[str], typer.Option("-D", metavar="NAME=VALUE", help="A value for $NAME in the scene.")] = [],  # noqa: B006
    as_json: Json = False,
) -> int:
    """Fit parameters of materials in a scene to pictures of it, with error bars."""
    from ..parameters import asked

    targets = once("--target", [pair(t, "--target", "CAMERA=IMAGE") for t in target])
    parameters = once("--fit", [asked(f) for f in fit])
    defaults = once("-D", [pair(d, "-D", "NAME=VALUE") for d in define])
    masks = once("--mask", [pair(m, "--mask", "CAMERA=IMAGE") if "=" in m else (only(targets), m) for m in mask])

    from .. import output
    from ..remarks import PRECISION
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
        precision=PRECISION if precision is None else precision,
        progress=printer(),
        defaults=defaults,
    )
    written = output.write(solution, out)
    if as_json:
        print_json({**solution.to_json(), "command": output.command(solution.settings)})
    else:
        print(solution)
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
