"""Writing fitted values back: byte by byte what changes, and Mitsuba as the judge of what the written file means."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import mitsuba as mi
import numpy as np
import pytest

from brdf import DataError, UsageError
from plugins import scene, xmlfile, xmlscan


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")


def value(bsdf: mi.BSDF, param: str) -> list[float]:
    params, key = scene.leaf(bsdf, param)
    return np.array(params[key]).ravel().tolist()


def single(*values: float) -> list[float]:
    return [float(np.float32(v)) for v in values]


# Before, the values to write, after. Everything between the two that differs is in the second.
CASES: list[tuple[str, dict[str, dict[str, Any]], str | None]] = [
    (
        '<bsdf type="cooktorrance" id="a"><float name="m" value="0.3"/></bsdf>',
        {"a": {"m": 0.25}},
        '<bsdf type="cooktorrance" id="a"><float name="m" value="0.25"/></bsdf>',
    ),
    (
        "<bsdf id = 'a'\n  type='cooktorrance' >\n<!-- <float name=\"m\" value=\"1\"/> -->\n<float\tvalue='.3'   name='m'></float >\n</bsdf >",
        {"a": {"m": np.float32(0.1)}},
        "<bsdf id = 'a'\n  type='cooktorrance' >\n<!-- <float name=\"m\" value=\"1\"/> -->\n<float\tvalue='0.1'   name='m'></float >\n</bsdf >",
    ),
    (
        '<default name="m" value=".3"/><bsdf type="cooktorrance" id="a"><float name="m" value="$m"/></bsdf>',
        {"a": {"m": 1e-4}},
        '<default name="m" value=".3"/><bsdf type="cooktorrance" id="a"><float name="m" value="0.0001"/></bsdf>',
    ),
    (
        '<bsdf type="diffuse" id="a"><rgb name="reflectance" value="0.5"/></bsdf>',
        {"a": {"reflectance": (0.1, 0.2, 1 / 3)}},
        f'<bsdf type="diffuse" id="a"><rgb name="reflectance" value="0.1, 0.2, {1 / 3!r}"/></bsdf>',
    ),
    (
        '<bsdf type="diffuse" id="a"><spectrum name="reflectance" value="0.5"/></bsdf>',
        {"a": {"reflectance": np.array([0.1, 0.2, 0.3], np.float32)}},
        '<bsdf type="diffuse" id="a"><rgb name="reflectance" value="0.1, 0.2, 0.3"/></bsdf>',
    ),
    (
        '<bsdf type="diffuse" id="a"><float name="reflectance" value="0.5"/></bsdf>',
        {"a": {"reflectance": (0.1, 0.2, 0.3)}},
        '<bsdf type="diffuse" id="a"><rgb name="reflectance" value="0.1, 0.2, 0.3"/></bsdf>',
    ),
    (
        '<bsdf type="roughconductor" id="a"><integer name="alpha" value="1"/></bsdf>',
        {"a": {"alpha": 0.5}},
        '<bsdf type="roughconductor" id="a"><float name="alpha" value="0.5"/></bsdf>',
    ),
    (
        '<bsdf type="roughconductor" id="a"><spectrum type="uniform" name="alpha">\n<float name="value" value="1"/></spectrum></bsdf>',
        {"a": {"alpha": 0.5}},
        '<bsdf type="roughconductor" id="a"><float name="alpha" value="0.5"/></bsdf>',
    ),
    (
        '<texture type="uniform" id="t"><float name="value" value="1"/></texture>'
        '<bsdf type="roughconductor" id="a"><ref name="alpha" id="t"/></bsdf>',
        {"a": {"alpha": 0.5}},
        '<texture type="uniform" id="t"><float name="value" value="1"/></texture>'
        '<bsdf type="roughconductor" id="a"><float name="alpha" value="0.5"/></bsdf>',
    ),
    # absent: at the end, in the indentation of the file
    (
        '  <bsdf type="cooktorrance" id="a">\n      <float name="m" value="0.3"/>\n  </bsdf>',
        {"a": {"eta": 1.25}},
        '  <bsdf type="cooktorrance" id="a">\n      <float name="m" value="0.3"/>\n      <float name="eta" value="1.25"/>\n  </bsdf>',
    ),
    ('  <bsdf type="diffuse" id="a" />', {"a": {"reflectance": (0, 0, 0.5)}}, None),
    (
        '  <bsdf type="cooktorrance" id="a" />\n',
        {"a": {"m": 0.5, "eta": 1.25}},
        '  <bsdf type="cooktorrance" id="a">\n      <float name="m" value="0.5"/>\n      <float name="eta" value="1.25"/>\n  </bsdf>\n',
    ),
    (
        '<shape type="sphere" id="s"><bsdf type="cooktorrance"/></shape>',
        {"s.bsdf": {"m": 0.5}},
        '<shape type="sphere" id="s"><bsdf type="cooktorrance"><float name="m" value="0.5"/></bsdf></shape>',
    ),
    (
        '<bsdf type="cooktorrance" id="a"> <!-- none --> </bsdf>',
        {"a": {"m": 0.5}},
        None,
    ),
    # the right one of many
    (
        '<shape type="sphere"><bsdf type="twosided"><bsdf type="cooktorrance"/></bsdf></shape><!-- <bsdf/> -->'
        '<shape type="sphere"><bsdf type="twosided"><bsdf type="cooktorrance"/></bsdf></shape>',
        {"shape[1].bsdf": {"m": 0.5}},
        '<shape type="sphere"><bsdf type="twosided"><bsdf type="cooktorrance"/></bsdf></shape><!-- <bsdf/> -->'
        '<shape type="sphere"><bsdf type="twosided"><bsdf type="cooktorrance"><float name="m" value="0.5"/></bsdf></bsdf></shape>',
    ),
    # presets that would contradict
    (
        '<bsdf type="roughdielectric" id="a">\n\t<string name="int_ior" value="bk7"/>\n\t<float name="ext_ior" value="1"/>\n</bsdf>',
        {"a": {"eta": 1.25}},
        '<bsdf type="roughdielectric" id="a">\n\t<float name="int_ior" value="1.25"/>\n\t<float name="ext_ior" value="1"/>\n</bsdf>',
    ),
    ('<bsdf type="roughdielectric" id="a"/>', {"a": {"eta": 1.25, "alpha": 0.3}}, None),
    ('<bsdf type="roughdielectric" id="a"><string name="ext_ior" value="water"/></bsdf>', {"a": {"eta": 1.25}}, None),
    (
        '<bsdf type="roughconductor" id="a">\n\t<string name="material" value="Al"/>\n\t<float name="alpha" value="1"/>\n</bsdf>',
        {"a": {"eta": (1, 2, 3), "k": (4, 5, 6)}},
        '<bsdf type="roughconductor" id="a">\n\t<float name="alpha" value="1"/>'
        '\n\t<rgb name="eta" value="1.0, 2.0, 3.0"/>\n\t<rgb name="k" value="4.0, 5.0, 6.0"/>\n</bsdf>',
    ),
    ('<bsdf type="roughconductor" id="a"><string name="material" value="Al"/></bsdf>', {"a": {"k": (4, 5, 6)}}, None),
    (
        '<bsdf type="principled" id="a"><float name="eta" value="1.5"/></bsdf>',
        {"a": {"eta": 1.25, "roughness": 0.25}},
        None,
    ),
    ('<bsdf type="principled" id="a"/>', {"a": {"specular": 0.25, "sheen": 0.5, "base_color": (0.1, 0.2, 0.3)}}, None),
]


@pytest.mark.parametrize(("before", "values", "after"), CASES)
def test_rewrite(tmp_path: Path, before: str, values: dict[str, dict[str, Any]], after: str | None) -> None:
    path, out = tmp_path / "scene.xml", tmp_path / "out.xml"
    frame = '<?xml version="1.0"?>\n<!-- é -->\n<scene version="3.0.0">\n{}\n</scene>\n<!-- end -->'
    path.write_text(frame.format(before), encoding="utf-8")
    original = scene.load(path)
    assert xmlfile.rewrite(path, out, values) == [out]
    if after is not None:
        assert out.read_text(encoding="utf-8") == frame.format(after)
    assert sorted(os.listdir(tmp_path)) == ["out.xml", "scene.xml"]
    # Mitsuba's reading of it: what was asked for, and everything else as it was.
    written = scene.load(out)
    assert list(written.bsdfs) == list(original.bsdfs)
    for name, bsdf in written.bsdfs.items():
        old, new = mi.traverse(original.bsdfs[name].bsdf), mi.traverse(bsdf.bsdf)
        assert list(old.keys()) == list(new.keys())
        for key in list(old.keys()):
            asked = values.get(name, {}).get(key.removesuffix(".value"))
            want = np.array(old[key]) if asked is None else np.array(asked, np.float32)
            np.testing.assert_allclose(np.array(new[key]).ravel(), want.ravel(), rtol=2e-7)  # one float32 step


@pytest.mark.parametrize(
    ("codec", "declared"),
    [
        ("utf-8", "utf-8"),
        ("utf-8-sig", "utf-8"),
        ("latin-1", "iso-8859-1"),
        ("latin-1", "latin1"),
        ("utf-16", "utf-16"),
        ("utf-16-le", "utf-16"),
        ("utf-16-be", "utf-16"),
    ],
)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_encodings_and_line_ends(tmp_path: Path, codec: str, declared: str, newline: str) -> None:
    text = f'<?xml version="1.0" encoding="{declared}"?>\n<!-- ü -->\n<scene version="3.0.0">\n  <!-- é -->\n' + (
        '  <bsdf type="cooktorrance" id="ö">\n    <float name="m" value="0.5"/>{}\n  </bsdf>\n</scene>\n'
    )
    path, out = tmp_path / "scene.xml", tmp_path / "out.xml"
    path.write_bytes(text.format("").replace("\n", newline).encode(codec))
    xmlfile.rewrite(path, out, {"ö": {"m": 0.5, "eta": 1.25}})
    assert out.read_bytes() == text.format('\n    <float name="eta" value="1.25"/>').replace("\n", newline).encode(
        codec
    )
    assert value(scene.load(out).bsdfs["ö"].bsdf, "eta") == [1.25]


def test_bytes_that_are_no_text_stay(tmp_path: Path) -> None:
    body = b'<scene version="3.0.0"><!-- \xff\xfe --><bsdf type="cooktorrance" id="a"><float name="m" value="0.5"/></bsdf></scene>'
    (tmp_path / "scene.xml").write_bytes(body)
    xmlfile.rewrite(tmp_path / "scene.xml", tmp_path / "out.xml", {"a": {"m": 0.25}})
    assert (tmp_path / "out.xml").read_bytes() == body.replace(b'"0.5"', b'"0.25"')


@pytest.mark.parametrize("number", [0.1, 1 / 3, 1e-4, 123456.789, 1e20, float(np.float32(0.1)), 1.0000001])
def test_numbers_read_back_as_they_were(number: float) -> None:
    assert float(np.float32(xmlfile.shortest(number))) == float(np.float32(number))
    if float(np.float32(number)) != number:
        assert float(xmlfile.shortest(number)) == number
    assert len(xmlfile.shortest(float(np.float32(number)))) <= 13


# ------------------------------------------------------------------------------------------------ folders

ODD = 'a & b\'s $ "q" ü'


@pytest.fixture
def world(tmp_path: Path) -> Path:
    """A scene with a mesh, a texture, an environment map, and includes two deep, in folders of odd names."""
    home = tmp_path / ODD
    (home / "in c").mkdir(parents=True)
    (home / "more").mkdir()
    (home / "tex").mkdir()
    grey = mi.Bitmap(np.full((4, 4, 3), 0.4, np.float32))
    grey.write(str(home / "in c" / "t & 1.exr"))
    grey.write(str(home / "tex" / "found by path.exr"))
    grey.write(str(home / "env.exr"))
    mi.load_dict({"type": "rectangle"}).write_ply(str(home / "more" / "plate.ply"))
    (home / "scene.xml").write_text(
        """<?xml version="1.0" encoding="utf-8"?>
