"""``brdf fit`` as its user meets it: what it says of each bad input, its exit codes, and what it prints."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest

from fitting import images
from fitting.cli.app import main
from tests.fitting import studio
from tests.fitting.command import FIT, RESULTS, SIZE, ball, contents, of, run, strict

#: What in the standard scene is replaced by what, for a scene of this name.
SCENES = {
    "broken": ("</scene>", ""),
    "glass": ('<bsdf type="cooktorrance" id="ball">', '<bsdf type="dielectric" id="ball"/> <bsdf type="cooktorrance">'),
    "blind": (studio.camera(SIZE), ""),
    "dark": (studio.KEY + "\n  " + studio.RIM, ""),
    "eclipse": (
        studio.KEY + "\n  " + studio.RIM,
        '<emitter type="point"> <point name="position" x="0" y="0" z="-9"/> </emitter>',
    ),
    "textured": (
        '<float name="m" value="$m"/>',
        '<texture name="m" type="bitmap"> <string name="filename" value="rough.exr"/> <boolean name="raw" value="true"/> </texture>',
    ),
    "spare": ("<shape", '<bsdf type="diffuse" id="unused"/> <shape'),
    "empty": (studio.SPHERE, ""),
    "plugin": ("cooktorrance", "cooktorance"),
    "wrong": ('value="$m"', 'value="-1"'),
    "grey": ('<rgb name="diffuse_reflectance" value="$base"/>', ""),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with scenes, a good target, and bad ones."""
    place = tmp_path_factory.mktemp("place")
    scene, target = ball(place)
    for name, (old, new) in SCENES.items():
        text = scene.read_text()
        assert old in text
        (place / f"{name}.xml").write_text(text.replace(old, new))
    images.write(place / "small.exr", target[:40])
    images.write(place / "grey.exr", target[..., :1])
    images.write(place / "two.exr", target[..., :2], ["R", "G"])
    images.write(place / "rough.exr", 0 * target + 0.2)
    images.write(place / "black.exr", 0 * target)
    images.write(place / "white.exr", 0 * target + 1)
    images.write(place / "clear.exr", np.dstack([target, np.zeros((SIZE, SIZE))]))
    off = target.copy()
    off[3:45, 3:45] = 0
    images.write(place / "unlit.exr", off)
    for name, value in (("nan", np.nan), ("inf", np.inf), ("negative", -1.0)):
        bad = target.copy()
        bad[21, 19, 2] = bad[22, 3, 0] = bad[22, 3, 1] = value
        images.write(place / f"{name}.exr", bad)
    (place / "text.exr").write_text("not a picture")

    (place / "out").mkdir()
    (place / "out" / "fit.json").write_text('{"of": "an earlier fit"}')
    (place / "out" / "notes.txt").write_text("mine")
    return place


