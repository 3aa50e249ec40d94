"""The report of checks: one self-contained page."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from brdf.checks import CHECKS, Result

from ..checking import Checked, counted, kind
from ..figures import comparison, figure, limit
from ..files import replacing
from .page import ENVIRONMENT, minus
from .plots import Plot
from .portrait import charts

#: For each kind of outcome its symbol and a word for a small cell.
SHOWN = {
    "passed": ("✓", "ok"),
    "not asked": ("·", "n/a"),
    "declared": ("≈", "declared"),
    "failed": ("✗", "failed"),
    "undue": ("!", "no fault"),
}
#: The banner names so many unexpected outcomes.
MOST = 5
#: What a case says elsewhere on the page.
ELSEWHERE = ("command", "figure", "found", "parameters")


@dataclass(frozen=True)
class Line:
    """One check as the page shows it."""

    check: str
    kind: str
    symbol: str
    word: str
    outcome: str
    figure: str
    limit: str
    comparison: str
    what: str
    reason: str
    found: str
    case: tuple[tuple[str, str], ...]
    command: str


@dataclass(frozen=True)
class Entry:
    """One BSDF: its checks by name, and its plots."""

    name: str
    anchor: str
    lines: dict[str, Line]
    plots: list[Plot]

    @property
    def failures(self) -> list[Line]:
        return [line for line in self.lines.values() if line.kind in ("failed", "undue", "declared")]

    @property
    def unexpected(self) -> bool:
        return any(line.kind in ("failed", "undue") for line in self.lines.values())


def write(checked: Checked, path: str | os.PathLike[str], about: Mapping[str, Any]) -> None:
    """Write the report to `path`, one HTML file that needs no other.

    Parameters
    ----------
    about : dict
        ``command``, ``seed`` and ``versions``.

    Raises
    ------
    DataError
        The folder is missing or cannot be written.
    """
    text = html(checked, about)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def html(checked: Checked, about: Mapping[str, Any]) -> str:
    """The whole report."""
    entries = [
        Entry(
            name,
            f"bsdf-{number}",
            {check: line(result) for check, result in results.items()},
            charts(checked.portraits[name], name) if name in checked.portraits else [],
        )
        for number, (name, results) in enumerate(checked.results.items())
    ]
    names = [check for check in CHECKS if any(check in entry.lines for entry in entries)]
    count = checked.count()
    return ENVIRONMENT.get_template("checks.html").render(
        title=title(checked),
        checked=checked,
        entries=entries,
        checks=names,
        questions={name: CHECKS[name] for name in names},
        heading=lambda name: name.replace("_", " "),
        count=count,
        unexpected=count["failed"] + count["undue"],
        verdict=verdict(checked),
        duration=duration(checked.seconds),
        command=about.get("command", ""),
        seed=about.get("seed", 0),
        versions=about.get("versions", {}),
    )


def title(checked: Checked) -> str:
    """What was checked, in a few words."""
    models = list(dict.fromkeys(asked.owner for asked in checked.asked))
    what = "model" if all(asked.described for asked in checked.asked) else "BSDF"
    return ", ".join(models) if len(models) <= 3 else counted(len(models), what)


def verdict(checked: Checked) -> str:
    """One sentence for the banner."""
    unexpected = checked.unexpected()
    said = "Everything is as declared."
    if unexpected:
        names = [f"{result.check.replace('_', ' ')} of {name}" for name, result in unexpected]
        more = f", and {len(names) - MOST} more" if len(names) > MOST else ""
        said = f"Not as declared: {', '.join(names[:MOST])}{more}."
    if not checked.complete:
        said = f"{checked.interruption()} {said}"
    return said


def line(result: Result) -> Line:
    """A result as text."""
    which = kind(result)
    case = dict(result.case)
    parameters = case.get("parameters")
    rows = [(name, plain(value)) for name, value in case.items() if name not in ELSEWHERE and value is not None]
    if isinstance(parameters, Mapping):
        rows += [(str(name), plain(value)) for name, value in parameters.items()]
    return Line(
        check=result.check,
        kind=which.replace(" ", "-"),
        symbol=SHOWN[which][0],
        word=SHOWN[which][1],
        outcome="does not arise" if which == "not asked" else result.outcome,
        figure=minus(figure(result)),
        limit=minus(limit(result)),
        comparison=minus(comparison(result)) if result.figure is not None else "",
        what=str(case.get("figure") or result.reason),
        reason=sentence(result.reason),
        found=str(case.get("found") or ""),
        case=tuple(rows),
        command=str(case.get("command") or ""),
    )


def sentence(text: str) -> str:
    """With a capital and a full stop, if it begins with a word."""
    first = text.partition(" ")[0]
    text = text[:1].upper() + text[1:] if len(first) > 1 and first.isalpha() else text
    return text if not text or text.endswith((".", "!", "?")) else f"{text}."


def plain(value: Any) -> str:
    """With six digits."""
    if isinstance(value, bool | str):
        return str(value)
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {plain(v)}" for key, v in value.items())
    if isinstance(value, list | tuple | np.ndarray):
        return ", ".join(plain(v) for v in value)
    return minus(f"{value:.6g}") if isinstance(value, int | float | np.number) else str(value)


def duration(seconds: float) -> str:
    """``12.3 s``, ``4 min 5 s``."""
    if seconds < 60:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(math.floor(seconds + 0.5), 60)
    return f"{minutes} min {rest} s"
