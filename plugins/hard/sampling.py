"""How well facets of the sharpest lobes are sampled in float32: ours, and beside them Mitsuba's own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from brdf import microfacet
from brdf.checks.values import opaque

from ..registry import register

#: Roughness of the lobes, and samples of each.
ALPHAS, SAMPLES = (1e-4, 1e-3, 1e-2), 1 << 17
#: Cosines of the directions from which facets and reflections are looked at: oblique, and grazing.
OBLIQUE, GRAZING = math.sqrt(0.5), 1e-2
#: Who samples, and how: of Mitsuba's, all normals, or those that are visible, which its BSDFs do unless told otherwise.
OURS, VISIBLE, ALL = "ours", "Mitsuba's, visible normals", "Mitsuba's, all normals"
#: Share of the samples that an error below is that of.
QUANTILE = 0.99


class SamplingFigures(NamedTuple):
    """What was measured of one way of sampling.

    Attributes
    ----------
    who, distribution : str
    alpha : float
        Roughness.
    on_normal : float
        Share of the facet normals, seen at 45 degrees, that are the surface normal itself.
    distance : float
        The largest difference between the distribution of their slopes and the exact one (Kolmogorov and Smirnov's).
    facet_pdf : float
        Relative difference between the density that comes with a facet normal and that computed for it, of all but 1 %
        of the samples.
    oblique_pdf, grazing_pdf : float
        The same of reflected directions, at 45 and at 89.4 degrees: what multiple importance sampling relies on.
    """

    who: str
    distribution: str
    alpha: float
    on_normal: float
    distance: float
    facet_pdf: float
    oblique_pdf: float
    grazing_pdf: float


def hard_sampling(alphas: Sequence[float] = ALPHAS, seed: int = 0) -> list[SamplingFigures]:
    """Sampling of Beckmann's and GGX's facets, ours and Mitsuba's, in the variant now set, which must have arrays.

    Ours is that of ``cooktorrance`` with V-shaped cavities; Mitsuba's ``mi.MicrofacetDistribution`` and
    ``roughconductor``.

    Parameters
    ----------
    alphas : float
        Beckmann's or GGX's roughness, up to 0.01: the slopes that are visible are then distributed as all are.
    seed : int
    """
    register()
    random = mi.PCG32(SAMPLES, seed)
    u = mi.Point3f(*(random.next_float32() for _ in range(3)))
    dr.eval(u)
    made = []
    for distribution in ("beckmann", "ggx"):
        for alpha in alphas:
            for who in (OURS, VISIBLE, ALL):
                h, given, asked = facets(who, distribution, alpha, u)
                normal = np.asarray(h, dtype=np.float64)
                slope = np.hypot(normal[0], normal[1]) / normal[2] / alpha
                spread = -np.expm1(-np.square(slope)) if distribution == "beckmann" else 1 - 1 / (1 + np.square(slope))
                made.append(
                    SamplingFigures(
                        who,
                        distribution,
                        alpha,
                        float(np.mean((normal[0] == 0) & (normal[1] == 0))),
                        distance(spread),
                        apart(given, asked),
                        *(reflections(who, distribution, alpha, cos, u) for cos in (OBLIQUE, GRAZING)),
                    )
                )
    return made


def facets(who: str, distribution: str, alpha: float, u: mi.Point3f) -> tuple[mi.Vector3f, mi.Float, mi.Float]:
    """Facet normals seen at 45 degrees, the densities that come with them, and those computed for them."""
    wi = mi.Vector3f(math.sqrt(1 - OBLIQUE**2), 0, OBLIQUE)
    if who == OURS:
        ours, m = microfacet.DISTRIBUTIONS[distribution], dr.opaque(mi.Float, alpha)
        tangent = ours.tangent(u.x, m)
        s, c = dr.sincos(dr.two_pi * u.y)
        h = microfacet.vcavity_visible(microfacet.facet(tangent, c, s, wi), wi, u.z)
        drawn, got = tangent * tangent, (h.x * h.x + h.y * h.y) / (h.z * h.z)
        # What facets that are hidden or tilted count less is the same factor in both.
        return h, *(dr.square(ours.d_half(t, m)) * dr.rsqrt(1 + t) for t in (drawn, got))
    kind = {"beckmann": mi.MicrofacetType.Beckmann, "ggx": mi.MicrofacetType.GGX}[distribution]
    theirs = mi.MicrofacetDistribution(kind, dr.opaque(mi.Float, alpha), who == VISIBLE)
    h, density = theirs.sample(wi, mi.Point2f(u.x, u.y))
    return h, density, theirs.pdf(wi, h)


def reflections(who: str, distribution: str, alpha: float, cos: float, u: mi.Point3f) -> float:
    """How far the density that comes with a direction is from that computed for it."""
    xml: dict[str, Any] = {"type": "roughconductor", "alpha": alpha, "sample_visible": who == VISIBLE}
    if who == OURS:
        xml = {"type": "cooktorrance", "m": alpha, "fresnel": "constant", "diffuse_reflectance": 0.0}
    bsdf = mi.load_dict({**xml, "distribution": distribution})
    si = dr.zeros(mi.SurfaceInteraction3f, SAMPLES)
    si.wi = opaque(mi.Vector3f, [math.sqrt(1 - cos * cos), 0, cos])
    context = mi.BSDFContext()
    bs, weight = bsdf.sample(context, si, u.z, mi.Point2f(u.x, u.y))
    lit = np.asarray(dr.any(mi.unpolarized_spectrum(weight) != 0))
    return apart(np.asarray(bs.pdf)[lit], np.asarray(bsdf.pdf(context, si, bs.wo))[lit])


def apart(given: Any, asked: Any) -> float:
    """The relative difference of two densities, of all but the worst samples."""
    a, b = (np.asarray(x, dtype=np.float64) for x in (given, asked))
    return float(np.quantile(np.abs(a - b) / np.maximum(np.maximum(a, b), 1e-30), QUANTILE))


def distance(share: np.ndarray) -> float:
    """The largest difference between the distribution of numbers and the uniform one on [0, 1]."""
    ranked = np.sort(share)
    below = np.arange(len(ranked)) / len(ranked)
    return float(max((ranked - below).max(), (below + 1 / len(ranked) - ranked).max()))
