"""``brdf check --hard``: value and derivatives at hard points, in roundings."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from brdf.checks.result import plain
from brdf.hard import Verdict
from brdf.hard.criterion import PRECISIONS

from ..checking import counted
from ..hard import ORACLES, Asked, Hard, run, strangers_terms
from .output import WIDE, print_json, progress_bar

INTERRUPTED = 130
PEER_LEGEND = (
    "C in float32: of Mitsuba's function, then of ours in its place, at the points whose roughness Mitsuba accepts."
)
SAMPLING_LEGEND = (
    "Facets drawn in float32. on normal: share that is the surface normal itself. distance: of the distribution of "
    "their slopes from the exact one. pdf: relative difference between the density that comes with a sample and that "
    "computed for it, of all but 1 % of the samples; of facets, and of reflected directions at 45 and 89.4 degrees."
)
LEGEND = (
    "C: error in roundings, in either precision, beside what is allowed: |f - f*| <= C eps (|f*| + sum |x df/dx|), "
    "and of a derivative in p with |f*/p| added. ill: share of the values and of the derivatives where the problem "
    "itself permits no answer in the coarser precision, or a derivative jumps; they need only be finite. A formula is "
    "called by its model, then by the choices that are not the default, or by the part of the model that it is."
)


def check_hard(asked: Sequence[Asked], peers: bool, as_json: bool, line: str) -> int:
    """Judge, and print a table or JSON; the exit code is 1 if anything of ours is beyond its limit."""
    from plugins.hard.peers import PEERS, compare
    from plugins.hard.sampling import hard_sampling

    pairs, drawn = [], []
    with progress_bar() as bar:
        task = bar.add_task("check", total=len(asked) + (len(PEERS) + 1 if peers else 0))

        def tell(done: int, name: str, part: float) -> None:
            bar.update(task, completed=done + part, description=name)

        found = run(asked, tell)
        try:
            if peers and found.complete:
                for pair in compare():
                    pairs.append(pair)
                    tell(len(asked) + len(pairs), pair.theirs.name, 0)
                drawn = hard_sampling()
        except KeyboardInterrupt:
            found.complete = False
    if as_json:
        if found.complete:
            about = {"command": line, "models": found.to_json()}
            if peers:
                about["peers"] = [{"ours": plain(asdict(p.ours)), "theirs": plain(asdict(p.theirs))} for p in pairs]
                about["sampling"] = [plain(row._asdict()) for row in drawn]
            print_json(about)
    else:
        console = Console(width=None if sys.stdout.isatty() else WIDE, highlight=False)
        if asked:
            show(found, console)
        if pairs:
            console.print(peer_table(pairs))
            console.print(PEER_LEGEND, soft_wrap=True)
        if drawn:
            console.print(sampling_table(drawn))
            console.print(SAMPLING_LEGEND, soft_wrap=True)
        if not found.complete:
            console.print(f"Interrupted at {len(found.verdicts)} of {len(found.asked)} formulas.")
    return INTERRUPTED if not found.complete else 1 if found.failed() or found.errors else 0


def show(found: Hard, console: Console) -> None:
    """A line for each formula, then what is wrong."""
    console.print(table(found))
    console.print(LEGEND, soft_wrap=True)
    others = {a.oracle for a in found.asked} - {"table"}
    for oracle in sorted(others):
        names = ", ".join(a.formula.name for a in found.asked if a.oracle == oracle)
        console.print(f"Judged by {ORACLES[oracle]}: {names}.", soft_wrap=True)
    if others:
        console.print(strangers_terms(), soft_wrap=True)
    for message in found.errors.values():
        console.print(Text(message, "bold red"), soft_wrap=True)
    for verdict in found.failed():
        console.print(Text(verdict.sentence(), "bold red"), soft_wrap=True)
    points = sum(v.points for per in found.verdicts.values() for v in per.values())
    bad = len({v.name for v in found.failed()}) or "none"
    formulas = counted(len(found.verdicts), "formula")
    console.print(f"{formulas} at {points} points, in both precisions: {bad} beyond the limits.", soft_wrap=True)


def table(found: Hard) -> Table:
    """Value and gradient C in both precisions, beside what is allowed."""
    heads = [
        "value\nf32",
        "C\nf64",
        "\nof",
        "grad.\nf32",
        "C\nf64",
        "\nof",
        "not\nfinite",
        "recip-\nrocal",
        "ill\nvalue",
        "ill\ngrad.",
    ]
    made = narrow_table("formula", heads)
    for name, verdicts in found.verdicts.items():
        per = [verdicts.get(p) for p in PRECISIONS]
        some = next(v for v in per if v is not None)
        given = [v for v in per if v is not None]
        row: list[Any] = [cell(v, "value") for v in per] + [f"{some.limits[0]:g}"]
        row += [cell(v, "slope") for v in per] + [f"{some.limits[1]:g}"]
        count = sum(v.not_finite for v in given)
        same = {None: "", True: "yes", False: "NO"}[some.reciprocal and all(v.reciprocal for v in given)]
        row += [Text(str(count), "bold red" if count else ""), same]
        row += [f"{100 * (ill + some.kinks / some.points):.1f}%" for ill in (some.ill, some.slope_ill)]
        made.add_row(Text(name, "" if all(v.passed for v in given) else "bold red"), *row)
    return made


def narrow_table(first: str, heads: Sequence[str]) -> Table:
    """Figures in columns that stay whole; the names before them are folded where there is no room."""
    made = Table(Column(first, overflow="fold"), box=None, padding=(0, 1, 0, 0))
    for head in heads:
        made.add_column(head, justify="right", no_wrap=True)
    return made


def cell(verdict: Verdict | None, what: str) -> Text:
    """A figure, red beyond its limit."""
    if verdict is None:
        return Text("")
    figure, limit = getattr(verdict, what), verdict.limits[what == "slope"]
    return Text(f"{figure:.2f}" if figure < 1000 else f"{figure:.2g}", "bold red" if figure > limit else "")


def peer_table(pairs: Sequence[Any]) -> Table:
    """Mitsuba's beside ours."""
    heads = ["value C\ntheirs", "\nours", "gradient C\ntheirs", "\nours", "not finite\ntheirs", "\nours"]
    made = narrow_table("Mitsuba's", heads)
    for pair in pairs:
        both = (pair.theirs, pair.ours)
        row = [f"{getattr(v, what):.3g}" for what in ("value", "slope") for v in both]
        made.add_row(pair.theirs.name, *row, *(str(v.not_finite) for v in both))
    return made


def sampling_table(rows: Sequence[Any]) -> Table:
    """One way of drawing facets a line."""
    heads = ["facets", "distribution", "alpha", "on normal", "distance", "facet pdf", "pdf at 45°", "pdf at 89.4°"]
    made = Table(*heads, box=None, padding=(0, 2, 0, 0))
    for column in made.columns[2:]:
        column.justify = "right"
    for row in rows:
        made.add_row(*(x if isinstance(x, str) else f"{x:.2g}" for x in row))
    return made
