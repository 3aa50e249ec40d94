"""The lecture's table: what is said not to be called for is nothing, by brute force; what is called for is there."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf.errors import DataError, UsageError
from plugins import scene as scenes
from plugins.effects import table
from plugins.effects.convex import meets_itself
from plugins.effects.inventory import take
from plugins.scenes import FOLDER, torus

sys.path.insert(0, str(Path(__file__).parent))
import brutecells

#: The scenes that ship, and the cells in which their pictures have light. Worked out by hand from the definition.
SHIPPED = {
    "point": "glossy.point",
    "points": "diffuse.point glossy.point",
    "area": "diffuse.area diffuse.indirect glossy.area glossy.indirect mirror.area mirror.indirect",
    "glass": "diffuse.point diffuse.indirect mirror.indirect",
    "environment": "diffuse.environment glossy.environment emitter",
    "cornell": "diffuse.area diffuse.indirect emitter",
    "all": " ".join(cell for cell in table.CELLS if cell != "mirror.point"),
    "mesh": "diffuse.point diffuse.area diffuse.indirect glossy.point glossy.area glossy.indirect",
}
#: In these the lamp is above the picture, which nobody can know without a look.
OUT_OF_VIEW = ("area", "mesh")
DEPTH = {"point": 2, "points": 2, "area": 5, "glass": 8, "environment": 3, "cornell": 6, "all": 5, "mesh": 5}

CAMERA = {"origin": [0, -6, 2.5], "target": [0, 0, 0.5], "up": [0, 0, 1]}


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def camera(**look_at: Any) -> dict[str, Any]:
    to_world = mi.ScalarTransform4f().look_at(**{**CAMERA, **look_at})
    film = {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}}
    return {"type": "perspective", "fov": 40, "to_world": to_world, "film": film}


def make(**things: Any) -> Any:
    return mi.load_dict({"type": "scene", "camera": camera(), **things})


def ball(bsdf: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"type": "sphere", "bsdf": bsdf, **more}


def lamp() -> dict[str, Any]:
    to_world = mi.ScalarTransform4f().look_at([-1, -2, 4], [0, 0, 0], [0, 1, 0])
    return {"type": "rectangle", "to_world": to_world, "light": {"type": "area"}}


def point() -> dict[str, Any]:
    return {"type": "point", "position": [-1, -4, 4], "intensity": 40.0}


def floor() -> dict[str, Any]:
    return {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0, 0, -1]).scale(5), "bsdf": MATT}


MATT = {"type": "diffuse"}
CHROME = {"type": "conductor"}


def wanted(scene: Any, depth: int = -1) -> set[str]:
    return set(table.called_for(table.plan(scene, depth)))


def lit(scene: Any, depth: int, **sampling: int) -> set[str]:
    return {name for name, light in brutecells.cells(scene, depth, **sampling).items() if light.any()}


def test_cells_are_rows_and_columns_and_lamps() -> None:
    assert table.CELLS[:5] == (
        "diffuse.point",
        "diffuse.area",
        "diffuse.environment",
        "diffuse.indirect",
        "glossy.point",
    )
    assert table.CELLS[8:] == ("mirror.point", "mirror.area", "mirror.environment", "mirror.indirect", "emitter")
    assert set(table.ABOUT) == set(table.CELLS) == set(brutecells.CELLS)
    # The lecture: mirror reflections of everything but point sources, all else from point sources.
    assert set(table.CELLS) - table.CLASSIC == {
        *(f"{row}.{column}" for row in ("diffuse", "glossy") for column in ("area", "environment", "indirect")),
        "mirror.point",
    }


@pytest.mark.parametrize("name", SHIPPED)
def test_scenes_that_ship(name: str) -> None:
    scene = scenes.load(FOLDER / "effects" / f"{name}.xml", size=24).scene
    there = set(SHIPPED[name].split())
    assert lit(scene, DEPTH[name], spp=128) == there
    assert wanted(scene, DEPTH[name]) == there | ({"emitter"} if name in OUT_OF_VIEW else set())
    assert f"max_depth = {DEPTH[name]}," in str(scene.integrator())


def test_the_torus_is_what_is_in_the_package() -> None:
    """A regression test: the script writes what is committed."""
    stored = mi.load_dict({"type": "ply", "filename": str(FOLDER / "effects" / "torus.ply")})
    for key, value in mi.traverse(torus.mesh()).items():
        if hasattr(value, "numpy"):
            np.testing.assert_allclose(np.array(value), np.array(mi.traverse(stored)[key]), atol=1e-6, err_msg=key)
    for name, picture in zip(("colours", "bumps"), torus.pictures(), strict=True):
        np.testing.assert_array_equal(
            np.array(mi.Bitmap(str(FOLDER / "effects" / f"{name}.png"))).squeeze(), picture.squeeze()
        )


def any_scene(seed: int) -> tuple[Any, int]:
    """One to three bodies of any kind under any lights, and a depth."""
    draw = np.random.default_rng(seed)
    transform = mi.ScalarTransform4f
    bsdfs: list[dict[str, Any]] = [
        MATT,
        CHROME,
        {"type": "roughconductor", "alpha": 0.3},
        {"type": "plastic"},
        {"type": "roughplastic", "alpha": 0.3},
        {"type": "glass"},
        {"type": "roughdielectric", "alpha": 0.3},
        {"type": "thindielectric"},
        {"type": "mask", "opacity": 0.5, "inside": MATT},
        {"type": "twosided", "inside": {"type": "roughplastic"}},
        {"type": "diffuse", "reflectance": 0.0},
        {"type": "glazed"},
        {"type": "null"},
    ]
    bodies = ["sphere", "cube", "rectangle", "disk", "cylinder"]
    lights: list[dict[str, Any]] = [
        point(),
        lamp(),
        {"type": "constant"},
        {"type": "directional", "direction": [0, 1, -1]},
    ]
    things: dict[str, Any] = {}
    for i in range(draw.integers(1, 4)):
        to_world = transform().translate([1.2 * (i - 1), 0.5 * i, 0]).rotate([1, 0, 0], 70).scale(0.7)
        shape = {"type": str(draw.choice(bodies)), "to_world": to_world, "bsdf": bsdfs[draw.integers(len(bsdfs))]}
        if draw.random() < 0.2:
            shape["glow"] = {"type": "area"}
        things[f"body{i}"] = shape
    for i in np.flatnonzero(draw.random(len(lights)) < 0.5):
        things[f"light{i}"] = lights[i]
    return make(**things), int(draw.integers(1, 6))


@pytest.mark.parametrize("seed", [pytest.param(i, marks=[pytest.mark.slow] if i >= 10 else []) for i in range(150)])
def test_what_is_not_called_for_is_nothing(seed: int) -> None:
    scene, depth = any_scene(seed)
    assert lit(scene, depth, size=16, spp=32, seed=seed) <= wanted(scene, depth)
    assert wanted(scene, depth) <= wanted(scene, -1) == wanted(scene, 100)


@pytest.mark.parametrize(
    ("things", "depth", "cells"),
    [
        # What a path tracer can find at each depth, counted by hand: an edge from the eye, one between surfaces, one to
        # the lamp.
        (lambda: {"a": ball(MATT), "b": floor(), "l": lamp()}, 0, ""),
        (lambda: {"a": ball(MATT), "b": floor(), "l": lamp()}, 1, "emitter"),
        (lambda: {"a": ball(MATT), "b": floor(), "l": lamp()}, 2, "emitter diffuse.area"),
        (lambda: {"a": ball(MATT), "b": floor(), "l": lamp()}, 3, "emitter diffuse.area diffuse.indirect"),
        # A point light does not reach the floor by the mirror ball; by floor, ball, floor it takes four edges.
        (lambda: {"a": ball(CHROME), "b": floor(), "l": point()}, 2, "diffuse.point"),
        (lambda: {"a": ball(CHROME), "b": floor(), "l": point()}, 3, "diffuse.point mirror.indirect"),
        (lambda: {"a": ball(CHROME), "b": floor(), "l": point()}, 4, "diffuse.point mirror.indirect diffuse.indirect"),
        # Of a lamp it does: a caustic.
        (lambda: {"a": ball(CHROME), "b": floor(), "l": lamp()}, 2, "emitter diffuse.area mirror.area"),
        (
            lambda: {"a": ball(CHROME), "b": floor(), "l": lamp()},
            3,
            "emitter diffuse.area mirror.area mirror.indirect diffuse.indirect",
        ),
        # Two mirrors under a lamp show lamps alone.
        (lambda: {"a": ball(CHROME), "b": ball(CHROME, center=[3, 0, 0]), "l": lamp()}, -1, "emitter mirror.area"),
        (lambda: {"a": ball(CHROME), "l": point()}, -1, ""),
        # A body that is the only lamp does not light itself.
        (lambda: {"a": ball(MATT, light={"type": "area"})}, -1, "emitter"),
        (
            lambda: {"a": ball(MATT, light={"type": "area"}), "l": {"type": "constant"}},
            5,
            "emitter diffuse.environment",
        ),
        (
            lambda: {"a": ball(MATT, light={"type": "area"}), "b": floor()},
            5,
            "emitter diffuse.area diffuse.indirect",
        ),
        # Glaze shows the sky, and a mirrored point light has measure zero.
        (
            lambda: {"a": ball({"type": "glazed"}), "l": {"type": "constant"}, "p": point()},
            -1,
            "emitter diffuse.point diffuse.environment mirror.environment",
        ),
        (lambda: {"a": ball(MATT), "l": {"type": "spot"}}, -1, "diffuse.point"),
        (lambda: {"a": ball(MATT), "l": {"type": "directional", "direction": [0, 1, -1]}}, -1, "diffuse.point"),
        (lambda: {"a": ball(MATT), "l": {"type": "sunsky"}}, -1, "emitter diffuse.environment"),
        # A light that shines along its normal is found by no path.
        (lambda: {"a": ball(MATT), "l": {"type": "rectangle", "light": {"type": "directionalarea"}}}, -1, ""),
        (lambda: {"l": lamp()}, -1, "emitter"),
        (lambda: {"a": ball({"type": "null"}), "l": lamp()}, -1, "emitter"),
    ],
)
def test_known_answers(things: Any, depth: int, cells: str) -> None:
    assert wanted(make(**things()), depth) == set(cells.split())


def test_hidden_lamps_are_still_seen_in_mirrors() -> None:
    """As Mitsuba's `path` with hide_emitters."""
    scene = make(a=ball(CHROME), l={"type": "constant"})
    cells = table.plan(scene, -1, hide_emitters=True)
    assert table.called_for(cells) == {"mirror.environment"}
    assert cells["emitter"].why == "hidden by hide_emitters"
    picture = np.array(mi.render(scene, spp=16, integrator=mi.load_dict({"type": "path", "hide_emitters": True})))
    assert picture[8, 8].min() > 0.5
    assert picture[0, 0].max() == 0


