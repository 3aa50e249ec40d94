"""Make the pictures of the README: ``.venv/bin/python docs/pictures.py``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import fitting  # before mitsuba: it chooses the libLLVM  # isort: skip
import matplotlib
import mitsuba as mi
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

import plugins
from fitting import examples
from fitting.images import to_srgb
from fitting.report.pictures import LUMINANCE, white_of
from fitting.solution import Lobes, View

HERE = Path(__file__).parent
NOTEBOOKS = HERE.parent / "notebooks"

#: A dark card with light writing stands on a light page as well as on a dark one.
PAPER, INK, SOFT, RULE = "#0d1117", "#e6edf3", "#9aa5b4", "#3a434f"
SERIES = ("#6cb6ff", "#ff9e64", "#4fd1c5")
#: Inches, and dots an inch: some twice the width that a README is shown at.
WIDTH, HEIGHT, DOTS = 9.0, 2.6, 160
#: The colours of the error, and the error where they end: relative to the picture, but to no less than this fraction of
#: white.
DARKER_TO_BRIGHTER = ["#8fd0ff", "#2f6f9f", "#1b222b", "#a5502e", "#ffb58f"]
ERROR, FLOOR = 0.05, 0.05
STYLE: dict[Any, Any] = {"font.family": "DejaVu Sans", "font.size": 10.5, "text.color": INK}


def example() -> Figure:
    """The built-in sphere: target, fitted render, error, lobes."""
    solution = fitting.fit(
        examples.FOLDER / "sphere.xml",
        {"camera": examples.FOLDER / "sphere.exr"},
        ["ball.m", "ball.eta", "ball.diffuse_reflectance"],
    )
    (view,), white = solution.views, white_of(solution.views[0])
    figure = card()
    panel(figure, 0, "picture", to_srgb(view.target / white))
    panel(figure, 1, "fitted", to_srgb(view.render / white))
    panel(figure, 2, f"error, \N{PLUS-MINUS SIGN} {100 * ERROR:.0f} %", error_of(view, white))
    axes = figure.add_axes((0.71, 0.26, 0.27, 0.6))
    draw_lobes(axes, solution.lobes["ball"])
    heading(figure, 0.845, "reflected light")
    for name, y in (("m", 0.185), ("eta", 0.1)):
        e = solution.parameters[f"ball.{name}"]
        figure.text(0.79, y, name, ha="right", va="center", color=SOFT)
        text = f"{e.value[0]:.4f} \N{PLUS-MINUS SIGN} {(e.high[0] - e.low[0]) / 2:.4f}"
        figure.text(0.805, y, text, ha="left", va="center")
    return figure


def moon() -> Figure:
    """The model that the README writes, beside ideal diffuse reflection."""
    sys.path.insert(0, str(NOTEBOOKS))
    from lommelseeliger import LommelSeeliger

    plugins.register(LommelSeeliger)
    text = (NOTEBOOKS / "moon.xml").read_text()
    dust = mi.load_string(text)
    lines = [line for line in text.splitlines() if 'name="g"' not in line]
    text = "\n".join(lines).replace('"lommelseeliger"', '"lambertian"').replace('"albedo"', '"reflectance"')
    diffuse = mi.load_string(text)
    figure = card()
    for i, (scene, name) in enumerate(((diffuse, "lambertian"), (dust, "lommelseeliger"))):
        for sensor, phase in enumerate(("full", "quarter")):
            linear = np.array(mi.render(scene, sensor=sensor, spp=256))
            panel(figure, 2 * i + sensor, f"{name}, {phase}", to_srgb(0.9 * linear / linear.max()), 0.045)
    return figure


def card(height: float = HEIGHT) -> Figure:
    """An empty card with round corners."""
    figure = Figure(figsize=(WIDTH, height), dpi=DOTS)
    figure.patch.set_alpha(0)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, WIDTH), ylim=(0, height))
    axes.set_axis_off()
    inner = (0.15, 0.15), WIDTH - 0.3, height - 0.3
    axes.add_patch(FancyBboxPatch(*inner, boxstyle="round,pad=0.15", facecolor=PAPER, linewidth=0))
    return figure


def panel(figure: Figure, place: int, title: str, picture: npt.NDArray[Any], left: float = 0.012) -> None:
    """One picture under its title."""
    axes = figure.add_axes((left + 0.23 * place, 0.07, 0.22, 0.22 * WIDTH / HEIGHT))
    axes.set_axis_off()
    black = np.array(matplotlib.colors.to_rgb(PAPER))
    axes.imshow(1 - (1 - picture) * (1 - black), interpolation="bicubic" if picture.dtype == np.float32 else "nearest")
    heading(figure, left + 0.23 * place + 0.11, title)


def heading(figure: Figure, x: float, text: str, y: float = 0.9) -> None:
    """A title above a part of the card."""
    figure.text(x, y, text, ha="center", va="center", color=SOFT)


def error_of(view: View, white: float) -> npt.NDArray[np.float64]:
    """Colours of the relative error: blue where the render is darker, red where it is brighter."""
    target, render = view.target @ LUMINANCE, view.render @ LUMINANCE
    relative = (render - target) / np.maximum(target, FLOOR * white)
    scale = LinearSegmentedColormap.from_list("error", DARKER_TO_BRIGHTER)
    return np.where(view.used[..., None], scale(np.clip(0.5 + 0.5 * relative / ERROR, 0, 1))[..., :3], 0)


def draw_lobes(axes: Axes, lobes: Lobes) -> None:
    """The light reflected, ``f cos``, each lobe around where it leaves, scaled to its maximum; arrows are the light."""
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set_xlim(-1.3, 1.3)
    axes.set_ylim(-0.06, 1.28)
    f = lobes.f @ LUMINANCE * np.cos(lobes.outgoing)
    arc = np.linspace(-np.pi / 2, np.pi / 2, 181)
    for radius in (0.5, 1.0):
        axes.plot(radius * np.sin(arc), radius * np.cos(arc), color=RULE, linewidth=0.7)
    axes.plot([-1.15, 1.15], [0, 0], color=SOFT, linewidth=1.2)
    for colour, angle, values in zip(SERIES, lobes.incident, f / f.max(axis=1, keepdims=True), strict=True):
        x, y = values * np.sin(lobes.outgoing), values * np.cos(lobes.outgoing)
        axes.fill(x, y, color=colour, alpha=0.13, linewidth=0)
        axes.plot(x, y, color=colour, linewidth=1.5)
        along = np.array([-np.sin(angle), np.cos(angle)])
        arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.3, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", 0.8 * along, 1.05 * along, arrowprops=arrow)
        axes.text(*(1.18 * along), f"{np.degrees(angle):.0f}°", color=colour, ha="center", va="center", fontsize=9.5)


def main() -> None:
    """Write the pictures beside this file."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    mi.set_variant("llvm_ad_rgb")
    with matplotlib.rc_context(STYLE):
        for name, drawing in (("example", example), ("moon", moon)):
            drawing().savefig(HERE / f"{name}.png", metadata={"Software": None})
            print(HERE / f"{name}.png")


if __name__ == "__main__":
    main()
