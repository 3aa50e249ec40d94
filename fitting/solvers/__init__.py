"""Ways to minimise a `fitting.problem.Problem`: one file, one method. `METHODS` finds them by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..problem import Problem

Array = npt.NDArray[np.float64]
Progress = Callable[[int, float, Array], None]
"""Called after each iteration with its number, the loss, and `x`."""


@dataclass(frozen=True)
class Result:
    """Where a solver stopped: the point, how many iterations, whether by its own criterion, and why, in words."""

    x: Array
    iterations: int
    converged: bool
    reason: str


Solver = Callable[[Problem, Array, int, Progress], Result]
"""``solve(problem, start, max_iterations, progress)``."""


def methods() -> dict[str, Solver]:
    """The solvers by the name the command line knows them by."""
    from . import first_order, lbfgs, lm

    return {"lm": lm.solve, "lbfgs": lbfgs.solve, "adam": first_order.adam, "gd": first_order.gd}
