"""Plot the off-specular peak of rough aluminium, which Phong's lobe has not: ``.venv/bin/python docs/aluminium.py``."""

from __future__ import annotations

import argparse

import fitting  # before mitsuba: it chooses the libLLVM  # isort: skip  # noqa: F401
import matplotlib
import mitsuba as mi
import numpy as np
import numpy.typing as npt
from drjit.llvm.ad import Array3f64, Float64
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pictures import HERE, INK, RULE, SERIES, SOFT, STYLE, card, heading

from brdf import Model, defaults
from brdf.models.cooktorrance import CookTorrance
from brdf.models.phong import Phong
from plugins import indices

Array = npt.NDArray[np.float64]

#: Angles of incidence [degrees].
SHOWN = (45, 60, 75)
#: Roughness of the aluminium; exponent of a Phong lobe about as wide.
M, EXPONENT = 0.3, 22.0
HEIGHT = 3.4


def lobe(model: Model, incident: float, outgoing: Array, **values: object) -> Array:
    """The glossy lobe [1/sr] in the plane of incidence, at outgoing angles from the normal [degrees]."""
    i, o = np.radians(incident), np.radians(outgoing)
    wi = Array3f64(float(-np.sin(i)), 0, float(np.cos(i)))
    wo = Array3f64(Float64(np.sin(o)), 0, Float64(np.cos(o)))
    return np.array(model.f(defaults(model, Array3f64, **values), wi, wo)[1])[0]


def draw(axes: Axes, model: Model, **values: object) -> list[tuple[float, float]]:
    """The lobes, each divided by its value in the mirror direction; returns (incidence, where the maximum is)."""
    outgoing = np.linspace(0, 89.5, 1791)
    peaks = []
    axes.set_facecolor("none")
    for colour, incident in zip(SERIES, SHOWN, strict=True):
        f = lobe(model, incident, outgoing, **values) / lobe(model, incident, np.array([float(incident)]), **values)
        top = float(outgoing[np.argmax(f)])
        peaks.append((incident, top))
        axes.axvline(incident, color=colour, linewidth=0.8, linestyle=(0, (4, 3)), alpha=0.7)
        axes.plot(outgoing, f, color=colour, linewidth=1.8)
        axes.plot([top], [f.max()], "o", color=colour, markersize=5)
        label = f"{incident}°, maximum at {top:.0f}°" if abs(top - incident) > 0.1 else f"{incident}°, maximum there"
        axes.plot([], [], color=colour, linewidth=1.8, label=label)
    legend = axes.legend(loc="upper left", frameon=False, fontsize=9, title="light from")
    legend.get_title().set_color(SOFT)
    for text in (legend.get_title(), *legend.get_texts()):
        text.set_color(SOFT)
    axes.set_xlim(0, 90)
    axes.set_xticks([0, 15, 30, 45, 60, 75, 90], [f"{d}°" for d in (0, 15, 30, 45, 60, 75, 90)])
    axes.tick_params(colors=SOFT, labelsize=9)
    axes.set_xlabel("angle of reflection", color=INK)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(RULE)
    return peaks


def plot() -> Figure:
    """Cook and Torrance's V-cavities with aluminium's measured index, and Phong's lobe."""
    index = {name: tuple(float(c) for c in value) for name, value in indices.metal("Al", "Al").items()}
    figure = card(HEIGHT)
    left = figure.add_axes((0.07, 0.17, 0.415, 0.66))
    right = figure.add_axes((0.565, 0.17, 0.415, 0.66))
    metal = CookTorrance(fresnel="conductor", masking="vcavity")
    print("cooktorrance:", draw(left, metal, m=M, **index))
    print("phong:", draw(right, Phong(normalization="modified"), exponent=EXPONENT))
    left.set_ylabel("f / f in the mirror direction", color=INK)
    left.set_ylim(0, 3.6)
    right.set_ylim(0, 1.6)
    heading(figure, 0.277, f"aluminium, V-cavities, m = {M:g}", 0.91)
    heading(figure, 0.772, f"Phong, exponent {EXPONENT:g}", 0.91)
    return figure


def main() -> None:
    """Write the plot beside this file."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    mi.set_variant("llvm_ad_rgb")
    with matplotlib.rc_context(STYLE):
        plot().savefig(HERE / "aluminium.png", metadata={"Software": None})
    print(HERE / "aluminium.png")


if __name__ == "__main__":
    main()
