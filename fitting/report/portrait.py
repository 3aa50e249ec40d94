"""The plots of a BSDF that was checked: lobe, albedo and reciprocity, as SVG for a page or as one PNG."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from ..files import replacing
from ..portrait import Array, Portrait
from .plots import DASHES, FAINT, INK, SERIES, STYLE, Key, Plot, dashes, decades, degree, draw, power_of_ten

#: The most that an albedo axis shows on a linear scale.
TALLEST = 3.0
#: Decades of the map of reciprocity: from rounding to altogether different.
DECADES = (-7, 0)
#: Colour and dash of the sum of all lobes.
SUM = (6, "6 3")
#: Where the axes lie in an SVG: left, bottom, width, height.
CURVE, MAP = (0.12, 0.14, 0.84, 0.81), (0.2, 0.14, 0.6, 0.81)
#: Height of an SVG whose width is 400, and size of a PNG [inches] and its resolution [pixels / inch].
HEIGHT, PICTURE, DPI = 300, (14.5, 4.6), 100


def charts(portrait: Portrait, name: str) -> list[Plot]:
    """The three plots for a page; the map is left out where nothing can be exchanged."""
    plots = [
        Plot(
            draw(f"lobe {name}", partial(draw_lobes, portrait), (0, 0, 1, 1), HEIGHT),
            f"Polar plot of the lobes of {name}. {peaks(portrait)}",
            lobe_keys(portrait),
            lobe_note(portrait),
        ),
        Plot(
            draw(f"albedo {name}", partial(draw_albedo, portrait), CURVE, HEIGHT),
            f"Albedo of {name} against the angle of incidence. {brightest(portrait)}",
            albedo_keys(portrait),
            "Fraction of the light that leaves again, of the channel that reflects most. More than 1 is not physical.",
        ),
    ]
    if portrait.difference is not None:
        plots.append(
            Plot(
                draw(f"reciprocity {name}", partial(draw_map, portrait.theta, portrait.difference), MAP, HEIGHT),
                f"Map of the reciprocity of {name}. {worst(portrait)}",
                note="|f(wi, wo) − f(wo, wi)| over the larger, the worst over the azimuth between the two directions. "
                "Dark is rounding; yellow is not reciprocal.",
            )
        )
    return plots


def write_png(portrait: Portrait, name: str, path: str | os.PathLike[str]) -> None:
    """The three plots side by side in one picture.

    Raises
    ------
    DataError
        The folder is missing or cannot be written.
    """
    parts: list[tuple[Callable[[Axes], None], str, tuple[Key, ...]]] = [
        (partial(draw_lobes, portrait), "lobes in the plane of incidence", lobe_keys(portrait)),
        (partial(draw_albedo, portrait), "albedo", albedo_keys(portrait)),
    ]
    if portrait.difference is not None:
        drawing = partial(draw_map, portrait.theta, portrait.difference)
        parts.append((drawing, "|f(wi, wo) − f(wo, wi)| / the larger", ()))
    with matplotlib.rc_context(STYLE), replacing(path) as temporary:
        figure = Figure(figsize=PICTURE, dpi=DPI, layout="constrained")
        figure.suptitle(name, parse_math=False, fontsize=14)
        row = figure.subplots(1, len(parts), width_ratios=(1.5, 1, 1)[: len(parts)])
        for axes, (drawing, title, keys) in zip(row, parts, strict=True):
            axes.tick_params(length=0)
            axes.set_axisbelow(True)
            drawing(axes)
            axes.set_title(title, fontsize=12)
            if keys:
                lines = [axes.plot([], [], color=SERIES[k.colour], linestyle=dashes(k.dash))[0] for k in keys]
                labels = [k.label for k in keys]
                axes.legend(
                    lines,
                    labels,
                    loc="upper center",
                    bbox_to_anchor=(0.5, -0.12),
                    ncols=2 if len(keys) > 3 else 3,
                    frameon=False,
                )
        figure.savefig(temporary, format="png")


def draw_lobes(portrait: Portrait, axes: Axes) -> None:
    """Each lobe as a curve around the point it leaves, scaled to its own maximum, and ideal ones as rays."""
    below = portrait.outgoing.max() > 0.75 * np.pi
    reach = np.pi if below else np.pi / 2
    axes.set_axis_off()
    axes.set_aspect("equal")
    arc = np.linspace(-reach, reach, 361)
    for radius in (0.25, 0.5, 0.75, 1.0):
        axes.plot(radius * np.sin(arc), radius * np.cos(arc), color=FAINT, linewidth=0.6, alpha=0.5)
    for degrees in range(-150, 181, 30) if below else range(-90, 91, 30):
        sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
        axes.plot([0, sine], [0, cosine], color=FAINT, linewidth=0.6, alpha=0.5)
        axes.text(1.22 * sine, 1.17 * cosine, degree(degrees), ha="center", va="center", fontsize=10)
    axes.plot([-1.05, 1.05], [0, 0], color=INK, linewidth=1.5)
    for i, (angle, f) in enumerate(zip(portrait.incident, portrait.f, strict=True)):
        colour = SERIES[i]
        sine, cosine = np.sin(angle), np.cos(angle)
        radius = f / f.max() if f.max() > 0 else f
        axes.plot(radius * np.sin(portrait.outgoing), radius * np.cos(portrait.outgoing), color=colour)
        axes.plot([sine, 1.07 * sine], [cosine, 1.07 * cosine], color=colour, linewidth=3)
        axes.annotate(
            "",
            (-0.86 * sine, 0.86 * cosine),
            (-1.1 * sine, 1.1 * cosine),
            arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.5, "shrinkA": 0, "shrinkB": 0},
        )
    for ray in portrait.rays:
        colour = SERIES[int(np.abs(portrait.incident - ray.incident).argmin())]
        x, y = ray.weight * np.sin(ray.angle), ray.weight * np.cos(ray.angle)
        axes.plot([0, x], [0, y], color=colour, marker="o", markersize=5, markevery=[1])
    axes.set_xlim(-1.32, 1.32)
    axes.set_ylim(-1.27 if below else -0.06, 1.27)


def draw_albedo(portrait: Portrait, axes: Axes) -> None:
    """Directional albedo of each lobe and of their sum, and the limit 1."""
    degrees = np.degrees(portrait.angles)
    curves = shown(portrait)
    every = np.concatenate([curve for _, curve in curves])
    finite = every[np.isfinite(every)]
    top = max(1.0, float(finite.max(initial=0.0)))
    if top > TALLEST and (finite > 0).any():
        axes.set_yscale("log")
        axes.set_ylim(max(float(finite[finite > 0].min()) / 1.5, top * 1e-5), top * 2)
        decades(axes)
    else:
        axes.set_ylim(0, 1.08 * top)
    axes.axhline(1, color=INK, linewidth=1.2, linestyle=(0, (2, 2)))
    axes.text(1, 1, "1: all of it", va="bottom", fontsize=9)
    for key, curve in curves:
        axes.plot(degrees, curve, color=SERIES[key.colour], linestyle=dashes(key.dash))
    axes.set_xlim(0, 90)
    axes.set_xticks(range(0, 91, 15), [degree(d) for d in range(0, 91, 15)])
    axes.set_xlabel("angle from the normal")
    axes.set_ylabel("albedo")


def draw_map(theta: Array, difference: Array, axes: Axes) -> None:
    """The logarithm of the relative difference over the two angles from the normal."""
    low, high = DECADES
    with np.errstate(divide="ignore"):
        logarithm = np.clip(np.log10(np.nan_to_num(difference, nan=1.0, posinf=1.0)), low, high)
    axes.grid(False)
    image = axes.imshow(
        logarithm.T, cmap="viridis", vmin=low, vmax=high, origin="lower", extent=(0, 90, 0, 90), interpolation="nearest"
    )
    marks = range(0, 91, 30)
    axes.set_xticks(marks, [degree(d) for d in marks])
    axes.set_yticks(marks, [degree(d) for d in marks])
    axes.set_xlabel("wi from the normal")
    axes.set_ylabel("wo from the normal")
    bar = axes.figure.colorbar(image, cax=axes.inset_axes((1.04, 0, 0.05, 1)))
    bar.set_ticks([low, low // 2, high])
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: "1" if v == 0 else power_of_ten(10.0**v)))
    bar.ax.tick_params(length=0)
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]  (typed as if it were a list)


def lobe_keys(portrait: Portrait) -> tuple[Key, ...]:
    """One for each angle of incidence."""
    return tuple(Key(i, "", f"light from {degrees:.0f}°") for i, degrees in enumerate(np.degrees(portrait.incident)))


def lobe_note(portrait: Portrait) -> str:
    """How to read the plot of the lobes."""
    said = []
    if portrait.f.any():
        said.append("Each lobe is scaled to its own maximum.")
    if portrait.rays:
        said.append("A line that ends in a dot is an ideal lobe, as long as the fraction of the light that goes there.")
    said.append("An arrow is the light that arrives, the thick mark its mirror direction.")
    return " ".join(said)


def shown(portrait: Portrait) -> list[tuple[Key, Array]]:
    """The curves of albedo: each lobe, and the sum if there are several."""
    count = len(SERIES)
    curves = [
        (Key(i % count, DASHES[i // count % len(DASHES)], f"lobe {name}"), curve)
        for i, (name, curve) in enumerate(portrait.albedo.items())
    ]
    return [*curves, (Key(*SUM, "all lobes"), portrait.total)] if len(curves) > 1 else curves


def albedo_keys(portrait: Portrait) -> tuple[Key, ...]:
    """One for each curve."""
    return tuple(key for key, _ in shown(portrait))


def peaks(portrait: Portrait) -> str:
    """What the lobes do, in words."""
    smooth = [
        f"{angle:.0f}°: {f.max():.3g} at {np.degrees(portrait.outgoing[f.argmax()]):.0f}°"
        for angle, f in zip(np.degrees(portrait.incident), portrait.f, strict=True)
        if f.max() > 0
    ]
    ideal = [
        f"{np.degrees(ray.incident):.0f}°: {ray.weight:.3g} of it to {np.degrees(ray.angle):.0f}°"
        for ray in portrait.rays
    ]
    said = [f"Largest value [1/sr] for light from {'; '.join(smooth)}."] if smooth else []
    return " ".join(said + ([f"Ideal, for light from {'; '.join(ideal)}."] if ideal else []))


def brightest(portrait: Portrait) -> str:
    """The largest albedo, in words."""
    if not np.isfinite(portrait.total).any():
        return "It is not finite."
    at = int(np.nanargmax(portrait.total))
    return f"The largest is {portrait.total[at]:.3g}, at {np.degrees(portrait.angles[at]):.0f}°."


def worst(portrait: Portrait) -> str:
    """The largest difference, in words."""
    assert portrait.difference is not None
    i, o = np.unravel_index(np.argmax(portrait.difference), portrait.difference.shape)
    ti, to = (np.degrees(portrait.theta[k]) for k in (i, o))
    return f"The largest difference is {portrait.difference.max():.2g}, at {ti:.0f}° and {to:.0f}°."
