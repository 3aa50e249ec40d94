"""Derivatives of element-wise functions, for the tests of this folder."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np

from tests.brdf.arrays import VECTORS, Array, to_numpy


def slope(function: Callable[[Any], Any], kind: str, at: Any) -> Array:
    """``d function / d x`` at each of `at` by reverse-mode differentiation, in the precision of `kind`."""
    x = dr.value_t(VECTORS[kind])(np.asarray(at, dtype=float))
    dr.enable_grad(x)
    dr.backward(dr.sum(function(x), axis=None))
    return to_numpy(x.grad)


def quotient(function: Callable[[Any], Any], at: Any, step: float = 1e-6) -> Array:
    """The central difference quotient in float64, good to some 1e-9."""
    number = dr.value_t(VECTORS["float64"])
    x, h = number(np.asarray(at, dtype=float)), step * np.maximum(np.abs(at), 1)
    return (to_numpy(function(x + number(h))) - to_numpy(function(x - number(h)))) / (2 * h)
