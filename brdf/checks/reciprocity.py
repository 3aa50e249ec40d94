"""Does a reflection model give the same with the two directions exchanged?"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

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

Direction = tuple[float, float, float]


def ask(subject: Subject, seed: int = 0) -> Finding:
    """The largest relative difference between ``f(wi, wo)`` and ``adjoint(wo, wi)``, and for ideal lobes between the
    power that goes there and the power that comes back, or between the directions."""
    findings = []
    if subject.smooth:
        wi, wo = pairs(subject, PAIRS, seed)
        difference, (i, o) = reciprocity(subject.f, wi, wo, FLOOR[subject.double], subject.adjoint)
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


def there_and_back(subject: Subject, lobe: int, seed: int) -> Finding:
    """Through an ideal lobe and back again: the same direction and the same share of the power."""
    vector = subject.vector
    rng = np.random.default_rng(seed)
    given = hemisphere(RAYS, rng)
    if subject.transmits:
        given[2] *= np.where(rng.random(RAYS) < 0.5, -1, 1)
    wi = vector(given)
    u = vector(np.minimum(rng.random((3, RAYS)), BELOW_ONE))
    there = subject.sample(wi, u, lobe)
    back = subject.sample(vector(there.wo), u, lobe)
    powers = [channels(s.weight * s.pdf) for s in (there, back)]
    lit = powers[0].max(axis=0) > 0
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
    return at_most(figure, LIMIT[0], said, case)  # directions are rounded on the way, in float64 also at grazing


def reciprocity(
    f: Callable[[Any, Any], Any],
    wi: Any,
    wo: Any,
    floor: float = 0.0,
    adjoint: Callable[[Any, Any], Any] | None = None,
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

    Returns
    -------
    (float, (wi, wo))
        The difference, in [0, 2] (inf where a value is not finite), and the pair of directions where it was found.
    """
    there, back = channels(f(wi, wo)), channels((adjoint or f)(wo, wi))
    larger = np.maximum(np.abs(there), np.abs(back))
    peak = np.max(larger, initial=0.0, where=np.isfinite(larger))
    counts = (larger > 0) & ~(larger < floor * peak)
    with np.errstate(invalid="ignore"):
        difference = np.where(counts, np.abs(there - back) / np.where(counts, larger, 1), 0)
    difference = np.where(np.isfinite(there) & np.isfinite(back), difference, np.inf).max(axis=0)
    worst = int(np.argmax(difference))
    i, o = (np.broadcast_to(channels(w), (3, difference.size))[:, worst].tolist() for w in (wi, wo))
    return float(difference[worst]), (tuple(i), tuple(o))
