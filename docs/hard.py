"""Plot the error of Cook and Torrance's model against roughness, and print what accuracy costs.

``.venv/bin/python docs/hard.py`` writes docs/hard.png, prints what accuracy costs, and what ``brdf check --all --hard
--peers`` finds, a line for each model; with options only what they name.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fitting  # before mitsuba: it chooses the libLLVM  # noqa: F401  # isort: skip
import drjit as dr
import matplotlib
import mitsuba as mi
import mpmath
import numpy as np
import numpy.typing as npt
from drjit.llvm.ad import Array3f, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from pictures import INK, RULE, SERIES, SOFT, STYLE, card, heading  # noqa: E402  (the path first)

from brdf.model import Values  # noqa: E402  (as above)
from brdf.models.cooktorrance import CookTorrance  # noqa: E402  (as above)
from fitting import hard  # noqa: E402  (as above)
from plugins.hard import peers, textbook  # noqa: E402  (as above)
from tests.bench import price  # noqa: E402  (as above)
from tests.oracles import textbook as oracle  # noqa: E402  (as above)

Array = npt.NDArray[np.float64]

#: Roughness, and pairs of directions for each: within `SLOPES` of the mirror direction.
ROUGHNESS = 10.0 ** np.linspace(-6, 0, 25)
PAIRS, SLOPES = 200, 3.0
ETA = 1.5
#: Errors are drawn from here to here.
BEST, WORST = 8e-9, 1e2
HEIGHT = 4.0


def directions(m: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Pairs, shape (3, n), rounded to float32: facets up to `SLOPES` slopes off the normal, wi up to 84 degrees."""
    cos, azimuth = rng.uniform(0.1, 1, PAIRS), rng.uniform(0, 2 * np.pi, PAIRS)
    sin = np.sqrt(1 - cos * cos)
    wi = np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), cos])
    slope, turn = m * SLOPES * np.sqrt(rng.random(PAIRS)), rng.uniform(0, 2 * np.pi, PAIRS)
    h = np.stack([slope * np.cos(turn), slope * np.sin(turn), np.ones(PAIRS)])
    h /= np.linalg.norm(h, axis=0)
    wo = 2 * (wi * h).sum(axis=0) * h - wi
    up = wo[2] > 0.02
    return tuple(w[:, up].astype(np.float32).astype(np.float64) for w in (wi, wo))  # type: ignore[return-value]  (two of them)


def exact(wi: Array, wo: Array, m: float) -> tuple[Array, Array]:
    """Value and derivative in `m`, in 60 digits: Beckmann's D, Smith's G, Fresnel's F."""
    value, slope = [], []
    for i, o in zip(wi.T, wo.T, strict=True):
        p = oracle.Pair(i, o)
        F = oracle.fresnel_dielectric(p.vh, mpmath.mpf(ETA)) / (4 * p.ni * p.no)

        def f(m: Any, p: oracle.Pair = p, F: Any = F) -> Any:
            return oracle.beckmann_d(p.nh, m) * oracle.smith_g1(p.i, m) * oracle.smith_g1(p.o, m) * F

        value.append(float(f(mpmath.mpf(m))))
        slope.append(float(mpmath.diff(f, mpmath.mpf(m))))
    return np.array(value), np.array(slope)


def ours(wi: Any, wo: Any, m: Any) -> Any:
    """As the model has it."""
    model = CookTorrance(masking="smith")
    return model.f(Values(diffuse_reflectance=0.0, specular_reflectance=1.0, m=m, eta=ETA), wi, wo)[1]


def from_book(wi: Any, wo: Any, m: Any) -> Any:
    """As it is printed."""
    return textbook.cooktorrance(wi, wo, m, lambda c: textbook.fresnel_dielectric(c, ETA), "smith")


