"""``brdf render --effects``: only the cells asked for, with what the others are worth; ``--noise``, ``--layers``, Ctrl-C."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf.errors import DataError, UsageError
from fitting import rendering
from fitting.cli.app import main
from plugins.effects import pilot
from tests.fitting.test_cli_fit_stopped import started

SCENES = Path(plugins.__file__).parent / "scenes" / "effects"


@pytest.fixture
def small(tmp_path: Path) -> dict[str, Path]:
    """Two of the scenes that ship, of 32 x 32 pixels."""
    out = {}
    for name in ("cornell", "glass"):
        text = (SCENES / f"{name}.xml").read_text()
        assert "256" in text
        out[name] = tmp_path / f"{name}.xml"
        out[name].write_text(text.replace('value="256"', 'value="32"'))
    return out


def run(arguments: list[str], capsys: pytest.CaptureFixture[str], code: int = 0) -> dict:
    assert main(["render", *arguments, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def channels(path: Path) -> dict[str, np.ndarray]:
    bitmap = mi.Bitmap(str(path))
    names = [channel.name for channel in bitmap.struct_()]
    return dict(zip(names, np.moveaxis(np.array(bitmap, dtype=np.float64), -1, 0), strict=True))


def rgb(path: Path) -> np.ndarray:
    found = channels(path)
    return np.stack([found[c] for c in "RGB"], axis=-1)


def test_layers_add_up(small: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.exr"
    told = run([str(small["glass"]), "-o", str(out), "--layers", "--spp", "16"], capsys)
    cells = told["effects"]["rendered"]
    assert cells == ["diffuse.point", "diffuse.indirect", "mirror.indirect"]
    found = channels(out)
    assert set(found) == {*"RGB", *(f"{cell}.{c}" for cell in cells for c in "RGB")}
    for c in "RGB":
        layers = [found[f"{cell}.{c}"] for cell in cells]
        assert all(layer.max() > 0 for layer in layers)
        np.testing.assert_allclose(sum(layers), found[c], rtol=1e-5, atol=1e-7)
    assert main(["render", str(small["glass"]), "-o", str(tmp_path / "x.png"), "--layers"]) == UsageError.exit_code


@pytest.mark.parametrize(("name", "asked"), [("cornell", "-diffuse.indirect"), ("glass", "classic")])
def test_what_leaving_out_costs(
    name: str, asked: str, small: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The predicted error against that of two pictures: noise of 4096 samples a pixel is below a per cent of it."""
    out, whole = tmp_path / "out.exr", tmp_path / "whole.exr"
    told = run([str(small[name]), "-o", str(out), "--effects", asked, "--spp", "4096"], capsys)["effects"]
    assert told["left_out"] == ["diffuse.indirect"]
    assert "diffuse.indirect" not in told["rendered"]
    run([str(small[name]), "-o", str(whole), "--effects", "all", "--spp", "4096"], capsys)
    error = pilot.difference(rgb(whole), rgb(out), told["white"])
    assert error > 0.02
    assert error < told["error"] + pilot.SAFETY * told["error_se"]
    # Where the runs are noisy it errs on the large side: see `pilot.drop_error`.
    assert told["error"] - pilot.SAFETY * told["error_se"] < 1.1 * error


