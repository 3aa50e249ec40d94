"""The sphere of directions as a square that is finest where a lobe is: for quadrature, and for counting samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from .directions import stratified
from .subject import Subject
from .values import channels, opaque

#: Samples from which the place and width of a lobe are estimated, squared.
SIDE = 48
#: No lobe is taken to be narrower than this [rad]: float32 resolves no directions below.
NARROWEST = 1e-6
#: A mean direction shorter than this belongs to no lobe: the normal serves as well.
SHORTEST = 0.2
#: The ends of the square are at infinity: it is used up to here.
INSIDE = 1 - 2.0**-16
#: Points along each side of the square, before and after one refinement.
POINTS = (192, 384)


@dataclass(frozen=True)
class Around:
    """Stereographic projection about the third of `axes`, each coordinate stretched: ``s = scale p / (1 - p^2)``.

    ``w = (2 s, 1 - |s|^2) / (1 + |s|^2)`` in the frame `axes`; `p` in (-1, 1)^2 covers the sphere.

    Attributes
    ----------
    axes : three Dr.Jit 3-vectors
    scale : two Dr.Jit floats
        Half of the lobe lies within ``|s| < scale``.
    side : int
        +1 or -1 if only directions above or below the surface count, 0 if all do.
    """

    axes: tuple[Any, Any, Any]
    scale: tuple[Any, Any]
    side: int = 0

    def holds(self, w: Any) -> Any:
        """Whether a direction counts."""
        return w.z * self.side >= 0

    def direction(self, x: Any, y: Any) -> Any:
        """The direction of the point ``p = (x, y)``."""
        inside = (dr.clip(p, -INSIDE, INSIDE) for p in (x, y))
        sx, sy = (a * p / (1 - p * p) for a, p in zip(self.scale, inside, strict=True))
        square = sx * sx + sy * sy
        t1, t2, c = self.axes
        return (t1 * (2 * sx) + t2 * (2 * sy) + c * (1 - square)) / (1 + square)

    def point(self, w: Any) -> tuple[Any, Any]:
        """The inverse of `direction`."""
        t1, t2, c = self.axes
        below = dr.maximum(1 + dr.dot(w, c), 1e-12)
        out = []
        for axis, scale in ((t1, self.scale[0]), (t2, self.scale[1])):
            s = dr.dot(w, axis) / below / scale
            out.append(2 * s / (1 + dr.sqrt(1 + 4 * s * s)))
        return out[0], out[1]

    def area(self, x: Any, y: Any) -> Any:
        """Solid angle by area of the square [sr]."""
        total, square = 4, 1
        for a, end in zip(self.scale, (x, y), strict=True):
            p = dr.clip(end, -INSIDE, INSIDE)
            rest = 1 - p * p
            total *= a * (1 + p * p) / (rest * rest)
            square += dr.square(a * p / rest)
        return total / (square * square)


def around(subject: Subject, wi: npt.NDArray[np.float64], lobe: int | None, seed: int = 0) -> list[Around]:
    """Where a lobe lies as it is sampled from `wi`, of shape (3,): a domain for each side of the surface that it
    reaches; none if no direction comes out."""
    vector = subject.vector
    u = vector(stratified(SIDE, 1, seed))
    drawn = subject.draw(opaque(vector, wi) + 0 * u, u, lobe)
    wo = np.asarray(drawn.wo, dtype=np.float64).reshape(3, -1)
    lit = (channels(drawn.weight) != 0).any(axis=0)
    good = lit & (np.asarray(drawn.pdf) > 0) & ~np.asarray(drawn.ideal, dtype=bool) & np.isfinite(wo).all(axis=0)
    part = None if lobe is None else subject.lobes[lobe]
    one_sided = not subject.transmits or (part is not None and not (part.transmits and part.reflects))
    found = []
    for side in (0,) if one_sided else (1, -1):
        here = good & (wo[2] * side >= 0)
        if here.any():
            found.append(about(wo[:, here], vector, side))
    return found


def about(wo: npt.NDArray[np.float64], vector: Any, side: int) -> Around:
    """The domain of a lobe from samples of it, shape (3, n)."""
    c = wo.mean(axis=1)
    length = float(np.linalg.norm(c))
    c = c / length if length > SHORTEST else np.array([0.0, 0.0, 1.0])
    level = np.cross(
        [0.0, 0.0, 1.0], c
    )  # one axis is level, so that lobes that grazing incidence draws out lie along one
    t1 = np.cross(level, c) if np.hypot(c[0], c[1]) > 1e-6 else np.array([1.0, 0.0, 0.0])
    t1 /= np.linalg.norm(t1)
    t2 = np.cross(c, t1)
    scale = []
    for axis in (t1, t2):
        s = np.abs(axis @ wo) / np.maximum(1 + c @ wo, 1e-6)
        scale.append(float(np.clip(np.median(s), NARROWEST, 1.0)))
    axes = (opaque(vector, t1), opaque(vector, t2), opaque(vector, c))
    number = dr.value_t(vector)
    return Around(axes, (dr.opaque(number, scale[0]), dr.opaque(number, scale[1])), side)


def integral(
    function: Callable[[Any], Any], domains: list[Around], vector: Any
) -> tuple[npt.NDArray[np.float64], float]:
    """``integral function dw`` over the sphere by the midpoint rule, each side by its domain.

    Returns
    -------
    (array, float)
        Of each channel, and how much it changed in the last refinement.
    """
    found = []
    for n in POINTS:
        x, y = grid(dr.value_t(vector), n)
        total: Any = 0.0
        for domain in domains:
            wo = domain.direction(x, y)
            value = dr.select(domain.holds(wo), function(wo) * domain.area(x, y), 0)
            total = total + channels(value).mean(axis=1) * 4
        found.append(total)
    return found[1], float(np.abs(found[1] - found[0]).max())


def grid(number: Any, n: int) -> tuple[Any, Any]:
    """The middles of n x n cells of the square [-1, 1]^2."""
    index = dr.arange(dr.uint32_array_t(number), n * n)
    step = dr.opaque(number, 2.0 / n)
    row = index // dr.opaque(dr.uint32_array_t(number), n)
    column = index - row * dr.opaque(dr.uint32_array_t(number), n)
    return (number(column) + 0.5) * step - 1, (number(row) + 0.5) * step - 1
