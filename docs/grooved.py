"""Hold `grooved` against real cylinders and draw it: ``.venv/bin/python docs/grooved.py``. It takes a minute or two.

Each row of the picture is one direction of light. From the left: the grooves in section and what of them is lit; the
BRDF in all directions, by the model and as Mitsuba's ray tracer finds it on cylinders; the difference.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import fitting  # before mitsuba: it chooses the libLLVM  # noqa: F401  # isort: skip
import drjit as dr
import matplotlib
import mitsuba as mi
import numpy as np
import numpy.typing as npt
from drjit.llvm.ad import Array3f, Array3f64
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from pictures import DARKER_TO_BRIGHTER, INK, RULE, SOFT, STYLE, WIDTH, card  # noqa: E402  (the path first)

from brdf import defaults, evaluate  # noqa: E402  (as above)
from brdf.models.grooved import Grooved, reach  # noqa: E402  (as above)
from tests.oracles.tracedgrooves import mean_and_error, traced  # noqa: E402  (as above)

Array = npt.NDArray[np.float64]

#: The row of grooves, and of what it is made.
SPACING, HEIGHT, EXPONENT, DIFFUSE, SPECULAR = 2.5, 0.3, 30.0, 0.3, 0.5
#: Angles of the light from the normal and from the x axis, which is across the grooves [deg], and what to call it.
LIGHTS = ((45, 0, "across"), (65, 30, "oblique"), (60, 90, "along"))
#: Outgoing directions: this many over the diameter of the disk that is the hemisphere from above.
SIDE = 97
#: Lines of sight for each direction, in each of 32 batches.
SAMPLES = 128
#: Where the colours of the error end, relative to the traced value.
ERROR = 0.01
#: Value by brightness: black, and warm white at the largest.
GLOW = ["#10151c", "#1f3a5f", "#5b4b8a", "#b4567a", "#f08a5d", "#ffd28a", "#fff6e3"]
LIT = "#ffd28a"
TOP, LOW, GAP = 0.90, 0.045, 0.012


def direction(angle: float, azimuth: float) -> Array:
    """A unit vector from two angles [deg]."""
    a, b = np.radians((angle, azimuth))
    return np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])


def disk() -> tuple[Array, Array]:
    """Outgoing directions (n, 3) at the points of a grid inside the unit circle, and which points these are."""
    t = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    x, y = np.meshgrid(t, -t)
    inside = x * x + y * y < 0.99  # to some 84 degrees: further out a grid of the disk has hardly a direction
    x, y = x[inside], y[inside]
    return np.stack([x, y, np.sqrt(1 - x * x - y * y)], axis=1), inside


def compare(wi: Array, wo: Array) -> tuple[Array, Array, Array]:
    """The BRDF by the model and as traced, and the standard error of the latter [1/sr]."""
    i = np.broadcast_to(wi, wo.shape)
    p = defaults(
        Grooved(),
        Array3f,
        spacing=SPACING,
        height=HEIGHT,
        exponent=EXPONENT,
        reflectance=DIFFUSE,
        specular_reflectance=SPECULAR,
    )
    model = np.asarray(evaluate(Grooved(), p, Array3f(i.T), Array3f(wo.T)).x, dtype=float)
    batches = traced(i, wo, SPACING, HEIGHT, (EXPONENT,), SAMPLES)
    mean, error = mean_and_error(DIFFUSE * batches[0] + SPECULAR * batches[1])
    return model, mean, error


def picture() -> Figure:
    """All directions of light; what was found is printed."""
    wo, inside = disk()
    figure = card(6.35)
    rows = len(LIGHTS)
    for row, (angle, azimuth, name) in enumerate(LIGHTS):
        wi = direction(angle, azimuth)
        model, mean, error = compare(wi, wo)
        z = (model - mean) / error
        relative = model / mean - 1
        print(
            f"{name}: {len(z)} directions; difference in standard errors: rms {rms(z):.2f}, "
            f"largest {np.abs(z).max():.1f}; relative: rms {rms(relative):.1e}, "
            f"largest {np.abs(relative).max():.1e}"
        )
        height = (TOP - LOW) / rows
        bottom = TOP - (row + 1) * height + GAP
        side = (height - 2 * GAP) * figure.get_figheight() / WIDTH
        axes = figure.add_axes((0.02, bottom, 0.25, height - 2 * GAP))
        section(axes, wi)
        axes.text(-1.5 * SPACING, 3.25, f"{name}, {angle}°", color=INK, ha="left", va="center")
        said = f"{100 * rms(relative):.2f} % apart, {rms(z):.2f} standard errors"
        axes.text(0, -1.05, said, color=SOFT, ha="center", va="center", fontsize=9)
        white = np.quantile(mean, 0.999)
        glow = LinearSegmentedColormap.from_list("glow", GLOW)
        differ = LinearSegmentedColormap.from_list("error", DARKER_TO_BRIGHTER)
        panels = (glow(root(model / white)), glow(root(mean / white)), differ(0.5 + 0.5 * relative / ERROR))
        for column, colours in enumerate(panels):
            left = 0.305 + 0.235 * column
            show(figure.add_axes((left, bottom, side, height - 2 * GAP)), colours, inside, wi)
            if row == 0:
                title = ("model", "ray traced", f"difference, \N{PLUS-MINUS SIGN} {100 * ERROR:.0f} %")[column]
                figure.text(left + side / 2, 0.94, title, ha="center", va="center", color=SOFT)
    figure.text(0.145, 0.94, "light and grooves in section", ha="center", va="center", color=SOFT)
    return figure


def rms(x: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(x * x)))


def root(x: Array) -> Array:
    """Brightness for the eye: half of the light is far more than half as bright."""
    return np.clip(x, 0, 1) ** 0.5


def show(axes: Axes, colours: Array, inside: npt.NDArray[np.bool_], wi: Array) -> None:
    """Colours of the directions inside the disk, and a ring where the light comes from."""
    axes.set_axis_off()
    image = np.zeros((SIDE, SIDE, 4))
    image[inside] = colours
    axes.imshow(image, extent=(-1, 1, -1, 1), interpolation="nearest")
    axes.add_patch(Circle((0, 0), 1, fill=False, edgecolor=RULE, linewidth=0.8))
    axes.plot(wi[0], wi[1], "o", markersize=5, markerfacecolor="none", markeredgecolor=INK, markeredgewidth=1)
    axes.set_xlim(-1.03, 1.03)
    axes.set_ylim(-1.03, 1.03)


def section(axes: Axes, wi: Array) -> None:
    """The grooves in section, seen along the y axis: what the light reaches is bright, by the model's own ends."""
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set_xlim(-1.55 * SPACING, 1.55 * SPACING)
    axes.set_ylim(-1.4, 3.6)
    p = defaults(Grooved(), Array3f64, spacing=SPACING, height=HEIGHT)
    r = reach(p, Array3f64(*wi.tolist()))
    low, high, left, right = (float(dr.slice(x, 0)) for x in (r.low, r.high, r.left, r.right))
    rim = np.arccos(HEIGHT)
    foot = np.sin(rim)
    ground: dict[str, Any] = {"facecolor": "#1b222b", "linewidth": 0}
    axes.add_patch(Rectangle((-2 * SPACING, -0.6), 4 * SPACING, 0.6 + HEIGHT, **ground))
    for k in range(-2, 3):
        t = np.linspace(-rim, rim, 60)
        axes.fill(k * SPACING + np.sin(t), np.cos(t), **ground)
        for a, b, colour, width in ((-rim, rim, RULE, 1.3), (low, high, LIT, 2.4)):
            t = np.linspace(a, b, 60)
            axes.plot(k * SPACING + np.sin(t), np.cos(t), color=colour, linewidth=width, solid_capstyle="butt")
        for a, b, colour, width in ((foot, SPACING - foot, RULE, 1.3), (left, SPACING - right, LIT, 2.4)):
            if b > a:
                axes.plot(k * SPACING + np.array([a, b]), [HEIGHT] * 2, color=colour, linewidth=width)
    across = np.array([wi[0], wi[2]]) / np.hypot(wi[0], wi[2])
    arrow = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", np.array([0, 1.05]) + 0.15 * across, np.array([0, 1.05]) + 1.65 * across, arrowprops=arrow)


def main() -> None:
    """Write the picture beside this file."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    mi.set_variant("llvm_ad_rgb")
    with matplotlib.rc_context(STYLE):
        picture().savefig(HERE / "grooved.png", metadata={"Software": None})
    print(HERE / "grooved.png")


if __name__ == "__main__":
    main()
