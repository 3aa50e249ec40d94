"""Derivatives through `effects` against differences, each in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

#: What `make test` has time for; the rest is slow.
QUICK = ["glass eta, sky", "cooktorrance m, sky"]
SLOW = [
    "glass eta, even sky",
    "glass eta, wall",
    "glass eta, mirror",
    "glazed eta, sky",
    "glazed reflectance, sky",
    "metal eta, sky",
    "metal k, sky",
    "cooktorrance m, point",
    "cooktorrance m, lamp",
    "cooktorrance eta, point",
    "cooktorrance eta, lamp",
    "cooktorrance eta, sky",
    "texture, lamp",
    "light of a lamp",
    "in a mirror",
    "through glass",
]
#: Edges move with eta, which no derivative along a path sees.
EDGES = ["glass eta, edges", "glass eta, lamp"]


def measured(name: str, integrator: str = "effects") -> dict[str, np.ndarray]:
    command = [sys.executable, "-m", "tests.plugins.effects_gradient", name, integrator]
    out = subprocess.run(command, capture_output=True, text=True, check=True)
    return {k: np.array(v) for k, v in json.loads(out.stdout.splitlines()[-1]).items()}


def distance(found: dict[str, np.ndarray]) -> tuple[float, float]:
    """Reverse mode against differences, in standard errors; and that standard error over the derivative."""
    a, b = found["reverse"], found["differences"]
    error = np.sqrt(a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b))
    return float((a.mean() - b.mean()) / error), float(error / abs(b.mean()))


@pytest.mark.parametrize("name", QUICK + [pytest.param(name, marks=pytest.mark.slow) for name in SLOW])
def test_derivative(name: str) -> None:
    found = measured(name)
    # the same samples in both modes: float32 sums in another order
    np.testing.assert_allclose(found["forward"], found["reverse"][:2], rtol=1e-2)
    z, noise = distance(found)
    # Student's t with 5 to 10 degrees of freedom: 1 in 400 for one case at 4
    assert abs(z) < 4, f"{name}: {z:.1f} standard errors, each {100 * noise:.1f} %"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["glass eta, wall", "glass eta, sky"])
def test_derivative_through_raytree(name: str) -> None:
    """Of what it simulates: no indirect light."""
    found = measured(name, "raytree")
    z, noise = distance(found)
    assert abs(z) < 4, f"{name}: {z:.1f} standard errors, each {100 * noise:.1f} %"


@pytest.mark.slow
def test_fit_of_glass() -> None:
    """From 1.2 to the truth, 1.5, within 1 %; with the derivatives of `path` it goes elsewhere."""
    ours, theirs = (np.mean(measured("fit", integrator)["values"][-20:]) for integrator in ("effects", "path"))
    assert abs(ours / 1.5 - 1) < 0.01
    assert abs(theirs / 1.5 - 1) > 0.05


@pytest.mark.slow
def test_path_has_the_wrong_sign() -> None:
    """What the derivatives of mirrors and glass are compared with, where they are needed most."""
    found = measured("glass eta, sky", "path")
    assert found["reverse"].mean() < 0 < found["differences"].mean()


@pytest.mark.slow
@pytest.mark.parametrize("name", EDGES)
def test_moving_edges_are_missed(name: str) -> None:
    """Known and documented: a shadow or a lamp seen through glass moves as a whole, and with it its edge."""
    z, _ = distance(measured(name))
    assert abs(z) > 10
