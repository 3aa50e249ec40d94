"""What the stable forms cost: nanoseconds an evaluation, theirs and those of the text book, in one interleaved run."""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import brdf  # before drjit: it chooses the libLLVM  # noqa: F401  # isort: skip
import drjit as dr
import numpy as np
from drjit.llvm.ad import Array3f, Array3f64

from brdf import fresnel, microfacet
from brdf.geometry import half
from brdf.model import Model, Values
from brdf.models.blinnphong import BlinnPhong
from brdf.models.cooktorrance import CookTorrance
from brdf.models.hanrahankrueger import HanrahanKrueger
from brdf.models.orennayar import OrenNayar
from brdf.models.phong import Phong
from brdf.models.ward import Ward
from plugins.hard import textbook

DIRECTIONS = 1 << 22
#: Evaluations a round, since systems count processor time in steps of some milliseconds.
REPEATS = 8
PRECISIONS = {"float32": Array3f, "float64": Array3f64}
#: A kernel that takes less than this many times what reading its input takes is bound by memory.
BOUND = 1.5
#: Where parameters are, uniformly.
RANGES = {
    "m": (0.05, 0.5),
    "eta": (1.2, 2.0),
    "k": (1.0, 5.0),
    "exponent": (1.0, 300.0),
    "alpha_u": (0.05, 0.5),
    "alpha_v": (0.05, 0.5),
    "reflectance": (0.1, 0.9),
    "sigma": (0.1, 1.0),
    "sigma_s": (0.1, 2.0),
    "sigma_a": (0.1, 1.0),
    "thickness": (0.1, 2.0),
    "g": (-0.8, 0.8),
}

Form = Callable[..., Any]


@dataclass(frozen=True)
class Case:
    """The two forms of a formula, each called with ``wi``, ``wo`` and the parameters by name."""

    name: str
    stable: Form
    textbook: Form
    parameters: tuple[str, ...]


def facet(function: Form) -> Form:
    """A form of the text book in what it is a function of: `wi`, `wo`, cosine of the facet, and to the facet."""

    def form(wi: Any, wo: Any, **p: Any) -> Any:
        h, cos_d = textbook.half_vector(wi, wo)
        return function(wi, wo, h.z, cos_d, **p)

    return form


def stable(function: Form) -> Form:
    """A brick of `brdf` in what it is a function of: `wi`, `wo` and their `geometry.half`."""
    return lambda wi, wo, **p: function(wi, wo, half(wi, wo), **p)


def lobe(model: Model, number: int, wi: Any, wo: Any, **p: Any) -> Any:
    """One lobe of a model, white and alone."""
    return model.f(Values(**{"diffuse_reflectance": 0.0, "specular_reflectance": 1.0, **p}), wi, wo)[number]


def below(w: Any) -> Any:
    return type(w)(w.x, w.y, -w.z)


def cooktorrance(**choices: str) -> Form:
    return partial(lobe, CookTorrance(**choices), 1)


def cooktorrance_textbook(law: Form, masking: str = "vcavity") -> Form:
    return lambda wi, wo, m, **p: textbook.cooktorrance(wi, wo, m, lambda c: law(c, **p), masking)


def by_name(function: Form) -> Form:
    """A form of the text book whose parameter is the exponent."""
    return lambda wi, wo, exponent: function(wi, wo, exponent)


#: Not the same function: renderers have a fit for Smith's masking of Beckmann's facets, we the formula itself.
RATIONAL = "cooktorrance, Smith / rational fit"
LAYER = ("sigma_s", "sigma_a", "thickness", "g", "eta")

