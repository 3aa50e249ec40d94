"""The line plots of a report, as SVG that takes its colours from the page, so that it follows light and dark.

No text of the user's enters a plot: legends are the page's.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from ..solution import Array, Estimate, Lobes, Step
from .pictures import LUMINANCE

#: The light page's colours. In an SVG the page's own take their place, by name, so that it follows light and dark.
INK, FAINT = "#1b1f27", "#8a92a0"
SERIES = ("#0b5cad", "#c2410c", "#0f766e", "#7c3aed", "#946200", "#be185d", "#475569", "#4d7c0f")
DASHES = ("", "6 3", "2 3")
#: Size of a plot in its own units (a text is 11 high), and where the axes lie in it: left, bottom, width, height.
WIDTH, HEIGHT = 400, 235
FRAME = (0.14, 0.175, 0.83, 0.75)
#: Decades below the peak that a lobe plot shows.
LOBE_DECADES = 5
#: Span above which ratios are drawn on a logarithmic axis.
WIDE_RATIO = 2.0

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.size": 11,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": FAINT,
    "grid.alpha": 0.35,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.8,
    "lines.scale_dashes": False,
    "text.color": INK,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
}


@dataclass(frozen=True)
class Key:
    """A line of the legend: which colour, which dash pattern, what it is."""

    colour: int
    dash: str
    label: str


@dataclass(frozen=True)
class Plot:
    """An SVG element, what it shows (for those who cannot see it), its legend, and a note on how to read it."""

    svg: str
    alt: str
    keys: tuple[Key, ...] = ()
    note: str = ""


def draw(
    name: str,
    drawing: Callable[[Axes], None],
    frame: tuple[float, float, float, float] = FRAME,
    height: int = HEIGHT,
) -> str:
    """SVG of one pair of axes; `name` keeps its internal ids apart from those of other plots."""
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": name}):
        figure = Figure(figsize=(WIDTH / 72, height / 72), dpi=72)
        axes = figure.add_axes(frame)
        axes.tick_params(length=0)
        axes.set_axisbelow(True)
        drawing(axes)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.S)
    svg = re.sub(r' (?:width|height)="[\d.]+pt"', "", svg, count=2)  # as wide as the page lets it
    svg = re.sub(r' id="[A-Za-z0-9.]+_\d+"', "", svg)  # figure_1, axes_1, ...: not unique on a page
    svg = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font-size: \1px", svg)  # the page's own font
    svg = re.sub(r"font-family: [^;\"]*;? ?", "", svg)
    svg = svg.replace(INK, "var(--ink)").replace(FAINT, "var(--faint)")
    for i, colour in enumerate(SERIES):
        svg = svg.replace(colour, f"var(--series-{i})")
    return svg.replace("<svg ", '<svg aria-hidden="true" focusable="false" ', 1)


def convergence(history: Sequence[Step]) -> Plot:
    """Loss against iteration."""
    x = iterations(history)
    loss = np.array([step.loss for step in history])
    stages = stages_of(history)
    logarithmic = bool((loss > 0).any())
    low = loss <= 0

    def drawing(axes: Axes) -> None:
        floor = loss[loss > 0].min() / 3 if logarithmic else 0.0
        if logarithmic:
            axes.set_yscale("log")
        for number, (first, last, _) in enumerate(stages):
            part = slice(first, last)
            shown = np.where(low[part], np.nan, loss[part]) if logarithmic else loss[part]
            axes.plot(x[part], shown, color=SERIES[0], marker="o", markersize=3.5)
            if number:
                axes.axvline((x[first - 1] + x[first]) / 2, color=FAINT, linewidth=1, linestyle=(0, (2, 2)))
            if len(stages) > 1:
                axes.annotate(
                    str(number + 1),
                    (x[first], 1),
                    (0, 3),
                    xycoords=("data", "axes fraction"),
                    textcoords="offset points",
                )
        if logarithmic and low.any():
            axes.plot(x[low], np.full(low.sum(), floor), "v", color=SERIES[1], markersize=5, fillstyle="none")
        if logarithmic:
            decades(axes)
        axes.set_xlabel("iteration")
        axes.set_ylabel("loss")
        whole_numbers(axes, x)

    note = "Weighted mean square residual" + (", on a logarithmic scale." if logarithmic else ".")
    if len(stages) > 1:
        names = "; ".join(f"{number} {name}" for number, (_, _, name) in enumerate(stages, 1))
        note += f" Stages: {names}. Samples and weights may change from one to the next."
    if logarithmic and low.any():
        note += " Triangles: not positive. The loss is a product of two independent halves and can fall just below 0."
    alt = f"Loss against iteration, from {loss[0]:.3g} to {loss[-1]:.3g} in {len(history)} steps."
    return Plot(draw("convergence", drawing), alt, note=note)


def paths(history: Sequence[Step], parameters: dict[str, Estimate]) -> Plot | None:
    """Parameters relative to their final value; None where no final value is a number other than 0."""
    x = iterations(history)
    lines: dict[str, Array] = {}
    for name, estimate in parameters.items():
        final = float(np.mean(estimate.value))
        if np.isfinite(final) and final != 0 and all(name in step.values for step in history):
            lines[name] = np.array([float(np.mean(step.values[name])) / final for step in history])
    if not lines:
        return None
    keys = tuple(Key(i % len(SERIES), DASHES[i // len(SERIES) % len(DASHES)], name) for i, name in enumerate(lines))
    every = np.concatenate(list(lines.values()))
    every = every[np.isfinite(every)]
    logarithmic = every.size > 0 and every.min() > 0 and every.max() / every.min() > WIDE_RATIO

    def drawing(axes: Axes) -> None:
        if logarithmic:
            axes.set_yscale("log")
        else:
            axes.ticklabel_format(useOffset=False)
        axes.axhline(1, color=FAINT, linewidth=1)
        for key, line in zip(keys, lines.values(), strict=True):
            axes.plot(x, line, color=SERIES[key.colour], linestyle=dashes(key.dash), marker="o", markersize=2.5)
        if logarithmic:
            decades(axes)
        axes.set_xlabel("iteration")
        axes.set_ylabel("value / final value")
        whole_numbers(axes, x)

    note = "Each parameter divided by its final value" + (", on a logarithmic scale." if logarithmic else ".")
    if any(parameters[name].kind == "colour" for name in lines):
        note += " Of a colour, the mean of its channels."
    left_out = [name for name in parameters if name not in lines]
    if left_out:
        note += f" Not drawn, their final value being 0 or not recorded: {', '.join(left_out)}."
    starts = ", ".join(f"{name} {line[0]:.3g}" for name, line in lines.items())
    return Plot(draw("paths", drawing), f"Value over final value at the first iteration: {starts}.", keys, note)


def lobe_shapes(lobes: Lobes, name: str) -> Plot:
    """Each lobe as a curve around the point it leaves, scaled to its own maximum."""
    f = lobe_luminance(lobes)
    peaks = f.max(axis=1)

    def drawing(axes: Axes) -> None:
        axes.set_axis_off()
        axes.set_aspect("equal")
        arc = np.linspace(-np.pi / 2, np.pi / 2, 181)
        for radius in (0.25, 0.5, 0.75, 1.0):
            axes.plot(radius * np.sin(arc), radius * np.cos(arc), color=FAINT, linewidth=0.6, alpha=0.5)
        for degrees in range(-90, 91, 30):
            sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
            axes.plot([0, sine], [0, cosine], color=FAINT, linewidth=0.6, alpha=0.5)
            axes.text(1.22 * sine, 1.17 * cosine, degree(degrees), ha="center", va="center", fontsize=10)
        axes.plot([-1.05, 1.05], [0, 0], color=INK, linewidth=1.5)
        for i, angle in enumerate(lobes.incident):
            colour = SERIES[i % len(SERIES)]
            sine, cosine = np.sin(angle), np.cos(angle)
            radius = f[i] / peaks[i] if peaks[i] > 0 else f[i]
            axes.plot(radius * np.sin(lobes.outgoing), radius * np.cos(lobes.outgoing), color=colour)
            axes.plot([sine, 1.07 * sine], [cosine, 1.07 * cosine], color=colour, linewidth=3)
            axes.annotate(
                "",
                (-0.86 * sine, 0.86 * cosine),
                (-1.1 * sine, 1.1 * cosine),
                arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.5, "shrinkA": 0, "shrinkB": 0},
            )
        axes.set_xlim(-1.32, 1.32)
        axes.set_ylim(-0.06, 1.24)

    note = (
        "Shape: each lobe scaled to its own maximum. "
        "An arrow is the light that arrives, the thick mark its mirror direction."
    )
    alt = f"Polar plot of the lobes of {name}. " + peak_sentence(lobes, f)
    return Plot(draw(f"shapes {name}", drawing, (0, 0, 1, 1)), alt, lobe_keys(lobes), note)


def lobe_values(lobes: Lobes, name: str) -> Plot:
    """The BRDF against the outgoing angle, on a logarithmic axis."""
    f = lobe_luminance(lobes)
    top = f.max()
    degrees = np.degrees(lobes.outgoing)

    def drawing(axes: Axes) -> None:
        if top > 0:
            axes.set_yscale("log")
            bottom = max(f[f > 0].min() / 1.5, top * 10.0**-LOBE_DECADES)
            axes.set_ylim(bottom, top * 2)
            decades(axes)
        for i, angle in enumerate(np.degrees(lobes.incident)):
            colour = SERIES[i % len(SERIES)]
            axes.axvline(angle, color=colour, linewidth=1, linestyle=(0, (3, 3)))
            axes.plot(degrees, np.where(f[i] > 0, f[i], np.nan), color=colour)
        axes.set_xlim(-90, 90)
        axes.set_xticks(range(-90, 91, 30), [degree(d) for d in range(-90, 91, 30)])
        axes.set_xlabel("angle of the light that leaves")
        axes.set_ylabel("f [1/sr]")

    note = "Size: luminance of the BRDF, without the cosine, on a logarithmic scale. Dashed: mirror directions."
    alt = f"BRDF of {name} against the outgoing angle. " + peak_sentence(lobes, f)
    return Plot(draw(f"values {name}", drawing), alt, lobe_keys(lobes), note)


def lobe_luminance(lobes: Lobes) -> Array:
    """Shape (k, n), finite."""
    return np.nan_to_num(lobes.f @ LUMINANCE, nan=0, posinf=0, neginf=0)


def lobe_keys(lobes: Lobes) -> tuple[Key, ...]:
    """One for each angle of incidence."""
    return tuple(
        Key(i % len(SERIES), "", f"light from {angle:.0f}°") for i, angle in enumerate(np.degrees(lobes.incident))
    )


def peak_sentence(lobes: Lobes, f: Array) -> str:
    """What the lobe plots show, in words."""
    peaks = [
        f"{np.degrees(angle):.0f}°: {row.max():.3g} at {np.degrees(lobes.outgoing[row.argmax()]):.0f}°"
        for angle, row in zip(lobes.incident, f, strict=True)
    ]
    return f"Largest value [1/sr] for light from {'; '.join(peaks)}."


def stages_of(history: Sequence[Step]) -> list[tuple[int, int, str]]:
    """First step, one past the last, and name of each stage."""
    starts = [i for i, step in enumerate(history) if i == 0 or step.stage != history[i - 1].stage]
    return [(first, last, history[first].stage) for first, last in pairwise([*starts, len(history)])]


def iterations(history: Sequence[Step]) -> Array:
    """The steps' own numbers; where those start over, their places."""
    numbers = np.array([step.iteration for step in history], dtype=np.float64)
    return numbers if (np.diff(numbers) > 0).all() else np.arange(len(history), dtype=np.float64)


