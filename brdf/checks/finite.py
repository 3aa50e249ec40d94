"""Is everything finite and nothing negative, for hostile inputs?"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import drjit as dr
import numpy as np

from .directions import at_angle, row
from .gradient import moved
from .result import Finding, at_most
from .subject import BELOW_ONE, Subject
from .values import channels

#: Cosines of directions that touch the surface.
GRAZING = (1e-7, 1e-4)
#: Coordinates of the random numbers.
CORNERS = (0.0, 0.5, BELOW_ONE)


def hostile() -> np.ndarray:
    """Directions, shape (3, n): along the normal, oblique, grazing, tangent, and the same from below."""
    above = [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (-0.6, 0.0, 0.8), (0.0, -0.96, 0.28), tuple(at_angle(80.0, 30.0))]
    above += [(sign * math.sqrt(1 - z * z), 0.0, z) for z in GRAZING for sign in (1, -1)]
    tangent = [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    below = [(x, y, -z) for x, y, z in above]
    return np.array(above + tangent + below).T


def ask(subject: Subject, seed: int = 0) -> Finding:
    """How many values, densities, weights and derivatives are not finite, or negative where they may not be.

    `seed` is not used: the inputs are always the same.
    """
    vector = subject.vector
    w = hostile()
    n = w.shape[1]
    wi, wo = vector(np.repeat(w, n, axis=1)), vector(np.tile(w, (1, n)))
    cube = np.array(np.meshgrid(CORNERS, CORNERS, CORNERS)).reshape(3, -1)
    seen, u = vector(np.repeat(w, cube.shape[1], axis=1)), vector(np.tile(cube, (1, n)))
    bad, first = 0, {}
    for what, value, signed, inputs in asked(subject, wi, wo, seen, u):
        array = channels(value)
        wrong = ~np.isfinite(array) | ((array < 0) & (not signed))
        wrong = wrong.any(axis=0)
        if wrong.any() and not first:
            i = int(np.argmax(wrong))
            first = {"of": what, "value": [str(x) for x in array[:, i]]}
            first |= {name: row(x, i) for name, x in inputs.items()}
        bad += int(wrong.sum())
    case = subject.case(figure="number of values that are not finite, or negative", **first)
    said = f"{first.get('of')} is {', '.join(dict.fromkeys(first.get('value', [])))}." if first else ""
    return at_most(float(bad), 0.0, said, case)


def asked(subject: Subject, wi: Any, wo: Any, seen: Any, u: Any) -> Iterator[tuple[str, Any, bool, dict[str, Any]]]:
    """What is computed, its value, whether it may be negative, and from which inputs."""
    here, drawn = {"wi": wi, "wo": wo}, {"wi": seen, "u": u}
    f, pdf, sample = subject.f(wi, wo), subject.pdf(wi, wo), subject.sample(seen, u)
    dr.eval(f, pdf, sample)
    yield "f", f, False, here
    yield "pdf", pdf, False, here
    yield "the weight of a sample", sample.weight, False, drawn
    yield "the density of a sample", sample.pdf, False, drawn
    yield "a sampled direction", dr.select(sample.pdf > 0, sample.wo, 0), True, drawn
    ideal = [i for i, part in enumerate(subject.lobes) if part.ideal and not part.smooth]
    for quantity in subject.quantities():
        base = subject.get(quantity.name)
        t = dr.value_t(subject.vector)(0)
        dr.enable_grad(t)
        subject.set(quantity.name, base + moved(base, t))
        try:
            values = [(subject.f(wi, wo), here)] if subject.smooth else []
            values += [(subject.sample(seen, u, i).weight, drawn) for i in ideal]
            for value, inputs in values:
                if dr.grad_enabled(value):
                    dr.set_grad(t, 1)
                    gradient = dr.forward_to(value, flags=dr.ADFlag.ClearNone)
                    yield f"the derivative in {quantity.name}", gradient, True, inputs
        finally:
            subject.set(quantity.name, base)