def test_projector() -> None:
    irradiance = {"type": "bitmap", "bitmap": mi.Bitmap(np.ones((2, 2, 3), np.float32))}
    assert wanted(make(a=ball(MATT), l={"type": "projector", "irradiance": irradiance})) == {"diffuse.point"}


@pytest.mark.parametrize(
    "inside", ["diffuse", "roughconductor", "conductor", "roughplastic", "plastic", "hanrahankrueger"]
)
def test_lobes_are_seen_through_wrappers(inside: str) -> None:
    picture = {"type": "bitmap", "raw": True, "bitmap": mi.Bitmap(np.full((2, 2, 3), 0.5, np.float32))}
    bare = {"type": inside}
    wrapped: list[dict[str, Any]] = [
        {"type": "mask", "inside": bare},
        {"type": "bumpmap", "map": picture, "inside": bare},
        {"type": "normalmap", "normalmap": picture, "inside": bare},
        {"type": "blendbsdf", "a": bare, "b": bare, "weight": 0.5},
    ]
    if inside != "hanrahankrueger":  # which is so already, and refused
        wrapped.append({"type": "twosided", "inside": bare})

    def answers(bsdf: dict[str, Any]) -> set[str]:
        return wanted(make(a=ball(bsdf), b={"type": "cube", "bsdf": bsdf}, l=lamp(), p=point(), e={"type": "constant"}))

    for bsdf in wrapped:
        assert answers(bsdf) == answers(bare), bsdf["type"]
    blend = {"type": "blendbsdf", "a": MATT, "b": CHROME, "weight": 0.5}
    assert answers(blend) == answers({"type": "plastic"})


