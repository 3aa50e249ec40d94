"""Where a model declares that an integrator's gradient of it is wrong, a fit takes differences instead."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import pytest

import fitting
import plugins
from brdf import Model, number
from fitting.problem import Problem
from fitting.run import differenced
from tests.fitting import studio
from tests.fitting.problems import here, problem

CONSTANT = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'


class Half(Model):
    """Half of its gradient is missing."""

    name = "halfgradient"
    params = (number("grey", 0.5, (0.0, 1.0), "albedo", scale="logit"),)

    def faults(self) -> dict[str, str]:
        return {"gradient_path": "half of it is detached"}

    def f(self, p: Any, wi: Any, wo: Any) -> Any:
        return (0.5 * dr.inv_pi * (p.grey + dr.detach(p.grey)),)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    studio.use()
    plugins.register(Half)
    ball = '<bsdf type="halfgradient" id="ball"><float name="grey" value="$m"/></bsdf>'
    names = '<default name="m" value="0.3"/>'
    text = studio.text(ball, studio.SPHERE, studio.camera(24), CONSTANT).replace(studio.NAMES, names)
    path = tmp_path / "scene.xml"
    path.write_text(text)
    return path


def test_columns(scene: Path) -> None:
    """Twice what automatic differentiation says; in a furnace the exact picture is ``grey``, its slope in x known."""
    target = np.full((24, 24, 3), 0.3)
    p = problem(scene, ["ball.grey"], {"camera": target}, 64, "rendered")
    x = here(p)
    assert differenced(p.parameters, p.scene.scene.integrator()) == [0]  # type: ignore[attr-defined]
    right = Problem(p.parameters, p.pictures, [target.astype(np.float32)], [0])
    wrong, differences = p.linearize(x), right.linearize(x)
    slope = p.parameters.slope(x)[0]
    assert slope == pytest.approx(0.3 * 0.7, rel=1e-6)
    assert differences.jacobian[0].mean() == pytest.approx(slope, rel=0.01)  # some 500 noisy pixels
    assert wrong.jacobian[0].mean() == pytest.approx(0.5 * slope, rel=0.01)
    loss, gradient = right.descend(x + 0.1)
    step = 1e-3
    quotient = (right.loss(x + 0.1 + step) - right.loss(x + 0.1 - step)) / (2 * step)
    assert loss == pytest.approx(right.loss(x + 0.1), rel=1e-4)
    assert gradient[0] == pytest.approx(quotient, rel=1e-3)


def test_a_fit(scene: Path) -> None:
    picture = studio.picture(scene, 64, m=0.6)
    solution = fitting.fit(scene, {"camera": picture}, ["ball.grey"], solver="lm")
    assert solution.settings["method"] == "rendered"
    assert solution.converged, solution.status
    found = solution.parameters["ball.grey"]
    assert found.value[0] == pytest.approx(0.6, abs=4 * found.sd[0])
    assert found.sd[0] < 3e-3
