"""What the report says, put into its templates."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jinja2
import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from ..images import from_srgb, to_srgb
from ..solution import Array, Estimate, Solution
from . import pictures, plots

#: Width and height of the largest picture [pixels]; larger ones are shown shrunk, so that the page stays light.
LARGEST_ON_PAGE, LARGEST_IN_FRAGMENT = 1024, 256
#: Pictures narrower than this are shown as squares, not blurred.
COARSE = 200
#: Above this, two components are called hard to tell apart.
STRONG_CORRELATION = 0.95
#: Luminance on which black and white are read equally well: (1.05 / (Y + .05)) = (Y + .05) / .05, by WCAG 2.
EVEN_CONTRAST = 0.179
#: Intervals wider than the estimate itself run out of their bar.
WIDEST_BAR = 1.0

ENVIRONMENT = jinja2.Environment(
    loader=jinja2.PackageLoader("fitting.report"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


@dataclass(frozen=True)
class Bar:
    """An interval on an axis from 0 to 100 with the estimate at 50; `left` and `right` say that it runs out of it."""

    low: float
    high: float
    left: bool
    right: bool


@dataclass(frozen=True)
class Line:
    """One number of the table as it is printed; `channel` is empty, R, G or B. No `bar`: not determined."""

    channel: str
    value: str
    sd: str
    interval: str
    start: str
    bar: Bar | None


@dataclass(frozen=True)
class Row:
    """One parameter of the table; swatches are CSS colours, empty for a number."""

    name: str
    estimate: Estimate
    lines: tuple[Line, ...]
    swatch: str
    start_swatch: str


def html(solution: Solution) -> str:
    """The whole report, one self-contained HTML page."""
    views, limit = pictures.show(solution.views, LARGEST_ON_PAGE)
    history, materials = solution.history, {*solution.lobes, *solution.checks}
    charts = [plots.convergence(history), plots.paths(history, solution.parameters)] if history else []
    lobes = {
        material: (plots.lobe_shapes(lobes, material), plots.lobe_values(lobes, material))
        for material, lobes in solution.lobes.items()
    }
    tables, bar_limit = parameter_tables(solution, materials)
    command = solution.settings.get("command")
    settings = {key.replace("_", " "): plain(value) for key, value in solution.settings.items() if key != "command"}
    return ENVIRONMENT.get_template("page.html").render(
        solution=solution,
        state=state(solution),
        tables=tables,
        bar_limit=percent(bar_limit),
        views=views,
        pixels=sum(view.pixels for view in views),
        error_limit=percent(limit),
        colour_bar=pictures.colour_bar(),
        charts=[chart for chart in charts if chart],
        lobes=lobes,
        correlation=correlation_table(solution),
        command=command if isinstance(command, str) or command is None else shlex.join(map(str, command)),
        settings=settings,
        percent=percent,
        white=lambda value: f"{value:.3g}",
        white_percentile=pictures.WHITE_PERCENTILE,
        coarse=COARSE,
        strong=STRONG_CORRELATION,
        floor=percent(pictures.ERROR_FLOOR),
    )


def fragment(solution: Solution) -> str:
    """Status, parameters, pictures and remarks, as a piece of HTML whose styles touch nothing else."""
    views, limit = pictures.show(solution.views, LARGEST_IN_FRAGMENT)
    tables, bar_limit = parameter_tables(solution, {*solution.lobes, *solution.checks})
    return ENVIRONMENT.get_template("fragment.html").render(
        solution=solution,
        state=state(solution),
        tables=tables,
        bar_limit=percent(bar_limit),
        views=views,
        error_limit=percent(limit),
        colour_bar=pictures.colour_bar(),
        percent=percent,
        coarse=COARSE,
    )


def state(solution: Solution) -> str:
    """One or two words for the badge."""
    if solution.interrupted:
        return "Interrupted"
    return "Converged" if solution.converged else "Not converged"


def parameter_tables(solution: Solution, materials: set[str]) -> tuple[dict[str, list[Row]], float]:
    """Rows by material, and half the width of all bars relative to the estimate."""
    reach = [bar_reach(estimate) for estimate in solution.parameters.values()]
    limit = min(pictures.round_up(max(reach, default=0.0)), WIDEST_BAR)
    tables: dict[str, list[Row]] = {}
    for full, estimate in solution.parameters.items():
        owner = max((m for m in materials if full.startswith(f"{m}.")), key=len, default=full.rpartition(".")[0])
        name = full[len(owner) + 1 :] if owner else full
        channels = ("",) if len(estimate.value) == 1 else ("R", "G", "B")
        lines = tuple(line(estimate, i, channel, limit) for i, channel in enumerate(channels))
        value, start = (swatch(c) if estimate.kind == "colour" else "" for c in (estimate.value, estimate.start))
        tables.setdefault(owner, []).append(Row(name, estimate, lines, value, start))
    return tables, limit


def bar_reach(estimate: Estimate) -> float:
    """Largest distance of an interval's end from its estimate, relative to that; only of what is determined."""
    ends = np.abs(np.stack([estimate.low, estimate.high]) - estimate.value)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = ends / np.abs(estimate.value)
    return float(np.max(relative, initial=0.0, where=np.isfinite(relative)))


