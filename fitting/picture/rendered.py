"""Pictures through a Mitsuba integrator: any light, any number of bounces, and noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class RenderedPicture:
    """See `fitting.picture.Picture`. A half is an independent seed.

    Parameters
    ----------
    scene : mi.Scene
    sensor : mi.Sensor
    integrator : mi.Integrator
    entries : mi.SceneParameters
        The free parameters: Mitsuba differentiates a rendering with respect to these.
    pixels : int array
        Flat indices of the pixels to predict.
    samples : int
        Samples a pixel in each half.
    seed : int
    halves : {2, 1}
        1: one rendering stands for both halves, for a coarse search.
    """

    def __init__(
        self,
        scene: mi.Scene,
        sensor: mi.Sensor,
        integrator: mi.Integrator,
        entries: mi.SceneParameters,
        pixels: npt.NDArray[np.int64],
        samples: int,
        seed: int,
        halves: int = 2,
    ) -> None:
        self.pixels, self.halves = pixels, halves
        self.samples = samples
        self.scene, self.sensor, self.integrator, self.entries = scene, sensor, integrator, entries
        self.index = mi.UInt32(pixels.astype(np.uint32))
        rng = np.random.default_rng([seed, samples])
        self.seeds = [dr.opaque(mi.UInt32, int(s)) for s in rng.integers(0, 2**31, 4)]

    def predict(self, reverse: bool = False) -> Iterator[mi.Color3f]:
        return (self.render(half) for half in range(self.halves))

    def render(self, half: int) -> mi.Color3f:
        image = mi.render(
            self.scene,
            params=self.entries,
            sensor=self.sensor,
            integrator=self.integrator,
            spp=self.samples,
            seed=self.seeds[half],
            seed_grad=self.seeds[2 + half],
        )
        at = self.index * image.shape[2]
        return mi.Color3f(*(dr.gather(mi.Float, image.array, at + c) for c in range(3)))

    def fold(self, parts: Sequence[mi.Color3f]) -> tuple[Array, Array]:
        arrays = [np.array(part, dtype=np.float64) for part in parts]
        return arrays[0], arrays[-1]

    def unfold(self, halves: tuple[Array, Array]) -> list[mi.Color3f]:
        a, b = halves
        return [mi.Color3f(half.astype(np.float32)) for half in ([a, b] if self.halves == 2 else [a + b])]