def mitsubas(wi: Any, wo: Any, m: Any) -> Any:
    """As ``roughconductor`` puts Mitsuba's own functions together."""
    i, o = mi.Vector3f(wi), mi.Vector3f(wo)
    h = dr.normalize(i + o)
    facets = mi.MicrofacetDistribution(mi.MicrofacetType.Beckmann, m, False)
    F = mi.fresnel(dr.dot(i, h), mi.Float(ETA))[0]
    return facets.eval(h) * facets.smith_g1(i, h) * facets.smith_g1(o, h) * F / (4 * i.z * o.z)


FORMS: dict[str, Callable[..., Any]] = {"text book": from_book, "Mitsuba": mitsubas, "brdf": ours}
COLOURS = {"text book": SERIES[1], "Mitsuba": SERIES[0], "brdf": SERIES[2]}


def errors() -> dict[str, Array]:
    """Of each form, at each roughness: of the value and of its derivative in `m`, the error in median, at 99 %, and the
    largest, and the share that is not finite; shape (2, 4, roughness).

    The error of the derivative is relative to ``|df/dm| + f/m``, since df/dm goes through 0.
    """
    rng = np.random.default_rng(1)
    found: dict[str, list[list[list[float]]]] = {name: [] for name in FORMS}
    for m in ROUGHNESS.astype(np.float32).astype(float):
        wi, wo = directions(m, rng)
        value, slope = exact(wi, wo, m)
        for name, form in FORMS.items():
            x = dr.full(Float, m, wi.shape[1])
            dr.enable_grad(x)
            f = form(Array3f(*map(Float, wi)), Array3f(*map(Float, wo)), x)
            dr.backward_from(f, dr.ADFlag.Default | dr.ADFlag.AllowNoGrad)  # Mitsuba's has none below its least alpha
            pairs = ((dr.detach(f), value, value), (dr.grad(x), slope, np.abs(slope) + value / m))
            found[name].append([quantiles(np.array(got, dtype=float), want, scale) for got, want, scale in pairs])
    return {name: np.moveaxis(np.array(rows), 0, -1) for name, rows in found.items()}


def quantiles(got: Array, want: Array, scale: Array) -> list[float]:
    """Median, 99 %, largest error, and the share that is not finite, whose error is infinite."""
    finite = np.isfinite(got)
    error = np.where(finite, np.abs(np.where(finite, got, 0) - want) / scale, np.inf)
    return [*(float(q) for q in np.quantile(error, (0.5, 0.99, 1), method="higher")), float(np.mean(~finite))]


def plot(found: dict[str, Array]) -> Figure:
    """The errors of the value and of the derivative, and above each the share that is not finite."""
    figure = card(HEIGHT)
    for i, title in enumerate(("error of the value", "error of its derivative in m")):
        left = 0.07 + 0.5 * i
        axes = figure.add_axes((left, 0.145, 0.41, 0.615))
        above = figure.add_axes((left, 0.79, 0.41, 0.055), sharex=axes)
        prepare(axes)
        for name, form in found.items():
            median, high, worst = np.clip(form[i, :3], BEST, WORST)
            axes.fill_between(ROUGHNESS, median, high, color=COLOURS[name], alpha=0.16, linewidth=0)
            axes.plot(ROUGHNESS, median, color=COLOURS[name], linewidth=1.8)
            axes.plot(ROUGHNESS, worst, color=COLOURS[name], linewidth=0.7)
        shares(above, {name: form[i, 3] for name, form in found.items()})
        say(axes, i)
        heading(figure, left + 0.205, title, 0.925)
    return figure


def say(axes: Axes, i: int) -> None:
    """What the lines are, beside them."""
    said: dict[str, Any] = {"fontsize": 9, "va": "center", "linespacing": 1.35}
    axes.text(1.2e-3, 1.5, "text book", color=COLOURS["text book"], **said)
    axes.text(5e-5, 3e-3, "Mitsuba takes\nno m below 10⁻⁴", color=COLOURS["Mitsuba"], ha="right", **said)
    axes.text(0.9, 6e-2, "Mitsuba, rational G", color=COLOURS["Mitsuba"], ha="right", **said)
    axes.text(5e-5, 6e-6, "brdf", color=COLOURS["brdf"], ha="right", **said)
    if i == 0:
        axes.text(1.3e-6, 3e-8, "thick: median; band: to 99 %; thin: largest", color=SOFT, **said)
    else:
        axes.text(1.3e-6, 3e-8, "relative to |df/dm| + f/m", color=SOFT, **said)


