"""What a fit leaves in its folder: files that load in Mitsuba, figures that agree with each other, a command to repeat it."""

from __future__ import annotations

import csv
import dataclasses
import difflib
import html.parser
import json
import re
import shlex
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import fitting
from brdf.errors import UsageError
from fitting import images, output
from fitting.cli.app import main
from fitting.solution import Solution
from tests.fitting import studio
from tests.fitting.command import RESULTS, ball, strict


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A fit, where its scene is, and where its results are."""

    solution: Solution
    home: Path
    out: Path

    def values(self, name: str) -> np.ndarray:
        """As a scene holds them."""
        return self.solution.parameters[name].value.astype(np.float32)

    def saved(self) -> dict[str, Any]:
        return strict((self.out / "fit.json").read_text())


def pixels(scene: Any, sensor: int = 0, spp: int = 16, seed: int = 3) -> np.ndarray:
    return np.array(mi.render(scene, sensor=sensor, spp=spp, seed=seed))[..., :3]


def exactly(value: float) -> str:
    """A float32 in as few digits as tell it from the others."""
    return str(np.float32(value))


@pytest.fixture(scope="module")
def simple(tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    """One material, one picture."""
    studio.use()
    home = tmp_path_factory.mktemp("simple")
    scene, _ = ball(home)
    names = ["ball.m", "ball.eta", "ball.diffuse_reflectance"]
    found = fitting.fit(scene, {"camera": home / "target.exr"}, names, seed=5, spp=64)
    output.write(found, home / "results" / "one")
    return Fitted(found, home, home / "results" / "one")


BASE = """<bsdf type="cooktorrance" id="ball">
    <texture name="diffuse_reflectance" type="bitmap"> <string name="filename" value="pictures/stripes.exr"/> </texture>
    <float name="m" value="0.1"/>
  </bsdf>"""
FLOOR = """<scene version="3.0.0">
  <bsdf type="twosided"> <bsdf type="diffuse" id="floor"> <rgb name="reflectance" value="0.5"/> </bsdf> </bsdf>
  <shape type="rectangle" id="ground"> <ref id="floor"/>
    <transform name="to_world"> <scale value="4"/> <rotate x="1" angle="-90"/> <translate y="-1.01"/> </transform> </shape>
  <shape type="sphere"> <point name="center" x="1.6" y="-0.4" z="0"/> <float name="radius" value="0.6"/>
    <bsdf type="roughconductor"> <float name="alpha" value="0.1"/> </bsdf> </shape>
  <shape type="rectangle"> <bsdf type="diffuse"> <texture name="reflectance" type="bitmap">
    <string name="filename" value="pictures/stripes.exr"/> </texture> </bsdf>
    <transform name="to_world"> <scale value="4"/> <translate z="-3"/> </transform> </shape>
