"""`fit`: from a scene and pictures to parameters with error bars."""

from __future__ import annotations

import gc
import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from brdf import DataError, UsageError, llvm
from plugins import scene as scenes

from . import finish, pixels, starts, uncertainty
from .method import kind_of, why_rendered
from .parameters import Parameters, asked, resolve
from .picture import Picture
from .picture.exact import ExactPicture
from .picture.rendered import RenderedPicture
from .problem import Linear, Problem
from .solution import Solution, Step
from .solvers import Result, Solver, methods
from .views import Prepared, Target, prepare

Array = npt.NDArray[np.float64]
Method = Literal["auto", "exact", "rendered"]

VARIANT = "llvm_ad_rgb"
#: Samples a pixel in each half, level by level: the last two of those that were run are compared.
EXACT_LEVELS, RENDERED_LEVELS = (4, 16, 64, 256), (8, 32, 128)
#: Samples kept in memory for all pictures together, at some 200 bytes each.
MOST_SAMPLES = 8_000_000
#: Beyond so many an explicit request is refused.
TOO_MANY_SAMPLES = 8 * MOST_SAMPLES
#: Pixels and samples a half for the search of a start.
SEARCH_PIXELS, SEARCH_SAMPLES = 4000, 1
#: A given start is given up for another that makes the sum of squares smaller by so many variances of one residual.
WORTHWHILE = 10.0
#: A residual of this fraction of the picture is reason to look for another start than the one given.
ASTRAY = 0.1
#: Grid points where each is a rendering.
SEARCH_RENDERINGS = 64
#: Seeds are below this: Mitsuba takes 32 bits, and each view adds its number.
SEEDS = 2**31
#: Iterations allowed, by solver.
ITERATIONS = {"lm": 50, "lbfgs": 200, "adam": 300, "gd": 1000}
#: Of lm, where each is several renderings.
RENDERED_ITERATIONS = 15
#: Levels end when the last made no parameter move by more than this many standard deviations ...
STILL = 0.3
#: ... and the fit's own noise widens the error bars by less than this fraction, or they are below this anyway.
QUIET, FINE = 0.1, 1e-3


@dataclass
class Run:
    """A fit under way."""

    parameters: Parameters
    views: list[Prepared]
    integrator: mi.Integrator
    method: str
    solver: Solver
    max_iterations: int
    seed: int
    report: Callable[[Step], None]
    scene: scenes.Scene
    began: float = field(default_factory=time.perf_counter)
    history: list[Step] = field(default_factory=list)
    x: Array | None = None
    start: Array | None = None
    elsewhere: float | None = None
    problem: Problem | None = None
    levels: list[int] = field(default_factory=list)
    moved: Array | None = None
    noise: Array | None = None
    misfit: bool = False
    result: Result | None = None
    pressed: Callable[[], bool] = lambda: False

    def pause(self) -> None:
        """A place where a fit may be interrupted."""
        if self.pressed():
            raise KeyboardInterrupt

    def build(self, samples: int, seed: int, every: int = 1, halves: int = 2) -> Problem:
        """The problem with this many samples a half, on every `every`-th pixel."""
        pictures: list[Picture] = []
        for number, view in enumerate(self.views):
            groups = [(bsdf, where[::every]) for bsdf, where in view.groups]
            if self.method == "exact":
                pictures.append(ExactPicture(self.scene.scene, view.sensor, groups, samples, seed + number))
            else:
                where = np.concatenate([w for _, w in groups])
                together = self.parameters.together()
                scene = self.scene.scene
                pictures.append(
                    RenderedPicture(
                        scene, view.sensor, self.integrator, together, where, samples, seed + number, halves
                    )
                )
        differences = wrongly_derived(self.parameters, self.integrator) if self.method == "rendered" else ()
        return Problem(self.parameters, pictures, [v.target for v in self.views], differences)

    def solve(self, stage: str) -> None:
        """Run the solver from `x` on the problem as it is weighted now."""
        assert self.problem is not None and self.x is not None
        done = len(self.history)

        def progress(iteration: int, loss: float, x: Array) -> None:
            self.x = x.copy()
            if iteration == 0 and done:
                return
            values = self.parameters.by_name(self.parameters.values(x))
            number = self.history[-1].iteration + 1 if self.history else 0
            step = Step(number, loss, values, time.perf_counter() - self.began, stage)
            self.history.append(step)
            self.report(step)
            self.pause()

        self.result = self.solver(self.problem, self.x, self.max_iterations, progress)
        self.x = self.result.x

    def reweigh(self) -> None:
        """Weigh each residual by the inverse of its noise, unless there is more than noise in them.

        Where the model cannot explain the picture, pixels count alike: the answer is then that
        of least mean square error. By their noise, the bright ones would count least, and a highlight of another shape
        than the model's would be given up.
        """
        assert self.problem is not None and self.x is not None
        # From samples of their own: by those of the residuals, a pixel that these make too dark would count more.
        other = self.build(self.levels[-2:][0], self.seed + 2000)
        residuals = other.residuals(self.x)
        self.noise = other.noise(residuals)
        _, self.misfit = other.misfit(residuals, self.noise + other.sampling(residuals))
        if self.misfit:
            self.problem.weigh_equally()
        else:
            self.problem.weigh(1.0 / self.noise)