def test_cells_that_are_not_called_for(small: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", str(small["cornell"]), "-o", "x.exr", "--effects", "mirror.area"]) == UsageError.exit_code
    assert "It calls for: diffuse.area, diffuse.indirect, emitter." in capsys.readouterr().err


def test_nothing_is_dropped_unsaid(
    small: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By itself `auto` drops what a pilot finds to be below the tolerance, where the pilot pays; `all` does not."""
    from fitting import planning

    out = tmp_path / "out.exr"
    monkeypatch.setattr(planning, "PILOT_PAYS", 0)
    asked = [str(small["cornell"]), "-o", str(out), "--spp", "8"]
    told = run([*asked, "--effects", "auto", "--tolerance", "2"], capsys)["effects"]
    assert told["dropped"]
    assert 0 < told["error"] < 2
    told = run([*asked, "--effects", "auto", "--tolerance", "0.001"], capsys)["effects"]
    assert told["dropped"] == []
    assert told["error"] is None
    told = run([*asked, "--effects", "all"], capsys)["effects"]
    assert told["dropped"] == []
    monkeypatch.setattr(planning, "PILOT_PAYS", 10**12)
    told = run([*asked, "--effects", "auto", "--tolerance", "2"], capsys)["effects"]
    assert told["dropped"] == []


@pytest.mark.parametrize("effects", [None, "all"])
def test_the_noise_asked_for(
    effects: str | None, small: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The difference of two such pictures has twice the variance of one: seen in 1024 pixels to a tenth."""
    told, found = [], []
    for seed in ("1", "2"):
        out = tmp_path / f"{seed}.exr"
        more = ["--effects", effects] if effects else []
        told.append(run([str(small["cornell"]), "-o", str(out), "--noise", "0.05", "--seed", seed, *more], capsys))
        found.append(rgb(out))
    mean = 0.5 * (found[0] + found[1]).mean(axis=-1)
    square = 0.5 * ((found[0] - found[1]) ** 2).mean(axis=-1)
    noise = np.sqrt(np.mean(square / (mean**2 + 0.05 * mean.mean() ** 2)))
    assert all(0.03 < t["noise"] <= 0.05 for t in told)
    assert abs(noise / told[0]["noise"] - 1) < 0.2


def test_noise_that_is_not_reached(small: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.exr"
    told = run([str(small["cornell"]), "-o", str(out), "--noise", "0.001", "--spp", "32"], capsys, 1)
    assert told["spp"] == 32
    assert told["noise"] > 0.001
    assert out.exists()


def test_an_interruption_keeps_what_is_there(small: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    mi.set_variant("llvm_ad_rgb")
    scene = mi.load_file(str(small["cornell"]))
    monkeypatch.setattr(rendering, "SAMPLES_PER_PASS", 4 * 32 * 32)
    seen: list[tuple[int, int]] = []
    done = rendering.render(
        scene, scene.sensors()[0], 64, progress=lambda *a: seen.append(a), pressed=lambda: len(seen) == 3
    )
    assert seen == [(4, 64), (8, 64), (12, 64)]
    assert (done.spp, done.reached) == (12, False)
    whole = rendering.render(scene, scene.sensors()[0], 12, seed=0)
    np.testing.assert_allclose(done.picture, whole.picture, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(
    ("more", "code", "said"),
    [
        (["--effects", "diffuse.aria"], UsageError.exit_code, "Did you mean diffuse.area?"),
        (["--effects", "all", "--tolerance", "0.1"], UsageError.exit_code, "--tolerance is for --effects auto"),
        (["--noise", "0"], UsageError.exit_code, "--noise 0: expected a number above 0"),
        (["--effects", "auto", "--variant", "scalar_rgb"], UsageError.exit_code, "Take llvm_ad_rgb"),
        (["--noise", "nan"], UsageError.exit_code, "expected a number above 0"),
    ],
)
def test_bad_input_is_one_line(
    more: list[str], code: int, said: str, small: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["render", str(small["glass"]), "-o", str(tmp_path / "x.exr"), *more]) == code
    ended = capsys.readouterr()
    assert said in ended.err
    assert ended.err.count("\n") == 1
    assert not (tmp_path / "x.exr").exists()


@pytest.mark.parametrize("more", [["--effects", "auto"], ["--effects=-diffuse.indirect"], ["--effects", "classic"]])
def test_no_light_is_a_black_picture(more: list[str], small: dict[str, Path], tmp_path: Path) -> None:
    path, out = tmp_path / "dark.xml", tmp_path / "out.exr"
    text = re.sub(r"<emitter type=\"point\".*?</emitter>", "", small["glass"].read_text(), flags=re.DOTALL)
    assert "<emitter" not in text
    path.write_text(text)
    assert main(["render", str(path), "-o", str(out), "--spp", "4", *more]) == 0
    assert not rgb(out).any()
    assert main(["plan", str(path), "--pilot"]) == 0


def test_a_medium_is_not_left_out(small: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fog = '<shape type="cube"><bsdf type="null"/><medium name="interior" type="homogeneous"/></shape></scene>'
    path = tmp_path / "fog.xml"
    path.write_text(small["glass"].read_text().replace("</scene>", fog))
    assert main(["render", str(path), "-o", str(tmp_path / "x.exr"), "--effects", "auto"]) == DataError.exit_code
    assert "medium" in capsys.readouterr().err


INTERRUPTED = """
import os, signal, threading
from fitting import rendering
true = rendering.Scatter.add
def add(self, *given):
    true(self, *given)
    if self.passes == 2:
        threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()
rendering.Scatter.add = add
"""


@pytest.mark.parametrize("effects", ["", "--effects all"])
def test_ctrl_c_in_the_middle_of_a_pass(effects: str, small: dict[str, Path], tmp_path: Path) -> None:
    """Mitsuba has a handler of its own while it renders: ours hears of it, and the picture so far is written."""
    arguments = f"render {small['cornell']} -o out.exr --spp 10000000 --json {effects}"
    process = started(tmp_path, arguments, INTERRUPTED, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        out, said = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 130, said.decode()
    told = json.loads(out)
    assert told["interrupted"]
    assert 0 < told["spp"] < 10_000_000
    assert rgb(tmp_path / "out.exr").max() > 0
