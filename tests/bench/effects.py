"""What `effects` costs against `path`: time at equal error, in scenes that call for different cells, interleaved.

The error is the variance of a pixel relative to its brightness, ``var / (mean^2 + 0.05 mean_picture^2)``, meant over the
picture; both are unbiased, so time at equal error is the ratio of times at equal samples, times that of the errors.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import brdf  # before mitsuba: it chooses the libLLVM  # noqa: F401  # isort: skip
import mitsuba as mi
import numpy as np

import plugins
from tests.plugins import effects_scenes as scenes

SIDE, SAMPLES, ROUNDS = 64, 64, 20
#: Of the brightness of the whole picture, so that a black pixel has no infinite error.
FLOOR = 0.05
#: Scene, depth, and the most that the time at equal error is to be.
RACES: dict[str, tuple[Any, int, float]] = {
    "1 point light": (*scenes.SCENES["one_point"], 0.60),
    "4 point lights": (*scenes.SCENES["four_points"], 0.06),
    "16 point lights": (lambda size: scenes.many_points(size, 16), 2, 0.10),
    "glass and mirror": (*scenes.SCENES["glass_mirror"], 0.45),
    "lamp and mirror": (*scenes.SCENES["area_mirror"], 1.15),
    "glossy under a sky": (*scenes.SCENES["glossy_sky"], 1.15),
    "Cornell box": (*scenes.SCENES["cornell"], 1.15),
    "all cells": (*scenes.SCENES["all_cells"], 1.15),
}


@dataclass(frozen=True)
class Result:
    """Ratios, ours over those of `path`."""

    time: float
    error: float

    @property
    def equal_error(self) -> float:
        return self.time * self.error


def race(name: str, rounds: int = ROUNDS, **properties: Any) -> Result:
    """Render in turns; `properties` are those of `effects`."""
    mi.set_variant("llvm_ad_rgb")
    plugins.register()
    make, depth, _ = RACES[name]
    scene = mi.load_dict(make(SIDE))
    # no Russian roulette in either, so that both have the same picture
    common = {"max_depth": depth, "rr_depth": 1000}
    tracers = [mi.load_dict({"type": "effects", **common, **properties}), mi.load_dict({"type": "path", **common})]
    times: list[list[float]] = [[], []]
    pictures: list[list[Any]] = [[], []]
    for i in range(rounds + 1):
        for j, tracer in enumerate(tracers):
            start = time.perf_counter()
            picture = np.array(mi.render(scene, integrator=tracer, spp=SAMPLES, seed=2 * i + j), dtype=float)
            times[j].append(time.perf_counter() - start)
            pictures[j].append(picture)
    both = np.mean(pictures, axis=(0, 1))
    ground = both**2 + FLOOR * both.mean() ** 2
    error = [float(np.mean(np.var(p, axis=0, ddof=1) / ground)) for p in pictures]
    ours, theirs = (statistics.median(t[1:]) for t in times)
    return Result(ours / theirs, error[0] / error[1])


def first(name: str, integrator: str) -> float:
    """Seconds until the first picture is there, with nothing compiled before: in a new process with an empty cache."""
    with tempfile.TemporaryDirectory() as home:
        code = f"from tests.bench.effects import picture; print(picture({name!r}, {integrator!r}))"
        environment = {**os.environ, "HOME": home}
        command = [sys.executable, "-c", code]
        out = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return float(out.stdout.split()[-1])


def picture(name: str, integrator: str) -> float:
    """Seconds that one picture takes, the scene being loaded."""
    mi.set_variant("llvm_ad_rgb")
    plugins.register()
    make, depth, _ = RACES[name]
    scene = mi.load_dict(make(SIDE))
    tracer = mi.load_dict({"type": integrator, "max_depth": depth, "rr_depth": 1000})
    start = time.perf_counter()
    np.array(mi.render(scene, integrator=tracer, spp=SAMPLES))
    return time.perf_counter() - start


def table(names: Iterable[str] = RACES) -> str:
    """A line for each scene, in Markdown."""
    lines = ["| scene | time | error | time at equal error | first picture | path's |", "|---|---|---|---|---|---|"]
    for name in names:
        r = race(name)
        cold = " | ".join(f"{first(name, i):.2f} s" for i in ("effects", "path"))
        lines.append(f"| {name} | {r.time:.2f} | {r.error:.3f} | {r.equal_error:.3f} | {cold} |")
    return "\n".join(lines)
