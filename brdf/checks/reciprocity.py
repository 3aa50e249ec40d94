"""Does a reflection model give the same with the two directions exchanged?"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np

Direction = tuple[float, float, float]


def reciprocity(
    f: Callable[[Any, Any], Any], wi: Any, wo: Any, floor: float = 0.0
) -> tuple[float, tuple[Direction, Direction]]:
    """The largest relative difference between ``f(wi, wo)`` and ``f(wo, wi)``.

    ``max |a - b| / max(|a|, |b|)`` over all pairs and channels.

    Parameters
    ----------
    f : callable
        The BRDF [1/sr], without cosine, of two Dr.Jit 3-vectors; a number or a colour for each pair.
    wi, wo : Dr.Jit 3-vectors of n directions
    floor : float
        Pairs are left out where both values are below `floor` times the largest value found [1].

    Returns
    -------
    (float, (wi, wo))
        The difference, in [0, 2] (inf where a value is not finite), and the pair of directions where it was found.
    """
    there, back = channels(f(wi, wo)), channels(f(wo, wi))
    larger = np.maximum(np.abs(there), np.abs(back))
    peak = np.max(larger, initial=0.0, where=np.isfinite(larger))
    counts = (larger > 0) & ~(larger < floor * peak)
    with np.errstate(invalid="ignore"):
        difference = np.where(counts, np.abs(there - back) / np.where(counts, larger, 1), 0)
    difference = np.where(np.isfinite(there) & np.isfinite(back), difference, np.inf).max(axis=0)
    worst = int(np.argmax(difference))
    i, o = (np.broadcast_to(channels(w), (3, difference.size))[:, worst].tolist() for w in (wi, wo))
    return float(difference[worst]), (tuple(i), tuple(o))


def channels(value: Any) -> np.ndarray:
    """A Dr.Jit number, colour or vector as a float64 array of shape (channels, n)."""
    array = np.asarray(value, dtype=np.float64)
    return array.reshape(dr.size_v(value) if dr.depth_v(value) > 1 else 1, -1)
