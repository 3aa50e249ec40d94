"""Emitters as the integrators sample them: all of some, or one of many by its power."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

#: The share of choices that is even: no lamp that shines on little, but from near, is forgotten.
EVEN = 0.5
#: Rays of an emitter from which its power is taken, once a scene.
RAYS = 256


class Lights:
    """Some of the emitters of a scene, one of which is sampled at a time."""

    def __init__(self, scene: mi.Scene, emitters: Sequence[mi.Emitter], choose: bool = True) -> None:
        self.emitters = tuple(emitters)
        if not choose or len(emitters) < 2:
            return
        chances = chances_of([power(e) for e in emitters])
        order = [e.ptr for e in scene.emitters()]
        pointers = scene.emitters_dr()
        self.distribution = mi.DiscreteDistribution(mi.Float(chances))
        self.place = mi.UInt32([order.index(e.ptr) for e in emitters])
        self.pointers = pointers
        keys = np.asarray(dr.reinterpret_array(mi.UInt32, pointers))
        table = np.zeros(int(keys.max()) + 1)
        for e, chance in zip(emitters, chances, strict=True):
            table[keys[order.index(e.ptr)]] = chance
        #: Chance of an emitter by its number in the registry of Dr.Jit.
        self.table = mi.Float(table)

    def sample(self, si: Any, number: Any, point: Any, active: Any) -> tuple[Any, Any, Any]:
        """One emitter, and a direction towards it: ``(ds, weight, emitter)``, the chance of the choice in both."""
        if len(self.emitters) == 1:
            ds, weight = self.emitters[0].sample_direction(si, point, active)
            return ds, weight, self.emitters[0]
        index, chance = self.distribution.sample_pmf(number, active)
        place: Any = dr.gather(mi.UInt32, self.place, index, active)
        emitter = dr.gather(mi.EmitterPtr, self.pointers, place, active)
        ds, weight = emitter.sample_direction(si, point, active)
        ds.pdf *= chance
        return ds, weight / chance, emitter

    def pdf(self, reference: Any, ds: Any, active: Any) -> Any:
        """Density of `sample` for a direction that hit the emitter ``ds.emitter``, by solid angle [1/sr]."""
        if len(self.emitters) == 1:
            mine = self.emitters[0]
            return dr.select(active, mine.pdf_direction(reference, ds, active), 0)
        key: Any = dr.reinterpret_array(mi.UInt32, ds.emitter)
        chance = dr.gather(mi.Float, self.table, key, active)
        return dr.select(active, ds.emitter.pdf_direction(reference, ds, active) * chance, 0)


def chances_of(powers: Sequence[float]) -> list[float]:
    """How often each emitter is chosen: by its power, and a part of the time evenly."""
    n, total = len(powers), sum(powers)
    return [EVEN / n + (1 - EVEN) * (p / total if total > 0 else 1 / n) for p in powers]


def power(emitter: mi.Emitter) -> float:
    """The power that an emitter sends out, estimated from rays of its own; 1 if it cannot send any."""
    number = dr.arange(mi.Float, RAYS)
    # points of the additive sequence of the golden ratio and its relatives: even, and the same each time
    u = [dr.fma(number, step, 0.5) for step in (0.7548776662, 0.5698402910, 0.8191725134, 0.6710436067, 0.5497004779)]
    u = [x - dr.floor(x) for x in u]
    try:
        with dr.suspend_grad():
            _, weight = emitter.sample_ray(0, u[0], mi.Point2f(u[1], u[2]), mi.Point2f(u[3], u[4]))
            value = float(dr.mean(dr.mean(mi.unpolarized_spectrum(weight)))[0])
    except (
        RuntimeError,
        NotImplementedError,
    ):
        # It sends out no rays, or cannot without more than is given here: any chance above 0 is right.
        return 1.0
    return value if np.isfinite(value) and value > 0 else 0.0


def mis(mine: Any, other: Any) -> Any:
    """The power heuristic: the weight of a sample of density `mine` that another technique also takes."""
    weight = dr.square(mine) / (dr.square(mine) + dr.square(other))
    return dr.select(mine > 0, dr.select(dr.isfinite(weight), weight, 1), 0)


def moved(to: Any, n: Any) -> Any:
    """The solid angle of a fixed piece of surface in the direction `to`, over what it is now: 1, with its derivative.

    `to` leads from where it is seen to where it is, not zero; `n` is its normal.
    """
    distance2 = dr.squared_norm(to)
    solid = dr.abs(dr.dot(to, n)) / (distance2 * dr.sqrt(distance2))
    now = dr.detach(solid)
    return dr.select(now > 0, solid / dr.select(now > 0, now, 1), 1)
