"""Cases in which `effects` was once wrong, against `path`, a closed form, or itself asked in another way."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf import UsageError
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


def derivatives(scene: Any, params: Any, key: str, value: Any, integrator: Any, spp: int) -> Iterator[float]:
    """That of the mean of the picture at t = 0, where the parameter is ``value(t)``: in reverse, in forward mode."""
    for mode in ("reverse", "forward"):
        t = mi.Float(0)
        dr.enable_grad(t)
        params[key] = value(t)
        params.update()
        mean = dr.mean(mi.render(scene, params, integrator=integrator, spp=spp, seed=1), axis=None)
        if mode == "reverse":
            dr.backward(mean)
            yield float(dr.grad(t)[0])
        else:
            dr.forward(t)
            yield float(dr.grad(mean).array[0])


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
    for found in derivatives(scene, params, key, mi.Color3f, integrator, 256):
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


def test_a_scene_without_surfaces() -> None:
    """Nothing but a sky, with and without it being seen."""
    scene = mi.load_dict({"type": "scene", "sensor": scenes.camera(4), "sky": {"type": "constant"}})
    for hidden in (False, True):
        picture = np.array(mi.render(scene, integrator=mi.load_dict(effects(3, hide_emitters=hidden)), spp=4))
        np.testing.assert_array_equal(picture, float(not hidden))


def before(*things: dict[str, Any]) -> mi.Scene:
    """A sky behind things, that fill the picture, which has an alpha channel."""
    sensor = scenes.camera(8, fov=10)
    sensor["to_world"] = mi.ScalarTransform4f().look_at([0, -4, 0.3], [0, 0, 0], [0, 0, 1])
    sensor["film"]["pixel_format"] = "rgba"
    held = {f"thing{i}": thing for i, thing in enumerate(things)}
    return mi.load_dict({"type": "scene", "sensor": sensor, "sky": {"type": "constant"}, **held})


def wall(bsdf: dict[str, Any] | None = None, y: float = 0, radiance: float = 0) -> dict[str, Any]:
    out: dict[str, Any] = {"type": "rectangle"}
    out["to_world"] = mi.ScalarTransform4f().translate([0, y, 0]).rotate([1, 0, 0], 90).scale(3)
    if bsdf:
        out["bsdf"] = bsdf
    if radiance:
        out["emitter"] = {"type": "area", "radiance": scenes.rgb(radiance)}
    return out


HALF = {"type": "mask", "opacity": 0.5, "a": scenes.DIFFUSE}
NOTHING = {"type": "null"}
THIN_GLASS = {"type": "thindielectric"}


@pytest.mark.parametrize("hidden", [True, False])
@pytest.mark.parametrize(
    "things",
    [
        lambda: [wall(NOTHING)],
        lambda: [wall({"type": "mask", "opacity": 0.5, "a": MIRROR})],
        lambda: [wall(THIN_GLASS)],
        lambda: [wall(NOTHING), wall(radiance=2, y=1)],
        lambda: [wall(HALF), wall(radiance=2, y=1)],
        lambda: [wall(NOTHING, y=-1), wall(MIRROR)],
        lambda: [wall(THIN_GLASS), wall(radiance=2, y=-1)],
        lambda: [scenes.ball({"type": "dielectric"})],
    ],
    ids=["nothing", "masked mirror", "pane", "lamp behind", "masked lamp", "mirror", "lamp before", "glass"],
)
def test_the_sky_behind_what_light_passes(things: Any, hidden: bool) -> None:
    """Radiance and alpha of `path`: a hidden sky is not seen through a mask, though a lamp is, and a sky in glass."""
    scene = before(*things())
    ours, theirs = (
        np.array(mi.render(scene, integrator=mi.load_dict(make(8, hide_emitters=hidden)), spp=4096)).mean((0, 1))
        for make in (effects, path)
    )
    # of 262144 samples, each at most 2: the standard error of either is below 0.004
    np.testing.assert_allclose(ours, theirs, atol=0.016)


@pytest.mark.parametrize(("hidden", "radiance", "alpha"), [(True, 0.25, 0.5), (False, 0.75, 1)])
def test_a_diffuse_mask_before_a_sky(hidden: bool, radiance: float, alpha: float) -> None:
    """Half a wall that reflects a half. `path` loses what it sampled of a hidden sky where a path then goes through."""
    scene = before(wall(HALF))
    ours, theirs = (
        np.array(mi.render(scene, integrator=mi.load_dict(make(8, hide_emitters=hidden)), spp=4096)).mean((0, 1))
        for make in (effects, path)
    )
    np.testing.assert_allclose(ours, [radiance] * 3 + [alpha], atol=0.016)  # as above
    assert (theirs[0] < radiance - 0.04) == hidden


def test_a_hidden_lamp_behind_a_mask_is_in_the_plan() -> None:
    """What is not called for is zero."""
    scene = before(wall(NOTHING), wall(radiance=2, y=1))
    for depth in (1, 2):
        made = mi.load_dict(effects(depth, hide_emitters=True, layers=True))
        picture = np.array(mi.render(scene, integrator=made, spp=4))
        seen = by_cell(np.delete(picture, 3, axis=-1))["emitter"].any()  # alpha is before the layers
        assert table.plan(scene, depth, hide_emitters=True)["emitter"].called_for == seen == (depth > 1)
    assert not table.plan(before(wall(radiance=2)), 2, hide_emitters=True)["emitter"].called_for
    assert not table.plan(before(wall(NOTHING)), 2, hide_emitters=True)["emitter"].called_for


@pytest.mark.parametrize("key", ["max_depth", "rr_depth"])
@pytest.mark.parametrize(("tag", "value"), [("float", "2.7"), ("float", "2"), ("string", "3"), ("boolean", "true")])
def test_a_depth_that_is_no_integer(key: str, tag: str, value: str) -> None:
    """It is not rounded without a word."""
    text = f'<integrator version="3.0.0" type="effects"><{tag} name="{key}" value="{value}"/></integrator>'
    with pytest.raises((UsageError, RuntimeError), match=rf"{key} = .*It takes an <integer> from"):
        mi.load_string(text)


def shown(bsdf: dict[str, Any]) -> dict[str, Any]:
    """A wall of it before a white sky, that fills the picture."""
    sensor = scenes.camera(8, fov=10)
    sensor["to_world"] = mi.ScalarTransform4f().look_at([0, -4, 0.3], [0, 0, 0], [0, 0, 1])
    return {"type": "scene", "sensor": sensor, "wall": wall(bsdf), "sky": {"type": "constant"}}


SHINY = {**MIRROR, "specular_reflectance": scenes.rgb(0.9)}
PART = {"type": "uniform", "value": 0.4}


@pytest.mark.parametrize(
    ("bsdf", "derivative"),
    [
        ({"type": "blendbsdf", "weight": PART, "a": SHINY, "b": scenes.DIFFUSE}, 0.5 - 0.9),
        ({"type": "blendbsdf", "weight": PART, "a": scenes.DIFFUSE, "b": SHINY}, 0.9 - 0.5),
        ({"type": "blendbsdf", "weight": PART, "a": scenes.DIFFUSE, "b": NOTHING}, 1 - 0.5),
        ({"type": "mask", "opacity": PART, "a": scenes.DIFFUSE}, 0.5 - 1),
        ({"type": "mask", "opacity": PART, "a": SHINY}, 0.9 - 1),
    ],
    ids=["blend", "blend turned", "blend with nothing", "mask", "masked mirror"],
)
def test_derivative_by_the_weight_of_a_blend(bsdf: dict[str, Any], derivative: float) -> None:
    """What shows is a mean of two known brightnesses, so its derivative is their difference."""
    scene, integrator = mi.load_dict(shown(bsdf)), mi.load_dict(effects(3))
    params = mi.traverse(scene)
    key = next(key for key in params.keys() if key.endswith(("weight.value", "opacity.value")))  # noqa: SIM118
    for found in derivatives(scene, params, key, lambda t: 0.4 + t, integrator, 1024):
        # of 65536 samples, each at most 1 / 0.4: the standard error is below 0.006
        np.testing.assert_allclose(found, derivative, atol=0.025)