</scene>
"""
SHAPE = "shape[2].bsdf"


@pytest.fixture(scope="module")
def rich(tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    """Three materials, two of them in an included file, two cameras, pictures as textures: all paths relative."""
    studio.use()
    home = tmp_path_factory.mktemp("rich")
    (home / "parts").mkdir()
    (home / "pictures").mkdir()
    (home / "parts" / "room.xml").write_text(FLOOR)
    y, x = np.mgrid[:32, :32] // 4 % 2
    images.write(home / "pictures" / "stripes.exr", 0.1 + np.dstack([0.5 * x, 0.3 * y, 0.2 * x * y]))
    cameras = [studio.camera(name="left", origin="-1,1,5", fov=40), studio.camera(name="right", origin="2,1,5", fov=40)]
    room = '<include filename="parts/room.xml"/>'
    scene = studio.write(
        home, BASE, studio.SPHERE, *cameras, studio.KEY, room, integrator='<integrator type="direct"/>'
    )
    truth = home / "truth.xml"
    text = scene.read_text().replace('"m" value="0.1"', '"m" value="0.3"').replace("parts/room", "parts/true")
    truth.write_text(text)
    true = FLOOR.replace('value="0.5"/> </bsdf>', 'value="0.2,0.3,0.4"/> </bsdf>').replace(
        '"alpha" value="0.1"', '"alpha" value="0.3"'
    )
    assert true.count("0.3") == 2
    (home / "parts" / "true.xml").write_text(true)
    targets = {name: studio.picture(truth, 256, sensor=i) for i, name in enumerate(["left", "right"])}
    (home / "parts" / "true.xml").unlink()
    names = ["ball.m", "floor.reflectance", f"{SHAPE}.alpha"]
    found = fitting.fit(scene, targets, names, spp=64)
    output.write(found, home / "deep" / "er")
    return Fitted(found, home, home / "deep" / "er")


def test_the_files_of_a_fit(simple: Fitted, rich: Fitted) -> None:
    assert {p.name for p in simple.out.iterdir()} == RESULTS
    assert {p.name for p in rich.out.iterdir()} == {
        *("material-ball.xml", "material-floor.xml", f"material-{SHAPE}.xml", "scene.xml", "scene.room.xml"),
        *("render-left.exr", "render-right.exr", "error-left.exr", "error-right.exr"),
        *("history.csv", "report.html", "fit.json"),
    }


def test_the_fits_are_right(simple: Fitted, rich: Fitted) -> None:
    """So that what follows is about the true values and not about starts."""
    assert simple.values("ball.m") == pytest.approx(0.3, rel=0.02)
    assert simple.values("ball.eta") == pytest.approx(1.5, rel=0.02)
    assert rich.values("ball.m") == pytest.approx(0.3, rel=0.05)
    assert rich.values("floor.reflectance") == pytest.approx([0.2, 0.3, 0.4], rel=0.05)
    assert rich.values(f"{SHAPE}.alpha") == pytest.approx(0.3, rel=0.05)


def test_material_is_the_fitted_bsdf(simple: Fitted) -> None:
    loaded = mi.load_file(str(simple.out / "material.xml"))
    assert isinstance(loaded, mi.BSDF)
    assert loaded.id() == "ball"
    values = {name: simple.values(f"ball.{name}") for name in ("m", "eta", "diffuse_reflectance")}
    params = mi.traverse(loaded)
    for name, value in values.items():
        np.testing.assert_array_equal(np.array(params[f"{name}.value"]).ravel(), value)
    base = {"type": "rgb", "value": values["diffuse_reflectance"].tolist()}
    made = mi.load_dict(
        {
            "type": "cooktorrance",
            "m": float(values["m"][0]),
            "eta": float(values["eta"][0]),
            "diffuse_reflectance": base,
        }
    )
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(0.6, 0, 0.8)
    for wo in ((-0.6, 0, 0.8), (0, 0.28, 0.96), (0.8, 0, 0.6)):
        got, expected = (np.array(b.eval(mi.BSDFContext(), si, mi.Vector3f(*wo))) for b in (loaded, made))
        np.testing.assert_array_equal(got, expected)
        assert (got > 0).all()


@pytest.mark.parametrize("way", ["included", "pasted"])
def test_material_goes_into_another_scene(way: str, simple: Fitted, tmp_path: Path) -> None:
    """As its comment says."""
    text = (simple.out / "material.xml").read_text()
    assert "<include>" in text
    assert "leave out its version" in text
    material = re.sub(r"<\?xml.*?\?>|<!--.*?-->", "", text, flags=re.S).replace(' version="3.0.0"', "")
    if way == "included":
        (tmp_path / "wood.xml").write_text(text)
        material = '<include filename="wood.xml"/>'
    scene = mi.load_file(str(studio.write(tmp_path, material, studio.SPHERE, studio.camera(), studio.KEY)))
    worn = mi.traverse(scene.shapes()[0].bsdf())
    np.testing.assert_array_equal(np.array(worn["m.value"]), simple.values("ball.m"))


def test_materials_have_one_file_each_and_find_their_textures(rich: Fitted) -> None:
    for name, key in (("ball", "m.value"), ("floor", "reflectance.value"), (SHAPE, "alpha.value")):
        loaded = mi.load_file(str(rich.out / f"material-{name}.xml"))
        assert isinstance(loaded, mi.BSDF)
        params = mi.traverse(loaded)
        parameter = f"{name}.{key.removesuffix('.value')}"
        np.testing.assert_array_equal(np.array(params[key]).ravel(), rich.values(parameter))
    textured = mi.traverse(mi.load_file(str(rich.out / "material-ball.xml")))
    stripes = images.read(rich.home / "pictures" / "stripes.exr").rgb
    np.testing.assert_allclose(np.array(textured["diffuse_reflectance.data"]), stripes, atol=1e-3)


def test_scene_is_the_given_one_with_the_values_replaced(simple: Fitted) -> None:
    expected = (simple.home / "scene.xml").read_text()
    (m,), (eta,), base = (simple.values(f"ball.{name}") for name in ("m", "eta", "diffuse_reflectance"))
    for name, value in (("m", exactly(m)), ("eta", exactly(eta)), ("base", ", ".join(map(exactly, base)))):
        assert expected.count(f'value="${name}"') == 1
        expected = expected.replace(f'value="${name}"', f'value="{value}"')
    got = (simple.out / "scene.xml").read_text()
    new = [line[2:] for line in difflib.ndiff(expected.splitlines(), got.splitlines()) if line[:1] in "+-?"]
    assert [line.strip() for line in new] == ['<path value="../.."/>']


def test_scene_renders_as_the_given_one_with_these_values(simple: Fitted) -> None:
    values = {name: simple.values(f"ball.{name}") for name in ("m", "eta")}
    base = ",".join(map(exactly, simple.values("ball.diffuse_reflectance")))
    named = {name: exactly(value[0]) for name, value in values.items()}
    expected = pixels(mi.load_file(str(simple.home / "scene.xml"), **named, base=base))
    got = pixels(mi.load_file(str(simple.out / "scene.xml")))
    np.testing.assert_allclose(got, expected, rtol=1e-4, atol=1e-6)  # threads add in any order
    start = pixels(mi.load_file(str(simple.home / "scene.xml"), m="0.31"))
    assert np.abs(start - expected).max() > 1e-3


def test_scene_finds_includes_and_textures_and_leaves_the_given_files_alone(rich: Fitted) -> None:
    assert (rich.home / "parts" / "room.xml").read_text() == FLOOR
    scene = mi.load_file(str(rich.out / "scene.xml"))
    # By hand: the given files, with the values put in.
    room, text = FLOOR, (rich.home / "scene.xml").read_text()
    floor = ", ".join(map(exactly, rich.values("floor.reflectance")))
    room = room.replace('<rgb name="reflectance" value="0.5"/>', f'<rgb name="reflectance" value="{floor}"/>')
    room = room.replace('"alpha" value="0.1"', f'"alpha" value="{exactly(rich.values(f"{SHAPE}.alpha")[0])}"')
    assert room != FLOOR
    (rich.home / "parts" / "hand.xml").write_text(room)
    text = text.replace('"m" value="0.1"', f'"m" value="{exactly(rich.values("ball.m")[0])}"')
    (rich.home / "hand.xml").write_text(text.replace("parts/room.xml", "parts/hand.xml"))
    by_hand = mi.load_file(str(rich.home / "hand.xml"))
    for sensor in (0, 1):
        np.testing.assert_allclose(pixels(scene, sensor), pixels(by_hand, sensor), rtol=1e-4, atol=1e-6)


def test_pictures(simple: Fitted, rich: Fitted) -> None:
    for fitted, endings in ((simple, {"camera": ""}), (rich, {"left": "-left", "right": "-right"})):
        scene = mi.load_file(str(fitted.out / "scene.xml"))
        for number, view in enumerate(fitted.solution.views):
            render = images.read(fitted.out / f"render{endings[view.sensor]}.exr").rgb
            error = images.read(fitted.out / f"error{endings[view.sensor]}.exr").rgb
            np.testing.assert_array_equal(error[~view.used], 0)
            np.testing.assert_array_equal(error[view.used], (render - view.target)[view.used])
            rms = np.sqrt(np.mean(error[view.used] ** 2) / np.mean(view.target[view.used] ** 2))
            assert fitted.saved()["views"][number]["rms"] == pytest.approx(float(rms), rel=1e-4)
            expected = pixels(scene, number, spp=2048)
            for where, noise in ((view.used, 0.03), (~view.used, 0.1)):  # also where no prediction was made
                off = np.sqrt(np.mean((render - expected)[where] ** 2) / np.mean(expected[where] ** 2))
                assert off < noise
    target = images.read(simple.home / "target.exr").rgb
    used = simple.solution.views[0].used
    np.testing.assert_array_equal(simple.solution.views[0].target[used], target[used])


def test_history_ends_at_the_solution(simple: Fitted, rich: Fitted) -> None:
    for fitted in (simple, rich):
        with (fitted.out / "history.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert list(rows[0]) == ["iteration", "stage", "loss", "seconds", *fitted.solution.components]
        assert [int(row["iteration"]) for row in rows] == list(range(fitted.solution.iterations + 1))
        seconds = [float(row["seconds"]) for row in rows]
        assert seconds == sorted(seconds)
        assert np.isfinite([float(row["loss"]) for row in rows]).all()
        last = [float(rows[-1][name]) for name in fitted.solution.components]
        assert last == np.concatenate([e.value for e in fitted.solution.parameters.values()]).tolist()
        first = [float(rows[0][name]) for name in fitted.solution.components]
        starts = np.concatenate([e.start for e in fitted.solution.parameters.values()])
        assert first == pytest.approx(starts.tolist(), rel=1e-12)


def test_figures_are_strict_json_and_complete(simple: Fitted, rich: Fitted) -> None:
    for fitted in (simple, rich):
        saved = fitted.saved()
        assert saved["converged"] is True
        for name, estimate in fitted.solution.parameters.items():
            for key in ("value", "sd", "low", "high", "start"):
                assert np.atleast_1d(saved["parameters"][name][key]).tolist() == getattr(estimate, key).tolist()
        for check in saved["checks"].values():
            assert 0 <= check["reciprocity_max"] < 1e-3
            assert 0 < check["albedo_max"] < 1.01
        p = len(fitted.solution.components)
        assert np.shape(saved["covariance"]) == np.shape(saved["correlation"]) == (p, p)
        assert {"scene", "targets", "seed", "solver", "samples", "method", "max_iterations"} <= saved["settings"].keys()
        assert saved["versions"]["mitsuba"] == mi.__version__
    assert simple.saved()["settings"]["seed"] == 5
    assert simple.saved()["settings"]["method"] == "exact"
    assert list(rich.saved()["checks"]) == ["ball", "floor", SHAPE]


class Loads(html.parser.HTMLParser):
    """Collects what a page would fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        for name, value in attrs:
            if name in ("src", "srcset", "href", "xlink:href", "data", "poster", "action") and tag != "a":
                self.found.append(value or "")