def whole_numbers(axes: Axes, x: Array) -> None:
    """Marks of the iterations, with room for a single one."""
    axes.set_xlim(x[0] - 0.5, x[-1] + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True, min_n_ticks=1))


def decades(axes: Axes) -> None:
    """Marks of a logarithmic vertical axis: powers of ten, with others between them where those are few."""
    low, high = axes.get_ylim()
    between = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if high < 10 * low else (1.0, 2.0, 5.0) if high < 300 * low else (1.0,)
    written = (lambda v: f"{v:g}") if low > 1e-4 and high < 1e5 else power_of_ten
    axes.yaxis.set_major_locator(LogLocator(subs=between, numticks=8))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: written(v)))
    axes.yaxis.set_minor_locator(NullLocator())


def power_of_ten(v: float) -> str:
    """As 10⁻³, or 2·10⁻³."""
    exponent = int(np.floor(np.log10(v) + 1e-9))
    lead = v / 10.0**exponent
    digits = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{digits}" if abs(lead - 1) < 1e-6 else f"{lead:g}·10{digits}"


def degree(x: int) -> str:
    """As −30°."""
    return f"{x}°".replace("-", "−")


def dashes(pattern: str) -> str | tuple[float, tuple[float, ...]]:
    """The dashes of SVG as matplotlib writes them."""
    return (0, tuple(float(x) for x in pattern.split())) if pattern else "solid"
