"""How many samples a fit takes, and which pixels get most of them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from brdf import UsageError

from . import pixels
from .picture.exact import SHARP, ExactPicture
from .problem import Linear, Problem
from .uncertainty import Uncertainty

if TYPE_CHECKING:
    from .run import Run

Array = npt.NDArray[np.float64]

#: Samples a pixel in each half, level by level: the last two of those that were run are compared.
EXACT_LEVELS, RENDERED_LEVELS = (4, 16, 64), (8, 32, 128)
#: Samples kept in memory for all pictures together, at some 200 bytes each.
MOST_SAMPLES = 8_000_000
#: Beyond so many an explicit request is refused.
TOO_MANY_SAMPLES = 8 * MOST_SAMPLES
#: Levels with fewer samples than this in all are left out, but for one: they take as long as so many do, and mislead.
FEW_SAMPLES = 100_000
#: How often samples are placed by where the fit so far sees the picture bright: it moves the first time.
GUIDES = 2
#: Less than this in any coordinate, and a sharp highlight has not moved.
MOVED = 0.05
#: Then the pixels that need it get more, in powers of this, for their samples to add this fraction to the noise's
#: variance; in steps, each up to so many times the samples in all.
TIER, LEFT, GROWTH = 4, 0.1, (4, 32)
#: The samples that matter are taken to have become at least so many times as many.
LEAST_GROWTH = 2.0


def levels(run: Run) -> list[int]:
    """Samples a half to go through, as far as memory allows."""
    if run.method == "rendered":
        return list(RENDERED_LEVELS)
    lights = len(run.scene.scene.emitters())
    count = sum(len(where) for view in run.views for _, where in view.groups)
    found = [n for n in EXACT_LEVELS if 2 * n * lights * count <= MOST_SAMPLES] or [EXACT_LEVELS[0]]
    enough = [n for n in found[:-1] if 2 * n * lights * count >= FEW_SAMPLES] or found[-2:-1]
    return [*enough, found[-1]]


def afford(run: Run, spp: int) -> None:
    """Refuse a sample count that does not fit into memory."""
    one = sum(math.prod(pixels.film_size(v.sensor)) for v in run.views)
    if run.method == "exact":
        one = sum(len(where) for view in run.views for _, where in view.groups) * len(run.scene.scene.emitters())
    if one * spp > TOO_MANY_SAMPLES:
        raise UsageError(f"spp = {spp} needs more memory than there may be. Take at most {TOO_MANY_SAMPLES // one}.")


def widening(run: Run, linear: Linear, found: Uncertainty) -> float:
    """By what fraction the fit's own samples widen the error bars, at worst."""
    assert run.problem is not None
    if run.misfit:
        return 0.5 * found.sampling_share
    share = shares(run, linear, run.problem.sampling(linear.r))
    return math.sqrt(1.0 + float(share.sum(axis=0).max(initial=0.0))) - 1.0


def shares(run: Run, linear: Linear, sampling: Array) -> Array:
    """What `sampling`, the variance of each residual by the fit's own samples, adds to the parameters' variances.

    Through each residual, shape (n, p), as fractions of what the noise makes them.
    """
    assert run.problem is not None
    w = run.problem.weights
    live = np.flatnonzero(np.diag(linear.hessian(w)) > 0)
    h = linear.hessian(w)[np.ix_(live, live)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(h), 1e-300))
    inverse = np.linalg.pinv(h * np.outer(scale, scale))
    score = 0.5 * (linear.jacobian[0] + linear.jacobian[1])[:, live] * (w * scale[:, None]).T
    own = sampling[:, None] * (score @ inverse) ** 2
    noise = 1.0 if run.by_noise else linear.power(w)
    return own / np.maximum(noise * np.diag(inverse), 1e-300)


def scatter(problem: Problem) -> Array:
    """The variance of each residual by the fit's own samples, as they differ within a pixel."""
    found = [p.sampling().ravel() for p in problem.pictures if isinstance(p, ExactPicture)]
    return np.maximum(np.concatenate(found), 0.0)  # rounding leaves what is 0 a little below


def guide(run: Run) -> bool:
    """Note where the pictures are bright, for samples to be placed there.

    Tells whether any pixel sees a sharp highlight, and that is not where it was.
    """
    assert run.problem is not None and run.x is not None
    if run.guided is not None and np.all(np.abs(run.x - run.guided) < MOVED):
        return False
    run.guided = run.x
    exact = [p for p in run.problem.pictures if isinstance(p, ExactPicture)]
    run.pilots = run.pilots or [p.even() for p in exact]
    run.guides = [p.glow(even) for p, even in zip(exact, run.pilots, strict=True)]
    if not any((p.contrast(g)[p.pixels] > SHARP).any() for p, g in zip(exact, run.guides, strict=True)):
        run.guides = []
    return bool(run.guides)


def look_closer(run: Run, growth: int) -> bool:
    """Give more samples to the pixels whose own sampling noise widens the error bars, as that of a sharp highlight.

    With the shares ``c`` that pixels have in a variance, ``n ~ sqrt(c)`` makes ``sum c/n`` least for ``sum n`` (Neyman
    1934). There may be `growth` times the samples of equal shares in all. Tells whether any pixel got more than before.
    """
    assert run.problem is not None and run.x is not None
    problem = run.problem
    sizes = [math.prod(pixels.film_size(v.sensor)) for v in run.views]
    start = np.cumsum([0, *sizes[:-1]])
    at = start[problem.view] + problem.pixel
    before = np.concatenate(run.finer or [np.ones(size, dtype=np.int64) for size in sizes])
    linear = problem.linearize(run.x)
    # Where they are, the scatter tells; how many, the halves, whose samples are spread more evenly than by chance.
    share = shares(run, linear, scatter(problem))
    halves = shares(run, linear, problem.sampling(linear.r)).sum(axis=0)
    share *= np.clip(halves / np.maximum(share.sum(axis=0), 1e-300), 0.0, 1.0)
    wanted = np.sqrt(share * before[at, None])
    wanted = np.bincount(at, (wanted * wanted.sum(axis=0) / LEFT).max(axis=1, initial=0.0) / 3, len(before))
    count = len(at) // 3
    most = min(growth * count, MOST_SAMPLES / (2 * len(run.scene.scene.emitters()) * run.levels[-1]))
    wanted *= min(1.0, (most - count) / max(float(wanted.sum()), 1e-300))
    now = np.maximum(before, TIER ** np.rint(np.log(np.maximum(wanted, 1.0)) / np.log(TIER)).astype(np.int64))
    run.finer = np.split(now, start[1:])
    if not (now > before).any():
        return False
    left = (share * (before / now)[at, None]).sum(axis=0)
    run.growth = max(float(np.min(share.sum(axis=0) / np.maximum(left, 1e-300), initial=np.inf)), LEAST_GROWTH)
    return True
