"""Least-squares problems without the rest of a fit around them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fitting.parameters import Parameters, resolve
from fitting.picture import Picture
from fitting.picture.exact import ExactPicture
from fitting.picture.rendered import RenderedPicture
from fitting.problem import Problem
from fitting.views import prepare
from plugins import scene as scenes


def problem(
    path: Path,
    names: list[str],
    targets: dict[str, np.ndarray],
    samples: int = 4,
    method: str = "exact",
    seed: int = 0,
    halves: int = 2,
    masks: dict[str, np.ndarray] | None = None,
) -> Problem:
    """The problem of fitting `names` to `targets`, by sensor, with this many samples a half."""
    scene = scenes.load(path)
    free = resolve(scene, dict.fromkeys(names))
    parameters = Parameters(free)
    views = prepare(scene, targets, masks or {}, free)
    pictures: list[Picture] = []
    for number, view in enumerate(views):
        if method == "exact":
            pictures.append(ExactPicture(scene.scene, view.sensor, view.groups, samples, seed + number))
        else:
            pixels = np.concatenate([where for _, where in view.groups])
            entries, integrator = parameters.together(), scene.scene.integrator()
            pictures.append(
                RenderedPicture(scene.scene, view.sensor, integrator, entries, pixels, samples, seed + number, halves)
            )
    out = Problem(parameters, pictures, [view.target for view in views])
    out.scene = scene  # type: ignore[attr-defined]  (kept alive)
    return out


def grey(width: int, height: int | None = None) -> np.ndarray:
    """A target that is the same everywhere: for what does not depend on it."""
    return np.full((height or width, width, 3), 0.25, dtype=np.float32)


def here(p: Problem) -> np.ndarray:
    """The values that the scene was loaded with."""
    values = [np.asarray(f.entry[f.key], dtype=float).ravel() for f in p.parameters.free]
    return p.parameters.free_of(np.concatenate(values))
