"""``brdf fit`` interrupted and killed: what is left, and what it is worth."""

from __future__ import annotations

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
from tests.fitting.command import FIT, RESULTS, ball, contents, run, strict

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene and its picture, and the results of an earlier fit."""
    place = tmp_path_factory.mktemp("place")
    ball(place)
    (place / "out").mkdir()
    (place / "out" / "fit.json").write_text("{}")
    return place


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


def started(place: Path, arguments: str, *code: str, **streams: Any) -> subprocess.Popen[Any]:
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
            got, expected = images.read(results / n).rgb, images.read(whole / n).rgb
            np.testing.assert_allclose(got, expected, rtol=1e-3, atol=1e-5)
        elif n == "history.csv":
            rows, expected = left[n].splitlines(), (whole / n).read_bytes().splitlines()
            assert [r.count(b",") for r in rows] == [r.count(b",") for r in expected]
        else:
            assert left[n].rstrip().endswith(b"</html>")