@pytest.mark.parametrize("where", ["shape", "sensor"])
def test_a_medium_is_refused(where: str) -> None:
    fog = {"type": "homogeneous"}
    things = {"a": ball(MATT, id="cloud", interior=fog) if where == "shape" else ball(MATT), "l": lamp()}
    scene = mi.load_dict(
        {"type": "scene", **things, "camera": {**camera(), **({"m": fog} if where == "sensor" else {})}}
    )
    with pytest.raises(DataError, match=f"the {where} '.*' borders on a participating medium") as raised:
        table.plan(scene, 5)
    assert "\n" not in str(raised.value)


def faceted(points: list[list[float]], faces: list[list[int]], bsdf: dict[str, Any], round: bool = False) -> Any:
    """A mesh; if it is to look round, its normals point away from the origin."""
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(bsdf)
    made = mi.Mesh("mesh", len(points), len(faces), has_vertex_normals=round, props=props)
    params = mi.traverse(made)
    if round:
        normals = np.array(points, np.float32) - [0, 0, 0.3]
        params["vertex_normals"] = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32).ravel()
    params["vertex_positions"] = np.array(points, np.float32).ravel()
    params["faces"] = np.array(faces, np.uint32).ravel()
    params.update()
    return made


TETRAHEDRON = [[0, 0, 1.2], [1, 0, 0], [-0.5, 0.87, 0], [-0.5, -0.87, 0]]
OUTWARD = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]
TWO_SIDED = {"type": "twosided", "inside": MATT}


