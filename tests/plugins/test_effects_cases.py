"""Cases in which `effects` was once wrong, against `path`, a closed form, or itself asked in another way."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import plugins
from plugins.effects import table
from plugins.effects.undivided import undivided
from tests.plugins import effects_scenes as scenes
from tests.plugins.effects_statistics import assert_same_mean, runs


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


PRINCIPLED = {"type": "principled", "base_color": scenes.rgb(0.7, 0.3, 0.2), "roughness": 0.3, "metallic": 0.3}
THIN = {"type": "principledthin", "base_color": scenes.rgb(0.7, 0.3, 0.2), "spec_trans": 0.4, "diff_trans": 0.8}
SMOOTH_METAL = {"type": "roughconductor", "alpha": 0.2}
MIRROR = {"type": "conductor", "material": "none"}


def blend(a: dict[str, Any], b: dict[str, Any]) -> dict[str, Any]:
    return {"type": "blendbsdf", "weight": 0.4, "a": a, "b": b}


@pytest.mark.parametrize(
    ("bsdf", "whole"),
    [
        (PRINCIPLED, True),
        ({**PRINCIPLED, "base_color": scenes.rgb(0), "specular": 0.0}, True),
        (THIN, True),
        ({"type": "twosided", "a": PRINCIPLED}, True),
        ({"type": "twosided", "a": scenes.rough_plastic(), "b": PRINCIPLED}, True),
        ({"type": "mask", "opacity": 0.5, "a": PRINCIPLED}, True),
        ({"type": "bumpmap", "map": {"type": "checkerboard"}, "a": PRINCIPLED}, True),
        ({"type": "normalmap", "normalmap": scenes.rgb(0.5, 0.5, 1), "a": PRINCIPLED}, True),
        (blend(scenes.DIFFUSE, PRINCIPLED), True),
        (scenes.rough_plastic(), False),
        ({"type": "plastic"}, False),
        (scenes.DIFFUSE, False),
        (SMOOTH_METAL, False),
        (blend(scenes.DIFFUSE, SMOOTH_METAL), False),
        ({"type": "phong"}, False),
        ({"type": "twosided", "a": scenes.rough_plastic()}, False),
    ],
)
def test_which_bsdfs_do_not_tell_their_lobes_apart(bsdf: dict[str, Any], whole: bool) -> None:
    assert undivided(mi.load_dict(bsdf)) == whole


def undivided_balls(size: int = 16) -> dict[str, Any]:
    """Of BSDFs that answer with all lobes to every question, among one that does not."""
    masked = {"type": "mask", "opacity": 0.6, "a": PRINCIPLED}
    glazed = {"type": "normalmap", "normalmap": scenes.rgb(0.55, 0.5, 0.95), "a": blend(PRINCIPLED, MIRROR)}
    return {
        "type": "scene",
        "sensor": scenes.camera(size),
        "bare": scenes.ball({"type": "twosided", "a": PRINCIPLED}, x=-1.1),
        "mask": scenes.ball(masked, x=1.1),
        "blend": scenes.ball(blend(scenes.DIFFUSE, glazed), y=-1.3, z=-0.5, radius=0.5),
        "thin": {"type": "rectangle", "to_world": scenes.pane(0, -1, 0.3, 0.5), "bsdf": THIN},
        "floor": scenes.plane(scenes.rough_plastic()),
        "lamp": scenes.lamp(1, -2, 4, 0.8, 4),
        "light": scenes.point(-2, -3, 4, 10),
        "sky": {"type": "constant", "radiance": scenes.rgb(0.2, 0.25, 0.3)},
    }


def effects(depth: int, **properties: Any) -> dict[str, Any]:
    return {"type": "effects", "max_depth": depth, "rr_depth": 100, **properties}


def path(depth: int, **properties: Any) -> dict[str, Any]:
    return {"type": "path", "max_depth": depth, "rr_depth": 100, **properties}


def by_cell(picture: Any) -> dict[str, Any]:
    """From the channels behind RGB."""
    return {cell: picture[..., 3 + 3 * i : 6 + 3 * i] for i, cell in enumerate(table.CELLS)}


def test_no_lobe_of_an_undivided_bsdf_counts_twice() -> None:
    """In layers, and in pictures of some cells, also where only one row goes on."""
    scene = mi.load_dict(undivided_balls())
    every = runs(scene, effects(3, layers=True), 0)
    parts = by_cell(every)
    assert_same_mean(sum(parts.values()), runs(scene, path(3), 1000))
    for cells in ("diffuse.area diffuse.point", "glossy.area glossy.indirect diffuse.point"):
        some = runs(scene, effects(3, cells=cells), 500)
        assert_same_mean(some, sum(parts[cell] for cell in cells.split()))


def test_an_undivided_bsdf_has_the_glossy_row() -> None:
    held = {"ball": scenes.ball(PRINCIPLED), "sensor": scenes.camera(16), "light": scenes.point(2, -3, 4, 30)}
    scene = mi.load_dict({"type": "scene", **held})
    assert table.called_for(table.plan(scene, 5)) == {"glossy.point"}
    picture = mi.render(scene, integrator=mi.load_dict(effects(2, layers=True)), spp=64)
    np.testing.assert_allclose(by_cell(np.array(picture))["glossy.point"], np.array(picture)[..., :3])
    assert_same_mean(runs(scene, effects(2), 0), runs(scene, path(2), 1000))


def test_undivided_bsdfs_where_derivatives_are_taken() -> None:
    """There all surfaces are asked as one. The picture is linear in the lights: its derivative is itself."""
    scene = mi.load_dict(undivided_balls())
    integrator = mi.load_dict(effects(3, cells="glossy.area glossy.environment"))
    params = mi.traverse(scene)
    t = mi.Float(1)
    dr.enable_grad(t)
    for key in ("lamp.emitter.radiance.value", "sky.radiance.value"):
        params[key] = dr.detach(type(params[key])(params[key])) * t
    params.update()
    image = mi.render(scene, params, integrator=integrator, spp=256, seed=1)
    dr.forward(t)
    derivative, value = np.array(dr.grad(image), dtype=float), np.array(image, dtype=float)
    # two estimates of one mean: of 256 x 768 samples each
    assert abs(derivative.mean() / value.mean() - 1) < 0.02


def black_floor() -> tuple[Any, Any, str]:
    """The scene, its parameters, and the key of the colour of a black floor."""
    floor = scenes.plane({"type": "diffuse", "reflectance": scenes.rgb(0)})
    scene = mi.load_dict(
        {"type": "scene", "sensor": scenes.camera(16), "floor": floor, "light": scenes.point(2, -3, 4, 30)}
    )
    return scene, mi.traverse(scene), "floor.bsdf.reflectance.value"


def test_black_that_is_given_a_colour() -> None:
    """By one integrator: as by another that never saw it black."""
    scene, params, key = black_floor()
    integrator = mi.load_dict(effects(3))
    assert not np.any(np.array(mi.render(scene, integrator=integrator, spp=4)))
    params[key] = mi.Color3f(0.5)
    params.update()
    expected = np.array(mi.render(scene, integrator=mi.load_dict(effects(3)), spp=4))
    assert expected.mean() > 0
    np.testing.assert_array_equal(np.array(mi.render(scene, integrator=integrator, spp=4)), expected)


def test_derivative_at_black() -> None:
    """The picture is linear in the colour: the derivative at 0 is twice the picture at a half; in both modes."""
    scene, params, key = black_floor()
    params[key] = mi.Color3f(0.5)
    params.update()
    half = float(np.array(mi.render(scene, integrator=mi.load_dict(effects(2)), spp=256, seed=5)).mean())
    integrator = mi.load_dict(effects(2))
    for mode in ("reverse", "forward"):
        t = mi.Float(0)
        dr.enable_grad(t)
        params[key] = mi.Color3f(t)
        params.update()
        value = dr.mean(mi.render(scene, params, integrator=integrator, spp=256, seed=1), axis=None)
        if mode == "reverse":
            dr.backward(value)
            found = float(dr.grad(t)[0])
        else:
            dr.forward(t)
            found = float(dr.grad(value).array[0])
        # one light, summed: noise is that of the hit points within a pixel
        np.testing.assert_allclose(found, 2 * half, rtol=1e-2)


def hollow(*origin: float) -> tuple[dict[str, Any], dict[str, Any]]:
    """A ball that answers on both sides, with a light in it, seen from outside; and a camera elsewhere."""
    ball = scenes.ball({"type": "twosided", "a": {"type": "diffuse", "reflectance": scenes.rgb(0.8)}})
    held = {"type": "scene", "sensor": scenes.camera(16), "ball": ball, "light": scenes.point(0, 0, 0.5, 1)}
    to = mi.ScalarTransform4f().look_at(list(origin), [0, 0, 0], [0, 0, 1])
    return held, {**scenes.camera(16, fov=60), "to_world": to}


def test_a_sensor_that_is_not_of_the_scene() -> None:
    """From within, light goes from wall to wall; from outside the same integrator sees that it does not."""
    held, within = hollow(0, -0.5, 0)
    scene, camera, integrator = mi.load_dict(held), mi.load_dict(within), mi.load_dict(effects(8))
    expected = np.array(mi.render(scene, sensor=camera, integrator=mi.load_dict(path(8)), spp=256))
    for _ in range(2):
        assert not np.any(np.array(mi.render(scene, integrator=integrator, spp=4)))
        seen = np.array(mi.render(scene, sensor=camera, integrator=integrator, spp=256, seed=1))
        # a closed ball without colour: both have the direct light exactly, and some noise in the rest
        np.testing.assert_allclose(seen.mean(), expected.mean(), rtol=1e-2)


def test_rays_without_a_sensor() -> None:
    """Nothing is taken for granted about where they begin."""
    held, within = hollow(0, -0.5, 0)
    scene, camera, integrator = mi.load_dict(held), mi.load_dict(within), mi.load_dict(effects(8))
    mi.render(scene, integrator=integrator, spp=1)
    number = 1 << 14
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, number)
    ray, _ = camera.sample_ray_differential(0, 0, sampler.next_2d(), mi.Point2f(0.5))
    ours, theirs = (
        float(np.array(one.sample(scene, sampler, ray)[0]).mean()) for one in (integrator, mi.load_dict(path(8)))
    )
    np.testing.assert_allclose(ours, theirs, rtol=1e-2)
