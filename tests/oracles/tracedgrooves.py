"""The reflection of a row of real cylinders on a floor, by Mitsuba's ray tracer: an estimate with a standard error.

One line of sight at a time: it starts at a random point of one period, at the height of the tops, and goes down along `wo`
to what it hits first; a second ray asks whether that point sees the light. No formula of the grooves is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Cylinders to either side of the middle one. No ray gets past the second: within a period it meets something, or has risen
#: above the tops.
NEIGHBOURS = 3
#: Half the length of the cylinders: a ray at cosine 0.01 runs some hundred radii along the groove before it lands.
LENGTH = 2000.0
#: Independent repetitions, whose spread gives the standard error.
BATCHES = 32
#: Rays that are traced at once.
AT_ONCE = 1 << 22


class Row:
    """Cylinders of radius 1 along y, whose axes are in the plane z = 0, and the floor.

    A shape does not shade itself where it faces the light, as all are convex. So each is asked alone, all but the one that
    the shadow ray starts from: the ray then need not start a little off the surface, which would move shadows.
    """

    def __init__(self, spacing: float, height: float) -> None:
        shapes: dict[str, Any] = {
            f"cylinder{k}": {
                "type": "cylinder",
                "p0": [k * spacing, -LENGTH, 0],
                "p1": [k * spacing, LENGTH, 0],
                "radius": 1,
            }
            for k in range(-NEIGHBOURS, NEIGHBOURS + 1)
        }
        wide = mi.ScalarTransform4f().translate([0, 0, height]).scale([(NEIGHBOURS + 1) * spacing, LENGTH, 1])
        shapes["floor"] = {"type": "rectangle", "to_world": wide}
        self.all = mi.load_dict({"type": "scene", **shapes})
        by_name = {shape.id(): shape for shape in self.all.shapes()}
        self.alone = [
            (mi.ShapePtr(by_name[name]), mi.load_dict({"type": "scene", name: shapes[name]})) for name in shapes
        ]

    def first_hit(self, ray: mi.Ray3f) -> mi.SurfaceInteraction3f:
        return self.all.ray_intersect(ray)

    def lit(self, hit: mi.SurfaceInteraction3f, light: mi.Vector3f) -> Any:
        lit = hit.is_valid() & (dr.dot(hit.n, light) > 0)
        for shape, scene in self.alone:
            other = lit & (hit.shape != shape)
            lit &= ~(other & scene.ray_test(mi.Ray3f(hit.p, light), other))
        return lit


def traced(
    wi: Array, wo: Array, spacing: float, height: float, exponents: Sequence[float], samples: int, seed: int = 0
) -> Array:
    """The BRDF of the row [1/sr] for pairs of directions, of the diffuse part and of a Phong lobe of each exponent.

    ``f = mean of base(n') max(n'.wi, 0) lit / wi.z`` over lines of sight.

    Parameters
    ----------
    wi, wo : array of shape (n, 3)
    samples : int
        In each of 32 batches: one in each cell of a grid over the period, which is shifted at random from batch to
        batch, so that the edge of a shadow is anywhere in its cell, and the errors of batches are spread evenly.
    seed : int
        The same seed, the same lines of sight, in parts of the period.

    Returns
    -------
    array
        Means of the batches, shape (1 + exponents, n, 32), for unit reflectances. See `mean_and_error`.
    """
    row, rng = Row(spacing, height), np.random.default_rng(seed)
    found = []
    block = max(1, AT_ONCE // (BATCHES * samples))
    for start in range(0, len(wi), block):
        i, o = wi[start : start + block], wo[start : start + block]
        shift = rng.random((len(i), BATCHES, 1))
        u = (np.arange(samples) + shift + rng.random((len(i), BATCHES, samples))) / samples % 1
        i, o = (np.repeat(w, BATCHES * samples, axis=0) for w in (i, o))
        values = lines_of_sight(row, spacing * u.ravel(), i, o, exponents)
        found.append(values.reshape(len(values), -1, BATCHES, samples).mean(axis=-1))
    return np.concatenate(found, axis=1)


def mean_and_error(batches: Array) -> tuple[Array, Array]:
    """Mean over the last axis, and its standard error."""
    return batches.mean(axis=-1), batches.std(axis=-1, ddof=1) / np.sqrt(batches.shape[-1])


def lines_of_sight(row: Any, x: Array, wi: Array, wo: Array, exponents: Sequence[float]) -> Array:
    """What each line of sight contributes, shape (1 + exponents, lines)."""
    light, eye = mi.Vector3f(wi.T), mi.Vector3f(wo.T)
    top = mi.Point3f(mi.Float(x), 0, 1)
    hit = row.first_hit(mi.Ray3f(top + 0.5 * eye, -eye))
    assert dr.all(hit.is_valid())
    n = hit.n
    cos = dr.dot(n, light)
    weight = dr.select(row.lit(hit, light), cos / light.z, 0)
    mirror = dr.maximum(dr.dot(2 * cos * n - light, eye), 0)
    lobes = [mi.Float(dr.inv_pi)] + [(e + 2) / (2 * dr.pi) * mirror**e for e in exponents]
    return np.array([np.asarray(weight * lobe, dtype=float) for lobe in lobes])