def fit(
    scene: str | os.PathLike[str] | scenes.Scene,
    targets: Mapping[str, Target],
    parameters: Mapping[str, Any] | Iterable[str],
    *,
    solver: str = "lm",
    masks: Mapping[str, Target] | None = None,
    spp: int | None = None,
    seed: int = 0,
    max_iterations: int | None = None,
    method: Method = "auto",
    progress: Callable[[Step], None] | None = None,
    defaults: Mapping[str, object] | None = None,
) -> Solution:
    """Fit parameters of materials in a scene to pictures of it.

    Parameters
    ----------
    scene : path of a Mitsuba XML file, or a scene from `plugins.scene.load`
        With at least one fitted material in it; camera and lights as they stood when the pictures were taken.
    targets : dict
        By sensor id: a file, or an array of shape (height, width, 3) or (height, width, 4), linear RGB and alpha.
    parameters : dict or iterable of str
        ``"ID.PARAM"``; as a dict with starts in the parameter's unit, or None to have one searched for.
    solver : {"lm", "lbfgs", "adam", "gd"}
        Levenberg-Marquardt, SciPy's L-BFGS-B, Adam, or steepest descent.
    masks : dict, optional
        By sensor id: what is above one half is used.
    spp : int, optional
        Samples a pixel. Default: as many as it takes for the error bars not to feel them.
    seed : int
    max_iterations : int, optional
        Of each run of the solver.
    method : {"auto", "exact", "rendered"}
        How pictures are predicted: from cached hit points, exact for direct light from points and directions; or
        through the scene's integrator. "auto" takes the first where it applies.
    progress : function of a `Step`, optional
        Called after each iteration.
    defaults : dict, optional
        Values for ``$name`` in the scene file.

    Returns
    -------
    Solution

    Raises
    ------
    UsageError, DataError, NoBackend
        One line each; see `brdf.errors`.
    """
    llvm.require()
    solvers = methods()
    if solver not in solvers:
        raise UsageError(f"solver {solver!r} is not one of {', '.join(solvers)}.")
    if method not in get_args(Method):
        raise UsageError(f"method {method!r} is not one of {', '.join(get_args(Method))}.")
    if spp is not None and spp < 4:
        raise UsageError(f"spp = {spp}: at least 4 samples a pixel are needed, two in each half.")
    if max_iterations is not None and max_iterations < 1:
        raise UsageError(f"max_iterations = {max_iterations}: at least 1 is needed.")
    if not 0 <= seed < SEEDS:
        raise UsageError(f"seed = {seed}: expected a whole number from 0 to {SEEDS - 1}.")
    if mi.variant() is None or not mi.variant().endswith("ad_rgb"):
        mi.set_variant(VARIANT)
    loaded = scene if isinstance(scene, scenes.Scene) else scenes.load(scene, **(defaults or {}))
    if not loaded.scene.emitters():
        raise DataError(f"{loaded.path}: the scene has no light. Add an <emitter>.")
    wanted = dict(parameters) if isinstance(parameters, Mapping) else dict(asked(text) for text in parameters)
    free = resolve(loaded, wanted)
    views = prepare(loaded, targets, masks or {}, free)
    integrator = loaded.scene.integrator()
    why = why_rendered(loaded.scene, [v.sensor for v in views])
    if method == "exact" and why:
        raise UsageError(f"method exact: {why}. Use method auto or rendered.")
    run = Run(
        parameters=Parameters(free),
        views=views,
        integrator=integrator,
        method="rendered" if method == "rendered" or why else "exact",
        solver=solvers[solver],
        max_iterations=max_iterations or (RENDERED_ITERATIONS if why and solver == "lm" else ITERATIONS[solver]),
        seed=seed,
        report=progress or (lambda step: None),
        scene=loaded,
    )
    interrupted = False
    with collector_paused(), interruptible() as pressed:
        run.pressed = pressed
        try:
            search(run)
            refine(run, spp)
        except KeyboardInterrupt:
            if not run.history:
                raise
            interrupted = True
        settings = {
            "folder": os.getcwd(),
            "scene": os.fspath(loaded.path),
            "targets": {v.name: v.path for v in views},
            "masks": {
                name: os.fspath(m) if isinstance(m, str | os.PathLike) else "(array)"
                for name, m in (masks or {}).items()
            },
            "parameters": {f.name: None if f.start is None else f.start.tolist() for f in free},
            "solver": solver,
            "max_iterations": run.max_iterations,
            "spp": spp,
            "samples": [2 * n for n in run.levels],
            "seed": seed,
            "asked_method": method,
            "method": run.method,
            "why": why,
            "defaults": {name: str(value) for name, value in (defaults or {}).items()},
            "variant": mi.variant(),
        }
        return finish.solution(run, settings, interrupted)


