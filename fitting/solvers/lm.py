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
#: Eigenvalues of the scaled normal matrix are raised to this fraction of the largest.
SINGULAR = 1e-9
#: Longest step in each coordinate: a factor e in m, or in eta - 1. One that hardly acts yet asks for a huge step, which
#: must not shorten those of the others.
LONGEST_STEP = 1.0
#: A step below this moves a parameter by less than float32 resolves.
SMALLEST_STEP = 1e-7
#: A step this small against the standard deviation does not change the answer. What is far from the answer, or hardly
#: acts, has a standard deviation that says nothing: it is taken as this at most.
ENOUGH, WIDEST = 0.02, 1.0
#: Within this many standard deviations undamped steps are taken without asking whether the loss falls, so many at most.
#: What is sought is the root of the gradient; a rendered loss is rougher than its gradient, since its paths change with
#: the material. Where the fit is still so bad that a standard deviation is long, a step must be this short as well.
NEAR, NEAR_STEPS, NEAR_STEP = 1.0, 4, 0.1


def solve(problem: Problem, start: Array, max_iterations: int, progress: Progress) -> Result:
    """Damped Gauss-Newton steps (Marquardt 1963) on the cross objective; see `fitting.problem`.

    A step is projected onto the bounds; a parameter at a bound that the gradient pushes outward is held there. Ends
    when a step is small against the standard deviations, or against float32.
    """
    x = start.copy()
    damping = DAMPING
    here = problem.linearize(x)
    w = problem.weights
    loss = here.loss(w)
    progress(0, loss, x)
    near = 0
    for iteration in range(1, max_iterations + 1):
        while True:
            step, full, sd = propose(problem, here, x, damping)
            if near == NEAR_STEPS or np.all(np.abs(full) <= np.maximum(SMALLEST_STEP, ENOUGH * np.minimum(sd, WIDEST))):
                return Result(
                    x, iteration - 1, True, "the last step was small against the error bars, or below float32"
                )
            close = bool(np.all(np.abs(full) <= np.minimum(NEAR * sd, NEAR_STEP)))
            if close:
                step = full
                near += 1
            trial = np.clip(x + step, problem.parameters.low, problem.parameters.high)
            ahead = problem.linearize(trial)
            new = ahead.loss(w)
            # The product of the halves falls below 0 by noise alone, without end where few samples meet a sharp lobe.
            sane = new > 0 or ahead.power(w) <= here.power(w)
            if np.isfinite(new) and (close or (new < loss and sane)):
                break
            damping *= DAMPING_UP
            if damping > DAMPING_MOST:
                return Result(x, iteration - 1, True, "no step makes the residual smaller")
        x, here, loss = trial, ahead, new
        damping = max(damping * DAMPING_DOWN, 1e-12)
        progress(iteration, loss, x)
    return Result(x, max_iterations, False, f"it stopped after {max_iterations} iterations")


def propose(problem: Problem, here: Linear, x: Array, damping: float) -> tuple[Array, Array, Array]:
    """A damped step; the undamped one inside the bounds; and roughly the standard deviations."""
    w = problem.weights
    g, h = here.gradient(w), here.hessian(w)
    if np.any(np.diag(h) <= 0):
        # Drowned in the samples' noise. Too large a curvature makes steps short, and leaves where they lead.
        h = here.rough_hessian(w)
    low, high = problem.parameters.low, problem.parameters.high
    held = ((x <= low) & (g > 0)) | ((x >= high) & (g < 0)) | (np.diag(h) <= 0)
    free = np.flatnonzero(~held)
    step, full, sd = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    if free.size == 0:
        return step, full, sd
    scale = 1.0 / np.sqrt(np.diag(h)[free])
    values, vectors = np.linalg.eigh(h[np.ix_(free, free)] * np.outer(scale, scale))
    values = np.maximum(values, SINGULAR * values.max())
    along = vectors.T @ (scale * g[free])
    step[free] = -scale * (vectors @ (along / (values + damping)))
    step = np.clip(step, -LONGEST_STEP, LONGEST_STEP)
    full[free] = np.clip(x[free] - scale * (vectors @ (along / values)), low[free], high[free]) - x[free]
    # The noise is in the mean of the halves; their product, the loss, is free of it.
    sd[free] = scale * np.sqrt(here.power(w) * np.sum(vectors**2 / values, axis=1))
    return step, full, sd
