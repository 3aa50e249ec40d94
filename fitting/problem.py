"""The least-squares problem of a fit: residuals, their derivatives, and the weights that noise asks for.

Each picture is predicted from two independent halves of its samples, A and B. With residuals ``r = I - target`` and
weights ``w``, the objective is ``C = 1/2 sum w r_A r_B``, whose mean is that of the noise-free ``1/2 sum w r^2``: the
samples' own noise does not enter, as it would in ``sum w r_A^2``, where it pulls the minimum aside. Gradient and
Gauss-Newton matrix are the symmetric cross terms.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from .parameters import Parameters
from .picture import Picture

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

#: No pixel is known better than this fraction of the picture's rms. A renderer's float32 is better, but a weight of
#: 1e12 for what is almost black would let it decide over all the rest.
ROUNDING = 1e-4
#: Residuals this far apart [pixels] share no noise, not even through a reconstruction filter. If they share more than
#: this fraction of its variance, and more than so many standard errors, that is misfit. Fewer pairs tell nothing.
APART, MISFIT, SIGNIFICANT, ENOUGH_PIXELS = 3, 0.05, 5.0, 200
#: The variance of pixels as bright counts as much as that of so many neighbours.
ALIKE = 3.0
#: However noisy the fit's own samples are, the target's noise is taken as at least this fraction of the residual's.
LEAST = 0.1
#: Bins of predicted intensity in which the variance of the residuals is measured.
NOISE_BINS = 24
#: Steps by which the noise's coefficients reach their greatest likelihood.
LIKELIHOOD_STEPS = 20
#: Half the step of a difference, in the coordinate of the parameter's scale: its square is what the derivative is off
#: by, relative; a smaller one has more noise where an edge moves across a pixel.
STEP = 0.03


@dataclass(frozen=True)
class Linear:
    """The problem about a point: residuals (n,) and Jacobians (n, p) of both halves, in the coordinates `x`."""

    r: tuple[Array, Array]
    jacobian: tuple[Array, Array]

    def loss(self, w: Array) -> float:
        """Weighted mean square residual ``mean(w r_A r_B)``."""
        return float(np.mean(w * self.r[0] * self.r[1]))

    def power(self, w: Array) -> float:
        """Weighted mean square of the mean of the halves: `loss` and the samples' own noise, never negative."""
        return float(np.mean(w * (0.5 * (self.r[0] + self.r[1])) ** 2))

    def gradient(self, w: Array) -> Array:
        """Half the gradient of the sum ``sum w r_A r_B``."""
        (ra, rb), (ja, jb) = self.r, self.jacobian
        return 0.5 * (ja.T @ (w * rb) + jb.T @ (w * ra))

    def hessian(self, w: Array) -> Array:
        """Its Gauss-Newton matrix, symmetric; positive but for sampling noise."""
        ja, jb = self.jacobian
        h = ja.T @ (w[:, None] * jb)
        return 0.5 * (h + h.T)

    def rough_hessian(self, w: Array) -> Array:
        """That of the mean of the halves: never negative, and too large by the noise of the Jacobian."""
        j = 0.5 * (self.jacobian[0] + self.jacobian[1])
        return j.T @ (w[:, None] * j)


