"""A row of grooves by brute force: what a direction reaches is found by lines against circles, then integrated adaptively.

Nothing here knows where an arc or a stretch of floor ends: the ends are where a point changes from reached to not, by
bisection. The integrand is written with a vector of the normal, and the mirror image of a direction about it.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.integrate import quad

Array = npt.NDArray[np.float64]

#: Cylinders to either side that are tried as obstacles.
NEIGHBOURS = 4
#: Points of the floor that are tried first; a reached stretch shorter than their distance is missed.
SCAN = 4001


class Row(NamedTuple):
    spacing: float
    height: float

    def reaches(self, x: Any, z: Any, w: Array, own: bool) -> Any:
        """Whether the line from (x, z) in direction `w` misses all cylinders (all but the one at 0, if that is its
        `own`)."""
        ax, az = w[0] / np.hypot(w[0], w[2]), w[2] / np.hypot(w[0], w[2])
        free = np.full(np.shape(x), True)
        for k in range(-NEIGHBOURS, NEIGHBOURS + 1):
            if own and k == 0:
                continue
            tx, tz = k * self.spacing - x, -z
            free &= ~((np.abs(tx * az - tz * ax) < 1) & (tx * ax + tz * az > 0))
        return free

    def on_arc(self, t: float, directions: list[Array]) -> bool:
        """Whether the point of the cylinder at angle `t` is above the floor, and reached from all directions."""
        s, c = np.sin(t), np.cos(t)
        return c > self.height and all(w[0] * s + w[2] * c > 0 and self.reaches(s, c, w, True) for w in directions)

    def arc(self, directions: list[Array]) -> tuple[float, float]:
        """The two ends of what is reached of the cylinder; the top always is."""

        def reached(t: float) -> bool:
            return self.on_arc(t, directions)

        return bisect(reached, 0, -np.pi / 2), bisect(reached, 0, np.pi / 2)

    def floor(self, directions: list[Array]) -> float:
        """How much of the floor of one period is reached."""
        foot = np.sqrt(1 - self.height**2)
        if foot >= self.spacing / 2:
            return 0.0

        def reached(x: Any) -> Any:
            free = [self.reaches(x, self.height, w, False) for w in directions]
            return (foot < x) & (x < self.spacing - foot) & np.all(free, axis=0)

        points = np.linspace(foot, self.spacing - foot, SCAN)
        hit = np.flatnonzero(reached(points))
        if len(hit) == 0:
            return 0.0
        left, right = points[hit[0]], points[hit[-1]]
        step = points[1] - points[0]
        return bisect(reached, right, right + step) - bisect(reached, left, left - step)


def bisect(reached: Callable[[float], bool], inside: float, outside: float) -> float:
    """Where `reached` ends, between a point where it holds and one further out."""
    if reached(outside):
        return outside
    for _ in range(60):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if reached(middle) else (inside, middle)
    return 0.5 * (inside + outside)


def phong(wi: Array, wo: Array, n: Array, exponent: float) -> Any:
    """The normalised lobe of a unit specular reflectance about the mirror image of `wi` [1/sr]."""
    mirror = 2 * (n @ wi) * n - wi
    cos = max(mirror @ wo, 0.0) / (np.linalg.norm(wi) * np.linalg.norm(wo))
    return (exponent + 2) / (2 * np.pi) * cos**exponent


def grooved(wi: Array, wo: Array, spacing: float, height: float, exponent: float) -> tuple[float, float]:
    """The BRDF of the row [1/sr]: diffuse and Phong part, each of unit reflectance."""
    row = Row(spacing, height)
    low, high = row.arc([wi, wo])
    floor = row.floor([wi, wo])

    def area(t: float, base: Callable[[Array], float]) -> float:
        n = np.array([np.sin(t), 0, np.cos(t)])
        return base(n) * (n @ wi) * (n @ wo) / (wi[2] * wo[2])

    up = np.array([0.0, 0.0, 1.0])
    middle = 0.5 * (np.arctan2(wi[0], wi[2]) + np.arctan2(wo[0], wo[2]))
    found = []
    for base in (lambda n: 1 / np.pi, lambda n: phong(wi, wo, n, exponent)):
        # The lobe is narrow about the middle: intervals that close in on it.
        cuts = [middle + side * 4.0**-k for k in range(8) for side in (-1, 1)] + [middle]
        points = [low, *sorted(c for c in cuts if low < c < high), high]
        total = sum(quad(area, a, b, args=(base,), epsabs=0, epsrel=1e-12, limit=200)[0] for a, b in pairwise(points))
        found.append((total + floor * base(up)) / spacing)
    return found[0], found[1]
