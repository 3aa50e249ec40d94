"""Does a reflection model give the same with the two directions exchanged?"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np

from .directions import hemisphere, pairs, row
from .result import Finding, at_most, worst
from .subject import BELOW_ONE, Subject
from .values import channels

#: Pairs of directions whose exchange is tried, and directions that are sent through an ideal lobe and back.
PAIRS, RAYS = 30_000, 2_000
#: (float32, float64) The difference allowed. Single precision loses three digits where the angle of a facet is taken
#: from a rounded half vector, as Mitsuba's own do.
LIMIT = (1e-3, 1e-9)
#: (float32, float64) Values below this share of the largest are rounding beside a sharp lobe, and are left out.
FLOOR = (1e-6, 1e-12)
#: (float32, float64) What may be lost on the way through an ideal lobe and back.
RETURN = (1e-3, 1e-6)

#: Directions are moved by a rounding this often, and what comes of it counts this many times.
TREMBLES, MARGIN = 4, 4.0
#: (float32, float64) The least cosine of a direction that is sent through an ideal lobe: nearer to grazing, its
#: rounding on the way changes the power.
STEEP = (0.05, 1e-4)

Direction = tuple[float, float, float]


def ask(subject: Subject, seed: int = 0) -> Finding:
    """The largest relative difference between ``f(wi, wo)`` and ``adjoint(wo, wi)``, and for ideal lobes between the
    power that goes there and the power that comes back, or between the directions."""
    findings = []
    if subject.smooth:
        wi, wo = pairs(subject, PAIRS, seed)
        floor = FLOOR[subject.double]
        difference, (i, o) = reciprocity(subject.f, wi, wo, floor, subject.adjoint)
        if LIMIT[subject.double] < difference < np.inf:
            doubt = trembling(subject, wi, wo, seed)
            difference, (i, o) = reciprocity(subject.f, wi, wo, floor, subject.adjoint, doubt)
        there, back = (
            channels(value).max(axis=1).tolist()
            for value in (
                subject.f(subject.vector(*i), subject.vector(*o)),
                subject.adjoint(subject.vector(*o), subject.vector(*i)),
            )
        )
        case = subject.case(figure="|f(wi, wo) - f(wo, wi)| / the larger", wi=i, wo=o, there=there, back=back)
        said = f"f(wi, wo) and f(wo, wi) differ by {difference:.3g} of the larger."
        findings.append(at_most(difference, LIMIT[subject.double], said, case))
    for number, part in enumerate(subject.lobes):
        if part.ideal and not part.smooth:
            findings.append(there_and_back(subject, number, seed))
    return worst(findings)


def trembling(subject: Subject, wi: Any, wo: Any, seed: int) -> np.ndarray:
    """How much the values move when the directions do by about a rounding: more than that cannot be asked of them."""
    rng = np.random.default_rng(seed)
    n = channels(wi).shape[1]
    rounding = 2.0**-52 if subject.double else 2.0**-23
    found: list[list[np.ndarray]] = [[], []]
    for _ in range(TREMBLES):
        i, o = (w * subject.vector(1 + rounding * rng.uniform(-1, 1, (3, n))) for w in (wi, wo))
        found[0].append(channels(subject.f(i, o)))
        found[1].append(channels(subject.adjoint(o, i)))
    return sum((np.ptp(np.array(values), axis=0) for values in found), np.zeros(1)) * MARGIN


def there_and_back(subject: Subject, lobe: int, seed: int) -> Finding:
    """Through an ideal lobe and back again: the same direction and the same share of the power."""
    vector = subject.vector
    rng = np.random.default_rng(seed)
    given = hemisphere(RAYS, rng)
    if subject.transmits:
        given[2] *= np.where(rng.random(RAYS) < 0.5, -1, 1)
    wi = vector(given)
    u = vector(np.minimum(rng.random((3, RAYS)), BELOW_ONE))
    there = subject.draw(wi, u, lobe)
    back = subject.draw(vector(there.wo), u, lobe)
    powers = [channels(s.weight * s.pdf) for s in (there, back)]
    steep = np.minimum(np.abs(given[2]), np.abs(channels(there.wo)[2])) > STEEP[subject.double]
    lit = (powers[0].max(axis=0) > 0) & steep
    larger = np.maximum(*(np.abs(p) for p in powers))
    power = (np.abs(powers[0] - powers[1]) / np.where(larger > 0, larger, 1)).max(axis=0)
    turned = np.abs(channels(back.wo) - channels(wi)).max(axis=0)
    difference = np.where(lit, np.maximum(power, turned), 0)
    difference = np.where(np.isfinite(difference), difference, np.inf)
    index = int(np.argmax(difference))
    figure = float(difference[index])
    case = subject.case(
        figure="relative difference of the power there and back, or of the direction",
        lobe=subject.lobes[lobe].name,
        wi=row(wi, index),
        wo=row(there.wo, index),
        there=powers[0][:, index].tolist(),
        back=powers[1][:, index].tolist(),
    )
    said = f"Light sent through the lobe {subject.lobes[lobe].name} does not come back as it went: {figure:.3g} off."
    return at_most(figure, RETURN[subject.double], said, case)


def reciprocity(
    f: Callable[[Any, Any], Any],
    wi: Any,
    wo: Any,
    floor: float = 0.0,
    adjoint: Callable[[Any, Any], Any] | None = None,
    doubt: np.ndarray | float = 0.0,
) -> tuple[float, tuple[Direction, Direction]]:
    """The largest relative difference between ``f(wi, wo)`` and ``f(wo, wi)``.

    ``max |a - b| / max(|a|, |b|)`` over all pairs and channels.

    Parameters
    ----------
    f : callable
        The BRDF [1/sr], without cosine, of two Dr.Jit 3-vectors; a number or a colour for each pair.
    wi, wo : Dr.Jit 3-vectors of n directions
    floor : float
        Pairs are left out where both values are below `floor` times the largest value found [1].
    adjoint : callable
        Used for ``(wo, wi)``, if it is not `f` itself: see `Subject.adjoint`.
    doubt : array of shape (channels, n)
        A difference counts as far as it exceeds this.

    Returns
    -------
    (float, (wi, wo))
        The difference, in [0, 2] (inf where a value is not finite), and the pair of directions where it was found.
    """
    both = f(wi, wo), (adjoint or f)(wo, wi)
    dr.eval(both)
    there, back = (channels(value) for value in both)
    larger = np.maximum(np.abs(there), np.abs(back))
    peak = np.max(larger, initial=0.0, where=np.isfinite(larger))
    counts = (larger > 0) & ~(larger < floor * peak)
    with np.errstate(invalid="ignore"):
        difference = np.where(counts, np.maximum(np.abs(there - back) - doubt, 0) / np.where(counts, larger, 1), 0)
    difference = np.where(np.isfinite(there) & np.isfinite(back), difference, np.inf).max(axis=0)
    worst = int(np.argmax(difference))
    i, o = (np.broadcast_to(channels(w), (3, difference.size))[:, worst].tolist() for w in (wi, wo))
    return float(difference[worst]), (tuple(i), tuple(o))
