"""How much of the light does a reflection model reflect? No more than arrives, if it is physical."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..geometry import cosine_hemisphere
from ..model import Model, Values
from .reciprocity import channels

#: Independent repetitions, whose spread gives the standard error.
BATCHES = 16

Weight = Callable[[Any, Any], Any]


def albedo(weight: Weight, mu: float, like: Any, side: int = 64, seed: int = 0) -> tuple[float, float]:
    """Directional albedo ``integral f(wi, wo) wo.z dwo`` by stratified sampling.

    Parameters
    ----------
    weight : callable
        ``f cos / pdf`` of a direction sampled for a Dr.Jit 3-vector `wi` from `u` in [0, 1)^3: see `cosine_weight` and
        `lobe_weight`. A number or a colour for each.
    mu : float
        Cosine of the angle between `wi` and the normal, in (0, 1] [1].
    like : type of Dr.Jit 3-vector
        Precision and backend: ``drjit.llvm.ad.Array3f`` and so on.
    side : int
        Each of 16 batches has ``side^2`` samples.
    seed : int

    Returns
    -------
    (float, float)
        The albedo of the channel that reflects most, and its standard error [1].
    """
    wi = like(math.sqrt((1 - mu) * (1 + mu)), 0, mu)
    u = like(*stratified(side, BATCHES, seed))
    found = channels(weight(wi, u))
    n = BATCHES * side * side
    return summarise(np.broadcast_to(found, (len(found), n)).reshape(-1, BATCHES, side * side))


def cosine_weight(f: Callable[[Any, Any], Any]) -> Weight:
    """The weight of cosine-distributed directions, ``pi f``: for any smooth BRDF `f` [1/sr], of two 3-vectors."""

    def weight(wi: Any, u: Any) -> Any:
        return f(wi, cosine_hemisphere(u, u)) * dr.pi

    return weight


def lobe_weight(model: Model, p: Values) -> Weight:
    """The weight of directions from the model's own sampling, each lobe sampled by itself: for sharp lobes as well."""

    def weight(wi: Any, u: Any) -> Any:
        total: Any = 0
        for i in range(len(model.lobes)):
            wo = model.sample(p, wi, u, i)
            up = wo.z > 0
            wo = type(wo)(wo.x, wo.y, dr.select(up, wo.z, 1))
            density = model.pdf(p, wi, wo)[i]
            good = up & (density > 0)
            total += dr.select(good, model.f(p, wi, wo)[i] * (wo.z / dr.select(good, density, 1)), 0)
        return total

    return weight


def stratified(side: int, batches: int, seed: int) -> npt.NDArray[np.float64]:
    """Points in the unit cube, shape (3, batches side^2).

    A batch is stratified in the first two coordinates together, and in the third alone.
    """
    rng = np.random.default_rng(seed)
    n = side * side
    cell = np.arange(n)
    u = np.empty((3, batches, n))
    u[0], u[1] = cell // side, cell % side
    u[:2] = (u[:2] + rng.random((2, batches, n))) / side
    u[2] = (rng.permuted(np.tile(cell, (batches, 1)), axis=1) + rng.random((batches, n))) / n
    return np.minimum(u, 1 - 2.0**-24).reshape(3, -1)


def summarise(weights: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Mean and its standard error, of the channel that reflects most, from weights of shape (channels, batches, n)."""
    means = weights.mean(axis=2)
    most = int(np.argmax(means.mean(axis=1)))
    return float(means[most].mean()), float(means[most].std(ddof=1) / math.sqrt(means.shape[1]))