def test_report_fetches_nothing(simple: Fitted, rich: Fitted) -> None:
    for fitted in (simple, rich):
        text = (fitted.out / "report.html").read_text()
        page = Loads()
        page.feed(text)
        assert page.found
        assert [one for one in page.found if not one.startswith(("data:", "#"))] == []
        styles = re.findall(r"url\(\s*['\"]?([^)'\"]*)", text) + re.findall(r"@import[^;]*", text)
        assert [one for one in styles if not one.startswith(("data:", "#"))] == []
        assert not page.tags & {"iframe", "object", "embed", "base"}
        assert fitted.solution.status in text


@pytest.mark.parametrize(
    "more",
    [
        "--fit ball.m --fit ball.eta --seed 7",
        "--fit ball.m=0.2 --fit ball.diffuse_reflectance=.2,.1,.1 --mask mask.png --spp 8 -D eta=1.4",
        "--fit ball.m=0.2 --solver lbfgs --iterations 7 --spp 4",
    ],
)
def test_the_command_in_the_figures_repeats_them(
    more: str, simple: Fitted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last digit, where no gradient comes from threads that add in any order."""
    monkeypatch.chdir(simple.home)
    images.write("mask.png", np.concatenate([np.zeros((20, 48, 1)), np.ones((28, 48, 1))]))
    found = []
    command = ["brdf", "fit", "scene.xml", "--target", "camera=target.exr", *more.split(), "--out", "DIR"]
    for run in ("first", "again"):
        assert (command[0], command[-1]) == ("brdf", "DIR")
        assert main([*command[1:-1], str(tmp_path / run)]) in (0, 1)
        found.append(json.loads((tmp_path / run / "fit.json").read_text()))
        command = shlex.split(found[-1]["command"])
    first, again = found
    assert first["command"] == again["command"]
    assert first["settings"] == again["settings"]
    if "lbfgs" in more:
        # Where such an optimiser ends is decided by roundings.
        m = first["parameters"]["ball.m"]
        assert again["parameters"]["ball.m"]["value"] == pytest.approx(m["value"], abs=0.01 * m["sd"])
        return
    assert first["iterations"] > 0
    for key in ("status", "parameters", "iterations", "loss", "rms", "covariance", "remarks", "views"):
        assert again[key] == first[key]


def test_scene_in_the_folder_of_the_given_one(simple: Fitted, tmp_path: Path) -> None:
    """No way leads back, none is needed; and the given file stays."""
    text = (simple.home / "scene.xml").read_text()
    (tmp_path / "room.xml").write_text(text)
    settings = {**simple.solution.settings, "scene": str(tmp_path / "room.xml")}
    output.write(dataclasses.replace(simple.solution, settings=settings), tmp_path)
    assert (tmp_path / "room.xml").read_text() == text
    assert "<path" not in (tmp_path / "scene.xml").read_text()
    mi.load_file(str(tmp_path / "scene.xml"))


@pytest.mark.parametrize("name", ["scene.xml", "material.xml", "scene.room.xml", "render.exr", "error-left.exr"])
def test_nothing_given_is_overwritten(name: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=re.escape(name)):
        output.ready(tmp_path, ["elsewhere/target.exr", tmp_path / name])
    assert list(tmp_path.iterdir()) == []
    output.ready(tmp_path, [tmp_path / "photo.exr", tmp_path / "below" / name])


def test_ids_that_are_no_file_names(tmp_path: Path) -> None:
    ids = ["a/b", "c"]
    bsdfs = [f'<bsdf type="diffuse" id="{i}"> <rgb name="reflectance" value="0.5"/> </bsdf>' for i in ids]
    shapes = [
        f'<shape type="sphere"> <point name="center" x="{x}" y="0" z="0"/> <float name="radius" value="0.5"/> <ref id="{i}"/> </shape>'
        for x, i in zip((-0.6, 0.6), ids, strict=True)
    ]
    scene = studio.write(
        tmp_path, *bsdfs, *shapes, studio.camera(), studio.KEY, integrator='<integrator type="direct"/>'
    )
    target = studio.picture(scene, 64)
    found = fitting.fit(scene, {"camera": target}, [f"{i}.reflectance" for i in ids], spp=8)
    written = output.write(found, tmp_path / "out")
    assert {p.name for p in written if p.name.startswith("material")} == {"material-a_b.xml", "material-c.xml"}
    assert all(p.parent == tmp_path / "out" for p in written)


def test_an_earlier_fit_json_goes_first(simple: Fitted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It vouches for the files beside it; they are about to change."""
    (tmp_path / "fit.json").write_text("{}")

    def fail(*_: object) -> None:
        raise OSError("full")

    monkeypatch.setattr(images, "write", fail)
    with pytest.raises(OSError, match="full"):
        output.write(simple.solution, tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"material.xml", "scene.xml"}
