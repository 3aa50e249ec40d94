"""``brdf fit`` as its user meets it: what it says of each bad input, its exit codes, and how it is interrupted."""

from __future__ import annotations

import json
import os
import pty
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting import finish, images, starts
from fitting.cli.app import main
from tests.fitting import studio

REPOSITORY = Path(__file__).parents[2]
SIZE = 48
TRUTH = {"m": 0.3, "eta": 1.5, "base": "0.25,0.08,0.04"}
FIT = "fit scene.xml --target camera=target.exr --fit ball.m"
RESULTS = {"material.xml", "scene.xml", "render.exr", "error.exr", "history.csv", "report.html", "fit.json"}

#: What in the standard scene is replaced by what, for a scene of this name.
SCENES = {
    "broken": ("</scene>", ""),
    "glass": ('<bsdf type="cooktorrance" id="ball">', '<bsdf type="dielectric" id="ball"/> <bsdf type="cooktorrance">'),
    "blind": (studio.camera(SIZE), ""),
    "dark": (studio.KEY, ""),
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
    scene = studio.standard(place, SIZE)
    for name, (old, new) in SCENES.items():
        text = scene.read_text()
        assert old in text
        text = text.replace(old, new).replace(studio.RIM if name == "dark" else "nothing", "")
        (place / f"{name}.xml").write_text(text)
    target = studio.noisy(studio.picture(scene, 512, **TRUTH), 0.01, 1)

    images.write(place / "target.exr", target)
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


def contents(folder: Path) -> dict[str, bytes | None]:
    """Everything in a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


def strict(text: str) -> Any:
    """JSON without the numbers that JSON does not have."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


BAD: dict[str, tuple[str, int, tuple[str, ...]]] = {
    # Targets.
    "no such target": (
        "fit scene.xml --target camera=nowhere.exr --fit ball.m",
        3,
        ("nowhere.exr", "no such picture"),
    ),
    "a folder as target": ("fit scene.xml --target camera=out --fit ball.m", 3, ("out", "is a folder")),
    "not a picture": (
        "fit scene.xml --target camera=text.exr --fit ball.m",
        3,
        ("text.exr", "cannot be read as a picture"),
    ),
    "of another size": (
        "fit scene.xml --target camera=small.exr --fit ball.m",
        3,
        ("small.exr", "48 x 40", "48 x 48"),
    ),
    "one channel": ("fit scene.xml --target camera=grey.exr --fit ball.m", 3, ("grey.exr", "1 channel", "expected 3")),
    "two channels": (
        "fit scene.xml --target camera=two.exr --fit ball.m",
        3,
        ("two.exr", "2 channels (R, G)", "expected 3"),
    ),
    "NaN": (
        "fit scene.xml --target camera=nan.exr --fit ball.m",
        3,
        ("nan.exr", "2 pixels are NaN", "first at x = 19, y = 21"),
    ),
    "Inf": (
        "fit scene.xml --target camera=inf.exr --fit ball.m",
        3,
        ("inf.exr", "2 pixels are Inf", "first at x = 19, y = 21"),
    ),
    "negative": (
        "fit scene.xml --target camera=negative.exr --fit ball.m",
        3,
        ("negative.exr", "2 pixels are negative", "first at x = 19, y = 21"),
    ),
    "black": ("fit scene.xml --target camera=black.exr --fit ball.m", 3, ("black.exr", "black")),
    "black on the material": (
        "fit scene.xml --target camera=unlit.exr --fit ball.m",
        3,
        ("unlit.exr", "fitted material is black"),
    ),
    "transparent": ("fit scene.xml --target camera=clear.exr --fit ball.m", 3, ("clear.exr", "every pixel is masked")),
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
    "no such material": (
        "fit scene.xml --target camera=target.exr --fit bal.m",
        2,
        ("'bal'", "Did you mean ball?"),
    ),
    "no such parameter": (
        "fit scene.xml --target camera=target.exr --fit ball.etta",
        2,
        ("'etta'", "Did you mean eta?", "diffuse_reflectance"),
    ),
    "no parameter": ("fit scene.xml --target camera=target.exr --fit ball", 2, ("'ball'", "ID.PARAM")),
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
    "no such scene": ("fit nowhere.xml --target camera=target.exr --fit ball.m", 3, ("nowhere.xml", "no such file")),
    "broken XML": ("fit broken.xml --target camera=target.exr --fit ball.m", 3, ("broken.xml:", "not well-formed")),
    "a picture as scene": ("fit target.exr --target camera=target.exr --fit ball.m", 3, ("target.exr",)),
    "unknown plugin": ("fit plugin.xml --target camera=target.exr --fit ball.m", 3, ("plugin.xml:", "cooktorance")),
    "value outside its bounds": (
        "fit wrong.xml --target camera=target.exr --fit ball.eta",
        3,
        ("wrong.xml:", "m = -1", "[1e-4, 1.5]"),
    ),
    "cannot be fitted": (
        "fit glass.xml --target camera=target.exr --fit ball.int_ior",
        2,
        ("ball", "'dielectric' cannot be fitted", "roughconductor"),
    ),
    "a texture": ("fit textured.xml --target camera=target.exr --fit ball.m", 2, ("ball", "m is a texture")),
    "no sensor": ("fit blind.xml --target camera=target.exr --fit ball.m", 2, ("camera", "no such sensor")),
    "no light": ("fit dark.xml --target camera=target.exr --fit ball.m", 3, ("dark.xml", "no light")),
    "no light, rendered": (
        "fit dark.xml --target camera=target.exr --fit ball.m --method rendered",
        3,
        ("dark.xml", "no light"),
    ),
    "material on no shape": (
        "fit spare.xml --target camera=target.exr --fit unused.reflectance",
        3,
        ("target.exr", "no pixel", "none is in view"),
    ),
    "no shape": (
        "fit empty.xml --target camera=target.exr --fit ball.m",
        3,
        ("target.exr", "no pixel", "none is in view"),
    ),
    "unknown $name": (f"{FIT} -D rough=0.1", 2, ("scene.xml", "$rough")),
    "a $name without value": (f"{FIT} -D m", 2, ("-D 'm'", "NAME=VALUE")),
    "a $name twice": (f"{FIT} -D m=0.1 -D m=0.2", 2, ("-D m", "twice")),
    # Numbers and names.
    "negative seed": (f"{FIT} --seed -1", 2, ("seed = -1",)),
    "large seed": (f"{FIT} --seed 4294967296", 2, ("seed = 4294967296",)),
    "seed that is no number": (f"{FIT} --seed x", 2, ("--seed",)),
    "no sample": (f"{FIT} --spp 0", 2, ("spp = 0",)),
    "one sample": (f"{FIT} --spp 1", 2, ("spp = 1",)),
    "no iteration": (f"{FIT} --iterations 0", 2, ("iterations = 0",)),
    "unknown solver": (f"{FIT} --solver newton", 2, ("newton", "lm", "lbfgs", "adam", "gd")),
    "unknown method": (f"{FIT} --method guess", 2, ("guess", "exact", "rendered")),
    "no scene": ("fit", 2, ("SCENE.xml", "brdf fit --help")),
    # Where the results go.
    "no folder": (f"{FIT} --out", 2, ("--out",)),
    "a file in place of the folder": (f"{FIT} --out target.exr", 3, ("target.exr",)),
    "a file above the folder": (f"{FIT} --out target.exr/out", 3, ("target.exr",)),
    "over the scene": (f"{FIT} --out .", 2, ("scene.xml", "overwrite")),
    "over the target": ("fit grey.xml --target camera=out/render.exr --fit ball.m", 2, ("out/render.exr", "overwrite")),
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


def run(place: Path, out: Path, arguments: str, capfd: pytest.CaptureFixture[str]) -> tuple[int, str, dict[str, Any]]:
    """Fit; code, standard output, fit.json. A fit that is not watched says nothing on standard error."""
    capfd.readouterr()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        code = main([*shlex.split(arguments), "--out", str(out)])
    text, err = capfd.readouterr()
    assert err == ""
    return code, text, strict((out / "fit.json").read_text())


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
    del saved["command"]
    assert shown == saved


def test_what_does_not_converge_is_1_and_still_written(
    place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    code, text, saved = run(place, tmp_path, f"{FIT}=0.1 --fit ball.eta=1.2 --solver gd --iterations 1", capfd)
    assert code == 1
    assert "Not converged" in text
    assert saved["converged"] is False
    assert {p.name for p in tmp_path.iterdir()} == RESULTS


def test_what_no_pixel_shows_is_null_and_1(place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """JSON has no NaN: a standard deviation that there is not is null."""
    code, text, saved = run(
        place, tmp_path, f"{FIT} -D base=0,0,0 --fit ball.specular_reflectance=0 --fit ball.eta --json", capfd
    )
    assert code in (0, 1)
    assert strict(text)["parameters"] == saved["parameters"]


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


def test_an_interruption_in_the_search_is_130_and_leaves_all_as_it_was(
    place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    points = 0
    true = starts.with_colours

    def interrupted(*arguments: Any) -> Any:
        nonlocal points
        points += 1
        if points == 3:
            signal.raise_signal(signal.SIGINT)
        return true(*arguments)

    monkeypatch.setattr(starts, "with_colours", interrupted)
    before = contents(place)
    assert main([*FIT.split(), "--out", "out"]) == 130
    assert capfd.readouterr() == ("", "brdf: interrupted\n")
    assert points == 3
    assert contents(place) == before
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interruption_when_the_fit_is_done_does_not_lose_it(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    true = finish.views

    def interrupted(*arguments: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return true(*arguments)

    monkeypatch.setattr(finish, "views", interrupted)
    code, _, saved = run(place, tmp_path, FIT, capfd)
    assert code == 0
    assert saved["converged"]
    assert {p.name for p in tmp_path.iterdir()} == RESULTS


def started(place: Path, arguments: str, *code: str, **streams: Any) -> subprocess.Popen[bytes]:
    """The command in a process of its own; `code` runs before it."""
    program = "\n".join([*code, "import sys", "from fitting.cli.app import main", "sys.exit(main())"])
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    return subprocess.Popen(
        [sys.executable, "-c", program, *shlex.split(arguments)],
        cwd=place,
        env=environment,
        stdin=subprocess.DEVNULL,
        **streams,
    )


def test_ctrl_c_leaves_the_best_values_so_far(place: Path, tmp_path: Path) -> None:
    """Progress appears on a terminal only, so the process is given one for its standard error."""
    ours, theirs = pty.openpty()
    # Adam always takes 300 iterations for each of two stages.
    slow = f"{FIT}=0.15 --fit ball.eta=1.3 --method rendered --solver adam --spp 64 --out {tmp_path}"
    process = started(place, slow, stdout=subprocess.PIPE, stderr=theirs)
    os.close(theirs)
    said = b""
    try:
        while said.count(b"loss ") < 3:
            said += os.read(ours, 4096)
        process.send_signal(signal.SIGINT)
        while True:
            try:
                more = os.read(ours, 4096)
            except OSError:  # the other end has been closed
                break
            if not more:
                break
            said += more
        out, _ = process.communicate()
    finally:
        process.kill()
        os.close(ours)
    assert process.returncode == 130, said.decode()
    assert b"Traceback" not in said
    assert b"Interrupted after" in out
    assert {p.name for p in tmp_path.iterdir()} == RESULTS
    saved = strict((tmp_path / "fit.json").read_text())
    assert saved["interrupted"] is True
    assert saved["converged"] is False
    assert saved["status"].startswith("Interrupted after ")
    assert 2 <= saved["iterations"] < 250
    lines = [line.split() for line in said.decode().splitlines() if "loss " in line]
    assert [int(line[0]) for line in lines] == list(range(saved["iterations"] + 1))
    assert float(lines[-1][lines[-1].index("ball.m") + 1]) == pytest.approx(
        saved["parameters"]["ball.m"]["value"], rel=1e-4
    )
    assert 0.15 < saved["parameters"]["ball.m"]["value"] < 0.6
    assert "Interrupted" in (tmp_path / "report.html").read_text()


#: Before the file of this name gets it, the process is gone.
KILLER = """
import os, signal
true = os.replace
def replace(old, new, **more):
    if os.path.basename(os.fspath(new)) == {name!r} and os.path.dirname(os.fspath(new)).endswith("results"):
        os.kill(os.getpid(), signal.SIGKILL)
    true(old, new, **more)
os.replace = replace
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", [".writable", *sorted(RESULTS)])
def test_a_killed_fit_leaves_no_half_file_and_no_false_witness(
    name: str, place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    results, whole = tmp_path / "results", tmp_path / "whole"
    assert run(place, results, f"{FIT} --seed 1 --spp 8", capfd)[0] == 0
    old = contents(results)
    new = f"{FIT} --fit ball.eta --seed 2 --spp 8"
    assert run(place, whole, new, capfd)[0] == 0
    process = started(place, f"{new} --out {results}", KILLER.format(name=name))
    assert process.wait() == -signal.SIGKILL
    left = {p.name: p.read_bytes() for p in results.iterdir() if not p.name.startswith(".")}
    changed = {n for n in left if left[n] != old[n]}
    if name == ".writable":
        assert left.keys() == RESULTS
        assert not changed
        return
    assert left.keys() == RESULTS - {"fit.json"}
    assert name not in changed
    for n in changed:
        if n.endswith(".xml"):
            assert left[n] == (whole / n).read_bytes()
        elif n.endswith(".exr"):
            np.testing.assert_array_equal(images.read(results / n).rgb, images.read(whole / n).rgb)
        elif n == "history.csv":
            rows, expected = left[n].splitlines(), (whole / n).read_bytes().splitlines()
            assert [r.count(b",") for r in rows] == [r.count(b",") for r in expected]
        else:
            assert left[n].rstrip().endswith(b"</html>")
