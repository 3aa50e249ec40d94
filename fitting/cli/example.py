"""``brdf example``: the main job on the built-in pictures, and how near it comes to what they were made with."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .fit import printer
from .output import Json, print_json

if TYPE_CHECKING:
    from ..solution import Solution

#: What is promised of the examples: the largest relative error.
PROMISED = {"ball.m": 0.005, "ball.eta": 0.01, "metal.m": 0.03}


@dataclass(frozen=True)
class Case:
    """One fit: scene, picture, what is fitted, values for ``$name``, and what it is."""

    name: str
    scene: str
    picture: str
    parameters: tuple[str, ...]
    defaults: dict[str, str]
    model: str


CASES = (
    Case(
        "sphere",
        "sphere.xml",
        "sphere.exr",
        ("ball.m", "ball.eta", "ball.diffuse_reflectance"),
        {},
        "cooktorrance",
    ),
    Case(
        "aluminium-smith",
        "aluminium.xml",
        "aluminium.exr",
        ("metal.m", "metal.specular_reflectance"),
        {"masking": "smith"},
        "cooktorrance, constant F, Smith G",
    ),
    Case(
        "aluminium-vcavity",
        "aluminium.xml",
        "aluminium.exr",
        ("metal.m", "metal.specular_reflectance"),
        {"masking": "vcavity"},
        "cooktorrance, constant F, V-cavity G",
    ),
    Case(
        "aluminium-conductor", "conductor.xml", "aluminium.exr", ("metal.alpha",), {}, "Mitsuba's roughconductor itself"
    ),
)


def command(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results; made if missing.")
    ] = Path("example"),
    as_json: Json = False,
) -> int:
    """Fit the built-in pictures: a sphere of the model itself, and an aluminium one by Mitsuba's own plugin."""
    from .. import examples, output
    from ..run import fit

    truth = examples.truth()
    known = {
        **truth["sphere"],
        "metal.alpha": truth["aluminium"]["metal.alpha"],
        "metal.m": truth["aluminium"]["metal.alpha"],
    }
    solutions: dict[str, Solution] = {}
    for case in CASES:
        output.ready(out / case.name)
        print(f"brdf: fitting {case.picture} with {case.model} ...", file=sys.stderr)
        solutions[case.name] = fit(
            examples.FOLDER / case.scene,
            {"camera": examples.FOLDER / case.picture},
            case.parameters,
            progress=printer(),
            defaults=case.defaults,
        )
        output.write(solutions[case.name], out / case.name)
    kept = {name: promised(s, known) for name, s in solutions.items()}
    good = kept["sphere"] and kept["aluminium-smith"] and all(s.converged for s in solutions.values())
    if as_json:
        print_json(
            {name: {**s.to_json(), "truth": {n: known.get(n) for n in s.parameters}} for name, s in solutions.items()}
        )
    else:
        print(text(solutions, known, out))
    return 0 if good else 1


def promised(solution: Solution, truth: dict[str, Any]) -> bool:
    """Whether the estimates are as near the truth as is promised, and the truth of the sphere inside the intervals."""
    for name, e in solution.parameters.items():
        if name in PROMISED and abs(float(e.value[0]) / truth[name] - 1) > PROMISED[name]:
            return False
        if name.startswith("ball") and name in PROMISED and not e.low[0] <= truth[name] <= e.high[0]:
            return False
    return True


def text(solutions: dict[str, Solution], truth: dict[str, Any], out: Path) -> str:
    """The results beside the truth."""
    sphere = solutions["sphere"]
    lines = ["", "(a) A sphere of Cook-Torrance over a coloured base, rendered by Mitsuba's path, 2 % noise added", ""]
    lines += [str(sphere), ""]
    for name in ("ball.m", "ball.eta"):
        e, true = sphere.parameters[name], truth[name]
        inside = "inside" if e.low[0] <= true <= e.high[0] else "OUTSIDE"
        lines.append(
            f"    {name}: truth {true:g}, estimate {e.value[0]:.5g} ({100 * (e.value[0] / true - 1):+.3f} %), "
            f"{inside} the interval"
        )
    alpha = truth["metal.alpha"]
    lines += [
        "",
        f"(b) An aluminium sphere, rendered by Mitsuba's own roughconductor with alpha = {alpha:g}, fitted with",
        "",
    ]
    metals = {case.model: solutions[case.name] for case in CASES if case.name.startswith("aluminium")}
    width = max(len(m) for m in metals)
    lines.append(f"    {'model'.ljust(width)}  roughness  error     misfit, of the noise")
    for model, s in metals.items():
        e = s.parameters.get("metal.m") or s.parameters["metal.alpha"]
        error = 100 * (e.value[0] / alpha - 1)
        lines.append(f"    {model.ljust(width)}  {e.value[0]:<9.5f}  {error:+.2f} %   {100 * s.misfit:.1f} %")
    ours = {m: s for m, s in metals.items() if m.startswith("cooktorrance")}
    best = min(ours, key=lambda m: ours[m].misfit)
    lines += ["", f"    Of our models {best} fits it best.", "", f"Reports: {out}/*/report.html"]
    return "\n".join(lines)
