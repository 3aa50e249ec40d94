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
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from ..pixels import film_size, index_of, rays

Array = npt.NDArray[np.float64]

#: Points of the table by which a filter's distribution is inverted.
FILTER_TABLE = 4096
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
        points = kronecker(len(both), samples, 4 if sensor.needs_aperture_sample() else 2, rng)
        inverse, masses = filter_table(sensor.film().rfilter())
        (dx, sx), (dy, sy) = inverse(points[0]), inverse(points[1])
        column, row = both % width, both // width
        x, y = np.repeat(column, samples) + 0.5 + dx, np.repeat(row, samples) + 0.5 + dy
        # What falls outside the film does not count. Samples on positive and on negative lobes of the filter share what
        # these weigh: with signs alone, their sum would be as noisy as the picture.
        sign = (sx * sy * ((x >= 0) & (x <= width) & (y >= 0) & (y <= height))).reshape(-1, samples)
        (px, nx), (py, ny) = masses(-column - 0.5, width - column - 0.5), masses(-row - 0.5, height - row - 0.5)
        minus = np.where((sign < 0).any(axis=1), (px * ny + nx * py) / ((px - nx) * (py - ny)), 0.0)
        count = [np.maximum((sign * s > 0).sum(axis=1), 1) for s in (1, -1)]
        share = np.where(sign > 0, ((1 + minus) / count[0])[:, None], -(minus / count[1])[:, None]) * (sign != 0)
        share = share.ravel()
        aperture = mi.Point2f(*(mi.Float(p.astype(np.float32)) for p in points[2:])) if len(points) > 2 else None
        position = mi.Point2f(mi.Float(x.astype(np.float32)), mi.Float(y.astype(np.float32)))
        ray, ray_weight = rays(sensor, position, aperture)
        si = scene.ray_intersect(ray)
        here = si.is_valid() & (dr.reinterpret_array(mi.UInt32, si.bsdf()) == index_of(bsdf)) & mi.Bool(share != 0)
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


def filter_table(rfilter: mi.ReconstructionFilter) -> tuple[Any, Any]:
    """Inversion of the distribution ``|filter(x)|`` along one axis.

    Returns
    -------
    function
        Of `u` in [0, 1), giving the offset from the pixel's centre [pixels] and the filter's sign there.
    function
        Of two offsets, giving the mass of the filter's positive lobes between them and that of its negative ones.
    """
    radius = float(rfilter.radius())
    edges = np.linspace(-radius, radius, FILTER_TABLE + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    value = np.array(rfilter.eval(mi.Float(middle.astype(np.float32))), dtype=np.float64)
    total = np.abs(value).sum()
    cdf = np.concatenate([[0.0], np.cumsum(np.abs(value))]) / total
    sums = [np.concatenate([[0.0], np.cumsum(np.maximum(s * value, 0))]) / total for s in (1, -1)]

    def inverse(u: Array) -> tuple[Array, Array]:
        cell = np.clip(np.searchsorted(cdf, u, side="right") - 1, 0, FILTER_TABLE - 1)
        width = cdf[cell + 1] - cdf[cell]
        t = np.where(width > 0, (u - cdf[cell]) / np.where(width > 0, width, 1.0), 0.5)
        return edges[cell] + t * (edges[1] - edges[0]), np.where(value[cell] < 0, -1.0, 1.0)

    def masses(low: Array, high: Array) -> list[Array]:
        return [np.interp(high, edges, each) - np.interp(low, edges, each) for each in sums]

    return inverse, masses