@pytest.mark.parametrize(
    ("shape", "again"),
    [
        (lambda: ball(MATT), False),
        (lambda: ball(TWO_SIDED), False),
        (lambda: ball(MATT, flip_normals=True), False),  # seen from outside it is black
        (lambda: ball({"type": "glass"}), True),
        (lambda: ball({"type": "roughdielectric"}), True),
        (lambda: ball({"type": "mask", "inside": MATT}), False),
        (lambda: ball({"type": "mask", "inside": TWO_SIDED}), True),
        (lambda: ball({"type": "bumpmap", "map": {"type": "checkerboard"}, "inside": MATT}), True),
        (lambda: {"type": "cube", "bsdf": MATT}, False),
        (lambda: {"type": "cube", "bsdf": TWO_SIDED}, False),
        (lambda: {"type": "cube", "flip_normals": True, "bsdf": {"type": "mask", "inside": MATT}}, True),
        (lambda: {"type": "rectangle", "bsdf": {"type": "glass"}}, False),
        (lambda: {"type": "disk", "bsdf": TWO_SIDED}, False),
        (lambda: {"type": "cylinder", "bsdf": MATT}, False),
        (lambda: {"type": "cylinder", "bsdf": TWO_SIDED}, True),
        (lambda: {"type": "cylinder", "bsdf": MATT, "flip_normals": True}, True),
        (lambda: faceted(TETRAHEDRON, OUTWARD, MATT), False),
        (lambda: faceted(TETRAHEDRON, OUTWARD, TWO_SIDED), False),
        (lambda: faceted(TETRAHEDRON, OUTWARD, MATT, round=True), True),  # light may be sent through a face
        (lambda: faceted(TETRAHEDRON, OUTWARD[:3], MATT), False),  # open, but only its outer side answers
        (lambda: faceted(TETRAHEDRON, OUTWARD[:3], TWO_SIDED), True),
        (lambda: faceted(TETRAHEDRON, [f[::-1] for f in OUTWARD], MATT), True),
        (lambda: faceted([*TETRAHEDRON[:3], [0.2, 0.2, 0.5]], OUTWARD, MATT), False),
        # The base drawn in: a dent. Four corners of a square, one lifted: folded upwards, or downwards.
        (lambda: faceted([*TETRAHEDRON, [0, 0, 0.3]], [*OUTWARD[:3], [1, 3, 4], [3, 2, 4], [2, 1, 4]], MATT), True),
        (lambda: faceted([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], TWO_SIDED), False),
        (lambda: faceted([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]], [[0, 1, 2], [0, 2, 3]], MATT), True),
        (lambda: faceted([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, -0.5]], [[0, 1, 2], [0, 2, 3]], MATT), False),
        (lambda: torus.mesh(), True),
    ],
)
def test_what_sees_itself(shape: Any, again: bool) -> None:
    """And where it is said not to, no light comes from itself, by brute force."""
    scene = make(a=shape(), e={"type": "constant"})
    assert meets_itself(scene.shapes()[0], scene.sensors()) == again
    if not again:
        assert not lit(scene, 4, size=32, spp=64) & {"diffuse.indirect", "glossy.indirect", "mirror.indirect"}


def test_a_sensor_inside_sees_a_hollow() -> None:
    """A ball that answers on both sides has indirect light if looked at from within, also over the near plane alone."""
    things = {"a": ball(TWO_SIDED), "e": {"type": "constant"}, "l": {"type": "point", "position": [0, 0.5, 0]}}
    for origin, near, inside in (([0, -6, 0], 0.1, False), ([0, -0.5, 0], 0.1, True), ([0, -1.05, 0], 0.3, True)):
        sensor = {**camera(origin=origin, target=[0, 0, 0]), "near_clip": near}
        scene = mi.load_dict({"type": "scene", **things, "camera": sensor})
        assert ("diffuse.indirect" in wanted(scene, 4)) == inside
        assert ("diffuse.indirect" in lit(scene, 4)) == inside
    # Where the rays of a sensor begin is not known of all.
    film = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}}
    meter = {"type": "radiancemeter", "origin": [0, -6, 0], "direction": [0, 1, 0], "film": film}
    assert "diffuse.indirect" in wanted(mi.load_dict({"type": "scene", **things, "camera": meter}))


