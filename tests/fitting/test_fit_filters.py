"""The film's reconstruction filter is part of the model: sharp highlights are fitted without bias through each of them.

Targets are Mitsuba's, splatted by its own film, under one lamp: `path` picks one lamp at random, which would be noise.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fitting
from fitting.solution import Solution
from tests.fitting import studio

M, ETA = 0.05, 1.5
SIZE = 72


def scene(folder: Path, rfilter: str) -> Path:
    return studio.write(
        folder, studio.BALL, studio.SPHERE, studio.camera(SIZE, rfilter), studio.KEY, name=f"{rfilter}.xml"
    )


def target(folder: Path, rfilter: str) -> np.ndarray:
    # Filters with negative lobes ring below zero beside the ball's edge, in pixels that no fit uses.
    clean = np.maximum(studio.picture(scene(folder, rfilter), 512, 4, m=M, eta=ETA), 0)
    return studio.noisy(clean, 0.005, 7, floor=0.002)


def fit(folder: Path, made_with: str, rfilter: str) -> Solution:
    return fitting.fit(scene(folder, rfilter), {"camera": target(folder, made_with)}, ["ball.m", "ball.eta"])


@pytest.mark.parametrize("rfilter", ["gaussian", "tent", "box", "mitchell", "catmullrom"])
def test_fit_without_bias(rfilter: str, tmp_path: Path) -> None:
    solution = fit(tmp_path, rfilter, rfilter)
    assert solution.converged, solution.status
    for name, truth in (("ball.m", M), ("ball.eta", ETA)):
        found = solution.parameters[name]
        assert abs(found.value[0] - truth) < 4 * found.sd[0], name
        # A wrong filter is 1 to 9 % off at this size: see below.
        assert abs(found.value[0] / truth - 1) < 0.005, name
        assert found.sd[0] < 0.005 * truth, name


@pytest.mark.parametrize("rfilter", ["gaussian", "tent"])
def test_the_wrong_filter_shows(rfilter: str, tmp_path: Path) -> None:
    """What the test above can see: a model with a box of what another filter made is biased by many standard deviations."""
    found = fit(tmp_path, rfilter, "box").parameters["ball.m"]
    print(f"{rfilter} fitted with box: m {100 * (found.value[0] / M - 1):+.2f} %")
    assert found.value[0] > M + 6 * found.sd[0]
    assert found.value[0] > 1.01 * M