def shares(axes: Axes, found: dict[str, Array]) -> None:
    """A strip of bars: of the points at each roughness, how many are not finite."""
    axes.set_facecolor("none")
    axes.set_ylim(0, 0.2)
    axes.tick_params(bottom=False, labelbottom=False, left=False, labelleft=False, which="both")
    for side, spine in axes.spines.items():
        spine.set_visible(side == "bottom")
        spine.set_color(RULE)
    for name, share in found.items():
        axes.vlines(ROUGHNESS, 0, share, color=COLOURS[name], linewidth=4)
    most = max(float(share.max()) for share in found.values())
    axes.text(2e-4, 0.1, f"not finite: up to {100 * most:.0f} %", color=SOFT, fontsize=9, va="center")


def prepare(axes: Axes) -> None:
    """Logarithmic axes on the card."""
    axes.set_facecolor("none")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(ROUGHNESS[0] * 0.85, ROUGHNESS[-1] * 1.1)
    axes.set_ylim(BEST, WORST)
    axes.set_xlabel("roughness m", color=INK)
    axes.set_yticks([10.0**k for k in range(-7, 2, 2)])
    axes.tick_params(colors=SOFT, labelsize=9, which="both")
    axes.tick_params(which="minor", length=0)
    axes.grid(which="major", color=RULE, linewidth=0.5, alpha=0.6)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(RULE)


def models() -> str:
    """What is found of every model of ours, and of Mitsuba's functions, as tables of Markdown."""
    found = hard.run(hard.all_formulas()).to_json()
    lines = ["| | points | value | derivative | not finite |", "|---|---|---|---|---|"]
    for name, m in found.items():
        limits = {tuple(v["limits"]) for f in m["formulas"].values() for p, v in f.items() if p != "oracle"}
        value, slope = (max(limit[i] for limit in limits) for i in (0, 1))
        cells = [f"{m['value_c']:.1f} of {value:g}", f"{m['gradient_c']:.1f} of {slope:g}"]
        lines.append(f"| {name} | {m['points']} | {' | '.join(cells)} | {m['non_finite']} |")
    lines += ["", "| Mitsuba's | value | ours | derivative | ours | not finite |", "|---|---|---|---|---|---|"]
    for pair in peers.compare():
        cells = [f"{getattr(v, what):.2g}" for what in ("value", "slope") for v in (pair.theirs, pair.ours)]
        lines.append(f"| {pair.theirs.name} | {' | '.join(cells)} | {pair.theirs.not_finite} |")
    return "\n".join(lines)


def main() -> None:
    """Write the plot beside this file, and print the tables; those that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plot", action="store_true", help="write docs/hard.png, and print its figures")
    parser.add_argument("--price", action="store_true", help="print what accuracy costs")
    parser.add_argument("--models", action="store_true", help="print what is found of each model")
    asked = parser.parse_args()
    everything = not any(vars(asked).values())
    mi.set_variant("llvm_ad_rgb")
    if asked.plot or everything:
        found = errors()
        print("error of value, of derivative: median, 99 %, largest, share that is not finite")
        for name, form in found.items():
            for m, row in zip(ROUGHNESS, form.reshape(8, -1).T, strict=True):
                print(f"{name:9} m {m:.1e}: " + " ".join(f"{x:.1e}" for x in row))
        with matplotlib.rc_context(STYLE):
            plot(found).savefig(HERE / "hard.png", metadata={"Software": None})
        print(HERE / "hard.png")
    if asked.price or everything:
        print(price.table(price.prices()))
    if asked.models or everything:
        print(models())


if __name__ == "__main__":
    main()