@contextmanager
def collector_paused() -> Iterator[None]:
    """Keeps the cyclic garbage collector from freeing a scene while Dr.Jit traces a BSDF written in Python.

    That would end in a segmentation fault (Mitsuba 3.9.1). What is free by then, as the samples of an earlier fit, goes
    back to the system: Dr.Jit keeps it, and one fit does not find use for all that another has left.
    """
    was = gc.isenabled()
    gc.collect()
    dr.flush_malloc_cache()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Notes a Ctrl-C instead of raising in the middle of a kernel's recording, which would spoil Dr.Jit's state.

    Gives a function that tells whether it was pressed. A second one is raised at once. Outside the main thread signals
    are left alone.
    """
    seen = [False]

    def note(number: int, frame: object) -> None:
        if seen[0]:
            raise KeyboardInterrupt
        seen[0] = True

    if threading.current_thread() is not threading.main_thread():
        yield lambda: seen[0]
        return
    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: seen[0]
    finally:
        signal.signal(signal.SIGINT, before)


def search(run: Run) -> None:
    """Find the start, but for what is given of it."""
    given = [v for f in run.parameters.free for v in (np.full(f.size, np.nan) if f.start is None else f.start)]
    run.start = run.x = look(run, np.array(given))


def look(run: Run, given: Array) -> Array:
    """Search for a start on some of the pixels and few samples; `given` are the values to keep, NaN elsewhere."""
    count = sum(len(where) for view in run.views for _, where in view.groups)
    exact = run.method == "exact"
    samples = SEARCH_SAMPLES if exact else RENDERED_LEVELS[0]
    coarse = run.build(samples, run.seed, max(1, count // SEARCH_PIXELS), halves=1)
    most = starts.MOST_POINTS if exact else SEARCH_RENDERINGS
    return starts.search(coarse, given, most, run.pause)


def astray(run: Run) -> bool:
    """Whether a fit from a given start may have missed the answer: without effect, at a bound, far from the target."""
    assert run.problem is not None and run.x is not None and run.result is not None
    linear = run.problem.linearize(run.x)
    idle = np.diag(linear.hessian(run.problem.weights)) == 0
    far = finish.rms_of(0.5 * (linear.r[0] + linear.r[1]), run.problem.target) > ASTRAY
    return bool(not run.result.converged or idle.any() or any(finish.ends(run.parameters, run.x)) or far)


def look_elsewhere(run: Run) -> None:
    """Ask whether the search's own start leads to a smaller residual than the one given did; then go on from there.

    A start far off may lie on a plateau: where no pixel sees a highlight, none says where to look for it.
    """
    assert run.problem is not None and run.x is not None
    problem = run.problem
    start = look(run, np.full(len(run.parameters), np.nan))
    result = run.solver(problem, start, run.max_iterations, lambda *_: run.pause())
    here, there = (
        float(np.mean(problem.weights * (0.5 * (a + b)) ** 2)) for a, b in map(problem.residuals, (run.x, result.x))
    )
    if len(problem.target) * (here - there) > WORTHWHILE * there:
        run.start, run.x, run.result, run.elsewhere = start, result.x, result, here / there


def refine(run: Run, spp: int | None) -> None:
    """Solve at growing sample counts, until more samples no longer move the answer against its error bars.

    At the first count with equal weights, which lead home from afar; then with weights from the noise. The first-order
    methods, which are slow to arrive, do so at one count; how far a larger one would move them is seen from a
    Gauss-Newton step there.
    """
    second_order = run.solver is methods()["lm"]
    if spp is not None:
        afford(run, spp)
    levels = levels_of(run) if spp is None else [max(2, spp // 8), (spp + 1) // 2] if spp >= 16 else [(spp + 1) // 2]
    first = levels[0] if second_order else levels[min(1, len(levels) - 1)]
    begin(run, first)
    assert run.problem is not None and run.x is not None
    run.problem.residuals(run.x)  # for its kernel, which `reweigh` needs: none is compiled after the first iteration
    run.solve("equal weights")
    # The first-order methods are there to compare: they go from where they are told.
    if second_order and any(f.start is not None for f in run.parameters.free) and astray(run):
        look_elsewhere(run)
    run.reweigh()
    run.solve("noise weights")
    if not second_order:
        check_samples(run, first)
        return
    run.reweigh()
    run.solve("noise weights")
    for samples in levels[1:]:
        before = run.x
        begin(run, samples)
        run.reweigh()
        run.solve(f"{2 * samples} samples")
        assert run.problem is not None and run.x is not None and before is not None
        run.moved = run.x - before
        linear = run.problem.linearize(run.x)
        found = uncertainty.estimate(run.problem, linear, run.x)
        sd = found.sd[found.effect]
        moved = np.abs(run.moved[found.effect])
        still = bool(np.all(np.isfinite(sd) & (moved <= np.maximum(STILL * np.nan_to_num(sd), 1e-6))))
        fine = bool(np.all(sd <= FINE))
        if still and (fine or widening(run, linear, found) <= QUIET):
            break


def wrongly_derived(parameters: Parameters, integrator: mi.Integrator) -> list[int]:
    """Components of models that declare that this integrator gives a wrong gradient in them, or none."""
    kind = kind_of(integrator)
    wrong = []
    for i, f in enumerate([free for free in parameters.free for _ in range(free.size)]):
        model = getattr(f.material.bsdf, "model", None)
        if model is not None and f"gradient_{kind}" in model.faults():
            wrong.append(i)
    return wrong


def widening(run: Run, linear: Linear, found: uncertainty.Uncertainty) -> float:
    """By what fraction the fit's own samples widen the error bars, at worst."""
    assert run.problem is not None and run.noise is not None
    if run.misfit:
        return 0.5 * found.sampling_share
    live = np.flatnonzero(np.isfinite(found.sd))
    w = run.problem.weights
    h = linear.hessian(w)[np.ix_(live, live)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(h), 1e-300))
    inverse = np.linalg.pinv(h * np.outer(scale, scale))
    score = 0.5 * (linear.jacobian[0] + linear.jacobian[1])[:, live] * (w * scale[:, None]).T
    own = score.T @ (run.problem.sampling(linear.r)[:, None] * score)
    noise, samples = np.diag(inverse), np.diag(inverse @ own @ inverse)
    return float(np.sqrt(np.max(1.0 + samples / np.maximum(noise, 1e-300), initial=1.0))) - 1.0


