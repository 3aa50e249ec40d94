"""The formulas of `brdf.hard` as books print them, with derivatives and condition numbers, in 100 digits.

No code and no rewriting is shared with brdf: what cancels, the digits absorb. Inputs are float32 numbers, so directions are
not quite of unit length; what a formula means then is agreed on: cosines are ``wi.z`` and ``wo.z``; of the half vector
``tan^2 = (h.x^2 + h.y^2) / h.z^2``; between light and facet ``cos^2 = H / (H + Q)`` with ``H = |wi + wo|^2`` and
``Q = |wi - wo|^2``. On directions of unit length this is the plain vector formula.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from multiprocessing import Pool
from types import SimpleNamespace
from typing import Any, NamedTuple

import mpmath
import numpy as np
from mpmath import mp, mpf

from brdf.hard import FORMULAS, Exact, Formula
from tests.oracles import bricks, layered, microfacets

DIGITS = 120
#: Step of the differences, relative or, at 0, as it is: what they cut off is beyond float64; what they cancel leaves digits.
STEP, STEP_AT_ZERO = mpf(2) ** -90, mpf(2) ** -180
#: A derivative of this size is one of 0, and so is one that a step smaller by NEARER more than halves: it is what the step
#: has left of a second derivative, which next to the critical angle is large.
NOTHING, NEARER = mpf(10) ** -45, mpf(2) ** -20

#: By the name of a formula, functions of its arguments; by the name of a model, of (model, wi, wo, parameters).
BRICKS: dict[str, bricks.Answer] = {**bricks.ANSWERS, **layered.BY_NAME}
MODELS: dict[str, bricks.Answer] = {**microfacets.ANSWERS, **layered.ANSWERS}


def answer(formula: Formula) -> bricks.Answer:
    """A formula's exact form as functions of its arguments in order."""
    model = formula.model
    if model is None:
        return BRICKS[formula.name]

    def of(function: Callable[..., Any] | None) -> Callable[..., Any] | None:
        return function and (
            lambda *x: function(
                model, x[:3], x[3:6], SimpleNamespace(**dict(zip(formula.inputs[6:], x[6:], strict=True)))
            )
        )

    value, *others = MODELS[model.name]
    return bricks.Answer(of(value) or value, *(of(f) for f in others))


class Jet(NamedTuple):
    """What `brdf.hard.Exact` has of one point."""

    value: float
    value_scale: float
    slope: list[float]
    slope_scale: list[float]
    peak: float
    kink: float


def jet(function: Callable[..., Any], x: Sequence[Any], by: Sequence[int]) -> tuple[Any, Any, list[Any], list[Any]]:
    """Value, its scale, derivatives by some arguments, and their scales. By forward differences."""

    def at(*steps: int, part: Any = 1) -> Any:
        moved = list(x)
        for i in steps:
            moved[i] += h[i] * part
        return function(*moved)

    def vanishes(p: int) -> bool:
        """The derivative at 0, which is all step."""
        return abs(d[p]) <= NOTHING or abs(at(p, part=NEARER) - f) < abs(d[p] * h[p] * NEARER) / 2

    h = [abs(v) * STEP if v else STEP_AT_ZERO for v in x]
    f, n = at(), range(len(x))
    one = [at(i) for i in n]
    d = [(one[i] - f) / h[i] for i in n]
    value_scale = abs(f) + mpmath.fsum(abs(x[i] * d[i]) for i in n)
    slopes, scales = [], []
    for p in by:
        moves = [abs(x[i] * (at(p, i) - one[p] - one[i] + f) / (h[p] * h[i])) for i in n if x[i]]
        slopes.append(mpf(0) if not x[p] and vanishes(p) else d[p])
        scales.append(abs(d[p]) + mpmath.fsum(moves) + (abs(f / x[p]) if x[p] else 0))
    return f, value_scale, slopes, scales


def at_point(name: str, column: Any) -> Jet:
    with mp.workdps(DIGITS):
        formula = FORMULAS[name]
        given, x = answer(formula), [mpf(float(v)) for v in column]
        f, scale, slopes, scales = jet(given.value, x, [formula.inputs.index(p) for p in formula.by])
        peak = given.peak(*x) if given.peak else abs(f)
        kink = given.kink(*x) if given.kink else mpmath.inf
        return Jet(
            float(f), float(scale), [float(s) for s in slopes], [float(s) for s in scales], float(peak), float(kink)
        )


def exact(formula: Formula, inputs: Any, processes: int = 2) -> Exact:
    """The exact answers of a formula at some points, shape (n_in, n)."""
    with Pool(processes) as pool:
        jets = pool.starmap(at_point, [(formula.name, column) for column in inputs.T], chunksize=16)
    columns = [np.array(c) for c in zip(*jets, strict=True)]
    for i in (2, 3):
        columns[i] = columns[i].reshape(len(jets), len(formula.by)).T
    return Exact(inputs, *columns)
