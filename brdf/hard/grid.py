"""Points where formulas are hard: mirror-like lobes, grazing and equal directions, an index next to 1, critical angles.

All numbers are float32, so that one exact answer serves float32 and float64.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from ..param import Param

Array = npt.NDArray[np.float64]
Draw = Callable[[np.random.Generator, int], Array]

#: Cosines from the normal to a ten-millionth above the surface.
COSINES = (1.0, 1 - 1e-7, 1 - 1e-5, 0.999, 0.9, 0.5, 0.1, *(10.0**-e for e in range(2, 8)))
#: Half vectors about the normal, in units of the width of the lobe.
OFFSETS = (0.0, 1e-3, 0.1, 0.5, 1.0, 2.0, 3.0, 4.5)
#: Azimuths off the opposite one [rad].
NEARLY_OPPOSITE = (1e-6, 1e-4, 1e-2)
#: Relative distance of a cosine from that of the critical and of Brewster's angle.
NEARLY_CRITICAL = tuple(10.0**-e for e in range(2, 8))
#: How pairs of directions are drawn, each with a sixth: about the mirror direction three times.
KINDS = ("mirror", "mirror", "mirror", "independent", "equal", "opposite")

INDICES_ABOVE = (1 + 2.0**-20, 1 + 2.0**-10, 1.000277, 1.01, 1.33, 1.5, 2.419, 10.0, 1e3, 1e4, 1e6)
INDICES_BELOW = (1 - 2.0**-20, 1 - 2.0**-10, 0.99, 0.4, 0.1, 1e-3)
METAL_ETA = (1e-3, 0.01, 0.04, 0.1, 0.3, 0.9, 1 - 2.0**-20, 1.0, 1 + 2.0**-20, 1.1, 1.5, 3.0, 10.0)
METAL_K = (0.0, *(10.0**e for e in range(-6, 7)))
#: Draws, by parameter: half of the points take a number of the list, half one in between.
HARD: dict[str, tuple[float, ...]] = {
    "roughness": (1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.3, 0.5, 1.0, 3.0),
    "roughness up to 1": (1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.3, 0.5, 0.9, 1.0),
    "index": (*INDICES_BELOW, *INDICES_ABOVE),
    "index above 1": INDICES_ABOVE,
    "metal eta": METAL_ETA,
    "metal k": METAL_K,
    "exponent": (0.0, 1e-3, 0.1, 1.0, 2.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6),
    "albedo": (0.0, 1e-6, 0.01, 0.2, 0.5, 0.9, 1 - 2.0**-20, 1.0),
    "angle": (0.0, 1e-6, 1e-3, 0.1, 0.3, 0.66, 1.0, 1.5),
}


def single(a: npt.ArrayLike) -> Array:
    """Rounded to float32."""
    return np.asarray(a, dtype=np.float32).astype(np.float64)


def among(values: Sequence[float]) -> Draw:
    """Half of them from the list, half between two neighbours of it, evenly in the logarithm (0 is left alone)."""
    some = np.sort(np.asarray(values, dtype=float))

    def draw(rng: np.random.Generator, n: int) -> Array:
        exact = rng.choice(some, n)
        positive = some[some > 0] if len(some[some > 0]) > 1 else some
        i = rng.integers(0, max(len(positive) - 1, 1), n)
        low, high = positive[i], positive[np.minimum(i + 1, len(positive) - 1)]
        between = np.exp(np.log(low) + rng.random(n) * (np.log(high) - np.log(low)))
        return single(np.where(rng.random(n) < 0.5, exact, between))

    return draw


def within(p: Param) -> Draw:
    """For a parameter of which no more is known: its ends, its default, and between, in the coordinate of a fit."""
    low, high = p.interior()
    default = float(np.mean(p.default))
    high = high if math.isfinite(high) else 1e3 * max(default, 1.0)
    low = low if math.isfinite(low) else -1e3 * max(abs(default), 1.0)
    ends = [b for b in p.bounds if math.isfinite(b)]

    def draw(rng: np.random.Generator, n: int) -> Array:
        x = p.to_free([low, high])
        between = p.to_value(x[0] + rng.random(n) * (x[1] - x[0]))
        return single(np.where(rng.random(n) < 0.5, rng.choice([*ends, default], n), between))

    return draw


def unit(cos: Array, azimuth: Array) -> Array:
    """Directions, shape (n, 3), each component to float32's last digit."""
    sin = np.sqrt((1 - cos) * (1 + cos))
    return single(np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), cos], axis=-1))


def cosines(rng: np.random.Generator, n: int) -> Array:
    """n of `COSINES`."""
    return rng.choice(COSINES, n)


def special(rng: np.random.Generator, eta: Array) -> Array:
    """Cosines; half of them within 1e-2 of that of the critical angle (`eta` < 1) or of Brewster's, if they are one."""
    n = len(eta)
    critical, brewster = np.sqrt(np.maximum(1 - eta * eta, 0)), 1 / np.sqrt(1 + eta * eta)
    near = np.where((eta < 1) & (rng.random(n) < 0.5), critical, brewster)
    near = near * (1 + rng.choice([-1, 1], n) * rng.choice(NEARLY_CRITICAL, n))
    return np.where((rng.random(n) < 0.5) & (near < 1) & (near > 1e-7), near, cosines(rng, n))


def pairs(rng: np.random.Generator, width: Array, cos_i: Array | None = None) -> tuple[Array, Array]:
    """Directions above the surface: (wi, wo), shape (n, 3) each.

    Parameters
    ----------
    width : array, shape (n,)
        Of the lobe about the mirror direction, as a slope of the half vector.
    cos_i : array, shape (n,), optional
        Cosine of wi.
    """
    n = len(width)
    cos_i = cosines(rng, n) if cos_i is None else cos_i
    azimuth = rng.uniform(0, 2 * np.pi, n)
    wi = unit(cos_i, azimuth)
    kind = rng.permutation(np.arange(n) % len(KINDS))
    names = np.array(KINDS)[kind]
    wo = unit(cosines(rng, n), rng.uniform(0, 2 * np.pi, n))
    opposite = azimuth + np.pi + rng.choice([-1, 1], n) * rng.choice(NEARLY_OPPOSITE, n)
    wo = np.where((names == "opposite")[:, None], unit(cosines(rng, n), opposite), wo)
    offset, turn = width * rng.choice(OFFSETS, n), rng.uniform(0, 2 * np.pi, n)
    for sign in (1, -1):  # a half vector that leads below the horizon is turned round
        h = np.stack([sign * offset * np.cos(turn), sign * offset * np.sin(turn), np.ones(n)], axis=-1)
        h /= np.linalg.norm(h, axis=-1, keepdims=True)
        i = np.stack([*wi.T[:2], cos_i], axis=-1)
        mirrored = single(2 * np.sum(i * h, axis=-1, keepdims=True) * h - i)
        wo = np.where(((names == "mirror") & (mirrored[:, 2] > 1e-8))[:, None], mirrored, wo)
    wo = np.where((names == "equal")[:, None], wi, wo)
    return wi, wo


#: The complex index of a metal.
METAL = {"eta": among(HARD["metal eta"]), "k": among(HARD["metal k"])}
