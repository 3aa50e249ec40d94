"""Names of BSDFs and sensors, and what is said of a scene file that cannot be read."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from brdf import DataError, UsageError
from plugins import scene


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")


def write(folder: Path, body: str, name: str = "scene.xml") -> Path:
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(f'<scene version="3.0.0">\n{body}\n</scene>\n')
    return path


NAMES = [
    ('<bsdf type="diffuse" id="a"/><shape type="sphere"><ref id="a"/></shape>', ["a"]),
    ('<shape type="sphere"><bsdf type="diffuse" id="a"/></shape>', ["a"]),
    ('<shape type="sphere" id="ball"><bsdf type="diffuse"/></shape>', ["ball.bsdf"]),
    (
        '<shape type="cube"/><shape type="sphere" id="s"/><shape type="disk"><bsdf type="diffuse"/></shape>',
        ["shape[2].bsdf"],
    ),
    ('<shape type="sphere"><bsdf type="twosided"><bsdf type="diffuse" id="in"/></bsdf></shape>', ["in"]),
    ('<shape type="sphere" id="s"><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>', ["s.bsdf"]),
    (
        '<shape type="sphere"><bsdf type="mask"><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></bsdf></shape>',
        ["shape[0].bsdf"],
    ),
    ('<shape type="sphere"><bsdf type="twosided" id="w"><bsdf type="diffuse"/></bsdf></shape>', ["w", "w.bsdf"]),
    (
        '<shape type="sphere" id="s"><bsdf type="blendbsdf"><float name="weight" value=".5"/>'
        '<bsdf type="diffuse"/><bsdf type="roughconductor"/></bsdf></shape>',
        ["s.bsdf[0]", "s.bsdf[1]"],
    ),
    (
        '<bsdf type="diffuse" id="a"/><shape type="sphere"><bsdf type="twosided"><ref id="a"/></bsdf></shape>',
        ["a"],
    ),
    (
        '<shape type="shapegroup" id="g"><shape type="sphere"><bsdf type="diffuse"/></shape></shape>'
        '<shape type="instance"><ref id="g"/></shape>',
        ["shape[1].bsdf"],
    ),
    (
        '<shape type="sphere"><bsdf type="bumpmap"><texture type="checkerboard"/><bsdf type="normalmap">'
        '<texture name="normalmap" type="checkerboard"/><bsdf type="diffuse" id="deep"/></bsdf></bsdf></shape>',
        ["deep"],
    ),
]


@pytest.mark.parametrize(("body", "names"), NAMES)
def test_names(tmp_path: Path, body: str, names: list[str]) -> None:
    loaded = scene.load(write(tmp_path, body))
    assert list(loaded.bsdfs) == names
    for name, found in loaded.bsdfs.items():
        assert found.id == name == found.bsdf.id()
        assert found.location == f"{tmp_path}/scene.xml:2"


@pytest.mark.parametrize("variant", ["llvm_ad_rgb", "llvm_ad_mono", "llvm_ad_spectral", "scalar_rgb"])
def test_every_variant_and_the_object_is_the_one_in_the_scene(tmp_path: Path, variant: str) -> None:
    mi.set_variant(variant)
    body = (
        '<bsdf type="twosided" id="w">'
        '<bsdf type="roughconductor" id="metal"><float name="alpha" value="0.3"/></bsdf></bsdf>'
        '<shape type="sphere" id="one"><ref id="w"/></shape><shape type="sphere" id="two"><ref id="w"/></shape>'
        '<shape type="sphere" id="three"><bsdf type="mask"><ref id="metal"/></bsdf></shape>'
    )
    loaded = scene.load(write(tmp_path, body))
    metal = scene.find(loaded, "metal")
    assert metal.plugin == "roughconductor"
    assert metal.props == {"alpha": 0.3}
    # Two shapes share the twosided one, a third has its mask: two parents, which are what the shapes hold.
    tops = {hash(s.bsdf()): s.bsdf() for s in loaded.scene.shapes()}
    assert {hash(p) for p in metal.parents} == set(tops)
    assert len(metal.parents) == 2
    params, key = scene.leaf(metal.bsdf, "alpha")
    params[key] = mi.Float(0.7)
    params.update()
    assert "0.7" in str(metal.parents[0])
    assert loaded.bsdfs["w"].parents == (loaded.bsdfs["w"].bsdf,)


def test_equal_bsdfs_and_meshes_stay_apart(tmp_path: Path) -> None:
    body = "".join(f'<shape type="rectangle" id="r{i}"><bsdf type="diffuse"/></shape>' for i in range(3))
    loaded = scene.load(write(tmp_path, body))
    assert list(loaded.bsdfs) == ["r0.bsdf", "r1.bsdf", "r2.bsdf"]
    assert len({hash(b.bsdf) for b in loaded.bsdfs.values()}) == 3
    assert [s.id() for s in loaded.scene.shapes()] == ["r0", "r1", "r2"]


def test_no_addresses(tmp_path: Path) -> None:
    body = (
        '<sensor type="perspective"/><shape type="sphere"><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>'
    )
    keys = mi.traverse(scene.load(write(tmp_path, body)).scene).keys()
    assert "shape[0].bsdf.brdf_0.reflectance.value" in keys
    assert not [k for k in keys if k.startswith("object_")]


def test_a_bsdf_no_shape_uses_has_no_parents(tmp_path: Path) -> None:
    assert scene.load(write(tmp_path, '<bsdf type="diffuse" id="lonely"/>')).bsdfs["lonely"].parents == ()


def test_sensors(tmp_path: Path) -> None:
    body = '<sensor type="perspective"/><sensor type="orthographic" id="top"/><sensor type="perspective"/>'
    loaded = scene.load(write(tmp_path, body))
    assert list(loaded.sensors) == ["sensor[0]", "top", "sensor[2]"]
    assert "Orthographic" in str(loaded.sensors["top"])


def test_included_files_and_defaults(tmp_path: Path) -> None:
    write(tmp_path, '<default name="n" value="mid"/><bsdf type="diffuse" id="$n"/>', "parts/inner.xml")
    write(tmp_path, '<include filename="parts/inner.xml"/><bsdf type="diffuse" id="outer"/>', "parts/outer.xml")
    path = write(tmp_path, '<include filename="parts/outer.xml"/>\n<shape type="sphere"><ref id="$n"/></shape>')
    loaded = scene.load(path)
    assert list(loaded.bsdfs) == ["mid", "outer"]
    assert loaded.bsdfs["mid"].location == f"{tmp_path}/parts/inner.xml:2"
    assert list(scene.load(path, n="other").bsdfs) == ["other", "outer"]
    with pytest.raises(UsageError, match=r"scene.xml: found unused parameters: \$typo=1"):
        scene.load(path, typo=1)


def test_files_are_found_from_the_folder_of_the_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, '<bsdf type="diffuse" id="a"/>', "here/part.xml")
    write(tmp_path, '<path value="sub"/><include filename="part.xml"/>', "here/scene.xml")
    (tmp_path / "here" / "sub").mkdir()
    before = scene.search_path()
    monkeypatch.chdir(tmp_path)
    assert list(scene.load("here/scene.xml").bsdfs) == ["a"]
    monkeypatch.chdir(tmp_path / "here")
    assert list(scene.load("scene.xml").bsdfs) == ["a"]
    assert scene.search_path() == before


ERRORS = [
    (
        '<bsdf type="diffuse" id="a"/>\n<bsdf type="diffuse" id="a"/>',
        r'scene.xml:3: duplicate ID: "a" \(previous was at .*scene.xml:2\)',
    ),
    ('<bsdf type="diffuse">', r"scene.xml:3: not well-formed XML: Start-end tags mismatch"),
    ('<shape type="ply"><string name="filename" value="no.ply"/></shape>', r'scene.xml:2: .*"no.ply"'),
    (
        '<bsdf type="diffuse"><texture name="reflectance" type="bitmap">\n'
        '<string name="filename" value="no.png"/></texture></bsdf>',
        r'scene.xml:2: .*"no.png"',
    ),
    ('<bsdf type="nothing"/>', r'scene.xml:2: .*"nothing" not found'),
    (
        '<bsdf type="diffuse"><float name="reflectence" value="1"/></bsdf>',
        r'scene.xml:2: Found 1 unreferenced .*float "reflectence": 1',
    ),
    ('<shape type="sphere"><ref id="a"/></shape>', r'scene.xml:2: unresolved reference to "a"'),
    ('<bsdf type="$t"/>', r"scene.xml:2: undefined parameter: \$t"),
    ('<include filename="no.xml"/>', r'scene.xml:2: included file "no.xml" not found'),
    ('<include filename="broken.xml"/>', r"broken.xml:1: not well-formed XML"),
    ('<include filename="unversioned.xml"/>', r"unversioned.xml: missing version"),
    ('<bsdf type="diffuse"><float name="reflectance" value="x"/></bsdf>', r'scene.xml:2: could not parse .*"x"'),
    ('<path value="nowhere"/>', r'scene.xml:2: <path>: folder "nowhere" not found'),
    (
        '<bsdf type="twosided">\n<bsdf type="cooktorrance"><float name="m" value="1.7"/></bsdf></bsdf>',
        r"scene.xml:3: cooktorrance: m = 1.7 is outside \[1e-4, 1.5\]\. m is the rms slope; "
        r"an artist's roughness r is m = r\*\*2\.$",
    ),
    (
        '<bsdf type="diffuse" id="s.bsdf"/>\n<shape type="sphere" id="s"><bsdf type="diffuse"/></shape>',
        r"scene.xml:2: the id 's.bsdf' is what the BSDF at .*scene.xml:3 is called too",
    ),
]


@pytest.mark.parametrize(("body", "message"), ERRORS)
def test_errors_are_one_line(tmp_path: Path, body: str, message: str) -> None:
    (tmp_path / "broken.xml").write_text("<scene version='3.0.0'><a></scene>")
    (tmp_path / "unversioned.xml").write_text("<scene/>")
    with pytest.raises(DataError, match=message) as raised:
        scene.load(write(tmp_path, body))
    text = str(raised.value)
    assert "\n" not in text
    assert "Traceback" not in text
    assert "parser.cpp" not in text


def test_what_a_plugin_of_somebody_elses_says_is_kept(tmp_path: Path) -> None:
    class Moody(mi.BSDF):
        def __init__(self, props: mi.Properties) -> None:
            mi.BSDF.__init__(self, props)
            raise ValueError("not today:\n  come back tomorrow")

    mi.register_bsdf("moody", lambda props: Moody(props))
    with pytest.raises(DataError, match=r"scene.xml:2: ValueError: not today: come back tomorrow$"):
        scene.load(write(tmp_path, '<bsdf type="moody"/>'))


def test_a_scene_is_let_go_of_without_the_garbage_collector(tmp_path: Path) -> None:
    """Dr.Jit calls every BSDF that is alive, and crashes on one that is freed while it does."""
    alive: list[weakref.ref[Any]] = []

    class Watched(mi.BSDF):
        def __init__(self, props: mi.Properties) -> None:
            mi.BSDF.__init__(self, props)
            alive.append(weakref.ref(self))

    mi.register_bsdf("watched", lambda props: Watched(props))
    good = '<shape type="sphere"><bsdf type="twosided"><bsdf type="watched"/></bsdf></shape>'
    gc.disable()
    try:
        loaded = scene.load(write(tmp_path, good))
        assert [w() for w in alive] == [loaded.bsdfs["shape[0].bsdf"].bsdf]
        del loaded
        assert [w() for w in alive] == [None]
        with pytest.raises(DataError) as raised:
            scene.load(write(tmp_path, f'{good}<shape type="sphere"><bsdf type="nothing"/></shape>'))
        assert [w() for w in alive] == [None, None]
        assert "nothing" in str(raised.value)
    finally:
        gc.enable()


def test_no_such_file_and_no_scene(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        scene.load(tmp_path / "no.xml")
    (tmp_path / "bsdf.xml").write_text('<bsdf version="3.0.0" type="diffuse"/>')
    with pytest.raises(DataError, match="holds a diffuse, not a scene"):
        scene.load(tmp_path / "bsdf.xml")
    (tmp_path / "empty.xml").write_text("")
    with pytest.raises(DataError, match=r"empty.xml:1: not well-formed XML"):
        scene.load(tmp_path / "empty.xml")
    (tmp_path / "latin.xml").write_bytes(
        '<scene version="3.0.0"><bsdf type="diffuse" id="é"/></scene>'.encode("latin-1")
    )
    with pytest.raises(DataError, match=r"latin.xml: holds text that is not UTF-8"):
        scene.load(tmp_path / "latin.xml")


def test_find_names_the_near_ones_and_all(tmp_path: Path) -> None:
    loaded = scene.load(write(tmp_path, '<bsdf type="diffuse" id="wood"/><bsdf type="diffuse" id="iron"/>'))
    with pytest.raises(UsageError, match=r"no BSDF 'wodo' in this scene\. Did you mean wood\? It has: wood, iron\."):
        scene.find(loaded, "wodo")


def test_leaf(tmp_path: Path) -> None:
    mi.Bitmap(np.full((2, 2, 3), 0.5, np.float32)).write(str(tmp_path / "t.exr"))
    body = (
        '<bsdf type="cooktorrance" id="ct"/>'
        '<bsdf type="cooktorrance" id="map"><texture name="m" type="bitmap"><string name="filename" value="t.exr"/>'
        '<boolean name="raw" value="true"/></texture></bsdf>'
        '<bsdf type="roughdielectric" id="glass"/>'
        '<bsdf type="principled" id="p"/>'
        '<bsdf type="diffuse" id="d"><texture name="reflectance" type="checkerboard"/></bsdf>'
    )
    bsdfs = scene.load(write(tmp_path, body)).bsdfs
    assert scene.leaf(bsdfs["ct"].bsdf, "m")[1] == "m.value"
    assert scene.leaf(bsdfs["ct"].bsdf, "diffuse_reflectance")[1] == "diffuse_reflectance.value"
    assert scene.leaf(bsdfs["glass"].bsdf, "eta")[1] == "eta"
    assert scene.leaf(bsdfs["p"].bsdf, "roughness")[1] == "roughness.value"
    for name, param in (("map", "m"), ("d", "reflectance")):
        with pytest.raises(UsageError, match=f"{name}: {param} is a texture"):
            scene.leaf(bsdfs[name].bsdf, param)
    with pytest.raises(
        UsageError, match=r"ct: 'etta' is not a parameter of this BSDF\. Did you mean eta\? It has: .*m, eta"
    ):
        scene.leaf(bsdfs["ct"].bsdf, "etta")


GREYS = ['<float name="{}" value="0.25"/>', '<spectrum name="{}" value="0.25"/>', '<rgb name="{}" value="0.25"/>']


@pytest.mark.parametrize("grey", GREYS)
@pytest.mark.parametrize(
    ("plugin", "param"),
    [
        ("diffuse", "reflectance"),
        ("cooktorrance", "diffuse_reflectance"),
        ("principled", "base_color"),
        ("roughconductor", "eta"),
    ],
)
def test_a_grey_has_three_components_that_can_be_told_apart(tmp_path: Path, grey: str, plugin: str, param: str) -> None:
    loaded = scene.load(write(tmp_path, f'<bsdf type="{plugin}" id="a">{grey.format(param)}</bsdf>'))
    params, key = scene.leaf(loaded.bsdfs["a"].bsdf, param)
    assert np.array(params[key]).ravel().tolist() == [0.25, 0.25, 0.25]


def test_a_colour_left_out_is_there_and_a_preset_stays(tmp_path: Path) -> None:
    body = (
        '<bsdf type="diffuse" id="d"/><bsdf type="roughconductor" id="al"><string name="material" value="Al"/></bsdf>'
    )
    loaded = scene.load(write(tmp_path, body))
    params, key = scene.leaf(loaded.bsdfs["d"].bsdf, "reflectance")
    assert np.array(params[key]).ravel().tolist() == [0.5, 0.5, 0.5]
    native = mi.traverse(mi.load_dict({"type": "roughconductor", "material": "Al"}))
    for name in ("eta", "k"):
        params, key = scene.leaf(loaded.bsdfs["al"].bsdf, name)
        assert np.array_equal(np.array(params[key]), np.array(native[f"{name}.value"]))


def test_bsdfs_do_not_share_a_constant_they_refer_to(tmp_path: Path) -> None:
    body = (
        '<texture type="uniform" id="v"><float name="value" value="0.2"/></texture>'
        '<bsdf type="roughconductor" id="a"><ref name="alpha" id="v"/></bsdf>'
        '<bsdf type="roughconductor" id="b"><ref name="alpha" id="v"/></bsdf>'
    )
    bsdfs = scene.load(write(tmp_path, body)).bsdfs
    params, key = scene.leaf(bsdfs["a"].bsdf, "alpha")
    params[key] = mi.Float(0.4)
    params.update()
    other, key = scene.leaf(bsdfs["b"].bsdf, "alpha")
    assert np.array(other[key]).ravel().tolist() == [np.float32(0.2)]
