"""The main job: the built-in pictures, by the command, to the accuracy that is promised, with every solver."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import pytest

from fitting import examples
from fitting.cli.app import main
from tests.fitting import studio

TRUTH = examples.truth()
#: Relative, as promised in the README.
M, ETA, ALPHA = 0.005, 0.01, 0.03


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict:
    """What `brdf example` says, and the files it leaves."""
    studio.use()
    out = tmp_path_factory.mktemp("example")
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = main(["example", "--out", str(out)])
    found = {path.parent.name: json.loads(path.read_text()) for path in out.glob("*/fit.json")}
    return {"code": code, "text": said.getvalue(), **found}


def test_the_command_succeeds(results: dict) -> None:
    assert results["code"] == 0


@pytest.mark.parametrize(("name", "within"), [("ball.m", M), ("ball.eta", ETA)])
def test_sphere_of_the_model_itself(results: dict, name: str, within: float) -> None:
    found, truth = results["sphere"]["parameters"][name], TRUTH["sphere"][name]
    assert abs(found["value"] / truth - 1) < within
    assert found["low"] <= truth <= found["high"]
    # The interval says something: it is narrower than what is promised.
    assert found["high"] - found["low"] < 2 * within * truth
    assert results["sphere"]["converged"]
    assert results["sphere"]["remarks"] == []


def test_base_colour_of_the_sphere(results: dict) -> None:
    found = results["sphere"]["parameters"]["ball.diffuse_reflectance"]
    for value, sd, truth in zip(found["value"], found["sd"], TRUTH["sphere"]["ball.diffuse_reflectance"], strict=True):
        assert abs(value - truth) < 4 * sd < 0.04 * truth


def test_aluminium_by_mitsubas_roughconductor(results: dict) -> None:
    """Our model with the masking of its plugin finds its alpha, and explains more than with V-cavities."""
    alpha = TRUTH["aluminium"]["metal.alpha"]
    smith, vcavity, own = (results[f"aluminium-{kind}"] for kind in ("smith", "vcavity", "conductor"))
    assert abs(smith["parameters"]["metal.m"]["value"] / alpha - 1) < ALPHA
    assert abs(own["parameters"]["metal.alpha"]["value"] / alpha - 1) < M
    beyond = [r["misfit"] for r in (smith, vcavity)]
    print(
        f"alpha {alpha}: {smith['parameters']['metal.m']['value']:.5f}, {vcavity['parameters']['metal.m']['value']:.5f}"
    )
    print(f"misfit, of the noise: {beyond[0]:.3f} (Smith), {beyond[1]:.3f} (V-cavities), {own['misfit']:.3f} (itself)")
    assert beyond[0] < 0.1 * beyond[1]
    assert abs(own["misfit"]) < 0.05
    assert not any("is not noise" in remark for remark in own["remarks"])


def test_its_text_gives_truth_and_estimate(results: dict) -> None:
    said = results["text"]
    for name in ("ball.m", "ball.eta"):
        value = results["sphere"]["parameters"][name]["value"]
        assert f"{name}: truth {TRUTH['sphere'][name]:g}, estimate {value:.5g}" in said
    assert said.count("inside the interval") == 2
    for kind in ("smith", "vcavity"):
        assert f"{results[f'aluminium-{kind}']['parameters']['metal.m']['value']:.5f}" in said
    assert "Of our models cooktorrance, constant F, Smith G fits it best." in said


@pytest.mark.parametrize("solver", ["lbfgs", "gd", pytest.param("adam", marks=pytest.mark.slow)])
def test_other_solvers_arrive_too(solver: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With their defaults, and no start."""
    arguments = ["fit", str(examples.FOLDER / "sphere.xml"), "--target", f"camera={examples.FOLDER / 'sphere.exr'}"]
    for name in TRUTH["sphere"]:
        arguments += ["--fit", name]
    assert main([*arguments, "--out", str(tmp_path), "--solver", solver, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["parameters"]
    for name in ("ball.m", "ball.eta"):
        assert abs(found[name]["value"] / TRUTH["sphere"][name] - 1) < 0.01
        assert found[name]["low"] <= TRUTH["sphere"][name] <= found[name]["high"]
