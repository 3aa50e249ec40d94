"""Exact answers of the formulas at hard points, as they come with the package.

``python -m tests.oracles.table`` of the source repository makes them, in 60 digits or more.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import DataError

Array = npt.NDArray[np.float64]
FOLDER = "answers"


@dataclass(frozen=True)
class Exact:
    """A formula's answers at n points, for n_in inputs and n_by derivatives.

    Attributes
    ----------
    inputs : array, shape (n_in, n)
        float32 numbers.
    value : array, shape (n,)
    value_scale : array, shape (n,)
        ``|f| + sum_i |x_i df/dx_i|``: what a rounding of everything does, in roundings.
    slope : array, shape (n_by, n)
        Derivatives by the formula's `by`.
    slope_scale : array, shape (n_by, n)
        ``|g| + sum_i |x_i dg/dx_i| + |f / p|``.
    peak : array, shape (n,)
        The value without its exponential: what it underflows from.
    kink : array, shape (n,)
        Relative distance from where the derivative jumps; infinite if it does not.
    """

    inputs: Array
    value: Array
    value_scale: Array
    slope: Array
    slope_scale: Array
    peak: Array
    kink: Array

    def __len__(self) -> int:
        return len(self.value)

    def some(self, which: Any) -> Exact:
        """Those points alone."""
        return Exact(*(getattr(self, name)[..., which] for name in self.__dataclass_fields__))

    def write(self, path: Path) -> None:
        """Compressed: inputs as float32; scales, which need few digits, by their logarithms."""
        held: dict[str, Any] = {name: getattr(self, name) for name in self.__dataclass_fields__}
        held["inputs"] = self.inputs.astype(np.float32)
        held |= {name: to_steps(held[name]) for name in SCALES}
        np.savez_compressed(path, **held)


#: Kept by their logarithm to base 2 in steps of 1/32, 2 %.
SCALES = ("value_scale", "slope_scale", "peak", "kink")
STEPS, NONE, INFINITE = 32, -(2**15), 2**15 - 1


def to_steps(a: Array) -> npt.NDArray[np.int16]:
    """The logarithm of numbers >= 0; of 0 and of infinity what stands for them."""
    with np.errstate(divide="ignore"):
        steps = np.round(STEPS * np.log2(a))
    return np.clip(steps, NONE, INFINITE).astype(np.int16)


def from_steps(steps: Array) -> Array:
    """The inverse of `to_steps`."""
    found = np.exp2(np.minimum(steps, INFINITE - 1) / STEPS)
    return np.where(steps <= NONE, 0, np.where(steps >= INFINITE, np.inf, found))


def path_of(name: str) -> Any:
    """Where a formula's answers are."""
    return resources.files("brdf.hard") / FOLDER / f"{file_name(name)}.npz"


def file_name(name: str) -> str:
    """Of a formula's table."""
    return name.replace(", ", "-").replace(" ", "-")


def load(name: str) -> Exact:
    """The answers of one formula.

    Raises
    ------
    DataError
        There are none.
    """
    path = path_of(name)
    if not path.is_file():
        raise DataError(f"{name}: there is no table of its exact answers in this installation.")
    with resources.as_file(path) as file, np.load(file) as held:
        read = {key: held[key].astype(np.float64) for key in held.files}
    return Exact(**{key: from_steps(a) if key in SCALES else a for key, a in read.items()})
