"""Pictures of a scene: in passes, so that they fit in memory, can be interrupted, and tell their noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np
import numpy.typing as npt

#: Samples taken at once: few enough that they fit in memory and that nobody waits long for progress, many enough to
#: keep all cores busy.
SAMPLES_PER_PASS = 2**21
#: Passes before the noise is read off their scatter: of fewer its estimate is no better than a guess.
ENOUGH_PASSES = 8
#: Samples a pixel of each of these.
FIRST_SPP = 4
#: See `Scatter.noise`.
DARK = 0.05


@dataclass(frozen=True)
class Rendering:
    """A picture.

    Attributes
    ----------
    picture : float32 array, shape (height, width, channels)
    channels : list of str
        As in a file: ``R``, ``G``, ``B``, ``diffuse.point.R`` ...
    spp : int
        Samples a pixel that it has.
    noise : float or None
        `Scatter.noise` of the picture; None where there were too few passes to tell.
    reached : bool
        It has the samples, or the noise, that were asked for.
    """

    picture: npt.NDArray[np.float32]
    channels: list[str]
    spp: int
    noise: float | None
    reached: bool


def render(
    scene: mi.Scene,
    sensor: mi.Sensor,
    spp: int,
    seed: int = 0,
    *,
    integrator: mi.Integrator | None = None,
    noise: float | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    pressed: Callable[[], bool] = lambda: False,
) -> Rendering:
    """Render in passes that fit in memory.

    What the passes add up to is the film's weighted sums, not its pixels, so that their number does not show.

    Parameters
    ----------
    spp : int
        Samples a pixel; with `noise` the most there may be.
    noise : float, optional
        End when the noise of the picture is no more than this.
    progress : function
        Called after each pass with the samples a pixel done, and those there will be as far as is known.
    pressed : function
        Asked after each pass; true ends the rendering.
    """
    film: Any = sensor.film()
    width, height = film.crop_size()
    most = max(1, SAMPLES_PER_PASS // (width * height))
    wanted = spp if noise is None else min(spp, ENOUGH_PASSES * FIRST_SPP)
    seeds = np.random.SeedSequence(seed)  # seeds next to each other share no pass
    chosen = {} if integrator is None else {"integrator": integrator}
    raw: Any = 0.0
    scatter = Scatter()
    done = 0
    while done < spp:
        # Towards a noise: a few small passes first, that tell it, and then half of what seems to be missing.
        part = wanted if noise is None else FIRST_SPP if scatter.passes < ENOUGH_PASSES else -(-(wanted - done) // 2)
        count = min(most, max(1, part), spp - done)
        number = int(seeds.spawn(1)[0].generate_state(1)[0])
        image = np.array(mi.render(scene, sensor=sensor, spp=count, seed=number, **chosen), dtype=np.float64)
        raw = raw + np.asarray(film.develop(raw=True), dtype=np.float64)
        scatter.add(image[..., :3], count)
        done += count
        error = scatter.noise()
        if noise is not None and error is not None:
            if error <= noise:
                break
            wanted = min(spp, max(done + 1, math.ceil(done * (error / noise) ** 2)))
        progress(done, wanted)
        if pressed():
            break
    channels = [channel.name for channel in film.bitmap().struct_()]
    film.clear()
    film.put_block(mi.ImageBlock(mi.TensorXf(raw.astype(np.float32)), film.crop_offset()))
    error = scatter.noise()
    reached = done >= spp if noise is None else error is not None and error <= noise
    return Rendering(np.array(film.develop(), dtype=np.float32), channels, done, error, reached)


class Scatter:
    """How passes of a picture differ."""

    def __init__(self) -> None:
        self.passes, self.weight = 0, 0.0
        self.sum: Any = 0.0
        self.squares: Any = 0.0

    def add(self, image: npt.NDArray[np.float64], count: int) -> None:
        """A pass of `count` samples a pixel, shape (height, width, 3)."""
        self.passes += 1
        self.weight += count
        self.sum = self.sum + count * image
        self.squares = self.squares + count * image * image

    def noise(self) -> float | None:
        """The noise of the mean of all passes: root mean square of the standard errors, each relative to its pixel.

        ``sqrt(mean of variance / (pixel^2 + DARK mean^2))``, with the mean of the picture: what is much darker than
        that looks black. None with fewer than `ENOUGH_PASSES`.
        """
        if self.passes < ENOUGH_PASSES:
            return None
        mean = self.sum / self.weight
        # A pass of n samples has the variance v / n: the weighted sum of squares is (passes - 1) v on average.
        variance = np.maximum(self.squares - self.weight * mean * mean, 0) / (self.passes - 1) / self.weight
        bright, variance = mean.mean(axis=-1), variance.mean(axis=-1)
        below = bright**2 + DARK * bright.mean() ** 2
        return float(np.sqrt(np.mean(variance / below))) if bright.any() else 0.0
