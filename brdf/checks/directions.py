"""Pairs of directions at which the checks ask."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .subject import BELOW_ONE, Subject

Array = npt.NDArray[np.float64]

#: Slopes of the normals about which `near_mirror` reflects: sharper lobes than a roughness of 1e-4 are rare.
SLOPES = (1e-4, 1.0)
#: Angles from the normal at which albedos are measured [deg].
ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 80.0, 85.0, 88.0, 89.9)
#: Azimuths at which an anisotropic surface is looked at, and one that is not [deg].
AZIMUTHS = (0.0, 45.0, 90.0)
#: The same where each direction is a quadrature or a test of its own.
FEW_AZIMUTHS = (0.0, 55.0)


def at_angle(angle: float, azimuth: float = 0.0) -> Array:
    """The direction at an angle from the normal, both in degrees; below the surface beyond 90."""
    a, phi = math.radians(angle), math.radians(azimuth)
    z = math.cos(a) if angle <= 90 else -math.cos(math.pi - a)
    return np.array([math.sin(a) * math.cos(phi), math.sin(a) * math.sin(phi), z])


def incident(subject: Subject, angles: tuple[float, ...], azimuths: tuple[float, ...] = AZIMUTHS) -> list[Array]:
    """Directions at these angles from the normal, from below as well if the subject transmits."""
    azimuths = azimuths if subject.anisotropic else azimuths[:1]
    sides = (1.0, -1.0) if subject.transmits else (1.0,)
    return [at_angle(a, phi) * [1, 1, side] for side in sides for phi in azimuths for a in angles]


def hemisphere(n: int, rng: np.random.Generator) -> Array:
    """Directions of uniform cosine, shape (3, n)."""
    z, phi = 1 - rng.random(n), 2 * np.pi * rng.random(n)
    r = np.sqrt(1 - z * z)
    return np.array([r * np.cos(phi), r * np.sin(phi), z])


def near_mirror(wi: Array, rng: np.random.Generator) -> Array:
    """Reflections of `wi`, shape (3, n), about normals whose slopes are spread evenly in their logarithm."""
    n = wi.shape[1]
    low, high = np.log(SLOPES)
    slope, phi = np.exp(rng.uniform(low, high, n)), 2 * np.pi * rng.random(n)
    h = np.array([slope * np.cos(phi), slope * np.sin(phi), np.ones(n)]) / np.sqrt(1 + slope**2)
    return 2 * np.sum(wi * h, axis=0) * h - wi


def pairs(subject: Subject, n: int, seed: int) -> tuple[Any, Any]:
    """Pairs (wi, wo): a third independent, a third near the mirror direction, a third as the subject samples them.

    If it transmits, from both sides of the surface to both.
    """
    rng = np.random.default_rng(seed)
    wi, wo = hemisphere(n, rng), hemisphere(n, rng)
    kind = np.arange(n) % 3
    wo = np.where(kind == 1, near_mirror(wi, rng), wo)
    if subject.transmits:
        wi[2] *= np.where(rng.random(n) < 0.5, -1, 1)
        wo[2] *= np.where(rng.random(n) < 0.5, -1, 1)
    drawn = subject.draw(subject.vector(wi), subject.vector(np.minimum(rng.random((3, n)), BELOW_ONE)))
    found = np.asarray(drawn.wo, dtype=np.float64).reshape(3, -1)
    use = (kind == 2) & (np.asarray(drawn.pdf, dtype=np.float64) > 0) & np.isfinite(found).all(axis=0)
    wo = np.where(use & ~np.asarray(drawn.ideal, dtype=bool), found, wo)
    keep = (wi[2] != 0) & (wo[2] != 0) if subject.transmits else (wi[2] > 0) & (wo[2] > 0)
    return subject.vector(wi[:, keep]), subject.vector(wo[:, keep])


def row(w: Any, index: int) -> list[float]:
    """One of many directions, as plain numbers."""
    array = np.asarray(w, dtype=np.float64).reshape(3, -1)
    return array[:, index if array.shape[1] > 1 else 0].tolist()


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