class Problem:
    """Pictures, their targets, and the free parameters.

    Attributes
    ----------
    weights : array, shape (n,)
        One a residual. Residuals are ordered picture by picture, channel by channel, pixel by pixel.
    pixel, channel, view : int array, shape (n,)
        Flat index of the pixel of each residual, its channel, and the number of its picture; ``widths[view]`` is how
        wide that is.
    spread : float
        Weighted mean square of the mean of both halves at the last `descend`: it has the noise that the loss lacks.
    """

    def __init__(
        self,
        parameters: Parameters,
        pictures: Sequence[Picture],
        targets: Sequence[npt.NDArray[np.float32]],
        differences: Collection[int] = (),
    ) -> None:
        """`targets` are linear RGB pictures of shape (height, width, 3).

        `differences` are the components of `x` whose derivatives are taken as central differences with the same random
        numbers, because those that the pictures' integrator gives are wrong.
        """
        self.parameters = parameters
        self.differences = frozenset(differences)
        self.pictures: list[Picture] = list(pictures)
        shown = [np.asarray(t).reshape(-1, 3)[p.pixels].T for p, t in zip(pictures, targets, strict=True)]
        self.target = np.concatenate([t.ravel() for t in shown]).astype(np.float64)
        self.pixel = np.concatenate([np.tile(p.pixels, 3) for p in pictures])
        self.channel = np.concatenate([np.repeat(np.arange(3), len(p.pixels)) for p in pictures])
        self.view = np.repeat(np.arange(len(pictures)), [3 * len(p.pixels) for p in pictures])
        self.widths = np.array([t.shape[1] for t in targets])
        self.scale = float(np.sqrt(np.mean(self.target**2)))
        self.evaluations = 0
        self.spread = 0.0
        self.weigh_equally()

    def weigh_equally(self) -> None:
        """Set all weights to 1 over the mean square of the targets."""
        self.weigh(np.full(len(self.target), 1.0 / self.scale**2))

    def weigh(self, weights: Array) -> None:
        """Set the weights of the residuals."""
        self.weights = weights

    def residuals(self, x: Array) -> tuple[Array, Array]:
        """Prediction less target for both halves, without derivatives."""
        self.parameters.place(x)
        parts = self.predict()
        dr.eval(parts)
        self.evaluations += 1
        ra, rb = self.fold(parts)
        return ra - self.target, rb - self.target

    def loss(self, x: Array) -> float:
        """Weighted mean square residual at `x`."""
        ra, rb = self.residuals(x)
        return float(np.mean(self.weights * ra * rb))

    def linearize(self, x: Array, columns_of: Sequence[int] | npt.NDArray[np.intp] | None = None) -> Linear:
        """Residuals and Jacobians at `x`, by forward-mode differentiation: one pass a column, all in one kernel.

        `columns_of` picks components; the Jacobians then have these columns alone.
        """
        chosen = list(range(len(x)) if columns_of is None else columns_of)
        columns: dict[int, list[mi.Color3f]] = {i: [] for i in chosen if i not in self.differences}
        slope = self.parameters.slope(x)
        parts = []
        for variables, part in self.attached(x):
            for i, column in columns.items():
                dr.clear_grad(variables)
                dr.clear_grad(part)
                dr.set_grad(variables[i], 1)
                dr.enqueue(dr.ADMode.Forward, variables)
                dr.traverse(dr.ADMode.Forward, dr.ADFlag.ClearInterior | dr.ADFlag.ClearInput)
                column.append(dr.grad(part))
            parts.append(dr.detach(part))
        dr.eval(parts, list(columns.values()))
        self.evaluations += 1
        ra, rb = self.fold(parts)
        folded = {i: [half * slope[i] for half in self.fold(column)] for i, column in columns.items()}
        folded |= {i: self.difference(x, i) for i in chosen if i in self.differences}
        ja, jb = (np.stack([folded[i][half] for i in chosen], axis=1) for half in (0, 1))
        return Linear((ra - self.target, rb - self.target), (ja, jb))

    def attached(self, x: Array) -> Iterator[tuple[list[mi.Float], mi.Color3f]]:
        """What the pictures predict, part by part, each with the variables that it depends on.

        They are its own: where there is one parameter, `mi.render` passes its tangent on to the first of several
        pictures alone (Mitsuba 3.9.1).
        """
        self.counts = [0] * len(self.pictures)
        for number, picture in enumerate(self.pictures):
            predictions = picture.predict()
            while True:
                variables = self.parameters.place(x, differentiate=True)
                part = next(predictions, None)
                if part is None:
                    break
                self.counts[number] += 1
                yield variables, part

    def difference(self, x: Array, i: int) -> list[Array]:
        """Derivative of both halves' predictions in component `i` of `x`, by central differences."""
        low, high = x.copy(), x.copy()
        low[i], high[i] = max(x[i] - STEP, self.parameters.low[i]), min(x[i] + STEP, self.parameters.high[i])
        ends = [self.residuals(end) for end in (low, high)]
        return [(after - before) / (high[i] - low[i]) for before, after in zip(*ends, strict=True)]

    def descend(self, x: Array) -> tuple[float, Array]:
        """Loss and its gradient by reverse-mode differentiation, as a first-order method wants them."""
        if len(self.differences) == len(x):
            linear = self.linearize(x)
            self.spread = linear.power(self.weights)
            return linear.loss(self.weights), 2 * linear.gradient(self.weights) / len(self.target)
        variables = self.parameters.place(x, differentiate=True)
        parts = self.predict(reverse=True)
        dr.eval(parts)
        ra, rb = (half - self.target for half in self.fold(dr.detach(parts)))
        scaled = self.weights / len(self.target)
        dr.set_grad(parts, self.unfold(scaled * rb, scaled * ra))
        dr.enqueue(dr.ADMode.Backward, parts)
        dr.traverse(dr.ADMode.Backward)
        gradient = np.array([dr.grad(v)[0] for v in variables], dtype=np.float64) * self.parameters.slope(x)
        for i in self.differences:
            ja, jb = self.difference(x, i)
            gradient[i] = scaled @ (rb * ja + ra * jb)
        self.evaluations += 1
        self.spread = float(np.mean(self.weights * (0.5 * (ra + rb)) ** 2))
        return float(np.mean(self.weights * ra * rb)), gradient

    def predict(self, reverse: bool = False) -> list[mi.Color3f]:
        """What the pictures predict, one after another: see `Picture.predict`."""
        predictions = [list(picture.predict(reverse)) for picture in self.pictures]
        self.counts = [len(p) for p in predictions]
        return [part for p in predictions for part in p]

    def fold(self, parts: Sequence[mi.Color3f]) -> tuple[Array, Array]:
        """Two vectors over the residuals, one a half."""
        each = iter(parts)
        a, b = [], []
        for picture, count in zip(self.pictures, self.counts, strict=True):
            halves = picture.fold([next(each) for _ in range(count)])
            a.append(halves[0].ravel())
            b.append(halves[1].ravel())
        return np.concatenate(a), np.concatenate(b)

    def unfold(self, a: Array, b: Array) -> list[mi.Color3f]:
        """The transpose of `fold`."""
        out, start = [], 0
        for picture in self.pictures:
            end = start + 3 * len(picture.pixels)
            halves = (a[start:end].reshape(3, -1), b[start:end].reshape(3, -1))
            out += picture.unfold(halves)
            start = end
        return out

    def noise(self, residuals: tuple[Array, Array]) -> Array:
        """Variance of the target's noise in each residual.

        ``a + b I + c I^2 + d S`` with a, b, c, d >= 0: additive, shot and multiplicative noise of the predicted
        intensity `I`, and that of a rendered target, whose samples fall anywhere in a pixel and differ there as those
        of the fit do, `S`. Read off second differences of the residuals along the rows, in which a misfit, as far as it
        is smooth, cancels; by bins of equal count, so that a few bright pixels do not decide; by the likelihood of a
        variance, ``log v + s^2 / v``, which does not let a few be far too small. What the fit's own samples add is
        subtracted.
        """
        mean = 0.5 * (residuals[0] + residuals[1])
        predicted = np.maximum(self.target + mean, 0.0)
        left, right = self.beside(1)
        middle, after = self.beside(1, right)
        before, here = left[middle], right[middle]
        within = self.sampling(residuals)
        t, s = predicted / self.scale, within / self.scale**2

        def combined(v: Array) -> Array:
            """What independent variances make the variance of a second difference: neighbours may be far brighter."""
            return (v[here] + 0.25 * (v[before] + v[after])) / 1.5

        square = (mean[here] - 0.5 * (mean[before] + mean[after])) ** 2 / 1.5 / self.scale**2
        x, x2, own = combined(t), combined(t * t), combined(s)
        if len(here) < ENOUGH_PIXELS:
            square, x, x2, own = (mean / self.scale) ** 2, t, t * t, s
        bins = [
            group
            for key in (x2, own)
            for group in np.array_split(np.argsort(key, kind="stable"), NOISE_BINS)
            if len(group)
        ]
        total = np.array([square[g].mean() for g in bins])
        mine = np.array([own[g].mean() for g in bins])
        variance = np.maximum(np.maximum(total - mine, LEAST * total), ROUNDING**2)
        basis = np.array([[1.0, x[g].mean(), x2[g].mean(), mine[i]] for i, g in enumerate(bins)])
        fitted = variance
        for _ in range(LIKELIHOOD_STEPS):
            a, b, c, d = nnls(basis / fitted[:, None], variance / fitted)[0]
            fitted = np.maximum(0.5 * fitted + 0.5 * (basis @ (a, b, c, d)), ROUNDING**2)
        return self.scale**2 * np.maximum(a + b * t + c * t * t + d * s, ROUNDING**2)

    def sampling(self, residuals: tuple[Array, Array]) -> Array:
        """Variance that the fit's own samples give the mean of the halves: one a pixel, for all three channels.

        It is largest in few pixels, those on the edge of a shadow and in a sharp highlight. The difference of the
        halves says it of a pixel with one degree of freedom; so it is averaged with the neighbours in the row, and with
        pixels as bright, or chance would weigh the pixels.
        """
        square = 0.25 * (residuals[0] - residuals[1]) ** 2
        start = 0
        for picture in self.pictures:
            end = start + 3 * len(picture.pixels)
            square[start:end] = np.tile(square[start:end].reshape(3, -1).mean(axis=0), 3)
            start = end
        alike = np.empty_like(square)
        for group in np.array_split(np.argsort(self.target + 0.5 * (residuals[0] + residuals[1])), NOISE_BINS):
            alike[group] = square[group].mean() if len(group) else 0.0
        total, count = square + ALIKE * alike, np.full(len(square), 1.0 + ALIKE)
        for lag in (1, 2):
            i, j = self.beside(lag)
            total[i] += square[j]
            total[j] += square[i]
            count[i] += 1
            count[j] += 1
        return total / count

    def misfit(self, residuals: tuple[Array, Array], variance: Array) -> tuple[float, bool]:
        """What the model does not explain, as a fraction of the noise's variance, and whether that is beyond doubt.

        Residuals a few pixels apart have no noise in common; the mean of their product is misfit.
        """
        z = 0.5 * (residuals[0] + residuals[1]) / np.sqrt(variance)
        i, j = self.beside(APART)
        if len(i) < ENOUGH_PIXELS:
            return 0.0, False
        shared = z[i] * z[j]
        mean = float(shared.mean())
        return mean, mean > max(MISFIT, SIGNIFICANT * float(shared.std()) / len(i) ** 0.5)

    def beside(self, lag: int, of: Index | None = None) -> tuple[Index, Index]:
        """Pairs of residuals of the same channel `lag` pixels apart in a row: positions, and indices of both.

        The second of a pair is to the right of the first. With `of`, the firsts are sought among these residuals alone,
        and given as positions in `of`.
        """
        width = self.widths[self.view]
        column = self.pixel % width
        key = ((self.view << 40) + self.pixel) * 3 + self.channel
        order = np.argsort(key)
        first = np.arange(len(key)) if of is None else of
        wanted = key[first] + 3 * lag
        at = np.minimum(np.searchsorted(key[order], wanted), len(key) - 1)
        found = (key[order][at] == wanted) & (column[first] + lag < width[first])
        return np.flatnonzero(found) if of is not None else first[found], order[at[found]]