def test_instances_answer_as_what_is_in_the_group() -> None:
    scene = make(
        g={"type": "shapegroup", "a": ball(CHROME), "b": {"type": "cube", "bsdf": {"type": "roughplastic"}}},
        one={"type": "instance", "group": {"type": "ref", "id": "g"}},
        e={"type": "constant"},
    )
    assert wanted(scene) == {
        "emitter",
        *("diffuse.environment", "diffuse.indirect", "glossy.environment", "glossy.indirect"),
        *("mirror.environment", "mirror.indirect"),
    }
    alone = make(
        g={"type": "shapegroup", "a": ball(MATT)},
        one={"type": "instance", "group": {"type": "ref", "id": "g"}},
        e={"type": "constant"},
    )
    assert "diffuse.indirect" in wanted(alone)  # there may be more of it


def test_a_lamp_is_black_until_its_colour_is_differentiated() -> None:
    scene = make(a=ball(MATT), l=lamp())
    assert "diffuse.indirect" not in wanted(scene)
    params = mi.traverse(scene)
    key = next(key for key in params.keys() if key.endswith("reflectance.value") and np.array(params[key]) == 0)  # noqa: SIM118
    dr.enable_grad(params[key])
    params.update()
    assert "diffuse.indirect" in wanted(scene)


def test_caustics_need_a_mirror_another_surface_and_a_lamp() -> None:
    mirror, matt = {"a": ball(CHROME)}, {"b": floor()}
    assert take(make(**mirror, **matt, l=lamp())).caustics
    assert take(make(**mirror, **matt, l={"type": "sunsky"})).caustics
    for things in ({**mirror, "l": lamp()}, {**matt, "l": lamp()}, {**mirror, **matt, "l": point()}):
        assert not take(make(**things)).caustics
    assert not take(make(**mirror, **matt, l={"type": "constant"})).caustics


def test_why_and_how() -> None:
    cells = table.plan(make(a=ball({"type": "glass"}), b=floor(), p=point()), -1)
    assert "no path finds them" in cells["diffuse.indirect"].why
    assert cells["diffuse.point"].technique == "all lights summed"
    assert all(bool(cell.technique) == cell.called_for for cell in cells.values())
    assert all(cell.why and "\n" not in cell.why for cell in cells.values())
    assert [name for name, cell in cells.items() if cell.easy] == [c for c in table.CELLS if c in table.CLASSIC]
    many = table.plan(make(a=ball(MATT), **{f"p{i}": point() for i in range(65)}), -1)
    assert many["diffuse.point"].technique == "one light drawn by power"
    assert table.plan(make(a=ball(MATT), l=lamp()), -1)["diffuse.area"].technique == "light sampling"


@pytest.mark.parametrize(
    ("text", "cells"),
    [
        ("all", set(table.CELLS)),
        ("auto", set(table.CELLS)),
        ("classic", set(table.CLASSIC)),
        ("diffuse.point, emitter", {"diffuse.point", "emitter"}),
        ("diffuse.point emitter", {"diffuse.point", "emitter"}),
        ("-diffuse.indirect", set(table.CELLS) - {"diffuse.indirect"}),
        ("all,-emitter,-mirror.area", set(table.CELLS) - {"emitter", "mirror.area"}),
        ("classic,diffuse.area,-emitter", (set(table.CLASSIC) | {"diffuse.area"}) - {"emitter"}),
        ("-classic", set(table.CELLS) - table.CLASSIC),
    ],
)
def test_parse(text: str, cells: set[str]) -> None:
    assert table.parse(text) == cells


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("difuse.point", "Did you mean diffuse.point?"),
        ("all,-mirror.indirct", "Did you mean mirror.indirect?"),
        ("clasic", "Did you mean classic?"),
        ("xyzzy", "There are: all, auto, classic, diffuse.point"),
        ("", "leaves no cell"),
        ("emitter,-emitter", "leaves no cell"),
    ],
)
def test_unknown_cells_are_wrong_use(text: str, said: str) -> None:
    with pytest.raises(UsageError) as raised:
        table.parse(text)
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)
