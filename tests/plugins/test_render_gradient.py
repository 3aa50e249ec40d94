"""Derivatives of a path-traced picture with respect to m and eta, against finite differences of the same pictures."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("integrator", "light"),
    [("path", "area"), ("prb", "constant"), ("direct", "constant"), ("direct", "point")],
)
def test_mean_of_a_picture(integrator: str, light: str) -> None:
    """A sphere on a floor. `direct` weighs light and BSDF samples by their densities: one with a gradient makes it wrong
    (roughconductor, alpha: 8 %; this model before its density was detached, m: 75 %)."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.plugins.render_gradient", integrator, light],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows = {name: [float(x) for x in rest] for name, *rest in map(str.split, done.stdout.splitlines())}
    assert set(rows) == {"m", "eta"}
    for name, (slope, slope_error, quotient, quotient_error) in rows.items():
        print(
            f"{integrator} {light} d/d{name}: {slope:.6f} +- {slope_error:.6f}, differences {quotient:.6f} +- {quotient_error:.6f}"
        )
        error = (slope_error**2 + quotient_error**2) ** 0.5
        assert abs(slope - quotient) < 4 * error + 0.01 * abs(quotient)
        assert error < (0.2 if name == "m" else 0.02) * abs(quotient), "too noisy to tell"
