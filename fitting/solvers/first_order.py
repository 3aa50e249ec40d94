"""Plain first-order descent through reverse-mode differentiation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..problem import Problem
from . import Progress, Result

Array = npt.NDArray[np.float64]

#: Adam's own defaults for the moments (Kingma and Ba 2015), and a step of 5 % in a logarithmic coordinate.
ADAM_RATE, ADAM_BETA1, ADAM_BETA2, ADAM_EPSILON = 0.05, 0.9, 0.999, 1e-12
#: Adam's rate falls by a cosine to this fraction.
ADAM_LAST = 1e-3
#: Sufficient decrease of a line search (Nocedal and Wright, sec. 3.1), and the change of the step.
ARMIJO, GD_SHRINK, GD_GROW = 1e-4, 0.5, 2.0
GD_LONGEST, GD_SMALLEST = 0.5, 1e-9
#: Descent has arrived when in `GD_PATIENCE` iterations the sum of squares falls by less than this fraction of one
#: residual's variance: a parameter is then within some 0.03 standard deviations.
GD_ENOUGH, GD_PATIENCE = 1e-3, 10


def adam(problem: Problem, start: Array, max_iterations: int, progress: Progress) -> Result:
    """Adam with a cosine schedule: always `max_iterations` steps."""
    x = start.copy()
    mean, square = np.zeros_like(x), np.zeros_like(x)
    for i in range(1, max_iterations + 1):
        loss, g = problem.descend(x)
        progress(i - 1, loss, x)
        mean = ADAM_BETA1 * mean + (1 - ADAM_BETA1) * g
        square = ADAM_BETA2 * square + (1 - ADAM_BETA2) * g * g
        unit = (mean / (1 - ADAM_BETA1**i)) / (np.sqrt(square / (1 - ADAM_BETA2**i)) + ADAM_EPSILON)
        rate = ADAM_RATE * (ADAM_LAST + (1 - ADAM_LAST) * 0.5 * (1 + np.cos(np.pi * i / max_iterations)))
        x = np.clip(x - rate * unit, problem.parameters.low, problem.parameters.high)
    progress(max_iterations, problem.loss(x), x)
    return Result(x, max_iterations, True, "its schedule of steps has run out")


def gd(problem: Problem, start: Array, max_iterations: int, progress: Progress) -> Result:
    """Steepest descent: a backtracking line search, begun at the step length of Barzilai and Borwein (1988)."""
    low, high = problem.parameters.low, problem.parameters.high
    x = start.copy()
    loss, g = problem.descend(x)
    progress(0, loss, x)
    step = GD_LONGEST / max(float(np.abs(g).max()), 1e-300)
    losses = [loss]
    for i in range(1, max_iterations + 1):
        step = min(step, GD_LONGEST / max(float(np.abs(g).max()), 1e-300))
        while True:
            trial = np.clip(x - step * g, low, high)
            new, ahead = problem.descend(trial)
            if np.isfinite(new) and new <= loss + ARMIJO * float(g @ (trial - x)):
                break
            step *= GD_SHRINK
            if step * float(np.abs(g).max()) < GD_SMALLEST:
                return Result(x, i - 1, True, "no step along the gradient makes the residual smaller")
        s, y = trial - x, ahead - g
        step = float(s @ s / (s @ y)) if s @ y > 0 else step * GD_GROW
        x, loss, g = trial, new, ahead
        losses.append(loss)
        progress(i, loss, x)
        if len(losses) > GD_PATIENCE:
            fallen = (losses[-1 - GD_PATIENCE] - loss) * len(problem.target)
            if fallen <= GD_ENOUGH * problem.spread:
                return Result(x, i, True, "the residual no longer falls")
    return Result(x, max_iterations, False, f"it stopped after {max_iterations} iterations")
