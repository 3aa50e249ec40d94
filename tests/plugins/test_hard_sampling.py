"""Sampling at the extremes through Mitsuba: random numbers next to 0 and 1, the sharpest lobes, bounds, grazing incidence."""

from __future__ import annotations

import itertools
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf import Model
from brdf.checks.directions import at_angle
from plugins.checks import chi2
from plugins.checks.subject import BsdfSubject
from plugins.hard.sampling import ALL, ALPHAS, OURS, SAMPLES, hard_sampling
from tests.models import ends, named, variations
from tests.oracles import directions
from tests.plugins.hits import array, interaction

#: How far the density that comes with a direction may be from that computed for it.
DENSITY = 1e-5
#: Roundings by which a direction's length may differ from 1: those of `wi`, and three more.
LENGTH = 4
EPS = 2.0**-23
COSINES = (1.0, 1 - 1e-6, 0.7, 0.1, 1e-3, 1e-5, 1e-7)
#: Random numbers, the least and the largest among them.
NUMBERS = (0.0, EPS / 2, 0.3, 0.5, 0.9, 1 - EPS / 2)


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def xml(model: Model, values: dict[str, float]) -> dict[str, Any]:
    """A model with its choices made, and numbers and grey colours."""
    colours = {p.name for p in model.parameters() if p.kind == "colour"}
    given = {k: {"type": "rgb", "value": [v] * 3} if k in colours else v for k, v in values.items()}
    return {"type": model.name, **vars(model), **given}


@pytest.mark.parametrize("model", variations(), ids=named)
def test_corners(model: Model) -> None:
    """Directions finite, of unit length, on the right side or without weight; weights finite and not negative; and ``pdf``
    says of a direction what `sample` said."""
    seen = [directions.unit(z, a) for z in COSINES for a in (0.0, 0.4, 2.0)]
    seen += [w * [1, 1, -1] for w in seen] if model.transmits else []
    u = np.array(list(itertools.product(NUMBERS, repeat=3)))
    wi, u = np.repeat(seen, len(u), axis=0), np.tile(u, (len(seen), 1))
    si, context = interaction(wi), mi.BSDFContext()
    for values in ends(model):
        bsdf = mi.load_dict(xml(model, values))
        bs, weight = bsdf.sample(context, si, mi.Float(u[:, 0]), mi.Point2f(u[:, 1:].T))
        asked = bsdf.pdf(context, si, bs.wo), bsdf.eval_pdf(context, si, bs.wo)[1]
        dr.eval(bs, weight, asked)
        ideal = np.asarray(mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta))
        through = np.asarray(mi.has_flag(bs.sampled_type, mi.BSDFFlags.Transmission))
        wo, w, density = array(bs.wo), array(weight), array(bs.pdf)
        lit = (w != 0).any(axis=0)
        assert np.isfinite(wo).all() and (np.abs(np.linalg.norm(wo, axis=0) - 1) <= LENGTH * EPS).all()
        assert np.isfinite(w).all() and (w >= 0).all()
        assert np.isfinite(density).all() and (density >= 0).all() and (density > 0)[lit].all()
        assert ((wo[2] * wi[:, 2] > 0) != through)[lit].all()
        drawn = lit & ~ideal
        for other in asked:
            assert (np.abs(array(other) - density) <= DENSITY * density)[drawn].all()
        assert lit.any() or values.get("thickness") == 0 or values.get("eta") == values.get("k") == 0


COOK = [
    {"type": "cooktorrance", "distribution": d, "masking": g}
    for d in ("beckmann", "ggx", "blinn")
    for g in ("vcavity", "smith", "none")
]
#: Of Cook and Torrance's, those with a sampling of their own; the other choices of masking share it.
OWN = {"vcavity": ("beckmann", "ggx", "blinn"), "smith": ("ggx",), "none": ()}
POWERS = ("blinnphong", "phong")


def sharp(m: float) -> list[Any]:
    """Each glossy lobe as sharp as roughness m, or as the exponent that belongs to it."""
    n = min(2 / m**2, 1e6)
    late = pytest.mark.slow if m < 1e-3 else ()
    made = [
        pytest.param(
            {**x, "m": m},
            id=f"{x['distribution']}-{x['masking']}-{m:g}",
            marks=late if x["distribution"] in OWN[x["masking"]] else pytest.mark.slow,
        )
        for x in COOK
    ]
    two = [{"type": "cooktorrance", "m_u": m, "m_v": 3 * m}, {"type": "ward", "alpha_u": m, "alpha_v": 3 * m}]
    made += [pytest.param(x, id=f"{x['type']}-two-{m:g}", marks=late) for x in two]
    return made + [pytest.param({"type": t, "exponent": n}, id=f"{t}-{n:g}") for t in POWERS if m >= 1e-3]


@pytest.mark.parametrize("bsdf", sharp(1e-3) + sharp(1e-4))
def test_chi_square(bsdf: dict[str, Any]) -> None:
    """In the stretched domain of `brdf check`, at normal incidence, 45 degrees, 80 degrees, and where a rounding of the
    directions turns the half vector by no more than a hundredth of the roughness."""
    subject = BsdfSubject(mi.load_dict(bsdf))
    grazing = 80.0 if 1e-4 in bsdf.values() else 88.85
    for angle in (0.0, 45.0, grazing):
        wi = np.array(at_angle(angle, 23.0))
        (region,) = chi2.regions(subject, wi, 1)
        found = chi2.test(subject, wi, 1, region, 0)
        assert found.passed, found.reason
        assert found.figure is not None and found.case["resolved"] > 0.99


def test_facets_beside_mitsubas() -> None:
    """The slopes of ours are distributed as they should be, and the densities are right, however sharp the lobe.

    ``pytest -s`` prints the table, Mitsuba's rows as measured. That the test can tell is seen from those of all normals.
    """
    found = hard_sampling()
    assert {(f.who, f.alpha) for f in found} >= {(who, alpha) for who in (OURS, ALL) for alpha in ALPHAS}
    critical = 1.95 / np.sqrt(SAMPLES)  # of Kolmogorov and Smirnov's distance, for one sample in a thousand
    for f in found:
        print(f"\n{f.who:26} {f.distribution:9} {f.alpha:<7g}", *(f"{x:8.2g}" for x in f[3:]), end="")
        if f.who == OURS:
            assert f.on_normal < 1e-4 and f.distance < critical
            assert max(f.facet_pdf, f.oblique_pdf, f.grazing_pdf) < DENSITY
        elif f.who == ALL and f.alpha == min(ALPHAS):
            assert f.on_normal > 0.5 and f.distance > critical and f.facet_pdf > DENSITY
