"""Mitsuba's own functions and BSDFs on the points that our formulas are held to, by the same criterion.

They get the same inputs under their conventions: alpha is m; half vectors are normalised, as their BSDFs do it; the
cosine of the light is taken out of a BSDF's `eval`; of the points those whose roughness they accept. Their masking of
Beckmann's facets is held to Smith's formula, of which it is a fit. What our formula has around theirs, a diffuse base
and a factor, is put around theirs as well.

In float32: the wheels of Mitsuba have no variant with LLVM in float64.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from types import SimpleNamespace
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from brdf.hard import FORMULAS, Exact, Formula, Verdict, judge, load

from ..peers import SMALLEST_ALPHA

VARIANT, PRECISION = "llvm_ad_rgb", "float32"
ROUGHNESS = ("m", "m_u", "m_v")

Function = Callable[[Any, SimpleNamespace], Any]


class Pair(NamedTuple):
    """What was found of a formula of ours and of Mitsuba's in its place, on the same points."""

    ours: Verdict
    theirs: Verdict


def compare(answers: Callable[[str], Exact] = load) -> Iterator[Pair]:
    """Every peer beside our formula.

    Parameters
    ----------
    answers : callable
        Exact answers by the name of a formula; those that come with the package, if left out.
    """
    mi.set_variant(VARIANT)
    for title, (name, function) in PEERS.items():
        formula = FORMULAS[name]
        exact = accepted(formula, answers(name))
        theirs = dataclasses.replace(formula, name=title, function=depending(formula, function))
        yield Pair(judge(formula, exact, PRECISION), judge(theirs, exact, PRECISION))


def accepted(formula: Formula, exact: Exact) -> Exact:
    """The points whose roughness is above the least that Mitsuba's microfacet code takes, where its derivatives end."""
    keep = np.ones(len(exact), dtype=bool)
    for name in set(ROUGHNESS) & set(formula.inputs):
        keep &= exact.inputs[formula.inputs.index(name)] > np.float32(SMALLEST_ALPHA)
    return exact.some(keep)


def depending(formula: Formula, function: Function) -> Function:
    """`function`, made to depend on all of its parameters: a derivative that it lacks is then 0, and no error."""

    def out(vector: Any, v: SimpleNamespace) -> Any:
        given = [getattr(v, name) for name in formula.by]
        return function(vector, v) + sum((x - x for x in given), 0)

    return out


def vector_of(v: SimpleNamespace, name: str) -> Any:
    """A direction by its components."""
    return mi.Vector3f(*(getattr(v, f"{name}_{axis}") for axis in "xyz"))


def facets(kind: str, m: Any) -> Any:
    """Mitsuba's distribution of facet normals."""
    return mi.MicrofacetDistribution(getattr(mi.MicrofacetType, kind), m, False)


def distribution(kind: str) -> Function:
    """D of a half vector of any length."""
    return lambda vector, v: facets(kind, v.m).eval(dr.normalize(vector_of(v, "wi")))


def masking(kind: str) -> Function:
    """G1 of a direction, for a facet that it sees from the front."""
    return lambda vector, v: facets(kind, v.m).smith_g1(vector_of(v, "wi"), mi.Vector3f(0, 0, 1))


def cosine(v: SimpleNamespace) -> Any:
    """Between light and facet."""
    return dr.sqrt(v.H / (v.H + v.Q))


def fresnel(vector: Any, v: SimpleNamespace) -> Any:
    """F of a dielectric."""
    return mi.fresnel(cosine(v), v.eta)[0]


def fresnel_conductor(vector: Any, v: SimpleNamespace) -> Any:
    """F of a conductor."""
    return mi.fresnel_conductor(cosine(v), mi.Complex2f(v.eta, v.k))


def bsdf(plugin: str, factor: float, textures: Mapping[str, str], **parameters: str) -> Function:
    """A BSDF of Mitsuba's without the cosine, times `factor` and a tint, over a diffuse base.

    Parameters
    ----------
    textures : mapping
        By the names of its textures, those of our parameters: each is a picture with a pixel for every point.
    parameters : str
        The same for what it takes as a plain number.
    """

    def out(vector: Any, v: SimpleNamespace) -> Any:
        wo = vector_of(v, "wo")
        n = dr.width(wo)
        rows = (2, n, 1)  # a bitmap has at least two
        given: dict[str, Any] = {"type": plugin, "distribution": "beckmann"}
        for theirs in textures:
            blank = dr.ones(mi.TensorXf, rows)
            given[theirs] = {"type": "bitmap", "data": blank, "raw": True, "filter_type": "nearest"}
        made = mi.load_dict(given)
        params = mi.traverse(made)
        for theirs, name in textures.items():
            params[f"{theirs}.data"] = mi.TensorXf(dr.tile(getattr(v, name), 2), rows)
        for theirs, name in parameters.items():
            params[theirs] = getattr(v, name)
        params.update()
        si = dr.zeros(mi.SurfaceInteraction3f, n)
        si.wi = vector_of(v, "wi")
        si.uv = mi.Point2f((dr.arange(mi.Float, n) + 0.5) / n, 0.25)
        above = (si.wi.z > 0) & (wo.z > 0)
        lobe = made.eval(mi.BSDFContext(), si, wo)[0] / dr.select(above, wo.z, 1)
        return dr.select(above, v.diffuse_reflectance * dr.inv_pi + v.specular_reflectance * factor * lobe, 0)

    return out


#: By what of Mitsuba it is: the formula of ours that it is held to, and how it is asked.
PEERS: dict[str, tuple[str, Function]] = {
    "MicrofacetDistribution.eval, Beckmann": ("beckmann_d", distribution("Beckmann")),
    "MicrofacetDistribution.eval, GGX": ("ggx_d", distribution("GGX")),
    "MicrofacetDistribution.smith_g1, Beckmann": ("smith_g1", masking("Beckmann")),
    "MicrofacetDistribution.smith_g1, GGX": ("ggx_g1", masking("GGX")),
    "fresnel": ("fresnel_dielectric", fresnel),
    "fresnel_conductor": ("fresnel_conductor", fresnel_conductor),
    "roughconductor": (
        "cooktorrance, conductor smith anisotropic ngan",
        bsdf("roughconductor", 4 / dr.pi, {"alpha_u": "m_u", "alpha_v": "m_v", "eta": "eta", "k": "k"}),
    ),
    "roughdielectric, reflection": ("cooktorrance, smith", bsdf("roughdielectric", 1.0, {"alpha": "m"}, eta="eta")),
}