CASES = (
    Case(
        "D, Beckmann",
        stable(lambda i, o, g, m: microfacet.beckmann_d(g.tan2, m)),
        facet(lambda i, o, c, d, m: textbook.beckmann_d(c, m)),
        ("m",),
    ),
    Case(
        "D, GGX",
        stable(lambda i, o, g, m: dr.square(microfacet.ggx_d_half(g.tan2, m)) * dr.inv_pi),
        facet(lambda i, o, c, d, m: textbook.ggx_d(c, m)),
        ("m",),
    ),
    Case(
        "D, Blinn",
        stable(lambda i, o, g, m: dr.square(microfacet.blinn_d_half(g.tan2, m)) * dr.inv_pi),
        facet(lambda i, o, c, d, m: textbook.blinn_d(c, m)),
        ("m",),
    ),
    Case(
        "G, V-cavities",
        stable(lambda i, o, g: microfacet.vcavity_g(i.z, o.z, g.hh, g.hz)),
        facet(lambda i, o, c, d: textbook.vcavity_g(c, d, i.z, o.z)),
        (),
    ),
    Case(
        "F, dielectric",
        stable(lambda i, o, g, eta: fresnel.fresnel_dielectric(g.cos_d, g.sin2_d, eta)),
        facet(lambda i, o, c, d, eta: textbook.fresnel_dielectric(d, eta)),
        ("eta",),
    ),
    Case(
        "F, conductor",
        stable(lambda i, o, g, eta, k: fresnel.fresnel_conductor(g.cos_d, g.sin2_d, eta, k)),
        facet(lambda i, o, c, d, eta, k: textbook.fresnel_conductor(d, eta, k)),
        ("eta", "k"),
    ),
    Case(
        "F, Schlick",
        stable(lambda i, o, g, eta: fresnel.fresnel_schlick(g.cos_d, g.sin2_d, eta)),
        facet(lambda i, o, c, d, eta: textbook.fresnel_schlick(d, eta)),
        ("eta",),
    ),
    Case(
        "cooktorrance, dielectric",
        cooktorrance(),
        cooktorrance_textbook(textbook.fresnel_dielectric),
        ("m", "eta"),
    ),
    Case(
        "cooktorrance, conductor",
        cooktorrance(fresnel="conductor"),
        cooktorrance_textbook(textbook.fresnel_conductor),
        ("m", "eta", "k"),
    ),
    Case(
        "cooktorrance, Smith",
        cooktorrance(masking="smith"),
        cooktorrance_textbook(textbook.fresnel_dielectric, "smith"),
        ("m", "eta"),
    ),
    Case(
        RATIONAL,
        cooktorrance(masking="smith"),
        cooktorrance_textbook(textbook.fresnel_dielectric, "rational"),
        ("m", "eta"),
    ),
    Case(
        "cooktorrance, GGX, Smith",
        cooktorrance(masking="smith", distribution="ggx"),
        cooktorrance_textbook(textbook.fresnel_dielectric, "ggx"),
        ("m", "eta"),
    ),
    Case("phong", partial(lobe, Phong(normalization="modified"), 1), by_name(textbook.phong), ("exponent",)),
    Case("blinnphong", partial(lobe, BlinnPhong(), 1), by_name(textbook.blinnphong), ("exponent",)),
    Case("ward, balanced", partial(lobe, Ward(variant="balanced"), 1), textbook.ward, ("alpha_u", "alpha_v")),
    Case("orennayar, full", partial(lobe, OrenNayar(), 0), textbook.orennayar, ("reflectance", "sigma")),
    Case(
        "hanrahankrueger, reflected",
        partial(lobe, HanrahanKrueger(), 0),
        lambda wi, wo, **p: textbook.hanrahankrueger(wi, wo, **p)[0],
        LAYER,
    ),
    Case(
        "hanrahankrueger, transmitted",
        lambda wi, wo, **p: lobe(HanrahanKrueger(), 1, wi, below(wo), **p),
        lambda wi, wo, **p: textbook.hanrahankrueger(wi, wo, **p)[1],
        LAYER,
    ),
)


@dataclass(frozen=True)
class Price:
    """Nanoseconds of processor time an evaluation, each a median: of the two forms, and of reading what they take and writing the result.

    ``ratio`` is the median of the ratios of what was timed back to back.
    """

    case: str
    precision: str
    gradient: bool
    stable: float
    textbook: float
    reading: float
    ratio: float

    @property
    def memory_bound(self) -> bool:
        return min(self.stable, self.textbook) < BOUND * self.reading


