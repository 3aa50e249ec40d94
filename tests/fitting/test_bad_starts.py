"""A fit arrives from the far ends of the bounds, or says that it has not; and no end holds a parameter fast."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fitting.solvers import lm
from tests.fitting import command
from tests.fitting.bad_starts import ENDS, WITHIN, Tables, Truth, outcomes, summary


def judge(kind: str, count: int, folder: Path, m_from: float | None = None) -> dict[str, float]:
    """What is asked of so many fits; the figures."""
    out = list(outcomes(kind, count, folder, m_from))
    found = summary(kind, out)
    print("\n" + json.dumps(found))
    for o in out:
        if o.error or not o.finite or (o.off >= WITHIN and (o.determined or o.claimed)):
            print(o)
    assert found["fits"] == count
    assert found["crashed"] == 0
    assert found["not finite"] == 0
    assert found["determined"] > 0.6 * count  # or there is little to show
    assert found["of these within 1 %"] >= 0.99 * found["determined"]
    # What is said to be known that well is: 1 % is more than three standard deviations.
    assert found["said to be determined, and off by more than 1 %"] <= 0.01 * count
    return found


@pytest.mark.parametrize(("kind", "count", "m_from"), [("pictures", 8, 0.1), ("tables", 12, None)])
def test_a_few_bad_starts(kind: str, count: int, m_from: float | None, tmp_path: Path) -> None:
    """From each corner of the bounds. Highlights smaller than a pixel, which take many samples, are left to the next."""
    judge(kind, count, tmp_path, m_from)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["pictures", "tables"])
def test_two_hundred_bad_starts(kind: str, tmp_path: Path) -> None:
    found = judge(kind, 200, tmp_path)
    assert found["others"] > 10
    # A standard deviation is estimated as well: next to the limit, some fall on its other side.
    assert found["others said to be determined"] <= 0.1 * found["others"]
    # Three standard deviations of 200 below 95 %; intervals may be too wide where the fit's own samples are not enough.
    assert found["coverage of m"] > 0.90
    assert found["coverage of eta"] > 0.90


#: As many facets as a mirror has; and something to see where the lobe of m = 1e-4 reaches.
SHARP = Truth(3e-4, 1.5, (0.3, 0.3, 0.3), 0.01)
PLAIN = Truth(0.2, 1.6, (0.3, 0.1, 0.05), 0.01)


@pytest.mark.parametrize(
    ("truth", "start", "component"),
    [
        (SHARP, (ENDS[0][0], 1.5, 0.3), 0),
        (PLAIN, (0.2, ENDS[1][0], 0.2), 1),
        (PLAIN, (0.5, ENDS[1][0], 0.5), 1),
        (PLAIN, (ENDS[0][1], 1.6, 0.2), 0),
        (PLAIN, (0.2, ENDS[1][1], 0.2), 1),
    ],
    ids=["m 1e-4", "eta 1 + 1e-6", "eta 1 + 1e-6 and m", "m 1.5", "eta 10"],
)
def test_a_bound_lets_go(truth: Truth, start: tuple[float, float, float], component: int, tmp_path: Path) -> None:
    """The derivative there is not 0, and points inward; the solver arrives, with no search for another start."""
    _, run = Tables(tmp_path).run(truth, start, 0)
    p = run.build(1, 0)
    x = p.parameters.free_of(np.array([start[0], start[1], *[start[2]] * 3]))
    assert x[component] in (p.parameters.low[component], p.parameters.high[component])
    linear = p.linearize(x)
    column = linear.jacobian[0][:, component]
    assert np.abs(column).max() > 0
    inward = 1 if x[component] == p.parameters.low[component] else -1
    assert inward * linear.gradient(p.weights)[component] < 0
    found = p.parameters.values(lm.solve(p, x, 50, lambda *_: None).x)
    excess = (found - [0, 1, 0, 0, 0]) / (truth.values - [0, 1, 0, 0, 0])
    assert abs(excess[component] - 1) < 0.05  # equal weights: the noise of the brightest decides


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
def test_a_far_start_is_left(start: str, place: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
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