<scene version="3.0.0">
    <default name="res" value="16"/>
    <default name="parts" value="in c"/>
    <include filename="more/../in c/nothing.xml"/>
    <include filename="$parts/outer.xml"/>
    <path value="tex"/>
    <integrator type="path"><integer name="max_depth" value="3"/></integrator>
    <sensor type="perspective" id="cam">
        <transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="$res"/><integer name="height" value="$res"/></film>
        <sampler type="independent"><integer name="sample_count" value="16"/></sampler>
    </sensor>
    <emitter type="envmap"><string name="filename" value="env.exr"/></emitter>
    <emitter type="point"><point name="position" value="1, 2, 4"/><rgb name="intensity" value="20"/></emitter>
    <shape type="ply"><string name="filename" value="more/plate.ply"/><ref id="floor"/></shape>
    <shape type="sphere" id="ball"><ref id="two"/></shape>
</scene>
"""
    )
    (home / "in c" / "nothing.xml").write_text('<scene version="3.0.0"><default name="m" value="0.4"/></scene>')
    (home / "in c" / "outer.xml").write_text(
        """<scene version="3.0.0">
    <texture type="bitmap" id="wood"><string name="filename" value="in c/t &amp; 1.exr"/></texture>
    <include filename="in c/inner.xml"/>
    <bsdf type="twosided" id="two">
        <bsdf type="cooktorrance" id="paint"><float name="m" value="$m"/><ref name="diffuse_reflectance" id="wood"/></bsdf>
    </bsdf>
