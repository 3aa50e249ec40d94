"""`effects` against `path`: the same picture, whole and in parts, in scenes that call for different cells."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf import DataError, NoBackend, UsageError
from plugins.effects import pilot
from plugins.effects.table import CELLS
from tests.plugins import effects_scenes as scenes
from tests.plugins.effects_statistics import assert_same_mean, runs


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def effects(depth: int, **properties: Any) -> dict[str, Any]:
    return {"type": "effects", "max_depth": depth, "rr_depth": 100, **properties}


def path(depth: int, **properties: Any) -> dict[str, Any]:
    return {"type": "path", "max_depth": depth, "rr_depth": 100, **properties}


def layers(picture: Any) -> dict[str, Any]:
    """By cell, from the channels behind RGB."""
    return {cell: picture[..., 3 + 3 * i : 6 + 3 * i] for i, cell in enumerate(CELLS)}


@pytest.mark.parametrize("name", scenes.SCENES)
def test_same_picture_as_path(name: str) -> None:
    make, depth = scenes.SCENES[name]
    scene = mi.load_dict(make())
    assert_same_mean(runs(scene, effects(depth), 0), runs(scene, path(depth), 1000))


#: What changes the estimator: scene, depth, properties of both integrators, properties of `effects` alone.
WAYS: dict[str, tuple[Any, int, dict[str, Any], dict[str, Any]]] = {
    "a hidden sky": (scenes.all_cells, 4, {"hide_emitters": True}, {}),
    "a hidden lamp": (scenes.cornell, 4, {"hide_emitters": True}, {}),
    "russian roulette": (scenes.cornell, 12, {"rr_depth": 2}, {}),
    "no limit": (scenes.all_cells, -1, {"rr_depth": 3}, {}),
    "one branch at random": (scenes.all_cells, 5, {}, {"threshold": 1.0}),
    "masks": (scenes.masked, 6, {}, {}),
    "thin glass": (scenes.thin, 5, {}, {}),
    "many lamps": (scenes.many_lamps, 3, {}, {}),
    "more points than are summed": (lambda: scenes.many_points(number=70), 2, {}, {}),
    "a lamp that also reflects": (scenes.shiny_lamp, 4, {}, {}),
    "only lamps": (scenes.all_cells, 1, {}, {}),
}


def test_instances() -> None:
    """Surfaces that the scene does not list by itself: glass and a glossy body in a group."""
    group = {"type": "shapegroup", "glass": scenes.ball({"type": "glass"}, x=-0.5, radius=0.5)}
    group["plastic"] = scenes.ball(scenes.rough_plastic(), x=0.5, radius=0.5)
    scene = {"type": "scene", "sensor": scenes.camera(32), "group": group, "floor": scenes.plane(scenes.DIFFUSE)}
    scene["light"] = scenes.point(2, -3, 4, 30)
    for i, x in enumerate((-0.9, 0.9)):
        to = mi.ScalarTransform4f().translate([x, 0, 0.2 * x])
        scene[f"copy{i}"] = {"type": "instance", "group": {"type": "ref", "id": "group"}, "to_world": to}
    loaded = mi.load_dict(scene)
    assert_same_mean(runs(loaded, effects(4), 0), runs(loaded, path(4), 1000))


@pytest.mark.parametrize("way", WAYS)
def test_same_in_other_ways(way: str) -> None:
    make, depth, both, ours = WAYS[way]
    scene = mi.load_dict(make())
    assert_same_mean(runs(scene, effects(depth, **both, **ours), 0), runs(scene, path(depth, **both), 1000))


def test_layers_sum_to_the_picture() -> None:
    scene = mi.load_dict(scenes.all_cells())
    picture = np.array(mi.render(scene, integrator=mi.load_dict(effects(5, layers=True)), spp=16), dtype=float)
    assert picture.shape[-1] == 3 + 3 * len(CELLS)
    parts = layers(picture)
    # float32 sums of the same samples in another order
    np.testing.assert_allclose(sum(parts.values()), picture[..., :3], rtol=1e-5, atol=1e-6)
    dark = {cell for cell, part in parts.items() if not part.any()}
    assert dark == {"mirror.point"}
    assert all(np.all(part >= 0) for part in parts.values())


def test_parts_of_what_mirrors_show() -> None:
    """They sum to the layer that they split, of the same samples; each is what goes with its cell."""
    scene = mi.load_dict(scenes.all_cells())
    whole, split = (
        np.array(mi.render(scene, integrator=mi.load_dict(effects(5, layers=True, parts=p)), spp=16), dtype=float)
        for p in (False, True)
    )
    # float32 sums in another order, here and below
    np.testing.assert_allclose(split[..., :3], whole[..., :3], rtol=1e-5, atol=1e-6)
    names = [n.rpartition(".")[0] for n in mi.load_dict(effects(5, layers=True, parts=True)).aov_names()[::3]]
    parts = {n: split[..., 3 + 3 * i : 6 + 3 * i] for i, n in enumerate(names)}
    shown = [part for n, part in parts.items() if n.startswith("mirror.indirect/")]
    assert len(shown) == 8
    assert all(part.any() for part in shown)
    np.testing.assert_allclose(sum(shown), layers(whole)["mirror.indirect"], rtol=1e-5, atol=1e-6)
    without = runs(scene, effects(5, cells="-diffuse.area"), 0)
    every = runs(scene, effects(5, layers=True, parts=True), 500)
    gone = sum(every[..., 3 + 3 * i : 6 + 3 * i] for i, n in enumerate(names) if n.endswith("diffuse.area"))
    assert_same_mean(without, every[..., :3] - gone)


def test_names_of_the_layers() -> None:
    names = mi.load_dict(effects(3, layers=True)).aov_names()
    assert names[:3] == ["diffuse.point.R", "diffuse.point.G", "diffuse.point.B"]
    assert names[-1] == "emitter.B"
    assert mi.load_dict(effects(3)).aov_names() == []


SUBSETS = [
    "diffuse.point glossy.point",
    "diffuse.area",
    "diffuse.environment, diffuse.area, glossy.area, emitter",
    "diffuse.indirect",
    "glossy.indirect diffuse.point",
    "mirror.area, mirror.environment, emitter",
    "emitter diffuse.area diffuse.indirect glossy.environment",
    "diffuse.point diffuse.area glossy.area mirror.indirect",
]


@pytest.mark.parametrize("cells", SUBSETS)
def test_subset_is_the_sum_of_its_layers(cells: str) -> None:
    """Of those cells alone, and cut out of all."""
    scene = mi.load_dict(scenes.all_cells())
    subset = runs(scene, effects(5, cells=cells), 0)
    own = runs(scene, effects(5, cells=cells, layers=True), 500)
    parts = layers(own)
    assert {cell for cell, part in parts.items() if part.any()} == set(cells.replace(",", " ").split())
    assert_same_mean(subset, own[..., :3])
    if "mirror.indirect" not in cells:  # which shows in a mirror no more than what is called for outside
        every = layers(runs(scene, effects(5, layers=True), 1000))
        assert_same_mean(subset, sum(every[cell] for cell in parts if parts[cell].any()))


def test_mirror_alone_shows_everything() -> None:
    scene = mi.load_dict(scenes.all_cells())
    alone = runs(scene, effects(5, cells="mirror.indirect"), 0)
    assert_same_mean(alone, layers(runs(scene, effects(5, layers=True), 1000))["mirror.indirect"])


def test_tolerance() -> None:
    """What a pilot finds to be worth little is left out, and the error is as small as was asked."""
    scene = mi.load_dict(scenes.all_cells())
    integrator = mi.load_dict(effects(5, tolerance=0.1))
    some = np.mean([mi.render(scene, integrator=integrator, spp=256, seed=i) for i in range(4)], axis=0)
    assert integrator.dropped
    assert integrator.dropped < set(CELLS)
    exact = mi.load_dict(effects(5))
    whole = np.mean([mi.render(scene, integrator=exact, spp=256, seed=9 + i) for i in range(4)], axis=0)
    noise = np.mean([mi.render(scene, integrator=exact, spp=256, seed=99 + i) for i in range(4)], axis=0)
    white = pilot.white_of({"": whole})
    error, floor = pilot.difference(whole, some, white), pilot.difference(whole, noise, white)
    assert floor < error
    assert error**2 - floor**2 < 0.1**2  # noise counts as an error, the same in both


def test_classic_has_no_indirect_light() -> None:
    scene = mi.load_dict(scenes.all_cells())
    picture = np.array(mi.render(scene, integrator=mi.load_dict(effects(5, cells="classic", layers=True)), spp=4))
    lit = {cell for cell, part in layers(picture).items() if part.any()}
    assert lit == {"diffuse.point", "glossy.point", "mirror.area", "mirror.environment", "mirror.indirect", "emitter"}


#: White surfaces, which reflect all they get: a picture of 1, whatever else happens.
WHITE: dict[str, dict[str, Any]] = {
    "lambertian": {"type": "lambertian", "reflectance": 1.0},
    "glazed": {"type": "glazed", "diffuse_reflectance": 1.0},
    "glass": {"type": "glass"},
    "mirror": {"type": "mirror"},
}


@pytest.mark.parametrize("name", WHITE)
def test_white_furnace(name: str) -> None:
    scene = mi.load_dict(furnace(WHITE[name]))
    picture = np.array(mi.render(scene, integrator=mi.load_dict(effects(-1, rr_depth=100)), spp=256), dtype=float)
    # on a convex body every path ends in the sky, in which MIS leaves some noise per pixel and little in the mean
    assert abs(picture.mean() - 1) < 2e-3


def furnace(bsdf: dict[str, Any]) -> dict[str, Any]:
    sky = {"type": "constant", "radiance": scenes.rgb(1)}
    return {"type": "scene", "sensor": scenes.camera(32), "ball": scenes.ball(bsdf), "sky": sky}


def test_blend_of_mirror_and_diffuse() -> None:
    """Half a mirror of .9 and half a diffuse .2: .55 of the sky. `path` shows less, since `blendbsdf` samples wrongly."""
    blend = {
        "type": "blendbsdf",
        "weight": 0.5,
        "a": {"type": "conductor", "material": "none", "specular_reflectance": scenes.rgb(0.9)},
        "b": {"type": "diffuse", "reflectance": scenes.rgb(0.2)},
    }
    scene = furnace(blend)
    scene["sensor"] = scenes.camera(8, fov=10)  # nothing but the ball
    loaded = mi.load_dict(scene)
    ours, theirs = (np.mean(runs(loaded, i, 0, samples=256, number=8)) for i in (effects(3), path(3)))
    assert abs(ours - 0.55) < 3e-3
    assert theirs < 0.5


def test_from_xml() -> None:
    text = """<integrator version="3.0.0" type="{}"><integer name="max_depth" value="4"/>
        <string name="cells" value="diffuse.point, mirror.area"/><boolean name="layers" value="true"/>{}</integrator>"""
    for name in ("effects", "raytree"):
        made = str(mi.load_string(text.format(name, "")))
        assert made.startswith(f"{name}[cells = diffuse.point mirror.area, max_depth = 4,")
    with pytest.raises(RuntimeError, match="cels"):
        mi.load_string(text.format("effects", '<string name="cels" value="all"/>'))
    assert str(mi.load_dict({"type": "raytree"})) != str(mi.load_dict({"type": "effects"}))


@pytest.mark.parametrize(
    ("properties", "said"),
    [
        ({"cells": "diffuse.pointt"}, "Did you mean diffuse.point"),
        ({"cells": ""}, "leaves no cell"),
        ({"cells": 3}, "takes a <string>"),
        ({"prune": "never"}, "random, cut"),
        ({"max_depth": -2}, "from -1 on"),
        ({"threshold": -0.1}, "from 0 on"),
        ({"rr_depth": 0}, "from 1 on"),
        ({"cells": "classic", "tolerance": 0.1}, "for cells = auto"),
        ({"layers": "yes"}, "takes a <boolean>"),
    ],
)
def test_wrong_properties(properties: dict[str, Any], said: str) -> None:
    with pytest.raises((UsageError, RuntimeError), match=said):
        mi.load_dict({"type": "effects", **properties})


def test_other_variants() -> None:
    mi.set_variant("scalar_rgb")
    plugins.register()
    with pytest.raises((NoBackend, RuntimeError), match="llvm_ad_rgb"):
        mi.load_dict({"type": "effects"})


@pytest.mark.parametrize("name", ["llvm_ad_mono", "llvm_ad_spectral"])
def test_variants(name: str) -> None:
    mi.set_variant(name)
    plugins.register()
    scene = mi.load_dict(scenes.glass_mirror())
    assert_same_mean(runs(scene, effects(5), 0), runs(scene, path(5), 1000))


def test_another_scene() -> None:
    """One integrator for two scenes, in turns."""
    integrator = mi.load_dict(effects(3))
    loaded = [mi.load_dict(make()) for make in (scenes.one_point, scenes.area_mirror)]
    first, second, again, alone = (
        np.array(mi.render(scene, integrator=i, spp=4))
        for scene, i in [(s, integrator) for s in (*loaded, loaded[0])] + [(loaded[1], mi.load_dict(effects(3)))]
    )
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(second, alone)


def test_scene_is_freed() -> None:
    """An integrator that belongs to a scene does not keep it in memory."""
    made = scenes.many_lamps()
    made["integrator"] = effects(3)
    scene = mi.load_dict(made)
    mi.render(scene, spp=1)
    ours = weakref.ref(scene.integrator())
    del scene
    gc.collect()
    assert ours() is None


def test_media_are_refused() -> None:
    scene = scenes.one_point()
    scene["ball"]["interior"] = {"type": "homogeneous", "albedo": 0.5}
    loaded = mi.load_dict(scene)
    with pytest.raises(DataError, match="participating medium"):
        mi.load_dict(effects(3)).render(loaded, spp=1)
