"""``brdf check``: is a BSDF reciprocal, does it conserve energy, are its samples and its gradients right?"""

from __future__ import annotations

import importlib
import os
import platform
import shlex
import sys
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from brdf import llvm
from brdf.errors import DataError, UsageError

from .fit import once, pair
from .output import Json, print_json, progress_bar

if TYPE_CHECKING:
    from ..checking import Asked, Checked

INTERRUPTED = 130
#: The time left is estimated from the last minutes: some checks take far longer than others.
PACE = 600.0
VARIANT = "llvm_ad_rgb"


def command(
    what: Annotated[
        str | None,
        typer.Argument(metavar="[NAME | SCENE.xml]", help="A model, any BSDF of Mitsuba's, or all those of a scene."),
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="Every model that brdf models lists, under each choice.")
    ] = False,
    given: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="PARAM=VALUE",
            help="Look there alone; a choice alone: at all trials of it. A colour is R,G,B.",
        ),
    ] = [],  # noqa: B006  (typer reads it, nobody changes it)
    bsdf: Annotated[str | None, typer.Option("--bsdf", metavar="ID", help="The BSDF of that id in the scene.")] = None,
    only: Annotated[
        list[str], typer.Option("--only", metavar="CHECK", help="This check; more than once for more.")
    ] = [],  # noqa: B006
    plot: Annotated[
        bool, typer.Option("--plot", help="Draw lobe, albedo and reciprocity as NAME.png, in --out or else here.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Folder for report.html and checks.json; made if missing."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the random directions.")] = 0,
    define: Annotated[list[str], typer.Option("-D", metavar="NAME=VALUE", help="A value for $NAME in the scene.")] = [],  # noqa: B006
    modules: Annotated[
        list[str],
        typer.Option("--import", metavar="MODULE", help="Import it first: a Python module that registers BSDFs."),
    ] = [],  # noqa: B006
    hard: Annotated[
        bool,
        typer.Option(
            "--hard",
            help="Instead: value and derivatives at hard points, against exact answers, in roundings. A model of yours "
            "is asked at 500 points, where its value may be off by 8 and a derivative by 16.",
        ),
    ] = False,
    peers: Annotated[
        bool, typer.Option("--peers", help="With --hard: Mitsuba's own functions and BSDFs on the same points.")
    ] = False,
    as_json: Json = False,
) -> int:
    """Check BSDFs: reciprocity, energy, sampling, gradients, hostile inputs, where the highlight is.

    A model's choices are tried one at a time. What it declares that it breaks is expected, and must occur.
    """
    settings = {
        name: value(text) for name, text in once("--set", [pair(s, "--set", "PARAM=VALUE") for s in given]).items()
    }
    defaults = once("-D", [pair(d, "-D", "NAME=VALUE") for d in define])
    known(only)
    if hard or peers:
        others = {"--set": given, "--bsdf": bsdf, "--only": only, "--plot": plot, "--out": out, "-D": define}
        others |= {"--seed": seed, "--peers": not hard}
        return hard_cases(what, everything, peers and hard, others, modules, as_json)
    asked = request(what, everything, settings, bsdf, defaults, modules)

    from .. import checking
    from ..output import ready

    folder = None if out is None else ready(out)
    with progress_bar(PACE) as bar:
        task = bar.add_task("check", total=len(asked))

        def tell(done: int, name: str, check: str, part: float) -> None:
            bar.update(task, completed=done + part, description=f"{name}: {check}".replace("[", r"\["))

        checked = checking.run(
            asked,
            only or None,
            seed,
            portraits=plot or folder is not None,
            progress=None if bar.disable else tell,
            modules=modules,
        )
    line = again(what, given, bsdf, only, seed, define, modules)
    written = write(checked, folder, plot, {"command": line, "seed": seed, "versions": versions()})
    if as_json:
        if checked.complete:
            print_json(checked.to_json())
    else:
        from .check_tables import show

        show(checked)
        if written:
            print(f"Look at {', '.join(map(str, written))}.")
    return INTERRUPTED if not checked.complete else 1 if checked.unexpected() else 0


def hard_cases(
    what: str | None, everything: bool, peers: bool, others: Mapping[str, Any], modules: list[str], as_json: bool
) -> int:
    """``--hard``; `others` are the options that were given and do not go with it."""
    for option, is_given in others.items():
        if is_given and option == "--peers":
            raise UsageError("--peers goes with --hard: brdf check --hard --peers.")
        if is_given:
            raise UsageError(f"{option} does not go with --hard, which asks a model at points of its own.")
    if everything and what is not None:
        raise UsageError(f"{what} and --all are both given. Give one of them.")
    if not (everything or what or peers):
        raise UsageError("--hard: name a model, or bricks, or give --all; with --peers none is needed.")
    llvm.require()
    import mitsuba as mi

    mi.set_variant(VARIANT)
    import plugins

    plugins.register()
    for module in modules:
        load_module(module)
    from .. import hard
    from .check_hard import check_hard

    asked = hard.all_formulas() if everything else hard.by_name(what) if what else []
    named = ["--all"] if everything else [what] if what else []
    words = ["brdf", "check", *named, "--hard", *(["--peers"] if peers else [])]
    return check_hard(asked, peers, as_json, shlex.join([*words, *(w for m in modules for w in ("--import", m))]))


def value(text: str) -> Any:
    """What is typed as a value: a number, three for a colour, true or false, else text."""
    if text in ("true", "false"):
        return text == "true"
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else numbers if len(numbers) == 3 else text


def known(only: list[str]) -> None:
    """Raise `UsageError` for a check that there is not."""
    from brdf.checks import CHECKS
    from plugins.scene import near

    for name in only:
        if name not in CHECKS:
            guess = near(name, CHECKS).replace("It has:", "There are:")
            raise UsageError(f"--only {name}: there is no such check. {guess}")


def request(
    what: str | None,
    everything: bool,
    settings: Mapping[str, Any],
    bsdf: str | None,
    defaults: Mapping[str, Any],
    modules: list[str],
) -> list[Asked]:
    """The BSDFs that a command line means."""
    if everything and what is not None:
        raise UsageError(f"{what} and --all are both given. Give one of them.")
    if not everything and what is None:
        raise UsageError("nothing is named. Name a model, a BSDF of Mitsuba's, a SCENE.xml, or give --all.")
    scene = what is not None and (what.endswith(".xml") or os.sep in what or Path(what).is_file())
    for option, is_given, fits, place in (
        ("--set", settings, not everything and not scene, "a NAME"),
        ("--bsdf", bsdf, scene, "a SCENE.xml"),
        ("-D", defaults, scene, "a SCENE.xml"),
    ):
        if is_given and not fits:
            raise UsageError(f"{option} goes with {place} alone.")
    llvm.require()
    import mitsuba as mi

    mi.set_variant(VARIANT)
    import plugins
    from plugins.scene import load

    from .. import checking

    plugins.register()
    for module in modules:
        load_module(module)
    if everything:
        return checking.all_models()
    assert what is not None
    if scene:
        return checking.in_scene(load(what, **defaults), bsdf, defaults)
    return checking.by_name(what, settings)


def load_module(name: str) -> None:
    """Import a module of the user's, from the folder that the command runs in as well."""
    here = os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        importlib.import_module(name)
    except ImportError as error:
        raise DataError(f"--import {name}: {error}.") from error


def again(
    what: str | None,
    settings: list[str],
    bsdf: str | None,
    only: list[str],
    seed: int,
    define: list[str],
    modules: list[str],
) -> str:
    """The command that makes the results again."""
    words = ["brdf", "check", what or "--all"]
    for option, values in (("--set", settings), ("--only", only), ("-D", define), ("--import", modules)):
        words += [word for given in values for word in (option, given)]
    words += [] if bsdf is None else ["--bsdf", bsdf]
    return shlex.join([*words, "--seed", str(seed), "--out", "DIR"])


def write(checked: Checked, folder: Path | None, plot: bool, about: Mapping[str, Any]) -> list[Path]:
    """The files that were asked for; returns those to look at."""
    from ..checking import file_names, write_json

    look = []
    if folder is not None:
        from ..report import checks as report

        report.write(checked, folder / "report.html", about)
        write_json(checked, folder / "checks.json", about)
        look.append(folder / "report.html")
    if plot:
        from ..report.portrait import write_png

        for name, file in file_names(checked.portraits).items():
            look.append((folder or Path()) / f"{file}.png")
            write_png(checked.portraits[name], name, look[-1])
    return look


def versions() -> dict[str, str]:
    """What the result was made with."""
    return {"python": platform.python_version(), **{n: version(n) for n in ("mitsuba", "drjit", "numpy")}}