</scene>
"""
    )
    (home / "in c" / "inner.xml").write_text(
        """<bsdf version="3.0.0" type="mask"><bsdf type="roughconductor" id="floor">
    <float name="alpha" value="0.2"/><string name="material" value="Cu"/></bsdf></bsdf>
"""
    )
    return home


VALUES: dict[str, dict[str, Any]] = {"paint": {"m": 0.15, "eta": 1.7}, "floor": {"alpha": 0.35, "eta": (0.3, 0.9, 1.1)}}


def expected_picture(path: Path, **defaults: str) -> np.ndarray:
    """The picture of a scene with VALUES set through ``mi.traverse``."""
    loaded = scene.load(path, **defaults)
    for name, given in VALUES.items():
        for param, new in given.items():
            params, key = scene.leaf(loaded.bsdfs[name].bsdf, param)
            params[key] = mi.Color3f(new) if isinstance(new, tuple) else mi.Float(new)
            params.update()
    return np.array(mi.render(loaded.scene, sensor=loaded.sensors["cam"], seed=1))


OUTS = ["scene2.xml", "deep/er/new.xml", "../sibling $x & 'y'/scene.xml", "in c/scene.xml"]


@pytest.mark.parametrize("out", OUTS)
def test_the_written_scene_renders_as_the_old_one_with_the_values_set(world: Path, out: str) -> None:
    target = world / out
    target.parent.mkdir(parents=True, exist_ok=True)
    before = {p: p.read_bytes() for p in world.rglob("*.xml")}
    written = xmlfile.rewrite(world / "scene.xml", target, VALUES)
    assert written[-1] == target
    assert {p.name for p in written[:-1]} == {f"{target.stem}.outer.xml", f"{target.stem}.inner.xml"}
    assert {p: p.read_bytes() for p in before} == before
    lines, old = target.read_text().splitlines(), (world / "scene.xml").read_text().splitlines()
    changed = [new for new in lines if new not in old]
    assert len(changed) == (1 if target.parent == world else 2)  # the <include>, and <path>
    picture = np.array(mi.render(mi.load_file(str(target)), seed=1))
    assert picture.std() > 0.01
    np.testing.assert_allclose(picture, expected_picture(world / "scene.xml"), rtol=1e-5)  # order of sums of emitters


def test_from_another_working_folder_and_by_relative_names(world: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (world / "fit").mkdir()
    monkeypatch.chdir(world)
    xmlfile.rewrite("scene.xml", "fit/scene.xml", VALUES)
    monkeypatch.chdir("/")
    assert value(scene.load(world / "fit" / "scene.xml").bsdfs["paint"].bsdf, "m") == single(0.15)
    monkeypatch.chdir(world / "fit")
    assert value(scene.load("scene.xml").bsdfs["paint"].bsdf, "m") == single(0.15)


def test_a_written_scene_can_be_fitted_and_written_again(world: Path) -> None:
    (world / "fit").mkdir()
    out = world / "fit" / "scene.xml"
    xmlfile.rewrite(world / "scene.xml", out, VALUES)
    xmlfile.rewrite(out, out, {"paint": {"m": 0.6}})
    loaded = scene.load(out)
    assert value(loaded.bsdfs["paint"].bsdf, "m") == single(0.6)
    assert value(loaded.bsdfs["floor"].bsdf, "alpha") == single(0.35)


def decoy(ident: str, inside: str = "") -> str:
    return f'<scene version="3.0.0">{inside}<bsdf type="cooktorrance" id="{ident}"/></scene>'


def test_what_is_included_stays_what_it_was(tmp_path: Path) -> None:
    """Mitsuba looks beside the including file first, then where <path> says: files of the same names elsewhere are decoys."""
    home, fit = tmp_path / "home", tmp_path / "fit"
    for folder in ("sub/deep", "p", "deep"):
        for place in (home, fit):
            (place / folder).mkdir(parents=True)
    (home / "scene.xml").write_text(
        '<scene version="3.0.0"><path value="p"/><include filename="one.xml"/><include filename="two.xml"/>'
        '<include filename="sub/three.xml"/><include filename="six.xml"/>'
        '<default name="first" value="seven"/><default name="first" value="two"/><include filename="$first.xml"/>'
        '<bsdf type="cooktorrance" id="own"/></scene>'
    )
    (home / "one.xml").write_text(decoy("one"))
    (home / "p" / "one.xml").write_text(decoy("wrong"))
    (home / "p" / "two.xml").write_text(decoy("two"))
    (home / "sub" / "three.xml").write_text(decoy("three", '<path value="deep"/><include filename="four.xml"/>'))
    (home / "sub" / "deep" / "four.xml").write_text(decoy("four", '<include filename="five.xml"/>'))
    (home / "sub" / "deep" / "five.xml").write_text(decoy("five"))
    (home / "p" / "six.xml").write_text(decoy("six"))
    (home / "sub" / "deep" / "six.xml").write_text(decoy("wrong"))
    (home / "seven.xml").write_text(decoy("seven"))
    for place in (fit, fit / "p", fit / "deep", home / "deep"):
        for name in ("one", "two", "three", "four", "five", "six", "seven", "scene.three", "scene.four"):
            (place / f"{name}.xml").write_text(decoy("wrong"))
    (home / "scene.three.xml").write_text(decoy("wrong"))
    names = ["one", "two", "five", "four", "three", "six", "seven", "own"]
    assert list(scene.load(home / "scene.xml").bsdfs) == names
    for changed in ([], *([name] for name in names), names):
        xmlfile.rewrite(home / "scene.xml", fit / "scene.xml", {name: {"m": 0.123} for name in changed})
        bsdfs = scene.load(fit / "scene.xml").bsdfs
        assert list(bsdfs) == names
        assert [name for name in names if value(bsdfs[name].bsdf, "m") == single(0.123)] == [
            n for n in names if n in changed
        ]


def test_a_path_of_the_scene_leads_where_it_did(tmp_path: Path) -> None:
    for place, grey in (("home", 0.25), ("fit", 0.75)):
        (tmp_path / place / "tex").mkdir(parents=True)
        mi.Bitmap(np.full((2, 2, 3), grey, np.float32)).write(str(tmp_path / place / "tex" / "t.exr"))
    (tmp_path / "home" / "scene.xml").write_text(
        '<scene version="3.0.0"><path value="tex"/><bsdf type="cooktorrance" id="a"><texture type="bitmap" '
        'name="diffuse_reflectance"><string name="filename" value="t.exr"/></texture></bsdf></scene>'
    )
    out = tmp_path / "fit" / "scene.xml"
    xmlfile.rewrite(tmp_path / "home" / "scene.xml", out, {"a": {"m": 0.5}})
    params = mi.traverse(scene.load(out).bsdfs["a"].bsdf)
    assert np.array(params["diffuse_reflectance.data"]).max() == 0.25


def test_a_copy_does_not_take_the_place_of_an_original(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(decoy("a"))
    (tmp_path / "s.a.xml").write_text(decoy("b"))
    (tmp_path / "old.xml").write_text(
        '<scene version="3.0.0"><include filename="a.xml"/><include filename="s.a.xml"/></scene>'
    )
    xmlfile.rewrite(tmp_path / "old.xml", tmp_path / "s.xml", {"a": {"m": 0.5}})
    assert (tmp_path / "s.a.xml").read_text() == decoy("b")
    assert [value(b.bsdf, "m") for b in scene.load(tmp_path / "s.xml").bsdfs.values()] == [single(0.5), single(0.3)]


def test_one_file_included_twice_becomes_two(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(
        '<scene version="3.0.0"><shape type="sphere"><bsdf type="cooktorrance"/></shape></scene>'
    )
    (tmp_path / "scene.xml").write_text(
        '<scene version="3.0.0"><include filename="ball.xml"/><include filename="ball.xml"/><include filename="ball.xml"/></scene>'
    )
    (tmp_path / "fit").mkdir()
    xmlfile.rewrite(
        tmp_path / "scene.xml", tmp_path / "fit/s.xml", {"shape[0].bsdf": {"m": 0.1}, "shape[2].bsdf": {"m": 0.2}}
    )
    bsdfs = scene.load(tmp_path / "fit" / "s.xml").bsdfs
    assert [value(bsdfs[f"shape[{i}].bsdf"].bsdf, "m") for i in range(3)] == [single(0.1), single(0.3), single(0.2)]


def test_defaults_of_the_user(world: Path) -> None:
    (world / "fit").mkdir()
    xmlfile.rewrite(world / "scene.xml", world / "fit" / "scene.xml", {"paint": {"m": 0.6}}, m=0.2, parts="in c")
    assert value(scene.load(world / "fit" / "scene.xml").bsdfs["paint"].bsdf, "m") == single(0.6)


def test_old_names(tmp_path: Path) -> None:
    """Files older than version 2 say ``intIOR``."""
    text = (
        '<scene version="1.0.0"><bsdf type="roughdielectric" id="a"><float name="intIOR" value="1.5"/></bsdf></scene>'
    )
    (tmp_path / "scene.xml").write_text(text)
    xmlfile.rewrite(tmp_path / "scene.xml", tmp_path / "out.xml", {"a": {"alpha": 0.3, "eta": 1.3}})
    assert 'name="intIOR"' in (tmp_path / "out.xml").read_text()
    assert value(scene.load(tmp_path / "out.xml").bsdfs["a"].bsdf, "eta") == pytest.approx([1.3], rel=2e-7)


def test_spectral_preset(tmp_path: Path) -> None:
    """In a spectral variant what is left of a preset stays a spectrum."""
    mi.set_variant("llvm_ad_spectral")
    text = (
        '<scene version="3.0.0"><bsdf type="roughconductor" id="a"><string name="material" value="Al"/></bsdf></scene>'
    )
    (tmp_path / "scene.xml").write_text(text)
    xmlfile.rewrite(tmp_path / "scene.xml", tmp_path / "out.xml", {"a": {"eta": (0.5, 0.5, 0.5)}})
    old, new = (mi.traverse(scene.load(tmp_path / f).bsdfs["a"].bsdf) for f in ("scene.xml", "out.xml"))
    assert np.array_equal(np.array(old["k.values"]), np.array(new["k.values"]))


# ------------------------------------------------------------------------------------------------ material.xml


@pytest.mark.parametrize("out", ["material.xml", "deep/material.xml", "../sibling $x & 'y'/material.xml"])
@pytest.mark.parametrize("name", ["paint", "floor"])
def test_material(world: Path, out: str, name: str) -> None:
    target = world / out
    target.parent.mkdir(parents=True, exist_ok=True)
    xmlfile.material(world / "scene.xml", name, VALUES[name], target, "fitted -- on a Monday--")
    text = target.read_text()
    kind = "cooktorrance" if name == "paint" else "roughconductor"
    assert f'<bsdf version="3.0.0" type="{kind}" id="{name}">' in text
    assert "<!-- fitted" in text
    assert "$" not in text.replace("\\$", "")
    bsdf = mi.load_file(str(target))
    assert bsdf.id() == name
    for param, want in VALUES[name].items():
        assert value(bsdf, param) == single(*np.ravel(want))
    # Files are found from wherever it is included.
    away = world / "away"
    away.mkdir(exist_ok=True)
    link = escape(str(target), {'"': "&quot;"}).replace("$", "\\$")
    (away / "other.xml").write_text(f'<scene version="3.0.0"><include filename="{link}"/></scene>')
    assert scene.load(away / "other.xml").bsdfs[name].plugin == kind
    # All the rest is what the scene has.
    written = world / "fit.xml"
    xmlfile.rewrite(world / "scene.xml", written, {name: VALUES[name]})
    whole, alone = mi.traverse(scene.load(written).bsdfs[name].bsdf), mi.traverse(bsdf)
    for key in list(alone.keys()):
        assert np.array_equal(np.array(whole[key]), np.array(alone[key])), key


def test_material_of_an_unnamed_bsdf_with_a_default_of_the_user(tmp_path: Path) -> None:
    text = '<scene version="3.0.0"><shape type="sphere"><bsdf type="cooktorrance"><float name="m" value="$m"/></bsdf></shape></scene>'
    (tmp_path / "scene.xml").write_text(text)
    xmlfile.material(tmp_path / "scene.xml", "shape[0].bsdf", {"m": 0.123}, tmp_path / "material.xml", m=0.5)
    assert "id=" not in (tmp_path / "material.xml").read_text()
    assert 'name="m" value="0.123"' in (tmp_path / "material.xml").read_text()
    assert value(mi.load_file(str(tmp_path / "material.xml")), "m") == single(0.123)


# ------------------------------------------------------------------------------------------------ what goes wrong


def test_errors(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text('<scene version="3.0.0"><bsdf type="diffuse" id="wood"/></scene>')
    new = {"reflectance": (0.1, 0.2, 0.3)}
    with pytest.raises(UsageError, match="Did you mean wood"):
        xmlfile.rewrite(tmp_path / "scene.xml", tmp_path / "out.xml", {"wodo": new})
    with pytest.raises(DataError, match="no such file"):
        xmlfile.rewrite(tmp_path / "nothing.xml", tmp_path / "out.xml", {"wood": new})
    with pytest.raises(DataError, match="cannot be written"):
        xmlfile.rewrite(tmp_path / "scene.xml", tmp_path / "no folder" / "out.xml", {"wood": new})
    assert os.listdir(tmp_path) == ["scene.xml"]


def test_scanner_on_what_mitsuba_accepts_and_others_do_not() -> None:
    text = b"<!DOCTYPE scene [<!ENTITY a '<bsdf>'>]><scene version='3'><?pi <x> ?><![CDATA[<y>]]><string name='a' value=\"b & <c>\" value='d'/></scene>"
    root = xmlscan.scan(Path("x.xml"), text)
    assert [e.tag for e in root.walk()] == ["scene", "string"]
    # Of an attribute given twice, Mitsuba takes the first.
    start, end = root.children[0].attributes["value"]
    assert text[start:end] == b"b & <c>"
