"""How much of the light does a reflection model reflect? No more than arrives, if it is physical."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..geometry import cosine_hemisphere
from ..model import Model, Values
from .directions import ANGLES, FEW_AZIMUTHS, incident, stratified
from .domain import around, integral
from .result import Finding, at_most, not_asked, worst
from .subject import Subject
from .values import channels, opaque

#: Independent repetitions, whose spread gives the standard error.
BATCHES = 16
#: Each of them has this many directions of a check, squared.
SIDE = 32
#: An albedo may exceed 1 by this many standard errors and by rounding.
SIGMA, ROUNDING = 4.0, 1e-5
#: Angles from the normal at which the mean weight of samples is compared with a quadrature [deg].
COMPARED = (0.0, 45.0, 80.0)
#: They may differ by this, beside what either is uncertain by: a fold in a lobe costs the quadrature some digits.
AGREEMENT = 5e-3
#: A quadrature that still changes by this share does not resolve the lobe, and says nothing.
UNRESOLVED = 0.05

Weight = Callable[[Any, Any], Any]


class Albedo(NamedTuple):
    """The largest directional albedo of any channel, its standard error, and where."""

    value: float
    error: float
    wi: list[float]


def ask(subject: Subject, seed: int = 0) -> Finding:
    """The largest directional albedo of each lobe, and whether sampling finds what a quadrature finds."""
    findings = []
    for number, part in enumerate(subject.lobes):
        findings.append(brightness(subject, number, part.name, seed))
        if part.smooth and not part.ideal:
            findings += agreement(subject, number, seed)
    return worst(findings)


def ask_sum(subject: Subject, seed: int = 0) -> Finding:
    """The largest directional albedo of all lobes together."""
    if len(subject.lobes) == 1:
        return not_asked("There is one lobe: nothing to couple.")
    return brightness(subject, None, "all", seed)


def brightness(subject: Subject, lobe: int | None, name: str, seed: int) -> Finding:
    """Whether a lobe, or all of them, sends out no more power than arrives."""
    found = brightest(subject, incident(subject, ANGLES), lobe, seed)
    limit = 1 + SIGMA * (found.error if math.isfinite(found.error) else 0) + ROUNDING
    case = subject.case(figure="directional albedo", lobe=name, wi=found.wi, standard_error=found.error)
    angle = math.degrees(math.acos(min(1.0, abs(found.wi[2]))))
    who = "All lobes together send" if lobe is None else f"The lobe {name} sends"
    return at_most(found.value, limit, f"{who} out {found.value:.4g} of the light that comes at {angle:.4g} deg.", case)


def brightest(subject: Subject, directions: list[npt.NDArray[np.float64]], lobe: int | None, seed: int) -> Albedo:
    """The largest mean weight of samples over some directions of incidence."""
    vector = subject.vector
    n = BATCHES * SIDE * SIDE
    u = vector(np.tile(stratified(SIDE, BATCHES, seed), len(directions)))
    wi = vector(np.repeat(np.array(directions).T, n, axis=1))
    drawn = subject.draw(wi, u, lobe)
    weights = channels(drawn.weight)
    weights = np.broadcast_to(weights, (len(weights), n * len(directions)))
    found = [summarise(w.reshape(len(w), BATCHES, -1)) for w in np.split(weights, len(directions), axis=1)]
    at = max(range(len(found)), key=lambda i: found[i][0] if math.isfinite(found[i][0]) else math.inf)
    return Albedo(*found[at], directions[at].tolist())


def agreement(subject: Subject, lobe: int, seed: int) -> list[Finding]:
    """Whether the mean weight of samples is the integral of ``f cos``."""
    findings = []
    vector = subject.vector
    part = subject.lobes[lobe]
    for wi in incident(subject, COMPARED, FEW_AZIMUTHS):
        domains = around(subject, wi, lobe, seed)
        if not domains:
            continue
        given = opaque(vector, wi)

        def power(wo: Any, given: Any = given) -> Any:
            return subject.adjoint(given, wo, lobe) * abs(wo.z)

        want, change = integral(power, domains, vector)
        got, error, _ = brightest(subject, [wi], lobe, seed)
        expected = float(want.max())
        if not change <= UNRESOLVED * abs(expected):
            continue
        allowed = SIGMA * error + change + AGREEMENT * max(abs(expected), 1e-3)
        case = subject.case(
            figure="|mean weight of samples - integral of f cos|",
            lobe=part.name,
            wi=wi.tolist(),
            sampled=got,
            integrated=expected,
        )
        said = f"The weights of samples of the lobe {part.name} add up to {got:.4g}, f cos to {expected:.4g}."
        finding = at_most(abs(got - expected), allowed, said, case)
        if not finding.passed:
            findings.append(finding)
    return findings


def albedo(weight: Weight, mu: float, like: Any, side: int = 64, seed: int = 0) -> tuple[float, float]:
    """Directional albedo ``integral f(wi, wo) wo.z dwo`` by stratified sampling.

    Parameters
    ----------
    weight : callable
        ``f cos / pdf`` of a direction sampled for a Dr.Jit 3-vector `wi` from `u` in [0, 1)^3: see `cosine_weight` and
        `lobe_weight`. A number or a colour for each.
    mu : float
        Cosine of the angle between `wi` and the normal, in (0, 1] [1].
    like : type of Dr.Jit 3-vector
        Precision and backend: ``drjit.llvm.ad.Array3f`` and so on.
    side : int
        Each of 16 batches has ``side^2`` samples.
    seed : int

    Returns
    -------
    (float, float)
        The albedo of the channel that reflects most, and its standard error [1].
    """
    wi = like(math.sqrt((1 - mu) * (1 + mu)), 0, mu)
    u = like(*stratified(side, BATCHES, seed))
    found = channels(weight(wi, u))
    n = BATCHES * side * side
    return summarise(np.broadcast_to(found, (len(found), n)).reshape(-1, BATCHES, side * side))


def cosine_weight(f: Callable[[Any, Any], Any]) -> Weight:
    """The weight of cosine-distributed directions, ``pi f``: for any smooth BRDF `f` [1/sr], of two 3-vectors."""

    def weight(wi: Any, u: Any) -> Any:
        return f(wi, cosine_hemisphere(u, u)) * dr.pi

    return weight


def lobe_weight(model: Model, p: Values) -> Weight:
    """The weight of directions from the model's own sampling, each lobe sampled by itself: for sharp lobes as well."""

    def weight(wi: Any, u: Any) -> Any:
        total: Any = 0
        for i in range(len(model.lobes)):
            wo = model.sample(p, wi, u, i)
            up = wo.z > 0
            wo = type(wo)(wo.x, wo.y, dr.select(up, wo.z, 1))
            density = model.pdf(p, wi, wo)[i]
            good = up & (density > 0)
            total += dr.select(good, model.f(p, wi, wo)[i] * (wo.z / dr.select(good, density, 1)), 0)
        return total

    return weight


def summarise(weights: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Mean and its standard error, of the channel that reflects most, from weights of shape (channels, batches, n)."""
    means = weights.mean(axis=2)
    most = int(np.argmax(means.mean(axis=1)))
    return float(means[most].mean()), float(means[most].std(ddof=1) / math.sqrt(means.shape[1]))
