"""A few small pictures, a layer a cell, that tell what each cell is worth before the large one is rendered.

Independent runs are needed, since the square of a noisy layer is too large by its variance: the mean square of a layer
Y is estimated from products of two runs, mean over pixels of Y_i Y_j, which is right on average. Its standard error is
that of the jackknife: the estimate again without each of the runs.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from brdf.errors import UsageError

from .table import CELLS, EMITTER

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Layers = Mapping[str, npt.NDArray[Any]]

#: Independent runs. A product of two is relative to the pixel in the others, so that four is the least for which the
#: jackknife, that leaves one out, has any.
RUNS = 4
SIZE, SPP = 32, 16
#: Percentile of the picture without lamps seen directly that counts as white.
WHITE_PERCENTILE = 99.0
#: An error is relative to the pixel, but to no less than this fraction of white: darker ones look black.
FLOOR = 0.05
#: Timings of each set of cells, after a first that compiles.
REPEATS = 3
#: So many standard errors are added to a predicted error. Each is from 4 runs: it is a bound in 93 % of cases.
SAFETY = 2.0


class Estimate(NamedTuple):
    """A value and its standard error."""

    value: float
    se: float


@dataclass(frozen=True)
class Pilot:
    """What the runs showed.

    Attributes
    ----------
    layers : dict of array, shape (runs, height, width, 3)
        The light of each cell. ``mirror.indirect/diffuse.area`` is a part of ``mirror.indirect`` that goes as well if
        ``diffuse.area`` is left out.
    white : float
        Radiance that counts as white.
    """

    layers: dict[str, Floats]
    white: float

    @property
    def runs(self) -> int:
        return len(next(iter(self.layers.values())))

    def total(self, cells: Collection[str] = CELLS) -> Floats:
        """The sum of the layers that are seen only with some of these cells, shape (runs, height, width, 3)."""
        zero = np.zeros_like(next(iter(self.layers.values())))
        return sum((y for name, y in self.layers.items() if not set(cells).isdisjoint(name.split("/"))), zero)


def run(
    layers: Callable[[mi.Scene, int, int, int], Layers],
    scene: mi.Scene,
    *,
    spp: int = SPP,
    size: int = SIZE,
    seed: int = 0,
    runs: int = RUNS,
) -> Pilot:
    """Render the runs.

    Parameters
    ----------
    layers : function
        ``layers(scene, spp, seed, size)`` returns for each cell an array of shape (height, width, 3), linear RGB.
    spp, size : int
        Samples a pixel, and the longer side of the picture [pixels].
    seed : int
        Another seed, other noise.

    Raises
    ------
    UsageError
        Fewer than 4 runs.
    """
    if runs < RUNS:
        raise UsageError(f"a pilot of {runs} runs has no standard error. It takes at least {RUNS}.")
    seeds = np.random.SeedSequence(seed).generate_state(runs)  # seeds next to each other share no run
    found = [layers(scene, spp, int(s), size) for s in seeds]
    stacked = {name: np.array([one[name] for one in found], dtype=np.float64) for name in found[0]}
    return Pilot(stacked, white_of({name: y.mean(axis=0) for name, y in stacked.items()}))


def white_of(layers: Layers) -> float:
    """The radiance to be shown white: a high percentile of the largest channel, not counting lamps seen directly."""
    for left_out in ((EMITTER,), ()):
        kept = [np.asarray(y, dtype=np.float64) for name, y in layers.items() if name not in left_out]
        bright = np.sum(kept, axis=0).max(axis=-1) if kept else np.zeros(1)
        for value in (np.percentile(bright, WHITE_PERCENTILE), bright.max()):
            if value > 0:
                return float(value)
    return 1.0


def shares(pilot: Pilot) -> dict[str, Estimate]:
    """The part of the light of the whole picture that each cell has, with its standard error. They add up to 1."""
    whole = pilot.total().sum(axis=(1, 2, 3))
    sums = {cell: np.zeros_like(whole) for cell in CELLS}
    for name, y in pilot.layers.items():
        sums[name.split("/")[0]] += y.sum(axis=(1, 2, 3))

    def share(cell: str, kept: Mask) -> float:
        light = whole[kept].sum()
        return float(sums[cell][kept].sum() / light) if light > 0 else 0.0

    return {cell: jackknife(lambda kept, cell=cell: share(cell, kept), pilot.runs) for cell in CELLS}


def drop_error(pilot: Pilot, cells: Collection[str]) -> Estimate:
    """The predicted error of a picture without these cells: `difference` from the whole one, with its standard error.

    It is formed of the sum of the layers: all are positive, so their errors add up, not their squares. Where the runs
    are noisy it errs on the large side, since what is divided by is noisy as well.

    Returns
    -------
    Estimate
        Relative root mean square; 0.01 is one per cent.
    """
    gone = pilot.total(cells)
    if not gone.any():
        return Estimate(0.0, 0.0)
    whole = pilot.total()

    def square(kept: Mask) -> float:
        runs = [k for k in range(pilot.runs) if kept[k]]
        seen = gone * visible(whole[runs].mean(axis=0), gone[runs].mean(axis=0), pilot.white)

        def size(*used: int) -> Floats:
            return scale(whole[[k for k in runs if k not in used]].mean(axis=0), pilot.white)

        products = [np.mean(seen[i] * seen[j] / size(i, j) ** 2) for i, j in itertools.combinations(runs, 2)]
        # What is met once in a while is in no two runs at the same pixel: a root mean square is no less than the mean.
        least = np.mean([np.mean(seen[i] / size(i)) for i in runs])
        return float(max(np.mean(products), least**2))

    value, se = jackknife(square, pilot.runs)
    root = math.sqrt(value)
    return Estimate(root, se / (2 * root) if root > 0 else 0.0)


def visible(whole: Floats, gone: Floats, white: float) -> Floats:
    """The part of the light left out whose loss is seen: less than 1 where the picture is above white."""
    shown = np.minimum(whole, white) - np.minimum(np.maximum(whole - gone, 0), white)
    return np.where(gone > 0, shown / np.where(gone > 0, gone, 1), 1)


def scale(whole: Floats, white: float) -> Floats:
    """What an error in a pixel is relative to: the mean of its channels, between `FLOOR` white and white."""
    return np.maximum(np.minimum(whole, white).mean(axis=-1, keepdims=True), FLOOR * white)


def difference(whole: npt.NDArray[Any], without: npt.NDArray[Any], white: float) -> float:
    """The error of a picture: root mean square over pixels and channels, relative to the pixel, both clipped at white.

    Parameters
    ----------
    whole, without : array, shape (height, width, 3)
        Linear RGB, without noise: noise counts as an error.
    """
    whole, without = np.asarray(whole, dtype=np.float64), np.asarray(without, dtype=np.float64)
    shown = np.minimum(whole, white) - np.minimum(without, white)
    return float(np.sqrt(np.mean((shown / scale(whole, white)) ** 2)))


def jackknife(value: Callable[[Mask], float], runs: int) -> Estimate:
    """A function of the runs that are kept (a mask), and its standard error from leaving out one at a time."""
    every = np.ones(runs, dtype=bool)
    without = np.array([value(np.arange(runs) != k) for k in range(runs)])
    return Estimate(value(every), float(np.sqrt((runs - 1) * np.mean((without - without.mean()) ** 2))))


class Drop(NamedTuple):
    """Cells to leave out, and the predicted error of leaving out all of them."""

    cells: frozenset[str]
    error: Estimate


def droppable(pilot: Pilot, tolerance: float, caustics: bool) -> Drop:
    """As many cells as can be left out so that the error stays below `tolerance`, `SAFETY` standard errors included.

    From the one that matters least upwards. What a few samples cannot know is not taken at its word: with caustics in
    the scene indirect light is kept, since its brightest spots are rarely met. Lamps seen directly cost nothing, and
    are kept.

    Parameters
    ----------
    tolerance : float
        Relative root mean square, as `drop_error`.
    caustics : bool
        ``inventory.take(scene).caustics``.
    """
    open_to = [
        c for c in CELLS if c != EMITTER and not (caustics and c.endswith(".indirect")) and pilot.total([c]).any()
    ]
    chosen, error = frozenset[str](), Estimate(0.0, 0.0)
    for cell in sorted(open_to, key=lambda c: drop_error(pilot, [c]).value):
        more = drop_error(pilot, chosen | {cell})
        if more.value + SAFETY * more.se > tolerance:
            break
        chosen, error = chosen | {cell}, more
    return Drop(chosen, error)


def rendered(integrator: Any, sensor: Any) -> Callable[[mi.Scene, int, int, int], Layers]:
    """The ``layers`` that `run` takes, by an integrator with three channels a cell: `effects` with ``layers``.

    Parameters
    ----------
    integrator : mi.Integrator
        Its ``aov_names()`` are ``CELL.R``, ``CELL.G``, ``CELL.B``, and so on.
    sensor : mi.Sensor
        Its film is made small for the time of the rendering.
    """
    names = [name.rpartition(".")[0] for name in integrator.aov_names()[::3]]

    def layers(scene: mi.Scene, spp: int, seed: int, size: int) -> Layers:
        with shrunk(sensor, size):
            picture = np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=spp, seed=seed))
        first = picture.shape[-1] - 3 * len(names)
        return {name: picture[..., first + 3 * i : first + 3 * i + 3] for i, name in enumerate(names)}

    return layers


@contextmanager
def shrunk(sensor: Any, size: int) -> Iterator[None]:
    """Within it, the longer side of a sensor's picture is `size` pixels, and it shows the same."""
    params = mi.traverse(sensor)
    keys = ("film.size", "film.crop_size", "film.crop_offset")
    before = {key: [int(n) for n in params[key]] for key in keys}
    factor = size / max(before["film.crop_size"])
    # A crop that is rounded up may not leave the film.
    whole = [max(round(n * factor), 1) for n in before["film.size"]]
    offset = [min(round(n * factor), w - 1) for n, w in zip(before["film.crop_offset"], whole, strict=True)]
    crop = [
        min(max(round(n * factor), 1), w - o) for n, w, o in zip(before["film.crop_size"], whole, offset, strict=True)
    ]

    def change(to: Mapping[str, list[int]]) -> None:
        for key, value in to.items():
            params[key] = type(params[key])(value)
        params.update()

    try:
        change(dict(zip(keys, (whole, crop, offset), strict=True)))
        yield
    finally:
        change(before)


def times(seconds: Callable[[frozenset[str]], float], cells: Iterable[str], repeats: int = REPEATS) -> dict[str, float]:
    """The part of the time that each cell takes: what is saved without it alone. They need not add up to 1.

    Parameters
    ----------
    seconds : function
        Renders these cells and returns how long it took; the first call of each set, which compiles, does not count.
    """
    cells = frozenset(cells)
    sets = {"": cells, **{cell: cells - {cell} for cell in cells if len(cells) > 1}}
    taken: dict[str, list[float]] = {name: [] for name in sets}
    for turn in range(repeats + 1):
        for name, kept in sets.items():
            spent = seconds(kept)
            if turn:
                taken[name].append(spent)
    whole = statistics.median(taken[""])
    return {
        cell: min(max(1 - statistics.median(taken[cell]) / whole, 0.0), 1.0) if len(cells) > 1 else 1.0
        for cell in cells
    }
