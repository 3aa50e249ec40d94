"""Whether two estimators have the same mean picture, from independent runs of each."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

RUNS, SAMPLES = 24, 64


def runs(scene: mi.Scene, integrator: dict[str, Any], seed: int, samples: int = SAMPLES, number: int = RUNS) -> Any:
    """Pictures, shape (number, height, width, channels), float64."""
    made = mi.load_dict(integrator)
    return np.array([mi.render(scene, integrator=made, spp=samples, seed=seed + i) for i in range(number)], dtype=float)


def same_mean(a: Any, b: Any) -> tuple[float, float, float]:
    """Z of the mean over the picture; standard deviation and greatest size of z over pixels and channels.

    A pixel counts where its noise is above a thousandth of the mean of the picture: below, z is a ratio of roundings.
    """
    mean_a, mean_b = a.mean(axis=(1, 2, 3)), b.mean(axis=(1, 2, 3))
    noise = np.sqrt(mean_a.var(ddof=1) / len(a) + mean_b.var(ddof=1) / len(b))
    total = (mean_a.mean() - mean_b.mean()) / noise
    noise = np.sqrt(a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b))
    noisy = noise > 1e-3 * b.mean()
    z = (a.mean(axis=0) - b.mean(axis=0))[noisy] / noise[noisy]
    return float(total), float(z.std()), float(np.abs(z).max())


def assert_same_mean(a: Any, b: Any) -> None:
    """The bounds: 1 in 15000 by chance for the mean; for 3000 pixels with 24 runs each the others were seen at most at
    1.2 and 6.2 where both estimators are right: in some pixels few bright paths make all the light."""
    total, spread, largest = same_mean(a, b)
    assert abs(total) < 4, f"Z of the mean is {total:.2f}"
    assert 0.8 < spread < 1.25, f"z over the pixels spreads by {spread:.2f}"
    assert largest < 7, f"the greatest z of a pixel is {largest:.1f}"
