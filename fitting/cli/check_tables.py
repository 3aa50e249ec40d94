"""What ``brdf check`` prints: tables of the outcomes, then each failure with the line that repeats it."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from rich.console import Console
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text

from brdf.checks import CHECKS, Result

from ..checking import Checked, kind
from ..figures import comparison, figure, limit
from .output import WIDE

#: For each kind of outcome its symbol, its word, and its colour.
SHOWN = {
    "passed": ("✓", "ok", "green"),
    "not asked": ("·", "", "dim"),
    "declared": ("≈", "declared", "yellow"),
    "failed": ("✗", "FAILED", "bold red"),
    "undue": ("!", "NO FAULT", "bold red"),
}
#: What the symbols mean.
LEGEND = "✓ passed   · the question does not arise   ≈ failed as declared   ✗ failed   ! declared to fail, and does not"
#: Headings for terminals that are too narrow for the names of the checks.
SHORT = {
    "reciprocity": "recip",
    "coupling": "coupl",
    "sampling": "sampl",
    "gradient": "grad",
    "gradient_effects": "eff",
    "gradient_raytree": "tree",
}
#: More BSDFs than this are shown in one table.
SEVERAL = 12
#: What a case says elsewhere.
ELSEWHERE = ("command", "figure", "found", "parameters")


def show(checked: Checked) -> None:
    """Print everything."""
    console = Console(width=None if sys.stdout.isatty() else WIDE, highlight=False)
    compact = len(checked.results) > SEVERAL or len({asked.owner for asked in checked.asked}) > 1
    if compact:
        console.print(overview(checked.results, console))
        say(console, LEGEND)
    else:
        for name, results in checked.results.items():
            say(console, Text(name, "bold"))
            console.print(single(results))
            console.print()
    unexpected = checked.unexpected()
    failures(console, "Failed as declared", checked.declared(), checked, brief=compact)
    failures(console, "Unexpected", unexpected, checked, brief=False)
    if not checked.complete:
        say(console, checked.interruption())
    say(console, checked.sentence())


def single(results: Mapping[str, Result]) -> Table:
    """All checks of one BSDF."""
    table = Table("check", "outcome", "figure", "limit", "the figure is", box=None, padding=(0, 2, 0, 0))
    for name, result in results.items():
        what = result.case.get("figure") or result.reason
        table.add_row(name, outcome(result), figure(result), limit(result), Text(str(what)))
    return table


def outcome(result: Result) -> Text:
    """Symbol and words."""
    which = kind(result)
    symbol, _, style = SHOWN[which]
    return Text(f"{symbol} {'does not arise' if which == 'not asked' else result.outcome}", style)


def overview(found: Mapping[str, Mapping[str, Result]], console: Console) -> Table:
    """A line for each BSDF, a column for each check; symbols alone where the words do not fit."""
    names = [check for check in CHECKS if any(check in results for results in found.values())]
    for words in (True, False):
        headings = [n.replace("_", "\n", 1) if words else SHORT.get(n, n.rpartition("_")[2]) for n in names]
        table = Table(Column(overflow="fold"), *headings, box=None, padding=(0, 1 + words, 0, 0))
        for name, results in found.items():
            cells = [cell(results[check], words) if check in results else Text() for check in names]
            table.add_row(Text(name), *cells)
        if Measurement.get(console, console.options.update(max_width=WIDE), table).maximum <= console.width:
            break
    return table


def cell(result: Result, words: bool) -> Text:
    """An outcome in a word, or in a symbol."""
    symbol, word, style = SHOWN[kind(result)]
    return Text(f"{symbol} {word}" if words else symbol, style)


def failures(console: Console, title: str, found: Sequence[tuple[str, Result]], checked: Checked, brief: bool) -> None:
    """Each failure with its reason and the line that repeats it; those of one model for one reason together."""
    if not found:
        return
    say(console, Text(f"{title}:", "bold"))
    model = {asked.name: asked.owner for asked in checked.asked}

    def alike(item: tuple[str, Result]) -> tuple[Any, ...]:
        name, result = item
        return list(model.values()).index(model[name]), list(CHECKS).index(result.check), result.reason

    for _, group in groupby(sorted(found, key=alike), alike):
        items = list(group)
        name, first = items[0]
        owner = name if len(items) == 1 else f"{model[name]}, {len(items)} variations"
        say(console, Text.assemble((f"{first.check} of {owner}", "bold"), f": {first.reason}"))
        for name, result in items:
            words = [name] if len(items) > 1 else []
            words += [comparison(result)] if result.figure is not None else []
            words += [str(result.case["found"])] if "found" in result.case and not brief else []
            if words:
                say(console, Text(f"  {': '.join(words)}"))
            if not brief:
                for line in case_lines(result.case, not result.expected):
                    say(console, Text(f"    {line}"))
            if "command" in result.case:
                say(console, Text(f"    {result.case['command']}", "cyan"))
    console.print()


def say(console: Console, text: Text | str) -> None:
    """A line that the terminal wraps, if anyone: it can be copied whole."""
    console.print(text, soft_wrap=True)


def case_lines(case: Mapping[str, Any], everything: bool) -> list[str]:
    """Where it was found: directions and the like, then, if it is to say everything, the parameters."""
    where = [f"{name} = {plain(value)}" for name, value in case.items() if name not in ELSEWHERE and value is not None]
    parameters = case.get("parameters") if everything else None
    values = [f"{name} = {plain(v)}" for name, v in parameters.items()] if isinstance(parameters, Mapping) else []
    return [line for line in ("; ".join(where), "; ".join(values)) if line]


def plain(value: Any) -> str:
    """With six digits."""
    if isinstance(value, bool | str):
        return str(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {plain(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple | np.ndarray):
        return "(" + ", ".join(plain(v) for v in value) + ")"
    return f"{value:.6g}" if isinstance(value, int | float | np.number) else str(value)
