"""Are directions distributed as the density says? Pearson's chi-square test, as Mitsuba has it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from brdf.checks.directions import FEW_AZIMUTHS, incident
from brdf.checks.domain import Around, around
from brdf.checks.result import Finding, at_least, not_asked, worst
from brdf.checks.sampling import ANGLES, called, density_where_it_counts, numbers
from brdf.checks.values import opaque

from .subject import BsdfSubject

#: A distribution is rejected if what was counted has less than this probability. Some ten to a hundred tests are made
#: of a BSDF, which should all pass if all is right.
LEVEL = 1e-4
#: Samples that are counted, cells along a side of the square, and points along a side of a cell.
SAMPLES, CELLS, POINTS = 400_000, 61, 8


def ask(subject: BsdfSubject, seed: int = 0) -> Finding:
    """The smallest p value over the smooth lobes, each by itself and all together, and some angles of incidence."""
    if not subject.smooth:
        return not_asked("All lobes are ideal: there is no density.")
    found = [
        test(subject, wi, lobe, domain, seed)
        for lobe in numbers(subject)
        for wi in incident(subject, ANGLES, FEW_AZIMUTHS)
        for domain in finest(subject, wi, lobe)
    ]
    return worst(found) if found else not_asked("No direction is sampled.")


def test(subject: BsdfSubject, wi: np.ndarray, lobe: int | None, domain: Around, seed: int) -> Finding:
    """One test: a lobe, or all, seen from `wi`, on the side of `domain`."""
    given = opaque(mi.Vector3f, wi)

    def sample(u: mi.Vector3f) -> tuple[mi.Vector3f, mi.Float]:
        drawn = subject.sample(given + 0 * u, u, lobe)
        good = ~drawn.ideal & (drawn.pdf > 0) & dr.any(drawn.weight != 0) & domain.holds(drawn.wo)
        return dr.select(good, drawn.wo, domain.axes[2]), dr.select(good, mi.Float(1), 0)

    def density(wo: mi.Vector3f) -> mi.Float:
        found = density_where_it_counts(subject, given, wo, lobe) * domain.area(*domain.point(wo))
        return dr.select(domain.holds(wo), found, 0)

    made = mi.chi2.ChiSquareTest(
        Square(domain), sample, density, sample_dim=3, sample_count=SAMPLES, res=CELLS, ires=POINTS, seed=seed
    )
    made.run(quiet=True)
    p = 0.0 if made.fail else float(made.p_value)
    name = called(subject, lobe)
    case = subject.case(figure="chi-square p value; fails below the limit", lobe=name, wi=wi.tolist(), seed=seed)
    said = f"The directions sampled from the lobe {name} are not distributed as its density: p = {p:.2g}."
    return at_least(p, LEVEL, said, case)


def finest(subject: BsdfSubject, wi: np.ndarray, lobe: int | None) -> list[Around]:
    """The domains of a lobe; of all lobes, on each side that of the sharpest."""
    if lobe is not None:
        return around(subject, wi, lobe)
    found = [d for i, part in enumerate(subject.lobes) if part.smooth for d in around(subject, wi, i)]
    sides: dict[int, Around] = {}
    for domain in sorted(found, key=lambda d: -float((d.scale[0] * d.scale[1])[0])):
        side = int(math.copysign(1, float(domain.axes[2].z[0]))) if subject.transmits else 0
        sides[side] = replace(domain, side=side)
    return list(sides.values())


class Square:
    """A domain in Mitsuba's sense: directions by the points of `Around`."""

    def __init__(self, domain: Around) -> None:
        self.domain = domain

    def bounds(self) -> Any:
        return mi.ScalarBoundingBox2f([-1, -1], [1, 1])

    def aspect(self) -> float:
        return 1.0

    def map_forward(self, p: mi.Point2f) -> mi.Vector3f:
        return self.domain.direction(p.x, p.y)

    def map_backward(self, wo: mi.Vector3f) -> mi.Point2f:
        return mi.Point2f(*self.domain.point(wo))
