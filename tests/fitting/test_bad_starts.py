"""A start at the far end of the bounds, where a highlight or its effect has vanished, is left."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fitting import command

#: From what its own search finds, a fit arrives here; the truth is in `command.TRUTH`.
STARTS = {
    "m 1e-4": ("--fit ball.m=1e-4", "--fit ball.eta"),
    "m 1.5": ("--fit ball.m=1.5", "--fit ball.eta=10"),
    "eta next to 1": ("--fit ball.m", "--fit ball.eta=1.000001"),
    "both": ("--fit ball.m=1e-4", "--fit ball.eta=1.000001"),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ball")
    command.ball(folder)
    return folder


@pytest.mark.parametrize("start", STARTS)
def test_a_bound_lets_go(start: str, place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = f"fit scene.xml --target camera=target.exr {' '.join(STARTS[start])}"
    code, _, found = command.run(place, tmp_path / "out", arguments, capfd)
    assert code == 0
    for name in ("m", "eta"):
        p = found["parameters"][f"ball.{name}"]
        assert abs(p["value"] - command.TRUTH[name]) < 4 * p["sd"] < 0.05


def test_a_good_start_is_kept(place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """And a bad one is not given up in silence."""
    said = {}
    for m in (0.25, 1e-4):
        arguments = f"fit scene.xml --target camera=target.exr --fit ball.m={m}"
        said[m] = command.run(place, tmp_path / "out", arguments, capfd)[2]["remarks"]
    assert not [remark for remark in said[0.25] if "Another start" in remark]
    assert [remark for remark in said[1e-4] if "Another start than the one given" in remark]
