"""Pairs of directions to test with."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def grid(roughness: tuple[float, ...], seed: int = 1) -> tuple[Array, Array, Array]:
    """Pairs (wi, wo), shape (n, 3), cosines >= 0.02, and the roughness of each: near the mirror direction at offsets of
    `m` times up to 4.5 in slope, independent, opposite each other, and equal."""
    rng = np.random.default_rng(seed)
    wi, wo, m = [], [], []
    for rough in roughness:
        for cos in (1.0, 1 - 1e-5, 0.999, 0.9, 0.5, 0.1, 0.02):
            a = unit(cos, rng.uniform(0, 2 * np.pi))
            others = [unit(rng.uniform(0.02, 1), rng.uniform(0, 2 * np.pi)), a.copy(), a * [-1, -1, 1]]
            for offset in (0.0, 1e-3, 0.1, 0.5, 1.1, 2.0, 4.5):
                azimuth = rng.uniform(0, 2 * np.pi)
                h = np.array([rough * offset * np.cos(azimuth), rough * offset * np.sin(azimuth), 1.0])
                h /= np.linalg.norm(h)
                others.append(2 * (a @ h) * h - a)
            for b in others:
                if b[2] >= 0.02:
                    wi.append(a)
                    wo.append(b / np.linalg.norm(b))
                    m.append(rough)
    return np.array(wi), np.array(wo), np.array(m)


def unit(cos: float, azimuth: float) -> Array:
    sin = np.sqrt((1 - cos) * (1 + cos))
    return np.array([sin * np.cos(azimuth), sin * np.sin(azimuth), cos])


def hemisphere(n: int, seed: int) -> Array:
    """Directions, shape (n, 3), cosine uniform in (0, 1)."""
    rng = np.random.default_rng(seed)
    return np.array([unit(c, a) for c, a in zip(rng.uniform(1e-3, 1, n), rng.uniform(0, 2 * np.pi, n), strict=True)])
