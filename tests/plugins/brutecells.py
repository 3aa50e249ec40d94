"""Every cell of the lecture's table by brute force: paths by BSDF sampling alone, each labelled by what it met.

Point lights are added at each vertex; lamps and the sky count where a path happens to hit them.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

CELLS = [
    f"{row}.{column}"
    for row in ("diffuse", "glossy", "mirror")
    for column in ("point", "area", "environment", "indirect")
]
CELLS.append("emitter")


def cells(scene: Any, max_depth: int, size: int = 24, spp: int = 64, seed: int = 0) -> dict[str, np.ndarray]:
    """The light of each cell, shape (size, size, 3), at `max_depth` edges at most."""
    sampler = mi.load_dict({"type": "independent"})
    lanes = size * size * spp
    sampler.seed(seed, lanes)
    pixel = dr.arange(mi.UInt32, lanes) // spp
    jitter = sampler.next_2d()
    x, y = (mi.Float(pixel % size) + jitter.x) / size, (mi.Float(pixel // size) + jitter.y) / size
    ray, weight = scene.sensors()[0].sample_ray(mi.Float(0), sampler.next_1d(), mi.Point2f(x, y), sampler.next_2d())
    ray = mi.Ray3f(ray)
    flags = mi.BSDFFlags
    delta = mi.UInt32(int(flags.DeltaReflection) | int(flags.DeltaTransmission))
    split = {}
    for row, kind in (("diffuse", flags.Diffuse), ("glossy", flags.Glossy)):
        split[row] = mi.BSDFContext()
        split[row].type_mask = int(kind)
    full = mi.BSDFContext()
    points = [e for e in scene.emitters() if int(e.flags()) & int(mi.EmitterFlags.Delta)]

    total = {name: mi.Color3f(0) for name in CELLS}
    whole = mi.Color3f(weight)  # throughput before y
    part = {"diffuse": mi.Color3f(0), "glossy": mi.Color3f(0)}  # after it, by the lobe at y
    chain, found, since = mi.Bool(False), mi.Bool(False), mi.UInt32(0)
    active = mi.Bool(True)

    def add(name: str, value: Any, where: Any) -> None:
        total[name] += dr.select(where, value, 0)

    for depth in range(max_depth):
        si = scene.ray_intersect(ray, active)
        light = si.emitter(scene)
        radiance = light.eval(si, active)
        sky = ~si.is_valid()
        for column, here in (("area", ~sky), ("environment", sky)):
            add("emitter", whole * radiance, active & here & ~found & ~chain)
            add(f"mirror.{column}", whole * radiance, active & here & ~found & chain)
            for row in part:
                add("mirror.indirect", part[row] * radiance, active & here & found & chain)
                add(f"{row}.{column}", part[row] * radiance, active & here & found & ~chain & (since == 1))
                add(f"{row}.indirect", part[row] * radiance, active & here & found & ~chain & (since > 1))
        active &= si.is_valid()
        if depth == max_depth - 1:
            break
        bsdf = si.bsdf(ray)
        for point in points:
            ds, strength = point.sample_direction(si, mi.Point2f(0.5), active)
            strength = dr.select(active & (ds.pdf > 0), strength, 0)
            seen = active & ~scene.ray_test(si.spawn_ray_to(ds.p), active)
            wo = si.to_local(ds.d)
            for row in part:
                answer = bsdf.eval(split[row], si, wo, seen) * strength
                add(f"{row}.point", whole * answer, seen & ~found & ~chain)
                add("mirror.indirect", whole * answer, seen & ~found & chain)
            answer = bsdf.eval(full, si, wo, seen) * strength
            for row in part:
                add("mirror.indirect", part[row] * answer, seen & found & chain)
                add(f"{row}.indirect", part[row] * answer, seen & found & ~chain)
        bs, factor = bsdf.sample(full, si, sampler.next_1d(), sampler.next_2d(), active)
        null = mi.has_flag(bs.sampled_type, flags.Null)
        single = (bs.sampled_type & delta) != 0
        values = {row: bsdf.eval(split[row], si, bs.wo, active) for row in part}
        both = values["diffuse"] + values["glossy"]
        first = active & ~found & ~single & ~null
        for row in part:
            share = dr.select(both > 0, values[row] / dr.select(both > 0, both, 1), 0)
            part[row] = dr.select(first, whole * factor * share, dr.select(found, part[row] * factor, part[row]))
        whole = dr.select(found, whole, whole * factor)
        since = dr.select(active & (found | first) & ~null, since + 1, since)
        chain |= active & ~found & single
        found |= first
        ray = si.spawn_ray(si.to_world(bs.wo))
        active &= dr.any(factor != 0)
        dr.eval(ray, whole, part, chain, found, since, active, total, sampler)
    found_light = {name: value + dr.zeros(mi.Color3f, lanes) for name, value in total.items()}
    return {name: np.array(value).T.reshape(size, size, spp, 3).mean(axis=2) for name, value in found_light.items()}
