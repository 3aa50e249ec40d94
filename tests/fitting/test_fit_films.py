"""The film's reconstruction filter is part of the model: a sharp lobe is recovered whatever the filter."""

from __future__ import annotations

from pathlib import Path

import pytest

from fitting import fit
from fitting.solution import Estimate
from tests.fitting import studio

#: Where a wrong filter costs 1.7 % (measured below); the lobe is some four pixels wide.
SHARP = 0.05
SIZE = 96
#: One lamp: `path` picks one of several at random, which would be the noise of these targets.
SPP, PASSES = 1024, 4


def ball(folder: Path, rfilter: str) -> Path:
    """A sphere under one lamp, with this filter."""
    return studio.write(
        folder, studio.BALL, studio.SPHERE, studio.camera(SIZE, rfilter), studio.KEY, name=f"{rfilter}.xml"
    )


def fitted_m(scene: Path, target: studio.Picture) -> Estimate:
    """The estimate of m; eta and the base stay at what they are."""
    return fit(scene, {"camera": target}, ["ball.m"]).parameters["ball.m"]


@pytest.mark.parametrize("rfilter", ["gaussian", "tent", "box", "mitchell"])
def test_each_filter_is_modelled(rfilter: str, tmp_path: Path) -> None:
    """No bias: within four standard deviations and a quarter of a percent, for filters of either sign."""
    scene = ball(tmp_path, rfilter)
    target = studio.noisy(studio.picture(scene, SPP, PASSES, m=SHARP).clip(0), 0.01, seed=1)
    found = fitted_m(scene, target)
    assert abs(found.value[0] / SHARP - 1) < 0.0025
    assert abs(found.value[0] - SHARP) < 4 * found.sd[0]


def test_the_wrong_filter_shows(tmp_path: Path) -> None:
    """A box fitted to what a gaussian took is far off: the test above can fail."""
    target = studio.noisy(studio.picture(ball(tmp_path, "gaussian"), SPP, m=SHARP), 0.01, seed=1)
    found = fitted_m(ball(tmp_path, "box"), target)
    assert abs(found.value[0] / SHARP - 1) > 0.0075
