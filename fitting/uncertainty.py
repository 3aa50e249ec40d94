"""Error bars: what the residual's noise does to the fitted parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

from .problem import APART, Linear, Problem

Array = npt.NDArray[np.float64]

#: Probability that an interval is meant to cover the truth.
LEVEL = 0.95
#: Sides of the blocks of pixels that are left out together; smaller ones are taken while less than so many decide on a
#: parameter.
BLOCK_SIDES, BLOCKS_ENOUGH = (8, 4, 2, 1), 25.0
#: Change of a pixel, against the rms of the picture, below which a parameter has no effect (float32 rounding).
NO_EFFECT = 1e-6
#: Pairs of pixels below which no correlation is given.
ENOUGH_PAIRS = 10
#: Eigenvalues of the scaled normal matrix below this fraction of the largest: directions no pixel determines.
SINGULAR = 1e-10
#: A component takes part in such a direction if this much of the direction's length squared is its own.
TAKES_PART = 1e-3


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
    effect, drowned : bool array, shape (p,)
        Whether a component changes any pixel, and whether that is lost in the noise of the fit's own samples.
    quantile : array, shape (p,)
        Half width of the 95 % interval in standard deviations: Student's t, a degree of freedom for each block that
        decides on the component (Satterthwaite 1946), less one.
    sampling_share : float
        Share of the residual's variance that the fit's own samples make.
    correlation_at_4 : float
        Of residuals four pixels apart: noise has none, a model that does not fit has much.
    """

    covariance: Array
    confusion: Array
    effect: npt.NDArray[np.bool_]
    drowned: npt.NDArray[np.bool_]
    quantile: Array
    sampling_share: float
    correlation_at_4: float

    @property
    def sd(self) -> Array:
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def estimate(problem: Problem, linear: Linear, x: Array, held: npt.NDArray[np.bool_] | None = None) -> Uncertainty:
    """Delete-one-block jackknife of the weighted least-squares estimate, to first order.

    `held` marks components that lie at a bound. Pixels are grouped into square blocks; with the block's share ``S_k``
    of the gradient and ``H_k`` of the Gauss-Newton matrix, leaving it out moves the estimate by ``(H - H_k)^-1 S_k``,
    and the covariance is the sum of the squares of these (Efron and Stein 1981; for clusters: Bell and McCaffrey 2002,
    "CR3"). Unlike ``sigma^2 H^-1`` it holds whatever the weights, for noise that differs from pixel to pixel, and for
    noise correlated within a block, as a reconstruction filter makes it. What the borders between blocks cut of such
    correlation is measured: see `cut`.
    """
    w = problem.weights
    held = np.zeros(len(x), dtype=bool) if held is None else held
    value_slope = problem.parameters.slope(x)
    values = np.abs(problem.parameters.values(x))
    (ra, rb), (ja, _) = linear.r, linear.jacobian
    strongest = np.abs(ja).max(axis=0) / value_slope * np.maximum(values, 0.1)
    effect = strongest > NO_EFFECT * problem.scale
    h = linear.hessian(w)
    diagonal = np.diag(h)
    live = effect & (diagonal > 0)
    number = np.full(len(x), np.inf)
    for side in BLOCK_SIDES:
        block = blocks_of(problem, side)
        number[live] = deciding(linear, w, np.flatnonzero(live), block)
        if number.min(initial=np.inf) >= BLOCKS_ENOUGH:
            break
    quantile = stats.t.ppf(0.5 + LEVEL / 2, np.maximum(number - 1, 1))
    covariance, confusion = jackknife(linear, w, np.flatnonzero(live), block)
    if held.any():
        # What lies at a bound stays there whatever the noise, as far as the others are concerned; its own spread is
        # that of the free estimate.
        own = np.diag(covariance)
        covariance, confusion = jackknife(linear, w, np.flatnonzero(live & ~held), block)
        covariance[held] = covariance[:, held] = 0.0
        covariance[held, held] = own[held]
    mean = 0.5 * (ra + rb)
    covariance *= cut(problem, mean * np.sqrt(w), block)
    total = float(np.mean(w * mean**2))
    sampling = float(np.mean(w * (ra - rb) ** 2)) / 4
    return Uncertainty(
        covariance,
        confusion,
        effect,
        effect & ~live,
        quantile,
        min(sampling / total, 1.0) if total > 0 else 0.0,
        far(problem, mean * np.sqrt(w)),
    )