def afford(run: Run, spp: int) -> None:
    """Refuse a sample count that does not fit into memory."""
    one = sum(math.prod(pixels.film_size(v.sensor)) for v in run.views)
    if run.method == "exact":
        one = sum(len(where) for view in run.views for _, where in view.groups) * len(run.scene.scene.emitters())
    if one * spp > TOO_MANY_SAMPLES:
        raise UsageError(f"spp = {spp} needs more memory than there may be. Take at most {TOO_MANY_SAMPLES // one}.")


def begin(run: Run, samples: int) -> None:
    """Take up the problem with this many samples a half."""
    run.problem = run.build(samples, run.seed + 1000)
    run.levels.append(samples)


def levels_of(run: Run) -> list[int]:
    """Samples a half to go through, as far as memory allows."""
    if run.method == "rendered":
        return list(RENDERED_LEVELS)
    lights = len(run.scene.scene.emitters())
    count = sum(len(where) for view in run.views for _, where in view.groups)
    return [n for n in EXACT_LEVELS if 2 * n * lights * count <= MOST_SAMPLES] or [EXACT_LEVELS[0]]


def check_samples(run: Run, samples: int) -> None:
    """How far four times the samples would move the answer."""
    assert run.problem is not None and run.x is not None
    weights = run.problem.weights
    finer = run.build(4 * samples, run.seed + 1000).linearize(run.x)
    h, g = finer.hessian(weights), finer.gradient(weights)
    run.moved = np.asarray(np.clip(np.linalg.lstsq(h, -g, rcond=1e-9)[0], -1.0, 1.0), dtype=np.float64)
