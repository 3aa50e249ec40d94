"""Pictures under point and directional lights, direct light only: what does not change in a fit is computed once.

Camera rays, hit points and light directions stand still, so they are kept as arrays, and an iteration evaluates the
reflection model alone. The lighting is exact; what remains is where inside a pixel's filter the samples fall.

The film's reconstruction filter is part of the model. A pixel is ``integral filter(x) L(x) dx``, so samples are drawn
from the filter itself, per pixel (Ernst, Stamminger and Greiner 2006, "Filter importance sampling"). That is the same
mean as splatting each sample with the filter; it needs no scatter, whose order of summation would differ from run to
run, and leaves the errors of neighbouring pixels independent, which the error bars use.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation, maximum_filter, uniform_filter

from ..pixels import film_size, index_of, rays

Array = npt.NDArray[np.float64]

#: Points of the table by which a filter's distribution is inverted.
FILTER_TABLE = 4096
#: Where a filter has lobes below zero, one sample in so many is drawn from them.
NEGATIVE = 4
#: Cells of a guide along the side of a pixel: the first that makes no more cells in all than this.
CELLS, MOST_CELLS = (8, 4, 2), 4_000_000
#: Of these so many are looked at together; and samples are placed for so many pixels together.
AT_ONCE, GUIDED = 500_000, 2_000
#: Where samples are placed: by the filter; evenly under it; by filter times light.
SHARES = (0.25, 0.25, 0.5)
#: Under the filter of a pixel whose samples are placed by the guide, the brightest part is so many times the mean; and
#: by what factor such a pixel has more samples.
SHARP, SHARPER = 4.0, 16
#: What is darker than this fraction of the film's mean matters to no pixel.
FAINT = 0.1
#: Roots of x^(d+1) = x + 1: the generalised golden ratios of the Kronecker sequences in 2 and 4 dimensions.
GOLDEN = {2: 1.32471795724474602596, 4: 1.16730397826141868426}


class ExactPicture:
    """See `fitting.picture.Picture`.

    Parameters
    ----------
    scene : mi.Scene
    sensor : mi.Sensor
    groups : list of (mi.BSDF, int array)
        What ``shape.bsdf()`` gives, and the flat indices of the pixels that see it alone.
    samples : int
        Samples a pixel in each half.
    seed : int
    guide : array, shape (height * cells, width * cells), optional
        How bright each part of the film is, as `glow` gives it: pixels that see a sharp highlight have most samples
        there, and `SHARPER` times as many.
    """

    def __init__(
        self,
        scene: mi.Scene,
        sensor: mi.Sensor,
        groups: list[tuple[mi.BSDF, npt.NDArray[np.int64]]],
        samples: int,
        seed: int,
        guide: Array | None = None,
    ) -> None:
        self.samples, self.size = samples, film_size(sensor)
        self.radius = float(sensor.film().rfilter().radius())
        self.cells = next((n for n in CELLS if math.prod(self.size) * n * n <= MOST_CELLS), CELLS[-1])
        self.source, self.rng = (scene, sensor, groups), np.random.default_rng([seed, samples])
        sharp = np.zeros(math.prod(self.size), dtype=bool) if guide is None else self.sharp(guide)
        parts = [
            (bsdf, where, by)
            for bsdf, pixels in groups
            for where, by in ((pixels[~sharp[pixels]], None), (pixels[sharp[pixels]], guide))
            if len(where)
        ]
        self.caches = []
        for bsdf, where, by in parts:
            n = samples if by is None else SHARPER * samples
            points = around_pixels(sensor, np.concatenate([where, where]), n, self.rng, by)
            self.caches.append(Cache(scene, sensor, bsdf, *points, n))
        self.pixels = np.concatenate([where for _, where, _ in parts])
        self.counts = [len(where) for _, where, _ in parts]

    def predict(self, reverse: bool = False) -> Iterator[mi.Color3f]:
        return (cache.radiance(reverse) for cache in self.caches)

    def fold(self, parts: Sequence[mi.Color3f]) -> tuple[Array, Array]:
        sums = [[dr.block_sum(c, cache.addends) for c in part] for cache, part in zip(self.caches, parts, strict=True)]
        dr.eval(sums)
        whole = np.concatenate([np.array(each, dtype=np.float64).reshape(3, 2, -1) for each in sums], axis=2)
        return whole[:, 0], whole[:, 1]

    def glow(self) -> Array:
        """How bright each part of the film is, shape (height * cells, width * cells), by a sample in each.

        Averaged with the parts around it: where a sharp highlight ends is not known that well. 0 away from the pixels.
        """
        scene, sensor, groups = self.source
        width, height = self.size
        out = np.zeros((height * self.cells, width * self.cells))
        for bsdf, pixels in groups:
            near = np.zeros(width * height, dtype=bool)
            near[pixels] = True
            near = binary_dilation(near.reshape(height, width), np.ones([2 * math.ceil(self.radius) + 1] * 2))
            row, column = np.nonzero(np.kron(near, np.ones((self.cells, self.cells))))
            for part in np.array_split(np.arange(len(row)), max(1, len(row) // AT_ONCE)):
                points = [(a[part] + self.rng.random(len(part))) / self.cells for a in (column, row)]
                if sensor.needs_aperture_sample():
                    points += list(self.rng.random((2, len(part))))
                light = Cache(scene, sensor, bsdf, points, np.ones(len(part)), 1).radiance(False)
                total = np.sum(np.array(dr.detach(light), dtype=np.float64), axis=0)
                out[row[part], column[part]] += total.reshape(len(part), -1).sum(axis=1)
        return uniform_filter(out, 3, mode="constant")

    def sharp(self, guide: Array) -> npt.NDArray[np.bool_]:
        """Which pixels of the film, shape (height * width,), see a highlight that lights a small part of them alone."""
        side = 2 * math.ceil(self.cells * self.radius) + 1
        peak, mean = (f(guide, side, mode="constant") for f in (maximum_filter, uniform_filter))
        middle = np.s_[self.cells // 2 :: self.cells, self.cells // 2 :: self.cells]
        return (peak[middle] > SHARP * (mean[middle] + FAINT * guide.mean())).ravel()

    def unfold(self, halves: tuple[Array, Array]) -> list[mi.Color3f]:
        out, start = [], 0
        for cache, count in zip(self.caches, self.counts, strict=True):
            both = np.concatenate([h[:, start : start + count] for h in halves], axis=1)
            out.append(mi.Color3f(np.repeat(both.astype(np.float32), cache.addends, axis=1)))
            start += count
        return out


class Cache:
    """Samples of some pixels that see the same BSDF: hit points, directions to the lights, their light.

    Pixel by pixel; for each pixel the lights; for each light the samples. So `addends` consecutive entries, lights
    times samples, add up to a pixel.

    Parameters
    ----------
    points : list of array, shape (n * samples,)
        Positions on the film in x and y [pixels]; for a lens two more in the unit square.
    share : array, shape (n * samples,)
        What each counts.
    samples : int
        A pixel.
    """

    def __init__(
        self, scene: mi.Scene, sensor: mi.Sensor, bsdf: mi.BSDF, points: Sequence[Array], share: Array, samples: int
    ) -> None:
        self.bsdf, self.context, self.samples = bsdf, mi.BSDFContext(), samples
        emitters = scene.emitters()
        self.addends = len(emitters) * samples
        x, y, *lens = (mi.Float(p.astype(np.float32)) for p in points)
        ray, ray_weight = rays(sensor, mi.Point2f(x, y), mi.Point2f(*lens) if lens else None)
        si = scene.ray_intersect(ray)
        here = si.is_valid() & (dr.reinterpret_array(mi.UInt32, si.bsdf()) == index_of(bsdf))
        factor = mi.Color3f(ray_weight) * mi.Float(share.astype(np.float32))
        dr.eval(si, here, factor)

        # Opaque, or each number of samples would ask for a kernel of its own.
        n, lights = dr.opaque(mi.UInt32, samples), dr.opaque(mi.UInt32, len(emitters))
        i = dr.arange(mi.UInt32, len(share) * len(emitters))
        sample, which = i // (n * lights) * n + i % n, i // n % lights
        self.si = dr.gather(mi.SurfaceInteraction3f, si, sample)
        self.active = dr.gather(mi.Bool, here, sample)
        self.wo, self.light = mi.Vector3f(0), mi.Color3f(0)
        for number, emitter in enumerate(emitters):
            ds, weight = emitter.sample_direction(self.si, mi.Point2f(0.5, 0.5), self.active)
            seen = self.active & (which == number) & ~scene.ray_test(self.si.spawn_ray_to(ds.p), self.active)
            self.wo = dr.select(which == number, self.si.to_local(ds.d), self.wo)
            self.light = dr.select(seen, mi.Color3f(weight) * dr.gather(mi.Color3f, factor, sample), self.light)
        self.active &= dr.max(dr.abs(self.light)) > 0
        dr.eval(self.si, self.active, self.wo, self.light)

    def radiance(self, reverse: bool) -> mi.Color3f:
        """What each sample adds to its pixel.

        In reverse mode the BSDF is called through a pointer: one node of the graph, whose adjoint gathers all that the
        samples say of a parameter in one kernel. Called directly, each use of a parameter would end in a reduction of
        its own.
        """
        bsdf = dr.select(self.active, mi.BSDFPtr(self.bsdf), dr.zeros(mi.BSDFPtr)) if reverse else self.bsdf
        return self.light * mi.Color3f(bsdf.eval(self.context, self.si, self.wo, self.active))


def around_pixels(
    sensor: mi.Sensor,
    pixels: npt.NDArray[np.int64],
    samples: int,
    rng: np.random.Generator,
    guide: Array | None = None,
) -> tuple[list[Array], Array]:
    """`samples` points around each of these pixels, and their weights, for a `Cache`: see `filter_points`."""
    width, height = film_size(sensor)
    column, row = pixels % width, pixels // width
    dimensions = 4 if sensor.needs_aperture_sample() else 2
    # What falls outside the film does not count.
    spans = ((-column - 0.5, width - column - 0.5), (-row - 0.5, height - row - 0.5))
    rfilter = sensor.film().rfilter()
    if guide is None:
        points, share = filter_points(rfilter, spans, samples, dimensions, rng)
    else:
        drawn = [
            guided_points(
                rfilter,
                [(low[some], high[some]) for low, high in spans],
                samples,
                dimensions,
                rng,
                *around(guide, sensor, column[some], row[some]),
            )
            for some in np.array_split(np.arange(len(pixels)), 1 + len(pixels) // GUIDED)
        ]
        points = [np.concatenate(each) for each in zip(*(p for p, _ in drawn), strict=True)]
        share = np.concatenate([s for _, s in drawn])
    points[:2] = [p + np.repeat(middle, samples) + 0.5 for p, middle in zip(points[:2], (column, row), strict=True)]
    return points, share


def kronecker(n: int, samples: int, dimensions: int, rng: np.random.Generator) -> list[npt.NDArray[np.float64]]:
    """Points in the unit square (or 4-cube), `samples` for each of `n` pixels.

    A Kronecker sequence, shifted at random per pixel.

    Returns
    -------
    list of array, shape (n * samples,)
        One a dimension, pixel by pixel.
    """
    steps = GOLDEN[dimensions] ** -np.arange(1, dimensions + 1)
    return [((rng.random((n, 1)) + np.arange(samples) * step) % 1.0).ravel() for step in steps]


def filter_points(
    rfilter: mi.ReconstructionFilter,
    spans: Sequence[tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]],
    samples: int,
    dimensions: int,
    rng: np.random.Generator,
) -> tuple[list[Array], Array]:
    """Points drawn from a reconstruction filter, `samples` for each of n pixels, and the weights that make up a mean.

    A filter's two axes are independent, and each is the difference of a positive and a negative part. A fixed number of
    points is drawn where their product is positive, and of those with lobes below zero a fixed number where it is
    negative: left to chance, how many there are would be as noisy as the picture.

    Parameters
    ----------
    rfilter : mi.ReconstructionFilter
    spans : pair of (array, array), each of shape (n,)
        For x and y, the least and the greatest offset from a pixel's centre that is on the film [pixels].
    samples : int
        One is drawn where the product is positive: good for the search of a start alone.
    dimensions : int
        2, or 4 with two more in the unit square.
    rng : np.random.Generator

    Returns
    -------
    list of array, shape (n * samples,)
        Offsets in x and y [pixels], and the further dimensions; pixel by pixel.
    array, shape (n * samples,)
        Weights; those of a pixel add up to 1.
    """
    radius = float(rfilter.radius())
    edges = np.linspace(-radius, radius, FILTER_TABLE + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    value = np.array(rfilter.eval(mi.Float(middle.astype(np.float32))), dtype=np.float64)
    # Of each part: its running integral, and that where the pixel's span begins and how much there is in it.
    parts = [np.concatenate([[0.0], np.cumsum(np.maximum(s * value, 0))]) for s in (1, -1)]
    starts = [[np.interp(low, edges, part) for part in parts] for low, _ in spans]
    (px, nx), (py, ny) = (
        [np.interp(high, edges, part) - start for part, start in zip(parts, each, strict=True)]
        for (_, high), each in zip(spans, starts, strict=True)
    )

    def draw(first: Array, second: Array, same: bool, count: int) -> tuple[list[Array], Array]:
        """`count` points, of weight `first` where x is drawn from the positive part and `second` where it is not.

        The part of y is the `same` as that of x, or the other.
        """
        points = [p.reshape(-1, count) for p in kronecker(len(first), count, dimensions, rng)]
        total = first + second
        chance = np.divide(first, total, out=np.ones_like(total), where=total > 0)[:, None]
        positive = points[0] < chance
        points[0] = np.where(positive, points[0], points[0] - chance) / np.where(positive, chance, 1.0 - chance)
        for axis, masses in enumerate(((px, nx), (py, ny))):
            positive = positive if axis == 0 or same else ~positive
            of = [
                np.interp(start[:, None] + points[axis] * mass[:, None], part, edges) if part[-1] > 0 else 0.0
                for part, start, mass in zip(parts, starts[axis], masses, strict=True)
            ]
            points[axis] = np.where(positive, *of)
        return points, np.repeat((total / ((px - nx) * (py - ny)))[:, None] / count, count, axis=1)

    fewer = max(1, samples // NEGATIVE) if samples > 1 and parts[1][-1] > 0 else 0
    points, share = draw(px * py, nx * ny, True, samples - fewer)
    if fewer:
        below, minus = draw(px * ny, nx * py, False, fewer)
        points = [np.concatenate(each, axis=1) for each in zip(points, below, strict=True)]
        share = np.concatenate([share, -minus], axis=1)
    return [p.ravel() for p in points], share.ravel()


def around(
    guide: Array, sensor: mi.Sensor, column: npt.NDArray[np.int64], row: npt.NDArray[np.int64]
) -> tuple[Array, int]:
    """The parts of a guide under the filter of each pixel, shape (n, parts, parts), 0 off the film; parts a pixel."""
    cells = guide.shape[1] // film_size(sensor)[0]
    reach = math.ceil(cells * float(sensor.film().rfilter().radius()))
    padded = np.pad(guide, reach)
    parts = np.arange(2 * reach) + cells // 2
    return padded[(cells * row)[:, None, None] + parts[:, None], (cells * column)[:, None, None] + parts], cells


def guided_points(
    rfilter: mi.ReconstructionFilter,
    spans: Sequence[tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]],
    samples: int,
    dimensions: int,
    rng: np.random.Generator,
    light: Array,
    cells: int,
) -> tuple[list[Array], Array]:
    """As `filter_points`, but most points lie where filter times light is large.

    A highlight smaller than a pixel lights its neighbours as well, through the tails of their filters, where the filter
    alone has a point in a thousand. A cell is drawn by a mixture of `SHARES`: in proportion to the integral `F` of the
    filter's magnitude over it; each alike; and in proportion to ``F L``, unless that is 0 everywhere. In the cell a
    point is drawn from the filter, so that its weight ``F / q`` depends on the cell alone.

    Parameters
    ----------
    light : array, shape (n, parts, parts)
        Of each pixel, how bright the parts under its filter are: rows from top to bottom, columns from left to right.
    cells : int
        Such parts along the side of a pixel.
    """
    radius, reach = float(rfilter.radius()), light.shape[1] // 2
    edges = np.linspace(-radius, radius, FILTER_TABLE + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    value = np.array(rfilter.eval(mi.Float(middle.astype(np.float32))), dtype=np.float64)
    size, signed = (np.concatenate([[0.0], np.cumsum(v)]) for v in (np.abs(value), value))
    sides = np.arange(-reach, reach + 1) / cells
    begin = np.interp(sides, edges, size)
    masses, totals = [], []
    for low, high in spans:
        on = (sides[:-1] >= low[:, None] - 1e-6) & (sides[1:] <= high[:, None] + 1e-6)
        masses.append(np.diff(begin) * on)
        totals.append(np.sum(np.diff(np.interp(sides, edges, signed)) * on, axis=1))
    mass = masses[1][:, :, None] * masses[0][:, None, :]
    bright = mass * light
    alike = (mass > 0).astype(float)
    q = np.zeros_like(mass)
    for chance, each in zip(SHARES, (mass, alike, bright), strict=True):
        q += chance * each / np.maximum(each.sum(axis=(1, 2), keepdims=True), 1e-300)
    q /= q.sum(axis=(1, 2), keepdims=True)
    u = kronecker(len(mass), samples, dimensions, rng)
    pixel = np.repeat(np.arange(len(mass)), samples)
    row, u[1] = pick(q.sum(axis=2), pixel, u[1])
    column, u[0] = pick(q.reshape(-1, 2 * reach), pixel * (2 * reach) + row, u[0])
    share = (mass / np.where(q > 0, q, 1.0))[pixel, row, column] / (samples * (totals[0] * totals[1])[pixel])
    for axis, cell in enumerate((column, row)):
        u[axis] = np.interp(begin[cell] + u[axis] * np.diff(begin)[cell], size, edges)
        share *= np.where(value[np.minimum(np.searchsorted(edges, u[axis], "right") - 1, FILTER_TABLE - 1)] < 0, -1, 1)
    return u, share


def pick(chances: Array, which: npt.NDArray[np.int64], u: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """Draw a cell of the line `which` of `chances` by each number of `u`, and what is left of that number."""
    cells = chances.shape[1]
    ends = np.cumsum(chances, axis=1)
    ends /= np.where(ends[:, -1:] > 0, ends[:, -1:], 1.0)
    ends += np.arange(len(ends))[:, None]
    flat = ends.ravel()
    at = np.minimum(np.searchsorted(flat, which + u, "right"), which * cells + cells - 1)
    before = np.where(at % cells > 0, flat[at - 1], which)
    return at % cells, np.clip((which + u - before) / np.maximum(flat[at] - before, 1e-300), 0.0, 1.0)
