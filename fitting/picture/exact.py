"""Pictures under point and directional lights, direct light only: what does not change in a fit is computed once.

Camera rays, hit points and light directions stand still, so they are kept as arrays, and an iteration evaluates the
reflection model alone. The lighting is exact; what remains is where inside a pixel's filter the samples fall.

The film's reconstruction filter is part of the model. A pixel is ``integral filter(x) L(x) dx``, so samples are drawn
from the filter itself, per pixel (Ernst, Stamminger and Greiner 2006, "Filter importance sampling"). That is the same
mean as splatting each sample with the filter; it needs no scatter, whose order of summation would differ from run to
run, and leaves the errors of neighbouring pixels independent, which the error bars use.
"""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from ..pixels import film_size, index_of, rays

Array = npt.NDArray[np.float64]

#: Points of the table by which a filter's distribution is inverted.
FILTER_TABLE = 4096
#: Where a filter has lobes below zero, one sample in so many is drawn from them.
NEGATIVE = 4
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
    """

    def __init__(
        self,
        scene: mi.Scene,
        sensor: mi.Sensor,
        groups: list[tuple[mi.BSDF, npt.NDArray[np.int64]]],
        samples: int,
        seed: int,
    ) -> None:
        self.pixels = np.concatenate([pixels for _, pixels in groups])
        self.samples = samples
        rng = np.random.default_rng([seed, samples])
        self.caches = [Cache(scene, sensor, bsdf, pixels, samples, rng) for bsdf, pixels in groups]

    def predict(self, reverse: bool = False) -> list[mi.Color3f]:
        return [cache.radiance(reverse) for cache in self.caches]

    def fold(self, parts: Sequence[mi.Color3f]) -> tuple[Array, Array]:
        sums = [[dr.block_sum(c, cache.addends) for c in part] for cache, part in zip(self.caches, parts, strict=True)]
        dr.eval(sums)
        whole = np.concatenate([np.array(each, dtype=np.float64).reshape(3, 2, -1) for each in sums], axis=2)
        return whole[:, 0], whole[:, 1]

    def unfold(self, halves: tuple[Array, Array]) -> list[mi.Color3f]:
        out, start = [], 0
        for cache in self.caches:
            both = np.concatenate([h[:, start : start + cache.count] for h in halves], axis=1)
            out.append(mi.Color3f(np.repeat(both.astype(np.float32), cache.addends, axis=1)))
            start += cache.count
        return out


class Cache:
    """All samples of some pixels that see the same BSDF: hit points, directions to the lights, their light.

    In this order: the pixels of half A, then those again of half B; for each pixel the lights; for each light the
    samples. So `addends` consecutive entries, lights times samples, add up to a pixel.
    """

    def __init__(
        self,
        scene: mi.Scene,
        sensor: mi.Sensor,
        bsdf: mi.BSDF,
        pixels: npt.NDArray[np.int64],
        samples: int,
        rng: np.random.Generator,
    ) -> None:
        self.bsdf, self.context, self.count = bsdf, mi.BSDFContext(), len(pixels)
        emitters = scene.emitters()
        self.addends = len(emitters) * samples
        width, height = film_size(sensor)
        both = np.concatenate([pixels, pixels])
        dimensions = 4 if sensor.needs_aperture_sample() else 2
        column, row = both % width, both // width
        # What falls outside the film does not count.
        spans = ((-column - 0.5, width - column - 0.5), (-row - 0.5, height - row - 0.5))
        points, share = filter_points(sensor.film().rfilter(), spans, samples, dimensions, rng)
        x, y = np.repeat(column, samples) + 0.5 + points[0], np.repeat(row, samples) + 0.5 + points[1]
        aperture = mi.Point2f(*(mi.Float(p.astype(np.float32)) for p in points[2:])) if len(points) > 2 else None
        position = mi.Point2f(mi.Float(x.astype(np.float32)), mi.Float(y.astype(np.float32)))
        ray, ray_weight = rays(sensor, position, aperture)
        si = scene.ray_intersect(ray)
        here = si.is_valid() & (dr.reinterpret_array(mi.UInt32, si.bsdf()) == index_of(bsdf))
        factor = mi.Color3f(ray_weight) * mi.Float(share.astype(np.float32))
        dr.eval(si, here, factor)

        # Opaque, or each number of samples would ask for a kernel of its own.
        n, lights = dr.opaque(mi.UInt32, samples), dr.opaque(mi.UInt32, len(emitters))
        i = dr.arange(mi.UInt32, len(both) * self.addends)
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
