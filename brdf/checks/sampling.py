"""Are directions drawn as the density says, and weighed by it?

Pearson's chi-square test, which needs Mitsuba, is in ``plugins.checks.chi2``.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from .directions import FEW_AZIMUTHS, incident, pairs, row, stratified
from .domain import around, integral
from .result import Finding, at_most, not_asked, worst
from .subject import Subject
from .values import channels, opaque

#: Angles of incidence [deg].
ANGLES = (0.0, 45.0, 80.0)
#: An integral of the density may exceed 1 by this, beside its uncertainty: what a fold costs the quadrature.
EXCESS = 5e-3
#: A quadrature that still changes by this does not resolve the lobe, and says nothing.
UNRESOLVED = 0.05
#: (float32, float64) How far weight and ``f cos / pdf`` may be apart for all but the worst samples. A rounded direction
#: moves the density of a sharp lobe.
WEIGHT = (2e-2, 1e-6)
#: The share of the samples that is held to it.
QUANTILE = 0.98
#: Samples whose weights are looked at, squared.
SIDE = 64
#: Pairs of directions asked for ``f > 0`` but ``pdf = 0``, and the share of the largest `f` below which it is rounding.
PAIRS, DARK = 20_000, 1e-4


def ask(subject: Subject, seed: int = 0) -> Finding:
    """``integral pdf dw <= 1``, ``weight = f cos / pdf``, and ``pdf > 0`` wherever ``f > 0``."""
    if not subject.smooth:
        return not_asked("All lobes are ideal: there is no density.")
    findings = []
    for lobe in numbers(subject):
        for wi in incident(subject, ANGLES, FEW_AZIMUTHS):
            findings += [normalisation(subject, wi, lobe, seed), weights(subject, wi, lobe, seed)]
        findings.append(support(subject, lobe, seed))
    return worst(findings)


def numbers(subject: Subject) -> list[int | None]:
    """The smooth lobes, and None for all of them together if there are several."""
    smooth: list[int | None] = [i for i, part in enumerate(subject.lobes) if part.smooth]
    return [*smooth, None] if len(subject.lobes) > 1 else smooth


def called(subject: Subject, lobe: int | None) -> str:
    """The name of a lobe."""
    return "all" if lobe is None else subject.lobes[lobe].name


def density_where_it_counts(subject: Subject, wi: Any, wo: Any, lobe: int | None) -> Any:
    """The density, and 0 below a surface that does not transmit: samples there have no weight, and some give them a
    density all the same."""
    density = subject.pdf(wi, wo, lobe)
    return density if subject.transmits else dr.select((wi.z > 0) & (wo.z > 0), density, 0)


def normalisation(subject: Subject, wi: np.ndarray, lobe: int | None, seed: int) -> Finding:
    """Whether the density integrates to 1, or less where directions get lost below the horizon."""
    if lobe is None:
        return not_asked("A sum of densities, each of which is looked at.")
    domains = around(subject, wi, lobe, seed)
    if not domains:
        return not_asked("No direction is sampled.")
    vector = subject.vector
    given = opaque(vector, wi)
    total, change = integral(lambda wo: density_where_it_counts(subject, given, wo, lobe), domains, vector)
    figure = float(total[0])
    if not change <= UNRESOLVED * abs(figure):
        return not_asked("The lobe is not resolved.")
    case = subject.case(figure="integral of the density", lobe=called(subject, lobe), wi=wi.tolist())
    said = f"The density of the lobe {called(subject, lobe)} integrates to {figure:.4g}."
    return at_most(figure, 1 + EXCESS + change, said, case)


def weights(subject: Subject, wi: np.ndarray, lobe: int | None, seed: int) -> Finding:
    """Whether samples weigh ``f cos / pdf``."""
    vector = subject.vector
    u = vector(stratified(SIDE, 1, seed))
    given = vector(*wi.tolist()) + 0 * u
    drawn = subject.draw(given, u, lobe)
    # A sample without weight is one that found no direction. What is lost by that, `energy` sees.
    lit = (channels(drawn.weight) != 0).any(axis=0)
    smooth = ~np.asarray(drawn.ideal, dtype=bool) & (np.asarray(drawn.pdf) > 0) & lit
    if not smooth.any():
        return not_asked("No direction is sampled.")
    wo = vector(drawn.wo)
    both = subject.adjoint(given, wo, lobe) * abs(wo.z), subject.pdf(given, wo, lobe)
    dr.eval(both)
    value, density = (channels(x) for x in both)
    got = channels(drawn.weight) * density
    difference = np.abs(got - value).max(axis=0)
    larger = np.maximum(np.abs(got), np.abs(value)).max(axis=0)
    stated = np.abs(channels(drawn.pdf) - density)[0] / np.maximum(density[0], 1e-30)
    with np.errstate(invalid="ignore"):
        apart = np.maximum(np.where(larger > 0, difference / np.where(larger > 0, larger, 1), 0), stated)
    apart = np.where(np.isfinite(apart), apart, np.inf)
    ranked = np.flatnonzero(smooth)[np.argsort(apart[smooth])]
    index = int(ranked[int(QUANTILE * (len(ranked) - 1))])
    case = subject.case(
        figure=f"|weight - f cos / pdf| relative, of all but {1 - QUANTILE:.0%} of the samples",
        lobe=called(subject, lobe),
        wi=wi.tolist(),
        wo=row(wo, index),
        u=row(u, index),
        weight=channels(drawn.weight)[:, index].tolist(),
        f_cos=value[:, index].tolist(),
        pdf=float(density[0, index]),
    )
    said = f"Samples of the lobe {called(subject, lobe)} do not weigh f cos / pdf, but differ by {apart[index]:.3g}."
    return at_most(float(apart[index]), WEIGHT[subject.double], said, case)


def support(subject: Subject, lobe: int | None, seed: int) -> Finding:
    """Whether every direction that matters can be sampled."""
    wi, wo = pairs(subject, PAIRS, seed)
    both = subject.f(wi, wo, lobe) * abs(wo.z), subject.pdf(wi, wo, lobe)
    dr.eval(both)
    value, density = channels(both[0]).max(axis=0), channels(both[1])[0]
    lost = (value > DARK * value.max(initial=0)) & ~(density > 0)
    index = int(np.argmax(np.where(lost, value, -1)))
    case = subject.case(
        figure="share of the pairs with f > 0 and pdf = 0",
        lobe=called(subject, lobe),
        wi=row(wi, index),
        wo=row(wo, index),
    )
    said = f"There are directions in which the lobe {called(subject, lobe)} reflects, and that are never sampled."
    return at_most(float(lost.mean()), 0.0, said, case)
