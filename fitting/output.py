"""The files that a fit leaves behind."""

from __future__ import annotations

import csv
import fnmatch
import json
import os
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from brdf.errors import DataError, UsageError
from plugins import xmlfile

from . import images, report
from .files import replacing
from .remarks import PRECISION
from .solution import Solution

#: Names of what `write` leaves.
NAMES = ("material.xml", "material-*.xml", "scene.xml", "scene.*.xml", "render.exr", "render-*.exr", "error.exr")
NAMES += ("error-*.exr", "history.csv", "report.html", "fit.json")


def ready(folder: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()) -> Path:
    """Make the folder, and make sure before the work that files can be written there.

    Raises
    ------
    DataError
        It cannot be made or written.
    UsageError
        One of the `inputs` lies there under a name that the results take.
    """
    folder = Path(folder)
    for path in map(Path, inputs):
        if path.resolve().parent == folder.resolve() and any(fnmatch.fnmatch(path.name, name) for name in NAMES):
            raise UsageError(f"{path}: the results would overwrite it. Choose another --out than {folder}.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"{folder}: cannot be made: {error.strerror}. Choose another --out.") from error
    probe = folder / ".writable"
    with replacing(probe):
        pass
    probe.unlink()
    return folder


def write(solution: Solution, folder: str | os.PathLike[str]) -> list[Path]:
    """Write everything a fit found; returns the files.

    ``material.xml`` (the fitted BSDF alone; ``material-ID.xml`` each if there are several), ``scene.xml`` (the scene
    with the fitted values), ``render.exr``, ``error.exr`` (render - target; 0 where a pixel was not used; with
    ``-SENSOR`` if there are several), ``history.csv``, ``report.html``, and last ``fit.json``: where it stands, the
    rest is complete.
    """
    folder = ready(folder)
    (folder / "fit.json").unlink(missing_ok=True)  # of an earlier fit: what it vouches for is about to change
    defaults = solution.settings["defaults"]
    scene = solution.settings["scene"]
    values = fitted_values(solution)
    written = []
    for name, params in values.items():
        path = folder / ("material.xml" if len(values) == 1 else f"material-{safe(name)}.xml")
        comment = (
            f"{name}: fitted by brdf-fitting {solution.versions['brdf-fitting']}. Error bars and settings: fit.json. "
            "For a scene to <include>; to paste it into one, leave out its version."
        )
        xmlfile.material(scene, name, params, path, comment, **defaults)
        written.append(path)
    written += xmlfile.rewrite(scene, folder / "scene.xml", values, **defaults)
    for view in solution.views:
        ending = "" if len(solution.views) == 1 else f"-{safe(view.sensor)}"
        error = np.where(view.used[..., None], view.render - view.target, 0)
        for kind, array in (("render", view.render), ("error", error)):
            written.append(folder / f"{kind}{ending}.exr")
            images.write(written[-1], array)
    written.append(folder / "history.csv")
    with replacing(written[-1]) as path:
        history(solution, path)
    written.append(folder / "report.html")
    report.write(solution, written[-1])
    written.append(folder / "fit.json")
    with replacing(written[-1]) as path:
        path.write_text(json.dumps({**solution.to_json(), "command": command(solution.settings)}, indent=2) + "\n")
    return written


def safe(name: str) -> str:
    """An id as part of a file's name."""
    return name.replace("/", "_")


def fitted_values(solution: Solution) -> dict[str, dict[str, Any]]:
    """``{ID: {PARAM: number or (r, g, b)}}``."""
    out: dict[str, dict[str, Any]] = {}
    for name, estimate in solution.parameters.items():
        identifier, _, parameter = name.rpartition(".")
        numbers = tuple(float(np.float32(v)) for v in estimate.value)
        out.setdefault(identifier, {})[parameter] = numbers[0] if estimate.kind == "number" else numbers
    return out


def history(solution: Solution, path: Path) -> None:
    """Iterations as comma-separated values: iteration, stage, loss, seconds, one column a component."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["iteration", "stage", "loss", "seconds", *solution.components])
        for step in solution.history:
            numbers = [repr(float(v)) for value in step.values.values() for v in value]
            rows.writerow([step.iteration, step.stage, repr(step.loss), f"{step.seconds:.3f}", *numbers])


def command(settings: dict[str, Any]) -> str:
    """The command that runs a fit again."""
    words = ["brdf", "fit", settings["scene"]]
    for name, path in settings["targets"].items():
        words += ["--target", f"{name}={path}"]
    for name, path in settings["masks"].items():
        words += ["--mask", f"{name}={path}"]
    for name, start in settings["parameters"].items():
        words += ["--fit", name if start is None else f"{name}={','.join(repr(float(v)) for v in start)}"]
    for name, value in settings["defaults"].items():
        words += ["-D", f"{name}={value}"]
    words += ["--solver", settings["solver"], "--iterations", str(settings["max_iterations"])]
    if settings["spp"] is not None:
        words += ["--spp", str(settings["spp"])]
    words += ["--precision", repr(settings["precision"])] if settings["precision"] != PRECISION else []
    if settings["asked_method"] != "auto":
        words += ["--method", settings["asked_method"]]
    return shlex.join([*words, "--seed", str(settings["seed"]), "--out", "DIR"])
