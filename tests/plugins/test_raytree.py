"""`raytree` against a recursion that is written out: the lecture's ray tracer, node by node."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import plugins
from tests.plugins import effects_scenes as scenes

DEPTH, SIDE = 5, 48


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def whitted() -> dict[str, Any]:
    """Glass, a mirror, a glazed ball, a floor; two point lights and a sky."""
    out = scenes.glass_mirror()
    glazed = {"type": "glazed", "diffuse_reflectance": scenes.rgb(0.2, 0.5, 0.3)}
    out["glazed"] = scenes.ball(glazed, y=-1.2, z=-0.6, radius=0.4)
    out["second"] = scenes.point(-3, -2, 3, 10, 20, 30)
    out["sky"] = {"type": "envmap", "filename": scenes.SKY}
    return out


def rays(scene: mi.Scene) -> mi.RayDifferential3f:
    at = mi.Point2f(np.random.default_rng(5).random((2, SIDE * SIDE)))
    ray, _ = scene.sensors()[0].sample_ray_differential(0, 0, at, mi.Point2f(0))
    return ray


def context(*flags: Any) -> mi.BSDFContext:
    out = mi.BSDFContext()
    out.type_mask = sum(int(f) for f in flags)
    return out


def recursion(scene: mi.Scene, ray: Any, beta: Any, eta: Any, depth: int, active: Any, cut: float, image: bool) -> Any:
    """Radiance along a ray, and how many nodes were visited: both branches of everything, one call a node."""
    si = scene.ray_intersect(mi.Ray3f(ray), active)
    total = dr.select(active & ~si.is_valid(), beta * si.emitter(scene, active).eval(si, active & ~si.is_valid()), 0)
    nodes = dr.select(active, mi.UInt32(1), 0)
    active = active & si.is_valid()
    if depth + 1 >= DEPTH:
        return total, nodes
    bsdf = si.bsdf()
    smooth = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    for light in scene.emitters():
        if light.is_environment():
            continue
        ds, weight = light.sample_direction(si, mi.Point2f(0), smooth)
        lit = smooth & ~scene.ray_test(si.spawn_ray_to(ds.p), smooth)
        f = bsdf.eval(context(mi.BSDFFlags.Smooth), si, si.to_local(ds.d), lit)
        total += dr.select(lit, beta * f * weight, 0)
    for kind in (mi.BSDFFlags.DeltaReflection, mi.BSDFFlags.DeltaTransmission):
        there = active & mi.has_flag(bsdf.flags(), kind)
        bs, weight = bsdf.sample(context(kind), si, 0, mi.Point2f(0), there)
        weight = dr.select(there & (bs.pdf > 0), weight, 0)
        strength = dr.max(beta * weight) * dr.square(eta * bs.eta)
        there &= (strength > 0) & (strength >= cut)
        onward = si.spawn_ray(si.to_world(bs.wo))
        more, visited = recursion(scene, onward, beta * weight, eta * bs.eta, depth + 1, there, cut, True)
        total += dr.select(there, more, 0)
        nodes += dr.select(there, visited, 0)
    return total, nodes


@pytest.mark.parametrize("threshold", [0.0, 0.01, 0.2])
def test_recursion(threshold: float) -> None:
    """The same radiance in each lane, but for the order of the sum, unpruned and cut."""
    scene = mi.load_dict(whitted())
    ray = rays(scene)
    made = {"type": "raytree", "max_depth": DEPTH, "rr_depth": DEPTH, "threshold": threshold, "prune": "cut"}
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(1, SIDE * SIDE)
    got, _, _ = mi.load_dict(made).sample(scene, sampler, ray)
    want, nodes = recursion(scene, ray, mi.Spectrum(1), mi.Float(1), 0, mi.Bool(True), threshold, False)
    got, want = np.array(got), np.array(want)
    assert nodes.numpy().max() >= (12 if threshold == 0 else 3)  # there is a tree to get wrong: glass in glass
    # a handful of float32 roundings of a sum of at most 30 terms
    np.testing.assert_allclose(got, want, rtol=4e-6, atol=1e-7 * want.max())


def test_random_branch_is_unbiased() -> None:
    """Below the threshold one branch is followed at random: any threshold has the same mean."""
    scene = mi.load_dict(whitted())
    runs = {}
    for threshold in (0.0, 0.5):
        integrator = mi.load_dict({"type": "raytree", "max_depth": DEPTH, "threshold": threshold})
        runs[threshold] = np.array(
            [np.mean(mi.render(scene, integrator=integrator, spp=16, seed=i)) for i in range(12)]
        )
    a, b = runs.values()
    assert b.std() > 0
    assert abs(a.mean() - b.mean()) < 4 * np.sqrt((a.var(ddof=1) + b.var(ddof=1)) / 12)


def test_cut_is_darker() -> None:
    """The lecture's pruning loses what it cuts."""
    scene = mi.load_dict(whitted())
    base = {"type": "raytree", "max_depth": DEPTH, "threshold": 0.2}
    full, cut = (mi.render(scene, integrator=mi.load_dict({**base, "prune": p}), spp=16) for p in ("random", "cut"))
    assert np.mean(cut) < 0.99 * np.mean(full)
