"""Is the derivative of a picture that of the picture, with each integrator that a user would take?"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from brdf.checks.result import Finding, at_most, not_asked, plain, worst_parameter

from .render_worker import Request

INTEGRATORS = ("path", "prb", "direct", "effects", "raytree")
#: Pictures of each kind, and again as many times this if something seems wrong.
SEEDS, AGAIN = 8, 2
#: The relative error allowed: the differences are over 2 % of a parameter, and off by the square of that.
LIMIT = 0.01
#: Standard errors that a difference must exceed: of eight pictures, they are uncertain themselves.
SIGMA = 5.0
#: An error beyond this is no accident, and not asked again.
CLEAR = 0.1
#: Errors are measured against the derivative, but at least against this share of picture over parameter.
FLOOR = 2e-3
#: With less than this share of the derivative known, nothing can be told.
NOISY = 0.5
#: Processes at a time.
WORKERS = 2


@dataclass(frozen=True)
class Source:
    """From what another process makes the same BSDF.

    Attributes
    ----------
    bsdf : dict or str
        For ``mi.load_dict``, or XML text.
    models : tuple of (module, qualified name, file)
        Models to register.
    setup : tuple of str
        Modules to import once the variant is set: they register plugins of their own.
    bounds : dict
        The ranges of some parameters, by their keys.
    """

    bsdf: Mapping[str, Any] | str
    models: tuple[tuple[str, str, str], ...] = ()
    setup: tuple[str, ...] = ()
    bounds: Mapping[str, Sequence[float]] = field(default_factory=dict)


def ask(
    source: Source,
    case: Mapping[str, Any],
    integrators: Sequence[str] = INTEGRATORS,
    seed: int = 0,
    done: Callable[[str], None] | None = None,
) -> dict[str, Finding]:
    """The worst parameter with each integrator; `done` is called with an integrator when it is finished."""

    def one(integrator: str) -> Finding:
        found = with_one(source, case, integrator, seed)
        if done:
            done(integrator)
        return found

    with ThreadPoolExecutor(WORKERS) as pool:
        return dict(zip(integrators, pool.map(one, integrators), strict=True))


def with_one(source: Source, case: Mapping[str, Any], integrator: str, seed: int) -> Finding:
    """The worst parameter with one integrator; what seems wrong is asked again with other random numbers."""
    found = judged(answer(source, integrator, range(seed, seed + SEEDS)), case, integrator, seed)
    if found.passed or found.figure is None or not found.figure < CLEAR:
        return found
    first = seed + SEEDS
    return judged(answer(source, integrator, range(first, first + AGAIN * SEEDS)), case, integrator, first)


def answer(source: Source, integrator: str, seeds: Sequence[int]) -> dict[str, Any]:
    """What the worker says."""
    request: Request = {
        "variant": str(mi.variant()),
        "bsdf": source.bsdf if isinstance(source.bsdf, str) else plain(source.bsdf),
        "models": [list(where) for where in source.models],
        "setup": list(source.setup),
        "integrator": integrator,
        "bounds": {k: [float(np.clip(b, -1e30, 1e30)) for b in v] for k, v in source.bounds.items()},
        "seeds": list(seeds),
    }
    root = str(Path(__file__).parents[2])
    paths = [root, *(p for p in sys.path if p)]
    run = subprocess.run(
        [sys.executable, "-m", "plugins.checks.render_worker"],
        input=json.dumps(request),
        env={**os.environ, "PYTHONPATH": os.pathsep.join(dict.fromkeys(paths))},
        capture_output=True,
        text=True,
        check=False,
    )
    try:
        return json.loads(run.stdout.splitlines()[-1])
    except (IndexError, ValueError):
        said = run.stderr.strip().splitlines()[-1:] or [f"exit code {run.returncode}"]
        return {"error": f"the process ended: {said[0]}"}


def judged(answer: Mapping[str, Any], case: Mapping[str, Any], integrator: str, seed: int) -> Finding:
    """The worst parameter of what a worker says."""
    case = {**case, "integrator": integrator, "seed": seed}
    if "error" in answer:
        return Finding(False, None, None, math.inf, f"`{integrator}` raises: {answer['error'][:400]}", case)
    if not answer["rows"]:
        return not_asked("There is no parameter to differentiate in, or nothing of it in such a picture.")
    return worst_parameter([row(name, values, case) for name, values in answer["rows"].items()])


def row(name: str, values: Mapping[str, Sequence[float]], case: Mapping[str, Any]) -> Finding:
    """One parameter: derivatives over the seeds, against differences over the seeds."""
    automatic, differences = np.array(values["automatic"]), np.array(values["differences"])
    got, want = float(automatic.mean()), float(differences.mean())
    error = math.hypot(*(float(np.std(a, ddof=1) / math.sqrt(len(a))) for a in (automatic, differences)))
    natural = abs(float(np.mean(values["mean"]))) / max(values["value"][0], 0.1)
    scale = max(abs(got), abs(want), FLOOR * natural)
    case = {
        "figure": "relative error of the derivative of the mean of the picture",
        "parameter": name,
        **case,
        "automatic": got,
        "differences": want,
        "standard_error": error,
    }
    integrator = case["integrator"]
    said = (
        f"`{integrator}` gives {got:.4g} as d picture / d {name}, differences {want:.4g} (standard error {error:.1g})."
    )
    if not math.isfinite(got):
        return Finding(False, math.inf, LIMIT, math.inf, said, case)
    excess = max(abs(got - want) - SIGMA * error, 0.0) / scale
    if excess == 0 and SIGMA * error > NOISY * scale:
        return not_asked(
            f"d picture / d {name} by `{integrator}` is too noisy to tell ({got:.2g} +- {error:.1g}).", case
        )
    return at_most(excess, LIMIT, said, case)
