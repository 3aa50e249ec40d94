"""The command line as a whole: exit codes, one line for a failure, a quick start. Each run is a process of its own."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from brdf.errors import BrdfError, DataError, NoBackend, UsageError
from fitting.cli import app

REPOSITORY = Path(__file__).parents[2]


def brdf(*arguments: object, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run the command."""
    command = [sys.executable, "-m", "fitting.cli.app", *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), **variables}
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


def test_help_names_every_verb_and_loads_no_renderer() -> None:
    code = "import sys; from fitting.cli.app import main; main(['--help']); sys.exit('mitsuba' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert run.returncode == 0
    for verb in ("fit", "example", "render", "plan", "models", "check", "doctor"):
        assert f" {verb} " in run.stdout


def test_every_verb_has_json() -> None:
    verbs = [command.name for command in app.app.registered_commands]
    assert {"fit", "example", "render", "plan", "models", "check", "doctor"} <= set(verbs)
    for verb in verbs:
        assert "--json" in brdf(verb, "--help", COLUMNS="200").stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nope",), "No such command 'nope'. See: brdf --help"),
        (("models", "--nope"), "No such option: --nope. See: brdf models --help"),
        (("render",), "Missing argument 'SCENE.xml'. See: brdf render --help"),
        (("render", "scene.xml", "-o", "out.exr", "--spp", "0"), "'--spp'"),
        (("models", "cooktorance"), "Did you mean cooktorrance?"),
    ],
)
def test_wrong_use_is_one_line_and_2(arguments: tuple[str, ...], said: str) -> None:
    run = brdf(*arguments)
    assert (run.returncode, run.stdout) == (UsageError.exit_code, "")
    assert run.stderr.startswith("brdf: ")
    assert run.stderr.count("\n") == 1
    assert said in run.stderr


@pytest.mark.parametrize("error", [UsageError("a\n b"), DataError("a b"), NoBackend("a b"), BrdfError("a b")])
def test_errors_of_ours_are_one_line_with_their_code(
    error: BrdfError, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(**_: object) -> None:
        raise error

    monkeypatch.setattr(app, "app", fail)
    assert app.main(["doctor"]) == error.exit_code
    assert capsys.readouterr().err == "brdf: a b\n"


def test_an_interruption_is_130(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("fitting.cli.doctor.examine", interrupt)
    assert app.main(["doctor"]) == 128 + signal.SIGINT
    assert capsys.readouterr().err == "brdf: interrupted\n"


def test_a_file_that_cannot_be_written_is_one_line_and_3(capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    def refuse() -> None:
        raise PermissionError(13, "Permission denied", "/out.exr")

    monkeypatch.setattr("fitting.cli.doctor.examine", refuse)
    assert app.main(["doctor"]) == DataError.exit_code
    assert capsys.readouterr().err == "brdf: /out.exr: Permission denied\n"


def test_a_reader_that_leaves_early_sees_no_traceback() -> None:
    command = [sys.executable, "-m", "fitting.cli.app", "models"]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    assert run.stdout is not None
    run.stdout.close()
    _, errors = run.communicate()
    assert "Traceback" not in errors


def test_models_lists_what_is_registered() -> None:
    import plugins

    listed = json.loads(brdf("models", "--json").stdout)
    assert [m["name"] for m in listed] == list(plugins.registered())
    assert all(m["summary"] for m in listed)


def test_models_shows_the_declaration() -> None:
    import plugins

    model = plugins.registered()["cooktorrance"]
    shown = json.loads(brdf("models", "cooktorrance", "--json").stdout)
    assert [p["name"] for p in shown["parameters"]] == [p.name for p in model.params]
    m = next(p for p in shown["parameters"] if p["name"] == "m")
    assert (m["bounds"], m["scale"], m["kind"]) == ([1e-4, 1.5], "log", "number")
    assert shown["choices"]["fresnel = constant"] == {"eta": "none"}
    text = brdf("models", "cooktorrance").stdout
    for p in model.params:
        assert f"\n{p.name} " in text
        assert p.meaning in text
        assert p.range_text() in text
