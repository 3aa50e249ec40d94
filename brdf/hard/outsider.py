"""A model that comes with no table: against its own formula in mpmath if it has one, else float32 against float64."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..errors import DataError
from ..model import Model
from .criterion import compute
from .formulas import Formula, Limits, whole
from .grid import Array
from .table import Exact

#: Asked of a model that states no limits of its own: as of Fresnel's formulas.
LIMITS = Limits(8, 16)
POINTS = 500
#: The relative step by which inputs are moved to see what rounding them does.
STEP = 2.0**-26


def formula(model: Model) -> Formula:
    """The model under its choices, over the bounds of its parameters; half vectors near the normal on all scales."""
    return whole(model, LIMITS, {}, None)


def has_exact(model: Model) -> bool:
    """Whether the model states its formula in mpmath."""
    return type(model).exact is not Model.exact


def by_mpmath(formula: Formula, inputs: Array, progress: Callable[[int], None] | None = None) -> Exact:
    """Exact answers from `Model.exact`.

    Raises
    ------
    DataError
        mpmath is not installed, or the formula raises.
    """
    try:
        from mpmath import mp, mpf

        from .jet import DIGITS, jet
    except ImportError:
        raise DataError("a formula in mpmath needs mpmath: pip install mpmath gmpy2.") from None
    model = formula.model
    assert model is not None

    def value(*x: Any) -> Any:
        p = SimpleNamespace(**dict(zip(formula.inputs[6:], x[6:], strict=True)))
        return model.exact(p, x[:3], x[3:6])

    found = []
    by = [formula.inputs.index(name) for name in formula.by]
    with mp.workdps(DIGITS):
        for i, column in enumerate(inputs.T):
            where = ", ".join(f"{n} = {x:.9g}" for n, x in zip(formula.inputs, column, strict=True))
            try:
                found.append(
                    [np.asarray(part, dtype=float) for part in jet(value, [mpf(float(x)) for x in column], by)]
                )
            except Exception as error:  # whatever somebody else's code may raise
                said = f"{type(error).__name__}: {error}"
                raise DataError(f"{formula.name}: exact failed at {where}: {said}.") from error
            if not np.isfinite(found[-1][0]):
                raise DataError(f"{formula.name}: exact is {found[-1][0]} at {where}. It is to be a number.")
            if progress:
                progress(i + 1)
    f, scale, slope, slope_scale = (np.array(column) for column in zip(*found, strict=True))
    return without_kinks(inputs, f, scale, slope.T, slope_scale.T)


def by_float64(formula: Formula, inputs: Array) -> Exact:
    """What float64 says, and condition numbers from moving each input by a little."""
    at = compute(formula, inputs, "float64")
    size, slope_size = np.abs(at.value), np.abs(at.reverse)
    p = inputs[[formula.inputs.index(name) for name in formula.by]].reshape(-1, inputs.shape[1])
    slope_size = slope_size + np.abs(at.value / np.where(p == 0, np.inf, p))
    with np.errstate(all="ignore"):
        for i in range(len(inputs)):
            moved = inputs.copy()
            moved[i] *= 1 + STEP
            there = compute(formula, moved, "float64")
            size = size + np.abs(there.value - at.value) / STEP
            slope_size = slope_size + np.abs(there.reverse - at.reverse) / STEP
    return without_kinks(inputs, at.value, size, at.reverse, slope_size)


def without_kinks(inputs: Array, value: Array, scale: Array, slope: Array, slope_scale: Array) -> Exact:
    """Where nothing is known of peaks and of kinks."""
    ones = np.ones_like(value)
    shape = (-1, len(value))
    return Exact(
        inputs,
        value,
        scale,
        slope.reshape(shape),
        slope_scale.reshape(shape),
        np.maximum(np.abs(value), 1),
        np.inf * ones,
    )
