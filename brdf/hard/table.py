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
        """Compressed: inputs as float32; scales, which need no digits, with 3."""
        held: dict[str, Any] = {name: getattr(self, name) for name in self.__dataclass_fields__}
        held["inputs"] = self.inputs.astype(np.float32)
        for name in ("value_scale", "slope_scale", "peak", "kink"):
            held[name] = coarse(held[name])
        np.savez_compressed(path, **held)


def coarse(a: Array) -> npt.NDArray[np.float32]:
    """float32 with 9 of its 24 bits, rounded."""
    with np.errstate(over="ignore"):
        bits = np.clip(a, 0, np.finfo(np.float32).max).astype(np.float32).view(np.uint32)
    return ((bits.astype(np.uint64) + 0x4000) & 0xFFFF8000).astype(np.uint32).view(np.float32)


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
        return Exact(**{key: held[key].astype(np.float64) for key in held.files})
