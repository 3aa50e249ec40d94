"""Are directions distributed as the density says? Pearson's chi-square test, as Mitsuba has it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
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
#: Samples that are counted, and cells along a side of the square.
SAMPLES, CELLS = 400_000, 61
#: Points along a side of a cell at which the density is taken, twice. A cell in which that makes a difference of more
#: than this many standard deviations of its count is left out: an edge or a fold of the density runs through it.
POINTS, UNRESOLVED = (6, 12), 0.3
#: With less than this share of the samples in the other cells, nothing is told.
KEPT = 0.3
#: The part of a square that counts as near its lobe, up to the edge of a cell: ``s`` up to ten times the scale.
CORE = 1 - 2 * 3 / CELLS
#: Where fewer are expected and found, there is nothing to test.
FEW = 500
#: Samples expected in a cell whose density is 0 at all points: a corner of it may still reach above the horizon.
LEAST = 1e-3


def ask(subject: BsdfSubject, seed: int = 0) -> Finding:
    """The smallest p value over the smooth lobes, each by itself and all together, and some angles of incidence."""
    if not subject.smooth:
        return not_asked("All lobes are ideal: there is no density.")
    found = [
        test(subject, wi, lobe, region, seed)
        for lobe in numbers(subject)
        for wi in incident(subject, ANGLES, FEW_AZIMUTHS)
        for region in regions(subject, wi, lobe)
    ]
    return worst(found) if found else not_asked("No direction is sampled.")


@dataclass(frozen=True)
class Region:
    """Directions counted together, in cells of `domain`: if `core` only near its lobe, and not near `without`."""

    domain: Around
    core: bool = False
    without: tuple[Around, ...] = ()

    def holds(self, w: mi.Vector3f) -> mi.Bool:
        inside = self.domain.holds(w)
        if self.core:
            inside &= near(self.domain, w)
        for other in self.without:
            inside &= ~(other.holds(w) & near(other, w))
        return inside


def near(domain: Around, w: mi.Vector3f) -> mi.Bool:
    """Whether a direction is within a lobe, taken ten times as wide as half of it is."""
    x, y = domain.point(w)
    return dr.maximum(dr.abs(x), dr.abs(y)) < CORE


def regions(subject: BsdfSubject, wi: np.ndarray, lobe: int | None) -> list[Region]:
    """Where a lobe is counted; all lobes together about each of them, the sharpest first, and each direction once."""
    if lobe is not None:
        return [Region(domain) for domain in around(subject, wi, lobe)]
    found = [d for i, part in enumerate(subject.lobes) if part.smooth for d in around(subject, wi, i)]
    if subject.transmits:
        found = [replace(d, side=int(math.copysign(1, float(d.axes[2].z[0])))) for d in found]
    found.sort(key=lambda d: float((d.scale[0] * d.scale[1])[0]))
    widest = {domain.side: domain for domain in found}
    made: list[Region] = []
    for i, domain in enumerate(found):
        sharper = tuple(d for d in found[:i] if d.side == domain.side)
        made.append(Region(domain, domain is not widest[domain.side], sharper))
    return made


def test(subject: BsdfSubject, wi: np.ndarray, lobe: int | None, region: Region, seed: int) -> Finding:
    """One test: a lobe, or all, seen from `wi`."""
    given = opaque(mi.Vector3f, wi)
    domain = region.domain

    def sample(u: mi.Vector3f, black: bool) -> tuple[mi.Vector3f, mi.Float]:
        drawn = subject.sample(given + 0 * u, u, lobe)
        counts = dr.any(drawn.weight != 0)
        if black:
            counts |= dr.all(subject.f(given, drawn.wo, lobe) == 0) & (dense(drawn.wo) > 0)
        good = ~drawn.ideal & (drawn.pdf > 0) & counts & region.holds(drawn.wo)
        return dr.select(good, drawn.wo, domain.axes[2]), dr.select(good, mi.Float(1), 0)

    def dense(wo: mi.Vector3f) -> mi.Float:
        return density_where_it_counts(subject, given, wo, lobe)

    def density(wo: mi.Vector3f) -> mi.Float:
        return dr.select(region.holds(wo), dense(wo) * domain.area(*domain.point(wo)), 0)

    def made(points: int, black: bool = False) -> mi.chi2.ChiSquareTest:
        return mi.chi2.ChiSquareTest(
            Square(domain),
            partial(sample, black=black),
            density,
            sample_dim=3,
            sample_count=SAMPLES,
            res=CELLS,
            ires=points,
            seed=seed,
        )

    coarse, fine = (made(points) for points in POINTS)
    coarse.tabulate_pdf()
    fine.tabulate_pdf()
    fine.tabulate_histogram()
    expected = float(dr.sum(fine.pdf)[0])
    if expected < FEW and float(dr.sum(fine.histogram)[0]) < FEW:
        return not_asked("Nothing is sampled there.")
    change = dr.abs(fine.pdf - coarse.pdf)
    resolved = ~(change > UNRESOLVED * dr.sqrt(dr.maximum(fine.pdf, 1)))
    kept = float(dr.sum(dr.select(resolved, fine.pdf, 0))[0])
    if kept < KEPT * expected:
        return not_asked("The lobe is not resolved.")
    table = dr.select(resolved, dr.select(fine.pdf == 0, LEAST, fine.pdf), LEAST)
    p = 0.0
    # A sample without weight may be one in whose direction the lobe is black, or one that found no direction.
    for black in (False, True):
        counted = made(POINTS[1], black)
        counted.tabulate_histogram()
        counted.histogram = dr.select(resolved, counted.histogram, 0)
        counted.pdf, counted.pdf_sum = table, fine.pdf_sum
        counted.histogram_start, counted.histogram_end = fine.histogram_start, fine.histogram_end
        counted.fail |= fine.fail
        counted.run(quiet=True)
        p = 0.0 if counted.fail else float(counted.p_value)
        if p >= LEVEL:
            break
    name = called(subject, lobe)
    case = subject.case(
        figure="chi-square p value; fails below the limit",
        lobe=name,
        wi=wi.tolist(),
        seed=seed,
        resolved=kept / expected,
    )
    said = f"The directions sampled from the lobe {name} are not distributed as its density: p = {p:.2g}."
    return at_least(p, LEVEL, said, case)


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
