"""The formulas of `brdf.hard` as books print them, with derivatives and condition numbers, in 120 digits.

No code and no rewriting is shared with brdf: what cancels, the digits absorb. Inputs are float32 numbers, so directions are
not quite of unit length; what a formula means then is agreed on: cosines are ``wi.z`` and ``wo.z``; of the half vector
``tan^2 = (h.x^2 + h.y^2) / h.z^2``; between light and facet ``cos^2 = H / (H + Q)`` with ``H = |wi + wo|^2`` and
``Q = |wi - wo|^2``. On directions of unit length this is the plain vector formula.
"""

from __future__ import annotations

from collections.abc import Callable
from multiprocessing import Pool
from types import SimpleNamespace
from typing import Any

import mpmath
import numpy as np
from mpmath import mp, mpf

from brdf.hard import FORMULAS, Exact, Formula
from brdf.hard.jet import DIGITS, jet
from tests.oracles import bricks, glossy, layered, microfacets

#: By the name of a formula, functions of its arguments; by the name of a model, of (model, wi, wo, parameters).
BRICKS: dict[str, bricks.Answer] = {**bricks.ANSWERS, **layered.BY_NAME}
MODELS: dict[str, bricks.Answer] = {**microfacets.ANSWERS, **glossy.ANSWERS, **layered.ANSWERS}


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


def at_point(name: str, column: Any) -> tuple[Any, ...]:
    """What `Exact` has of one point."""
    with mp.workdps(DIGITS):
        formula = FORMULAS[name]
        given, x = answer(formula), [mpf(float(v)) for v in column]
        found = jet(given.value, x, [formula.inputs.index(p) for p in formula.by])
        peak = given.peak(*x) if given.peak else abs(found.value)
        kink = given.kink(*x) if given.kink else mpmath.inf
        slopes = ([float(s) for s in column] for column in found[2:])
        return float(found.value), float(found.value_scale), *slopes, float(peak), float(kink)


def exact(formula: Formula, inputs: Any, processes: int = 2) -> Exact:
    """The exact answers of a formula at some points, shape (n_in, n)."""
    with Pool(processes) as pool:
        points = pool.starmap(at_point, [(formula.name, column) for column in inputs.T], chunksize=16)
    columns = [np.array(c) for c in zip(*points, strict=True)]
    for i in (2, 3):
        columns[i] = columns[i].reshape(len(points), len(formula.by)).T
    return Exact(inputs, *columns)
