"""Levenberg-Marquardt with bounds."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..problem import Linear, Problem
from . import Progress, Result

Array = npt.NDArray[np.float64]

#: First damping, relative to the diagonal of the Gauss-Newton matrix, and its change after a good and a bad step.
DAMPING, DAMPING_DOWN, DAMPING_UP = 1e-3, 0.2, 5.0
#: Beyond this damping a step is too small to matter: the objective is flat, or its derivative wrong.
DAMPING_MOST = 1e8
#: Longest step in any coordinate: a factor e in m, or in eta - 1.
LONGEST_STEP = 1.0
#: A step below this moves a parameter by less than float32 resolves.
SMALLEST_STEP = 1e-7
#: A step this small against the standard deviation it will be reported with does not change the answer.
ENOUGH = 0.01


def solve(problem: Problem, start: Array, max_iterations: int, progress: Progress) -> Result:
    """Damped Gauss-Newton steps (Marquardt 1963) on the cross objective; see `fitting.problem`.

    A step is projected onto the bounds; a parameter at a bound that the gradient pushes outward is held there. Ends when a
    step is small against the standard deviations, or against float32.
    """
    x = start.copy()
    damping = DAMPING
    here = problem.linearize(x)
    w = problem.weights
    loss = here.loss(w)
    progress(0, loss, x)
    for iteration in range(1, max_iterations + 1):
        while True:
            step, small = propose(problem, here, x, damping)
            if small:
                return Result(x, iteration - 1, True, "the last step was smaller than the error bars and float32 resolve")
            trial = np.clip(x + step, problem.parameters.low, problem.parameters.high)
            ahead = problem.linearize(trial)
            new = ahead.loss(w)
            if np.isfinite(new) and new < loss:
                break
            damping *= DAMPING_UP
            if damping > DAMPING_MOST:
                return Result(x, iteration - 1, True, "no step makes the residual smaller")
        x, here, loss = trial, ahead, new
        damping = max(damping * DAMPING_DOWN, 1e-12)
        progress(iteration, loss, x)
    return Result(x, max_iterations, False, f"stopped after {max_iterations} iterations")


def propose(problem: Problem, here: Linear, x: Array, damping: float) -> tuple[Array, bool]:
    """A damped step, and whether the undamped one is too small to matter."""
    w = problem.weights
    g, h = here.gradient(w), here.hessian(w)
    low, high = problem.parameters.low, problem.parameters.high
    held = ((x <= low) & (g > 0)) | ((x >= high) & (g < 0)) | (np.diag(h) <= 0)
    free = np.flatnonzero(~held)
    step = np.zeros_like(x)
    if free.size == 0:
        return step, True
    hf, gf = h[np.ix_(free, free)], g[free]
    scale = 1.0 / np.sqrt(np.diag(hf))
    values, vectors = np.linalg.eigh(hf * np.outer(scale, scale))
    values = np.maximum(values, 1e-9 * values.max())
    along = vectors.T @ (scale * gf)
    step[free] = -scale * (vectors @ (along / (values + damping)))
    longest = np.abs(step).max()
    if longest > LONGEST_STEP:
        step *= LONGEST_STEP / longest
    full = scale * (vectors @ (along / values))
    variance = max(here.loss(w), 0.0) * (scale**2 * np.sum(vectors**2 / values, axis=1))
    reach = np.clip(x[free] - full, low[free], high[free]) - x[free]
    return step, bool(np.all(np.abs(reach) <= np.maximum(SMALLEST_STEP, ENOUGH * np.sqrt(variance))))