def line(estimate: Estimate, i: int, channel: str, limit: float) -> Line:
    """The i-th number of a parameter, with as many digits as its standard deviation warrants."""
    value, sd, low, high, start = (
        float(x[i]) for x in (estimate.value, estimate.sd, estimate.low, estimate.high, estimate.start)
    )
    begun = f"{start:.4g}" if np.isfinite(start) else "–"
    if not np.isfinite([sd, low, high]).all():
        shown = f"{value:.4g}" if np.isfinite(value) else "–"
        return Line(channel, minus(shown), "not determined", "", minus(begun), None)
    digits = decimals(sd, value)
    shown, spread = minus(f"{value:.{digits}f}"), minus(sd_digits(sd, digits))
    interval = minus(f"{low:.{digits}f} to {high:.{digits}f}")
    return Line(channel, shown, spread, interval, minus(begun), bar_of(value, low, high, limit))


def bar_of(value: float, low: float, high: float, limit: float) -> Bar:
    """The bar of an interval; half its width is `limit` times the value."""
    unit = abs(value) * limit
    left, right = ((end - value) / unit if unit else np.sign(end - value) * np.inf for end in (low, high))
    ends = [50 + 50 * float(np.clip(np.nan_to_num(end), -1, 1)) for end in (left, right)]
    slack = 1 + 1e-9
    return Bar(ends[0], ends[1], left < -slack, right > slack)


def decimals(sd: float, value: float) -> int:
    """Places after the point that show two digits of `sd`, at most 8; without one, five digits of the value."""
    leading, digits = (sd, 2) if sd > 0 else (abs(value) or 1.0, 5)
    return int(np.clip(digits - 1 - np.floor(np.log10(leading)), 0, 8))


def sd_digits(sd: float, digits: int) -> str:
    """Fixed like the value, unless nothing would be left of it."""
    return f"{sd:.{digits}f}" if sd == 0 or sd >= 10.0**-digits else f"{sd:.1e}"


def minus(text: str) -> str:
    """A minus sign for the hyphen."""
    return text.replace("-", "−")


def swatch(rgb: Array) -> str:
    """CSS colour of a linear one; one brighter than white is scaled to its largest channel."""
    finite = np.nan_to_num(rgb, nan=0, posinf=1, neginf=0)
    return to_hex(to_srgb(finite / max(1.0, float(finite.max()))).tolist())


def correlation_table(solution: Solution) -> list[tuple[str, list[tuple[str, str, str]]]]:
    """For each component its name and, for each other one, figure, background and ink; empty for a single component."""
    if len(solution.components) < 2:
        return []
    return [
        (name, [correlation_cell(float(c)) for c in row])
        for name, row in zip(solution.components, solution.correlation, strict=True)
    ]


def correlation_cell(c: float) -> tuple[str, str, str]:
    """Figure, background, and black or white, whichever is told better from it."""
    if not np.isfinite(c):
        return "–", "", ""
    rgb = np.array(colormaps["RdBu_r"](0.5 + 0.5 * np.clip(c, -1, 1))[:3])
    ink = "#fff" if from_srgb(rgb) @ pictures.LUMINANCE < EVEN_CONTRAST else "#000"
    return minus(f"{c:.2f}"), to_hex(rgb.tolist()), ink


def percent(x: float) -> str:
    """With three digits at most, never in powers of ten."""
    if not np.isfinite(x):
        return "–"
    text = np.format_float_positional(100 * x, precision=3, fractional=False, trim="-")
    return minus(f"{text}\N{NO-BREAK SPACE}%")


def plain(value: Any) -> str:
    """A setting, readable."""
    if isinstance(value, str):
        return value
    if isinstance(value, Sequence) and all(isinstance(item, str) for item in value):
        return "\n".join(value)
    if isinstance(value, Mapping):
        return "\n".join(f"{key}: {plain(item)}" for key, item in value.items())
    return json.dumps(value, default=str, ensure_ascii=False)