def jackknife(
    linear: Linear, w: Array, live: npt.NDArray[np.intp], block: npt.NDArray[np.int64]
) -> tuple[Array, Array]:
    """Covariance of the components `live`, and how alike they act; NaN for the others, and for what is not determined.

    A combination of components that changes no pixel leaves those in it undetermined, and the rest as they are.
    """
    p = linear.jacobian[0].shape[1]
    covariance, confusion = np.full((p, p), np.nan), np.full((p, p), np.nan)
    groups = int(block.max()) + 1
    if not live.size or groups < 2:
        return covariance, confusion
    (ra, rb), (ja, jb) = linear.r, (j[:, live] for j in linear.jacobian)
    h = ja.T @ (w[:, None] * jb)
    h = 0.5 * (h + h.T)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(h), 1e-300))
    values, vectors = np.linalg.eigh(h * np.outer(scale, scale))
    if values.min() < 0:
        # The halves disagree so much that their cross product is not positive; their mean's is.
        ja = jb = 0.5 * (ja + jb)
        h = ja.T @ (w[:, None] * ja)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(h), 1e-300))
        values, vectors = np.linalg.eigh(h * np.outer(scale, scale))
    hs = h * np.outer(scale, scale)
    ja, jb = ja * scale, jb * scale
    score = 0.5 * w[:, None] * (ja * rb[:, None] + jb * ra[:, None])
    order = np.argsort(block, kind="stable")
    edges = np.searchsorted(block[order], np.arange(groups))
    s = np.add.reduceat(score[order], edges, axis=0)
    outer = 0.5 * w[:, None, None] * (ja[:, :, None] * jb[:, None, :] + jb[:, :, None] * ja[:, None, :])
    hk = np.add.reduceat(outer[order], edges, axis=0)
    moved = np.stack([np.linalg.lstsq(hs - one, sk, rcond=SINGULAR)[0] for one, sk in zip(hk, s, strict=True)])
    lost = np.sum(vectors[:, values <= SINGULAR * values.max()] ** 2, axis=1) > TAKES_PART
    found, sure = live[~lost], ~lost
    scaled = (groups - 1) / groups * moved.T @ moved * np.outer(scale, scale)
    covariance[np.ix_(found, found)] = scaled[np.ix_(sure, sure)]
    inverse = np.linalg.pinv(hs, rcond=SINGULAR, hermitian=True)
    size = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    confusion[np.ix_(found, found)] = (inverse / np.outer(size, size))[np.ix_(sure, sure)]
    return covariance, confusion


def deciding(
    linear: Linear, w: Array, live: npt.NDArray[np.intp], block: npt.NDArray[np.int64]
) -> npt.NDArray[np.float64]:
    """How many blocks decide on each of the components `live`: ``(sum a)^2 / sum a^2`` of their shares in its variance.

    Of 40 blocks, those two that hold a sharp highlight may say all there is about the roughness.
    """
    if not live.size:
        return np.ones(0)
    jacobian = (0.5 * (linear.jacobian[0] + linear.jacobian[1]))[:, live]
    h = linear.rough_hessian(w)[np.ix_(live, live)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(h), 1e-300))
    inverse = np.linalg.pinv(h * np.outer(scale, scale), rcond=SINGULAR, hermitian=True)
    pull = (w[:, None] * jacobian * scale) @ inverse
    share = np.stack([np.bincount(block, pull[:, j] ** 2 / w) for j in range(len(live))])
    total = share.sum(axis=1)
    return np.divide(total**2, (share**2).sum(axis=1), out=np.ones_like(total), where=total > 0)


def blocks_of(problem: Problem, side: int) -> npt.NDArray[np.int64]:
    """The number of the square block of pixels that each residual lies in, counted from 0 without gaps."""
    width = problem.widths[problem.view]
    row, column = problem.pixel // width // side, problem.pixel % width // side
    key = (problem.view * (1 << 20) + row) * (1 << 20) + column
    return np.unique(key, return_inverse=True)[1]


def cut(problem: Problem, residual: Array, block: npt.NDArray[np.int64]) -> float:
    """The factor by which blocks make a variance too small, because neighbours in two of them share their noise.

    Noise with correlation ``rho(d)`` at the distance ``d`` in a row gives the sum over many pixels a variance
    proportional to ``1 + 2 sum rho(d)``; blocks see of it only the fraction of pairs that lie in one block. Columns are
    taken to be as rows are.
    """
    power = max(float(np.mean(residual**2)), 1e-300)
    whole = within = 1.0
    for lag in range(1, APART + 1):
        i, j = problem.beside(lag)
        if len(i) < ENOUGH_PAIRS:
            continue
        rho = float(np.mean(residual[i] * residual[j])) / power
        whole += 2 * rho
        within += 2 * rho * float(np.mean(block[i] == block[j]))
    return max(whole / within, 1.0) ** 2 if within > 0 else 1.0


def far(problem: Problem, residual: Array) -> float:
    """Correlation of residuals of the same channel four pixels apart in a row."""
    i, j = problem.beside(4)
    if len(i) < ENOUGH_PAIRS:
        return 0.0
    return float(np.mean(residual[i] * residual[j]) / max(np.mean(residual**2), 1e-300))
