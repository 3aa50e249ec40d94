"""How many samples a fit takes, and where."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from brdf import UsageError

from . import pixels
from .picture.exact import SHARPER, ExactPicture
from .problem import Linear
from .uncertainty import Uncertainty

if TYPE_CHECKING:
    from .run import Run

#: Samples a pixel in each half, level by level: the last two of those that were run are compared.
EXACT_LEVELS, RENDERED_LEVELS = (4, 16, 64, 256), (8, 32, 128)
#: Samples kept in memory for all pictures together, at some 200 bytes each.
MOST_SAMPLES = 8_000_000
#: Beyond so many an explicit request is refused.
TOO_MANY_SAMPLES = 8 * MOST_SAMPLES


def levels(run: Run, spp: int | None) -> list[int]:
    """Samples a half to go through: those that make up `spp`, or as many as memory allows."""
    if spp is not None:
        afford(run, spp)
        return [max(2, spp // 8), (spp + 1) // 2] if spp >= 16 else [(spp + 1) // 2]
    if run.method == "rendered":
        return list(RENDERED_LEVELS)
    lights = len(run.scene.scene.emitters())
    count = sum(len(where) for view in run.views for _, where in view.groups)
    return [n for n in EXACT_LEVELS if 2 * n * lights * count <= MOST_SAMPLES] or [EXACT_LEVELS[0]]


def widening(run: Run, linear: Linear, found: Uncertainty) -> float:
    """By what fraction the fit's own samples widen the error bars, at worst."""
    assert run.problem is not None and run.noise is not None
    if run.misfit:
        return 0.5 * found.sampling_share
    live = np.flatnonzero(np.isfinite(found.sd))
    w = run.problem.weights
    h = linear.hessian(w)[np.ix_(live, live)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(h), 1e-300))
    inverse = np.linalg.pinv(h * np.outer(scale, scale))
    score = 0.5 * (linear.jacobian[0] + linear.jacobian[1])[:, live] * (w * scale[:, None]).T
    own = score.T @ (run.problem.sampling(linear.r)[:, None] * score)
    noise, samples = np.diag(inverse), np.diag(inverse @ own @ inverse)
    return float(np.sqrt(np.max(1.0 + samples / np.maximum(noise, 1e-300), initial=1.0))) - 1.0


def afford(run: Run, spp: int) -> None:
    """Refuse a sample count that does not fit into memory."""
    one = sum(math.prod(pixels.film_size(v.sensor)) for v in run.views)
    if run.method == "exact":
        one = sum(len(where) for view in run.views for _, where in view.groups) * len(run.scene.scene.emitters())
    if one * spp > TOO_MANY_SAMPLES:
        raise UsageError(f"spp = {spp} needs more memory than there may be. Take at most {TOO_MANY_SAMPLES // one}.")


def fits(run: Run, samples: int) -> bool:
    """Whether this many samples a half, and more where there is a sharp highlight, fit into memory."""
    assert run.problem is not None
    if not run.guides:
        return True
    exact = [p for p in run.problem.pictures if isinstance(p, ExactPicture)]
    count = sum(
        len(p.pixels) + (SHARPER - 1) * p.sharp(g)[p.pixels].sum() for p, g in zip(exact, run.guides, strict=True)
    )
    return bool(2 * samples * len(run.scene.scene.emitters()) * count <= MOST_SAMPLES)


def guide(run: Run) -> bool:
    """Note where the pictures are bright; whether any pixel sees a sharp highlight."""
    assert run.problem is not None and run.x is not None
    exact = [p for p in run.problem.pictures if isinstance(p, ExactPicture)]
    run.parameters.place(run.x)
    guides = [p.glow() for p in exact]
    run.guides = guides if any(p.sharp(g)[p.pixels].any() for p, g in zip(exact, guides, strict=True)) else []
    return bool(run.guides)
