"""SciPy's L-BFGS-B: bounds, limited memory, gradients by reverse-mode differentiation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from ..problem import Problem
from . import Progress, Result

Array = npt.NDArray[np.float64]

#: SciPy's status of a line search that found no lower point.
ABNORMAL = 2


def solve(problem: Problem, start: Array, max_iterations: int, progress: Progress) -> Result:
    """`scipy.optimize.minimize(method="L-BFGS-B")` in the coordinates of the parameters' scales."""
    seen: dict[bytes, float] = {}

    def value(x: Array) -> tuple[float, Array]:
        loss, gradient = problem.descend(x)
        seen[x.tobytes()] = loss
        return loss, gradient

    count = 0

    def after(x: Array) -> None:
        nonlocal count
        count += 1
        progress(count, seen.get(x.tobytes(), float("nan")), np.asarray(x))

    out = minimize(
        value,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(problem.parameters.low, problem.parameters.high, strict=True)),
        callback=after,
        options={"maxiter": max_iterations, "ftol": 1e-12, "gtol": 1e-12},
    )
    # Where the loss is float32's noise, which differs from run to run, a line search may find no lower point. Whether
    # that is the answer is asked afterwards, by how far a Gauss-Newton step would go.
    ended = bool(out.success) or out.status == ABNORMAL
    return Result(np.asarray(out.x), int(out.nit), ended, f"L-BFGS-B: {out.message}")
