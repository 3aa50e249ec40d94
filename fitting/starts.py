"""Where a fit starts when nobody says: the best point of a coarse grid."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.optimize import lsq_linear
from scipy.stats import qmc

from brdf import Param

from .parameters import Parameters
from .problem import Problem
from .solvers import lm

Array = npt.NDArray[np.float64]

#: Points along a logarithmic parameter, and along any other.
LOG_POINTS, OTHER_POINTS = 12, 5
#: Of the only axis: what is seen through glass has valleys as narrow as a tenth of eta - 1.
ALONE = 32
#: Beyond this many points the grid becomes a Sobol sequence of this length.
MOST_POINTS = 800
#: A logarithmic grid spans this factor below and above the default; ``eta - 1`` this range.
LOG_SPAN, ABOVE_ONE = 40.0, (0.05, 2.0)
#: With such a colour, so many of the best points are gone on from, by so many steps of the solver, before one is taken.
SEVERAL, BRIEF = 3, 8
#: A scan along one colour has so many times the points of the grid, and looks into so many of the valleys.
FINER, VALLEYS = 4, 3
#: Ends of the names of a colour's components.
CHANNELS = "rgb"

#: How far from the ends of its range a colour starts, as a fraction of it.
INSET = 0.01


def search(problem: Problem, fixed: Array, most: int = MOST_POINTS, pause: Callable[[], None] = lambda: None) -> Array:
    """The best start, in the coordinates `x`.

    The numbers that have no start are tried on a grid, and so are colours that are not fractions (an index of
    refraction, a coefficient of scattering), of each the best value for each channel. At each point the fractions
    without a start are solved for as a linear problem with bounds, which is exact for reflectances.

    Parameters
    ----------
    fixed : array, shape (p,)
        Starts that were given, in physical values; NaN for the others.
    most : int
        Points of the grid at most.
    pause : function, optional
        Called before each point; may raise to end the search.
    """
    parameters = problem.parameters
    open_ = np.isnan(fixed)
    axes, fractions = [], []
    for f in parameters.free:
        places = np.arange(f.size) + sum(g.size for g in parameters.free[: parameters.free.index(f)])
        if not open_[places].any():
            continue
        if f.param.kind == "colour" and f.param.scale == "logit":
            fractions += places.tolist()
        else:
            axes.append((places, f.param))
    solvable = np.array(fractions, dtype=np.intp)
    defaults = np.array([default(q, c) for q, c in zip(parameters.params, parameters.components, strict=True)])
    base = np.where(open_, defaults, fixed)
    if not axes and not fractions:
        return parameters.free_of(off_the_ends(parameters, base))
    channel = np.array([CHANNELS.find(c[-1]) if c[-2] == "." else -1 for c in parameters.components])
    channel[[p.kind != "colour" for p in parameters.params]] = -1
    found: dict[tuple[float, ...], tuple[Array, Array]] = {}
    for point in grid([p for _, p in axes], most):
        pause()
        values = base.copy()
        for (places, _), v in zip(axes, point, strict=True):
            values[places] = v
        losses, solved = with_colours(problem, values, solvable)
        numbers = tuple(float(v) for (places, _), v in zip(axes, point, strict=True) if len(places) == 1)
        if numbers in found:
            old_losses, old = found[numbers]
            better = losses < old_losses
            solved = np.where((channel >= 0) & better[channel], solved, old)
            losses = np.minimum(losses, old_losses)
        found[numbers] = losses, solved
    curved = [(places, param) for places, param in axes if param.kind == "colour"]
    ranked = sorted(found.values(), key=lambda each: float(each[0].sum()))
    best, least = ranked[0][1], math.inf
    for losses, values in ranked[: SEVERAL if curved else 1]:
        for places, param in curved:
            losses, values = scan(problem, values, losses, solvable, places, param, pause)
        if curved and len(ranked) > 1:
            values = parameters.values(lm.solve(problem, parameters.free_of(values), BRIEF, lambda *_: pause()).x)
            losses = with_colours(problem, values, solvable[:0])[0]
        if losses.sum() < least:
            best, least = values, float(losses.sum())
    return parameters.free_of(off_the_ends(parameters, best))


def off_the_ends(parameters: Parameters, values: Array) -> Array:
    """`values`, but no fraction at an end of its range, where the slope of the logit scale vanishes."""
    low, high = np.array([p.bounds for p in parameters.params]).T
    inset = np.array([INSET if p.scale == "logit" else 0.0 for p in parameters.params])
    inset = np.where(inset > 0, inset * (high - low), 0.0)
    return np.clip(values, low + inset, high - inset)


def scan(
    problem: Problem,
    values: Array,
    losses: Array,
    solvable: npt.NDArray[np.intp],
    places: npt.NDArray[np.intp],
    param: Param,
    pause: Callable[[], None],
) -> tuple[Array, Array]:
    """Go along a colour that is no fraction, and into each of the best valleys found: losses, and better values.

    Such a colour may have several, as the index of a metal, which reflects as much with another index far away.
    """
    usual = axis(param)
    x = np.linspace(param.to_free(usual[0]), param.to_free(usual[-1]), FINER * len(usual))
    best_losses, best = losses, values

    def at(colour: Array) -> Array:
        nonlocal best_losses, best
        pause()
        here = values.copy()
        here[places] = param.to_value(colour)
        lost, solved = with_colours(problem, here, solvable)
        better = lost < best_losses
        best = best.copy()
        best[places] = np.where(better, solved[places], best[places])
        best_losses = np.minimum(lost, best_losses)
        return lost

    along = np.array([at(np.full(len(places), v)) for v in x])
    bottoms = [valleys(x, along[:, c]) for c in range(len(places))]
    for rank in range(max(len(b) for b in bottoms)):
        at(np.array([b[min(rank, len(b) - 1)] for b in bottoms]))
    return best_losses, best


def valleys(x: Array, y: Array) -> Array:
    """Where a function on a grid has its lowest minima, each by the parabola through three points."""
    middle = np.flatnonzero((y[1:-1] <= y[:-2]) & (y[1:-1] <= y[2:])) + 1
    middle = middle[np.argsort(y[middle])][:VALLEYS]
    if not middle.size:
        return x[[int(np.argmin(y))]]
    before, here, after = y[middle - 1], y[middle], y[middle + 1]
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / np.where(bend > 0, bend, 1.0)
    return x[middle] + (x[1] - x[0]) * np.clip(shift, -0.5, 0.5)


def with_colours(problem: Problem, values: Array, colours: npt.NDArray[np.intp]) -> tuple[Array, Array]:
    """The loss of each channel, shape (3,), at `values` once the components `colours` are solved for; these values."""
    parameters = problem.parameters
    x = parameters.free_of(values)
    if not colours.size:
        ra, rb = problem.residuals(x)
        # Not the product of the halves: where few samples meet a sharp lobe, that may be negative and still be the
        # worst.
        return by_channel(problem, problem.weights * (0.5 * (ra + rb)) ** 2), values
    linear = problem.linearize(x, colours)
    w = np.sqrt(problem.weights)
    jacobian = 0.5 * (linear.jacobian[0] + linear.jacobian[1]) / parameters.slope(x)[colours] * w[:, None]
    r = 0.5 * (linear.r[0] + linear.r[1]) * w
    normal = jacobian.T @ jacobian
    ridge = 1e-9 * max(float(np.trace(normal)), 1e-300) * np.eye(len(colours))
    root = np.linalg.cholesky(normal + ridge).T
    right = np.linalg.solve(root.T, jacobian.T @ (jacobian @ values[colours] - r))
    bounds = np.array([parameters.params[i].interior() for i in colours]).T
    solved = np.clip(lsq_linear(root, right, (bounds[0], bounds[1])).x, bounds[0], bounds[1])
    step = solved - values[colours]
    out = values.copy()
    out[colours] = solved
    return by_channel(problem, (r + jacobian @ step) ** 2), out


def by_channel(problem: Problem, square: Array) -> Array:
    """Sums over the residuals of each channel; what is not finite is worse than all."""
    sums = np.bincount(problem.channel, square, minlength=len(CHANNELS))
    return np.where(np.isfinite(sums), sums, np.inf)


def grid(params: list[Param], most: int) -> list[Array]:
    """Points to try, in physical values."""
    axes = [axis(q, len(params) == 1) for q in params]
    if math.prod(len(a) for a in axes) <= most:
        return [np.array(point) for point in itertools.product(*axes)]
    unit = qmc.Sobol(len(params), scramble=False).random(most)
    return [
        np.array(
            [
                q.to_value(q.to_free(a[0]) + u * (q.to_free(a[-1]) - q.to_free(a[0])))
                for q, a, u in zip(params, axes, row, strict=True)
            ]
        )
        for row in unit
    ]


def axis(p: Param, alone: bool = False) -> Array:
    """Values of one number to try, evenly spaced in the coordinate of its scale; more if no other is sought."""
    low, high = p.interior()
    log_points, points = (ALONE, ALONE) if alone else (LOG_POINTS, OTHER_POINTS)
    usual = float(np.mean(p.default))
    if not math.isfinite(high):
        high = max(abs(usual), 1.0) * LOG_SPAN
    if p.scale == "log":
        middle = usual if usual > low else math.sqrt(low * high)
        return np.geomspace(max(low, middle / LOG_SPAN), min(high, middle * LOG_SPAN), log_points)
    if p.scale == "log_minus_one":
        return 1 + np.geomspace(max(low - 1, ABOVE_ONE[0]), min(high - 1, ABOVE_ONE[1]), points)
    inset = (high - low) / (2 * points)
    return np.linspace(low + inset, high - inset, points)


def default(p: Param, component: str) -> float:
    """A start for a component that the grid does not cover: its default, or the middle if that is at a bound."""
    value = float(p.default["rgb".index(component[-1])] if p.kind == "colour" else p.default)
    low, high = p.bounds
    return 0.5 * (low + high) if value in (low, high) and math.isfinite(high) else value
