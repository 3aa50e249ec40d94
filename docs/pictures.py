"""Make the pictures of the README: ``python docs/pictures.py``, in the repository's folder."""

from __future__ import annotations

import sys
from pathlib import Path

import fitting  # before mitsuba: this chooses libLLVM

import matplotlib
import mitsuba as mi
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import plugins
from fitting import examples
from fitting.images import to_srgb
from fitting.report.pictures import LUMINANCE, white_of
from fitting.solution import Lobes, Solution, View

HERE = Path(__file__).parent
NOTEBOOKS = HERE.parent / "notebooks"
sys.path.insert(0, str(NOTEBOOKS))

#: Dark cards with light writing, which stand on a light page as well as on a dark one.
PAPER, INK, SOFT, RULE = "#0d1117", "#e6edf3", "#9aa5b4", "#3a434f"
SERIES = ("#6cb6ff", "#ff9e64", "#4fd1c5")
#: Inches, at 200 dots each: twice the width that a README is shown at.
WIDTH, DOTS = 9.0, 200
#: Relative error at which the colours end: five times the noise of the picture.
ERROR = 0.1
STYLE = {"font.family": "DejaVu Sans", "font.size": 9, "text.color": INK}


def example() -> Figure:
    """The built-in sphere: target, fitted render, error, lobes."""
    target = {"camera": examples.FOLDER / "sphere.exr"}
    parameters = ["ball.m", "ball.eta", "ball.diffuse_reflectance"]
    solution = fitting.fit(examples.FOLDER / "sphere.xml", target, parameters)
    view, lobes = solution.views[0], solution.lobes["ball"]
    figure = card(2.8)
    titles = ("Target, with noise", "Fitted", f"Error, \N{MINUS SIGN}{ERROR:.0%} to +{ERROR:.0%}".replace("%", " %"))
    white = white_of(view)
    shown = (to_srgb(view.target / white), to_srgb(view.render / white), error_of(view))
    for i, (title, picture) in enumerate(zip(titles, shown, strict=True)):
        panel(figure, (0.012 + 0.228 * i, 0.135, 0.22, 0.7), title, picture)
    axes = figure.add_axes((0.705, 0.155, 0.285, 0.66))
    draw_lobes(axes, lobes)
    figure.text(0.8475, 0.9, "The material", ha="center", color=SOFT)
    figure.text(0.8475, 0.055, found(solution, "ball.m", "ball.eta"), ha="center")
    return figure


def moon() -> Figure:
    """What the README's own model looks like, beside ideal diffuse reflection."""
    from lommelseeliger import LommelSeeliger

    plugins.register(LommelSeeliger)
    dust = mi.load_file(str(NOTEBOOKS / "moon.xml"))
    plain = (NOTEBOOKS / "moon.xml").read_text().replace('"lommelseeliger"', '"lambertian"').replace('"albedo"', '"reflectance"')
    diffuse = mi.load_string("\n".join(line for line in plain.splitlines() if 'name="g"' not in line))
    figure = card(2.8)
    shown = ((diffuse, 0, "lambertian, full"), (dust, 0, "lommelseeliger, full"), (dust, 1, "lommelseeliger, quarter"))
    for i, (scene, sensor, title) in enumerate(shown):
        picture = np.array(mi.render(scene, sensor=sensor, spp=1024))
        panel(figure, (0.17 + 0.228 * i, 0.06, 0.22, 0.7), title, to_srgb(0.9 * picture / picture.max()))
    return figure


def card(height: float) -> Figure:
    """An empty card, its corners round."""
    figure = Figure(figsize=(WIDTH, height), dpi=DOTS)
    figure.patch.set_alpha(0)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, WIDTH), ylim=(0, height))
    axes.set_axis_off()
    box = matplotlib.patches.FancyBboxPatch(
        (0.1, 0.1), WIDTH - 0.2, height - 0.2, boxstyle="round,pad=0.1,rounding_size=0.18", facecolor=PAPER, linewidth=0
    )
    axes.add_patch(box)
    return figure