BAD: dict[str, tuple[str, int, tuple[str, ...]]] = {
    # Targets.
    "no such target": (of("nowhere.exr"), 3, ("nowhere.exr", "no such picture")),
    "a folder as target": (of("out"), 3, ("out", "is a folder")),
    "not a picture": (of("text.exr"), 3, ("text.exr", "cannot be read as a picture")),
    "of another size": (of("small.exr"), 3, ("small.exr", "48 x 40", "48 x 48")),
    "one channel": (of("grey.exr"), 3, ("grey.exr", "1 channel", "expected 3")),
    "two channels": (of("two.exr"), 3, ("two.exr", "2 channels (R, G)", "expected 3")),
    "NaN": (of("nan.exr"), 3, ("nan.exr", "2 pixels are NaN", "first at x = 19, y = 21")),
    "Inf": (of("inf.exr"), 3, ("inf.exr", "2 pixels are Inf", "first at x = 19, y = 21")),
    "negative": (of("negative.exr"), 3, ("negative.exr", "2 pixels are negative", "first at x = 19, y = 21")),
    "black": (of("black.exr"), 3, ("black.exr", "black")),
    "black on the material": (of("unlit.exr"), 3, ("unlit.exr", "fitted material is black")),
    "transparent": (of("clear.exr"), 3, ("clear.exr", "every pixel is masked")),
    "no target": ("fit scene.xml --fit ball.m", 2, ("no target", "--target camera=")),
    "no such sensor": (
        "fit scene.xml --target camra=target.exr --fit ball.m",
        2,
        ("camra", "no such sensor", "camera"),
    ),
    "target without a sensor": (
        "fit scene.xml --target target.exr --fit ball.m",
        2,
        ("--target 'target.exr'", "CAMERA=IMAGE"),
    ),
    "target without a picture": ("fit scene.xml --target camera= --fit ball.m", 2, ("'camera='", "CAMERA=IMAGE")),
    "a sensor twice": (f"{FIT} --target camera=white.exr", 2, ("--target camera", "twice")),
    # Masks.
    "all masked": (f"{FIT} --mask black.exr", 3, ("target.exr", "every pixel is masked")),
    "no such mask": (f"{FIT} --mask camera=nowhere.exr", 3, ("nowhere.exr", "no such picture")),
    "mask of another size": (f"{FIT} --mask small.exr", 3, ("small.exr", "48 x 40", "48 x 48")),
    "mask for another sensor": (f"{FIT} --mask left=white.exr", 2, ("mask left", "no such sensor", "camera")),
    "a mask twice": (f"{FIT} --mask white.exr --mask camera=white.exr", 2, ("--mask camera", "twice")),
    "mask without a target": ("fit scene.xml --mask white.exr --fit ball.m", 2, ("--mask",)),
    # Parameters.
    "no such material": (of(fit="bal.m"), 2, ("'bal'", "Did you mean ball?")),
    "no such parameter": (of(fit="ball.etta"), 2, ("'etta'", "Did you mean eta?", "diffuse_reflectance")),
    "no parameter": (of(fit="ball"), 2, ("'ball'", "ID.PARAM")),
    "nothing to fit": ("fit scene.xml --target camera=target.exr", 2, ("nothing to fit", "--fit")),
    "a parameter twice": (f"{FIT} --fit ball.m=0.2", 2, ("--fit ball.m", "twice")),
    "start too small": (f"{FIT}=0", 2, ("ball", "m = 0", "[1e-4, 1.5]")),
    "start too large": (f"{FIT}=7", 2, ("ball", "m = 7", "[1e-4, 1.5]")),
    "start below 1": (f"{FIT} --fit ball.eta=0.9", 2, ("ball", "eta = 0.9")),
    "start NaN": (f"{FIT}=nan", 2, ("ball", "m = nan")),
    "start that is no number": (f"{FIT}=rough", 2, ("'ball.m=rough'", "'rough' is not a number")),
    "empty start": (f"{FIT}=", 2, ("'ball.m='", "not a number")),
    "two numbers for a colour": (
        f"{FIT} --fit ball.diffuse_reflectance=.1,.2",
        2,
        ("ball.diffuse_reflectance", "2 numbers", "expected 3"),
    ),
    "three numbers for a number": (f"{FIT}=.1,.2,.3", 2, ("ball.m", "3 numbers", "expected 1")),
    # Scenes.
    "no such scene": (of(scene="nowhere"), 3, ("nowhere.xml", "no such file")),
    "broken XML": (of(scene="broken"), 3, ("broken.xml:", "not well-formed")),
    "a picture as scene": ("fit target.exr --target camera=target.exr --fit ball.m", 3, ("target.exr",)),
    "unknown plugin": (of(scene="plugin"), 3, ("plugin.xml:", "cooktorance")),
    "value outside its bounds": (of(scene="wrong", fit="ball.eta"), 3, ("wrong.xml:", "m = -1", "[1e-4, 1.5]")),
    "cannot be fitted": (
        of(scene="glass", fit="ball.int_ior"),
        2,
        ("ball", "'dielectric' cannot be fitted", "roughconductor"),
    ),
    "a texture": (of(scene="textured"), 2, ("ball", "m is a texture")),
    "no sensor": (of(scene="blind"), 2, ("camera", "no such sensor")),
    "no light": (of(scene="dark"), 3, ("dark.xml", "no light")),
    "no light, rendered": (
        "fit dark.xml --target camera=target.exr --fit ball.m --method rendered",
        3,
        ("dark.xml", "no light"),
    ),
    "material on no shape": (
        of(scene="spare", fit="unused.reflectance"),
        3,
        ("target.exr", "no pixel", "none is in view"),
    ),
    "no shape": (of(scene="empty"), 3, ("target.exr", "no pixel", "none is in view")),
    "unknown $name": (f"{FIT} -D rough=0.1", 2, ("scene.xml", "$rough")),
    "a $name without value": (f"{FIT} -D m", 2, ("-D 'm'", "NAME=VALUE")),
    "a $name twice": (f"{FIT} -D m=0.1 -D m=0.2", 2, ("-D m", "twice")),
    # Numbers and names.
    "negative seed": (f"{FIT} --seed -1", 2, ("seed = -1",)),
    "large seed": (f"{FIT} --seed 4294967296", 2, ("seed = 4294967296",)),
    "seed that is no number": (f"{FIT} --seed x", 2, ("--seed",)),
    "a choice": (of(fit="ball.fresnel=schlick"), 2, ("'schlick' is not a number", "choice is made in the scene")),
    "no sample": (f"{FIT} --spp 0", 2, ("spp = 0",)),
    "three samples": (f"{FIT} --spp 3", 2, ("spp = 3", "at least 4")),
    "no iteration": (f"{FIT} --iterations 0", 2, ("iterations = 0",)),
    "unknown solver": (f"{FIT} --solver newton", 2, ("newton", "lm", "lbfgs", "adam", "gd")),
    "unknown method": (f"{FIT} --method guess", 2, ("guess", "exact", "rendered")),
    "no scene": ("fit", 2, ("SCENE.xml", "brdf fit --help")),
    # Where the results go.
    "no folder": (f"{FIT} --out", 2, ("--out",)),
    "a file in place of the folder": (f"{FIT} --out target.exr", 3, ("target.exr",)),
    "a file above the folder": (f"{FIT} --out target.exr/out", 3, ("target.exr",)),
    "over the scene": (f"{FIT} --out .", 2, ("scene.xml", "overwrite")),
    "over the target": (of("out/render.exr", scene="grey"), 2, ("out/render.exr", "overwrite")),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_a_code_and_no_file(
    case: str, place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    typed, code, said = BAD[case]
    arguments = shlex.split(typed if "--out" in typed else f"{typed} --out out")
    before = contents(place)
    got = main(arguments)
    out, err = capfd.readouterr()
    assert err.startswith("brdf: "), err
    assert (got, out, err.count("\n")) == (code, "", 1), err
    assert err.endswith("\n")
    for words in said:
        assert words in err
    assert contents(place) == before


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no folder here that not even root can write")
def test_a_folder_that_cannot_be_written(
    place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    for folder in ("/proc", "/proc/out"):
        assert main([*FIT.split(), "--out", folder]) == 3
        out, err = capfd.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        assert err.startswith(f"brdf: {folder}: ")


def test_a_fit_prints_a_table_and_leaves_the_files(
    place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "made" / "as well"
    code, text, saved = run(place, out, f"{FIT} --fit ball.eta=1.3 --fit ball.diffuse_reflectance", capfd)
    assert code == 0
    assert {p.name for p in out.iterdir()} == RESULTS
    lines = text.splitlines()
    assert lines[0].split() == ["parameter", "value", "sd", "95", "%", "interval"]
    rows = {line.split()[0]: [float(w) for w in line.replace(" to ", " ").split()[1:]] for line in lines[1:6]}
    truth = dict(zip([f"ball.diffuse_reflectance.{c}" for c in "rgb"], (0.25, 0.08, 0.04), strict=True))
    truth |= {"ball.m": 0.3, "ball.eta": 1.5}
    assert rows.keys() == truth.keys()
    for name, (value, sd, low, high) in rows.items():
        assert low < value < high
        assert value == pytest.approx(truth[name], abs=4.5 * sd)
        assert 0 < sd < 0.05 * truth[name]
    assert rows["ball.m"][0] == pytest.approx(saved["parameters"]["ball.m"]["value"], rel=1e-5)
    assert saved["parameters"]["ball.eta"]["start"] == pytest.approx(1.3, rel=1e-6)
    assert saved["status"] in text
    assert "report.html" in lines[-1]


def test_json_has_the_documented_keys_and_is_strict(
    place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    code, text, saved = run(place, tmp_path, f"{FIT} --fit ball.diffuse_reflectance --json", capfd)
    assert code == 0
    shown = strict(text)
    assert {"status", "converged", "interrupted", "parameters", "seconds", "iterations"} <= shown.keys()
    assert (shown["converged"], shown["interrupted"]) == (True, False)
    assert shown["status"].startswith("Converged in ")
    assert shown["seconds"] > 0
    assert shown["iterations"] >= 1
    assert list(shown["parameters"]) == ["ball.m", "ball.diffuse_reflectance"]
    for name, estimate in shown["parameters"].items():
        assert list(estimate)[:5] == ["value", "sd", "low", "high", "start"]
        for key in ("value", "sd", "low", "high", "start"):
            assert np.shape(estimate[key]) == (() if name == "ball.m" else (3,))
            assert np.isfinite(estimate[key]).all()
    assert shown == saved


def test_what_does_not_converge_is_1_and_still_written(
    place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    code, text, saved = run(place, tmp_path, f"{FIT}=0.1 --fit ball.eta=1.2 --solver gd --iterations 1", capfd)
    assert code == 1
    assert "Not converged" in text
    assert saved["converged"] is False
    assert {p.name for p in tmp_path.iterdir()} == RESULTS


def test_a_parameter_without_effect_has_null_for_an_error_and_is_1(
    place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """JSON has no NaN."""
    code, text, saved = run(place, tmp_path, of(scene="eclipse", fit="ball.m=0.2 --json"), capfd)
    assert code == 1
    estimate = strict(text)["parameters"]["ball.m"]
    assert [estimate[key] for key in ("sd", "low", "high")] == [None, None, None]
    assert estimate["value"] == pytest.approx(estimate["start"]) == pytest.approx(0.2)
    assert "Not determined" in saved["status"]


def picture_of(place: Path) -> np.ndarray:
    return images.read(place / "target.exr").rgb


def half(value: float = 1.0) -> np.ndarray:
    """Nothing in the left half of a picture, `value` in the right."""
    out = np.zeros((SIZE, SIZE), dtype=np.float32)
    out[:, SIZE // 2 :] = value
    return out


def test_a_png_is_decoded_and_its_transparent_pixels_are_left_out(
    place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    scale = 0.5  # below the top of its range; the material is as dark
    clear = half()
    junk = np.where(clear[..., None] > 0, scale * picture_of(place), 0.9)
    images.write(tmp_path / "target.png", np.dstack([junk, clear]))
    dimmed = (
        (place / "scene.xml")
        .read_text()
        .replace('"intensity" value="30"', '"intensity" value="15"')
        .replace('"20,22,24"', '"10,11,12"')
    )
    (tmp_path / "dim.xml").write_text(dimmed)
    code, _, saved = run(tmp_path, tmp_path / "out", "fit dim.xml --target camera=target.png --fit ball.m", capfd)
    assert code == 0
    assert any("sRGB" in remark for remark in saved["remarks"])
    assert saved["parameters"]["ball.m"]["value"] == pytest.approx(0.3, rel=0.01)
    _, _, whole = run(place, tmp_path / "whole", FIT, capfd)
    assert saved["views"][0]["pixels"] < 0.6 * whole["views"][0]["pixels"]


@pytest.mark.parametrize("name", ["", "camera="])
def test_a_mask_leaves_out_what_is_wrong(
    name: str, place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    spoilt = picture_of(place)
    spoilt[:, : SIZE // 2] = 0.5
    spoilt[3, 3] = np.nan
    images.write(tmp_path / "spoilt.exr", spoilt)
    images.write(tmp_path / "mask.png", half()[..., None])
    fit = f"fit {place}/scene.xml --target camera=spoilt.exr --fit ball.m --mask {name}mask.png"
    code, _, saved = run(tmp_path, tmp_path / "out", fit, capfd)
    assert code == 0
    assert saved["parameters"]["ball.m"]["value"] == pytest.approx(0.3, rel=0.01)
    assert saved["settings"]["masks"] == {"camera": "mask.png"}
