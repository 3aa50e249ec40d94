"""Error bars: what the residual's noise does to the fitted parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

from .problem import Linear, Problem

Array = npt.NDArray[np.float64]

#: Probability that an interval is meant to cover the truth.
LEVEL = 0.95
#: Side of the blocks of pixels that are left out together, and the number of blocks below which smaller ones are taken.
BLOCK_SIDES, BLOCKS_ENOUGH = (8, 4, 2, 1), 40
#: Change of a pixel, against the rms of the picture, below which a parameter has no effect (float32 rounding).
NO_EFFECT = 1e-6
#: Pairs of pixels below which no correlation is given.
ENOUGH_PAIRS = 10
#: Eigenvalues of the scaled normal matrix below this fraction of the largest: directions no pixel determines.
SINGULAR = 1e-10


@dataclass(frozen=True)
class Uncertainty:
    """Of the free coordinates `x`.

    Attributes
    ----------
    covariance : array, shape (p, p)
        NaN in the rows of components that the pictures do not determine.
    confusion : array, shape (p, p)
        Correlation that independent noise in each residual would cause: how alike two components act on the pictures.
        That in `covariance` has the noise's own correlations in it, such as between the channels of a pixel.
    effect : bool array, shape (p,)
        Whether a component changes any pixel.
    quantile : float
        Half width of the 95 % interval in standard deviations (Student's t, one degree of freedom a block).
    sampling_share : float
        Share of the residual's variance that the fit's own samples make.
    correlation_at_4 : float
        Of residuals four pixels apart: noise has none, a model that does not fit has much.
    """

    covariance: Array
    confusion: Array
    effect: npt.NDArray[np.bool_]
    quantile: float
    sampling_share: float
    correlation_at_4: float

    @property
    def sd(self) -> Array:
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def estimate(problem: Problem, linear: Linear, x: Array) -> Uncertainty:
    """Delete-one-block jackknife of the weighted least-squares estimate, to first order.

    Pixels are grouped into square blocks; with the block's share ``S_k`` of the gradient and ``H_k`` of the
    Gauss-Newton matrix, leaving it out moves the estimate by ``(H - H_k)^-1 S_k``, and the covariance is the sum of the
    squares of these (Efron and Stein 1981; for clusters: Bell and McCaffrey 2002, "CR3"). Unlike ``sigma^2 H^-1`` it
    holds whatever the weights, for noise that differs from pixel to pixel, and for noise correlated within a block, as
    a reconstruction filter makes it.
    """
    w = problem.weights
    p = len(x)
    value_slope = problem.parameters.slope(x)
    values = np.abs(problem.parameters.values(x))
    (ra, rb), (ja, jb) = linear.r, linear.jacobian
    strongest = np.abs(ja).max(axis=0) / value_slope * np.maximum(values, 0.1)
    effect = strongest > NO_EFFECT * problem.scale
    h = linear.hessian(w)
    diagonal = np.diag(h)
    live = np.flatnonzero(effect & (diagonal > 0))
    covariance, confusion = np.full((p, p), np.nan), np.full((p, p), np.nan)
    block = blocks_of(problem)
    groups = int(block.max()) + 1
    quantile = float(stats.t.ppf(0.5 + LEVEL / 2, max(groups - len(live), 1)))
    if live.size and groups > 1:
        scale = 1.0 / np.sqrt(diagonal[live])
        hs = h[np.ix_(live, live)] * np.outer(scale, scale)
        ja, jb = ja[:, live] * scale, jb[:, live] * scale
        score = 0.5 * w[:, None] * (ja * rb[:, None] + jb * ra[:, None])
        order = np.argsort(block, kind="stable")
        edges = np.searchsorted(block[order], np.arange(groups))
        s = np.add.reduceat(score[order], edges, axis=0)
        outer = 0.5 * w[:, None, None] * (ja[:, :, None] * jb[:, None, :] + jb[:, :, None] * ja[:, None, :])
        hk = np.add.reduceat(outer[order], edges, axis=0)
        if np.linalg.eigvalsh(hs).min() > SINGULAR:
            moved = np.stack([np.linalg.lstsq(hs - one, sk, rcond=SINGULAR)[0] for one, sk in zip(hk, s, strict=True)])
            scaled = (groups - 1) / groups * moved.T @ moved
            covariance[np.ix_(live, live)] = scaled * np.outer(scale, scale)
            inverse = np.linalg.inv(hs)
            confusion[np.ix_(live, live)] = inverse / np.sqrt(np.outer(np.diag(inverse), np.diag(inverse)))
    mean = 0.5 * (ra + rb)
    total = float(np.mean(w * mean**2))
    sampling = float(np.mean(w * (ra - rb) ** 2)) / 4
    return Uncertainty(
        covariance, confusion, effect, quantile, sampling / total if total > 0 else 0.0, far(problem, mean * np.sqrt(w))
    )


def blocks_of(problem: Problem) -> npt.NDArray[np.int64]:
    """The number of the block that each residual lies in, counted from 0 without gaps."""
    labels = np.zeros(len(problem.pixel), dtype=np.int64)
    for side in BLOCK_SIDES:
        width = problem.widths[problem.view]
        row, column = problem.pixel // width // side, problem.pixel % width // side
        key = (problem.view * (1 << 20) + row) * (1 << 20) + column
        labels = np.unique(key, return_inverse=True)[1]
        if labels.max() + 1 >= BLOCKS_ENOUGH:
            break
    return labels


def far(problem: Problem, residual: Array) -> float:
    """Correlation of residuals of the same channel four pixels apart in a row."""
    i, j = problem.beside(4)
    if len(i) < ENOUGH_PAIRS:
        return 0.0
    return float(np.mean(residual[i] * residual[j]) / max(np.mean(residual**2), 1e-300))
