"""``brdf check --hard``: value and derivatives at hard points, in roundings."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from brdf.hard import Verdict
from brdf.hard.criterion import PRECISIONS

from ..hard import ORACLES, Asked, Hard, run
from .output import WIDE, print_json, progress_bar

INTERRUPTED = 130
LEGEND = (
    "C: error in roundings, |f - f*| <= C eps (|f*| + sum |x df/dx|). ill: share of the points where the problem "
    "itself permits no answer; they need only be finite."
)


def check_hard(asked: Sequence[Asked], as_json: bool, line: str) -> int:
    """Judge, and print a table or JSON; the exit code is 1 if anything is beyond its limit."""
    with progress_bar() as bar:
        task = bar.add_task("check", total=len(asked))

        def tell(done: int, name: str, part: float) -> None:
            bar.update(task, completed=done + part, description=name)

        found = run(asked, tell)
    if as_json:
        if found.complete:
            print_json({"command": line, "models": found.to_json()})
    else:
        show(found)
    return INTERRUPTED if not found.complete else 1 if found.failed() else 0


def show(found: Hard) -> None:
    """A line for each formula, then what is wrong."""
    console = Console(width=None if sys.stdout.isatty() else WIDE, highlight=False)
    console.print(table(found))
    console.print(LEGEND, soft_wrap=True)
    others = {a.oracle for a in found.asked} - {"table"}
    for oracle in sorted(others):
        names = ", ".join(a.formula.name for a in found.asked if a.oracle == oracle)
        console.print(f"Judged by {ORACLES[oracle]}: {names}.", soft_wrap=True)
    for verdict in found.failed():
        console.print(Text(verdict.sentence(), "bold red"), soft_wrap=True)
    if not found.complete:
        console.print(f"Interrupted at {len(found.verdicts)} of {len(found.asked)} formulas.")
    points = sum(v.points for per in found.verdicts.values() for v in per.values())
    bad = len({v.name for v in found.failed()}) or "none"
    console.print(f"{len(found.verdicts)} formulas at {points} points: {bad} beyond the limits.", soft_wrap=True)


def table(found: Hard) -> Table:
    """Value and gradient C in both precisions, beside what is allowed."""
    heads = ["value C\nfloat32", "\nfloat64", "\nlimit", "gradient C\nfloat32", "\nfloat64", "\nlimit", "\nlargest"]
    heads += ["not\nfinite", "recip-\nrocal", "\npoints", "ill\nfloat32"]
    made = Table("formula", *heads, box=None, padding=(0, 2, 0, 0))
    for column in made.columns[1:]:
        column.justify = "right"
    for name, verdicts in found.verdicts.items():
        per = [verdicts.get(p) for p in PRECISIONS]
        some = next(v for v in per if v is not None)
        given = [v for v in per if v is not None]
        row: list[Any] = [cell(v, "value") for v in per] + [f"{some.limits[0]:g}"]
        row += [cell(v, "slope") for v in per] + [f"{some.limits[1]:g}", f"{max(v.slope_max for v in given):.2g}"]
        count = sum(v.not_finite for v in given)
        same = {None: "", True: "yes", False: "NO"}[some.reciprocal and all(v.reciprocal for v in given)]
        row += [Text(str(count), "bold red" if count else ""), same, str(some.points), f"{100 * some.ill:.1f} %"]
        made.add_row(Text(name, "" if all(v.passed for v in given) else "bold red"), *row)
    return made


def cell(verdict: Verdict | None, what: str) -> Text:
    """A figure, red beyond its limit."""
    if verdict is None:
        return Text("")
    figure, limit = getattr(verdict, what), verdict.limits[what == "slope"]
    return Text(f"{figure:.2f}" if figure < 1000 else f"{figure:.2g}", "bold red" if figure > limit else "")