def prices(
    cases: Sequence[Case] = CASES,
    precisions: Iterable[str] = PRECISIONS,
    gradients: Iterable[bool] = (False, True),
    rounds: int = 9,
) -> list[Price]:
    """Time all forms in turns: each round takes every kernel once, the two of a case back to back, in either order.

    What is timed is the kernel alone: tracing and compiling are not in it.
    """
    names = {name for case in cases for name in case.parameters}
    kernels: dict[tuple[str, str, bool], tuple[Callable[[], Any], ...]] = {}
    for precision in precisions:
        wi, wo, p = inputs(PRECISIONS[precision], names)
        for gradient in gradients:
            for case in cases:
                own = {name: p[name] for name in case.parameters}
                forms = (case.stable, case.textbook, everything)
                kernels[case.name, precision, gradient] = tuple(
                    partial(value, form, gradient, wi, wo, own) for form in forms
                )
    times: dict[tuple[str, str, bool], tuple[list[float], ...]] = {key: ([], [], []) for key in kernels}
    for turn in range(-1, rounds):  # the first compiles
        for key, forms in kernels.items():
            for i in (0, 1, 2) if turn % 2 else (1, 0, 2):
                spent = processor_time(forms[i])
                if turn >= 0:
                    times[key][i].append(spent)
    out = []
    for key, (ours, theirs, least) in times.items():
        a, b, c = (statistics.median(t) for t in (ours, theirs, least))
        out.append(Price(*key, a, b, c, statistics.median(x / y for x, y in zip(ours, theirs, strict=True))))
    return out


def inputs(vector: Any, names: Iterable[str]) -> tuple[Any, Any, dict[str, Any]]:
    """Directions about each other's mirror direction, within a few slopes of .2, and parameters in their ranges."""
    rng = np.random.default_rng(1)
    number = dr.value_t(vector)
    cos, azimuth = np.sqrt(rng.random(DIRECTIONS)), rng.uniform(0, 2 * np.pi, DIRECTIONS)
    sin = np.sqrt(1 - cos * cos)
    wi = np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), cos])
    h = np.stack([*rng.normal(0, 0.2, (2, DIRECTIONS)), np.ones(DIRECTIONS)])
    h /= np.linalg.norm(h, axis=0)
    wo = 2 * (wi * h).sum(axis=0) * h - wi
    wo[2] = np.abs(wo[2])
    p = {name: number(rng.uniform(*RANGES[name], DIRECTIONS)) for name in sorted(names)}
    out = vector(*(number(c) for c in wi)), vector(*(number(c) for c in wo)), p
    dr.eval(out)
    return out


def value(form: Form, gradient: bool, wi: Any, wo: Any, p: dict[str, Any]) -> tuple[Any, ...]:
    """The value, and with it the derivatives in all parameters, in reverse mode; without parameters, in ``wi``."""
    if not gradient:
        return (form(wi, wo, **p),)
    wi, p = type(wi)(wi), {name: type(x)(x) for name, x in p.items()}
    by = list(p.values()) or [wi]
    dr.enable_grad(by)
    f = form(wi, wo, **p)
    dr.backward_from(f)
    return dr.detach(f), dr.grad(by)


def everything(wi: Any, wo: Any, **p: Any) -> Any:
    """The least that can be done with all of the input."""
    return sum(p.values(), dr.sum(wi) + dr.sum(wo))


def processor_time(run: Callable[[], Any]) -> float:
    """Nanoseconds of processor time an element that the kernel of what `run` traces takes.

    Not the time of the clock, which on a shared machine is that of the others as well. Tracing is not in it, nor is the
    assembly of the kernel, by Dr.Jit's own account.
    """
    milliseconds = 0.0
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for _ in range(REPEATS):
            traced = run()
            dr.schedule(traced)
            dr.kernel_history_clear()
            start = time.process_time()
            dr.eval()
            dr.sync_thread()
            milliseconds += 1e3 * (time.process_time() - start)
            milliseconds -= sum(k["codegen_time"] for k in dr.kernel_history((dr.KernelType.JIT,)))
    return milliseconds * 1e6 / REPEATS / DIRECTIONS


def table(found: Sequence[Price]) -> str:
    """As Markdown, ``stable / textbook = ratio``; a star where reading the input alone takes nearly as long."""
    columns = [(precision, gradient) for precision in PRECISIONS for gradient in (False, True)]
    by = {(x.case, x.precision, x.gradient): x for x in found}
    titles = [precision + (", with gradient" if gradient else "") for precision, gradient in columns]
    lines = ["| | " + " | ".join(titles) + " |", "|---|" + "---:|" * len(columns)]
    for case in dict.fromkeys(x.case for x in found):
        cells = []
        for column in columns:
            x = by[(case, *column)]
            cells.append(f"{x.stable:.2f} / {x.textbook:.2f} = {x.ratio:.2f}{'*' if x.memory_bound else ''}")
        lines.append(f"| {case} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    print(table(prices()))
