"""`fit`: from a scene and pictures to parameters with error bars."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from brdf import DataError, UsageError, llvm
from plugins import scene as scenes

from . import finish, samples, starts, uncertainty
from .interrupt import collector_paused, interruptible
from .method import kind_of, rendering, why_rendered
from .parameters import Parameters, asked, resolve
from .picture import Picture
from .picture.exact import ExactPicture
from .picture.rendered import RenderedPicture
from .problem import Problem
from .remarks import PRECISION
from .solution import Solution, Step
from .solvers import Result, Solver, lm, methods
from .views import Prepared, Target, prepare

Array = npt.NDArray[np.float64]
Method = Literal["auto", "exact", "rendered"]

VARIANT = "llvm_ad_rgb"
#: Pixels for the search of a start, with one sample a half; where there are fewer, more samples each.
SEARCH_PIXELS = 4000
#: How often samples are placed by where the fit so far sees a sharp highlight; less than this in every coordinate, and
#: that has not moved.
GUIDES, MOVED = 2, 0.05
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
    precision: float
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
    #: How bright each part of each film is, where some pixels see a sharp highlight, for samples to be placed there.
    guides: list[Array] = field(default_factory=list)
    #: The problem from other samples, of which weights are made.
    other: Problem | None = None
    noise: Array | None = None
    misfit: bool = False
    result: Result | None = None
    pressed: Callable[[], bool] = lambda: False

    def pause(self) -> None:
        """A place where a fit may be interrupted."""
        if self.pressed():
            raise KeyboardInterrupt

    def build(self, count: int, seed: int, every: int = 1, halves: int = 2) -> Problem:
        """The problem with this many samples a half, on every `every`-th pixel."""
        pictures: list[Picture] = []
        for number, view in enumerate(self.views):
            groups = [(bsdf, where[::every]) for bsdf, where in view.groups]
            if self.method == "exact":
                guide = self.guides[number] if self.guides else None
                pictures.append(ExactPicture(self.scene.scene, view.sensor, groups, count, seed + number, guide))
            else:
                where = np.concatenate([w for _, w in groups])
                together = self.parameters.together()
                scene = self.scene.scene
                pictures.append(
                    RenderedPicture(scene, view.sensor, self.integrator, together, where, count, seed + number, halves)
                )
        differences = differenced(self.parameters, self.integrator) if self.method == "rendered" else ()
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

    def reweigh(self, whatever: bool = False) -> None:
        """Weigh each residual by the inverse of its noise, unless there is more than noise in them (or `whatever` is).

        Where the model cannot explain the picture, pixels count alike: the answer is then that of least mean square
        error. By their noise, the bright ones would count least, and a highlight of another shape than the model's
        would be given up.
        """
        assert self.problem is not None and self.x is not None
        # From samples of their own: by those of the residuals, a pixel that these make too dark would count more.
        other = self.other = self.other or self.build(self.levels[-2:][0], self.seed + 2000)
        residuals = other.residuals(self.x)
        self.noise = other.noise(residuals)
        _, self.misfit = other.misfit(residuals, self.noise + other.sampling(residuals))
        if self.misfit and not whatever:
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
    precision: float = PRECISION,
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
        through `effects`, or the scene's own integrator if that is another than Mitsuba's usual ones. "auto" takes the
        first where it applies.
    precision : float
        A parameter on a logarithmic scale, as m or eta - 1, is called not determined, and the fit not converged, where
        half of its 95 % interval is more than this, in its logarithm.
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
    if not precision > 0:
        raise UsageError(f"precision = {precision}: expected a number above 0, as 0.01 for 1 %.")
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
    why = why_rendered(loaded.scene, [v.sensor for v in views])
    if method == "exact" and why:
        raise UsageError(f"method exact: {why}. Use method auto or rendered.")
    chosen: Method = "rendered" if method == "rendered" or why else "exact"
    integrator = rendering(loaded.scene) if chosen == "rendered" else loaded.scene.integrator()
    run = Run(
        parameters=Parameters(free),
        views=views,
        integrator=integrator,
        method=chosen,
        solver=solvers[solver],
        max_iterations=max_iterations or (RENDERED_ITERATIONS if why and solver == "lm" else ITERATIONS[solver]),
        precision=precision,
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
            "precision": float(precision),
            "seed": seed,
            "asked_method": method,
            "method": run.method,
            "why": why,
            "integrator": kind_of(integrator),
            "defaults": {name: str(value) for name, value in (defaults or {}).items()},
            "variant": mi.variant(),
        }
        return finish.solution(run, settings, interrupted)


def search(run: Run) -> None:
    """Find the start, but for what is given of it."""
    given = [v for f in run.parameters.free for v in (np.full(f.size, np.nan) if f.start is None else f.start)]
    run.start = run.x = look(run, np.array(given))


def look(run: Run, given: Array) -> Array:
    """Search for a start on some of the pixels and with few samples; `given` are the values to keep, NaN elsewhere."""
    count = sum(len(where) for view in run.views for _, where in view.groups)
    exact = run.method == "exact"
    each = max(1, SEARCH_PIXELS // max(count, 1)) if exact else samples.RENDERED_LEVELS[0]
    coarse = run.build(each, run.seed, max(1, count // SEARCH_PIXELS), halves=1)
    most = starts.MOST_POINTS if exact else SEARCH_RENDERINGS
    return starts.search(coarse, given, most, run.pause)


def astray(run: Run) -> bool:
    """Whether a fit from a given start may have missed the answer: at a bound, on a plateau, far from the target."""
    assert run.problem is not None and run.x is not None and run.result is not None
    linear = run.problem.linearize(run.x)
    plateau = lm.propose(run.problem, linear, run.x, 0.0)[2] > lm.WIDEST
    far = finish.rms_of(0.5 * (linear.r[0] + linear.r[1]), run.problem.target) > ASTRAY
    return bool(not run.result.converged or plateau.any() or any(finish.ends(run.parameters, run.x)) or far)


def look_elsewhere(run: Run) -> None:
    """Ask whether the search's own start leads to a smaller residual than the one given did; then go on from there.

    A start far off may lie on a plateau: where no pixel sees a highlight, none says where to look for it.
    """
    assert run.problem is not None and run.x is not None
    before, start = run.x, look(run, np.full(len(run.parameters), np.nan))
    run.x = start
    if run.method == "exact" and samples.guide(run):
        run.problem = run.build(run.levels[-1], run.seed + 1000)
    problem = run.problem
    result = run.solver(problem, start, run.max_iterations, lambda *_: run.pause())
    run.x = before
    here, there = (
        float(np.mean(problem.weights * (0.5 * (a + b)) ** 2)) for a, b in map(problem.residuals, (before, result.x))
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
    levels = samples.levels(run, spp)
    first = levels[0] if second_order else levels[min(1, len(levels) - 1)]
    begin(run, first)
    assert run.problem is not None and run.x is not None
    run.problem.residuals(run.x)  # for its kernel, which `reweigh` needs: none is compiled after the first iteration
    run.solve("equal weights")
    # The first-order methods are there to compare: they go from where they are told.
    if second_order and any(f.start is not None for f in run.parameters.free) and astray(run):
        look_elsewhere(run)
    if second_order and run.method == "exact":
        sharpen(run)
    equal = run.x
    # Where some pixels are much brighter than others, equal weights leave an error that in the dark ones is more than
    # noise: whether the model explains the picture is seen once all count by their noise.
    run.reweigh(whatever=second_order)
    run.solve("noise weights")
    if not second_order:
        check_samples(run, first)
        return
    run.reweigh()
    if run.misfit:
        run.x = equal
    run.solve("equal weights" if run.misfit else "noise weights")
    for count in levels[1:]:
        if not samples.fits(run, count):
            if spp is None:
                return
            run.guides = []
        before = run.x
        run.other = None
        begin(run, count)
        run.reweigh()
        run.solve(f"{2 * count} samples")
        assert run.problem is not None and run.x is not None and before is not None
        run.moved = run.x - before
        linear = run.problem.linearize(run.x)
        found = uncertainty.estimate(run.problem, linear, run.x)
        sd = found.sd[found.effect]
        moved = np.abs(run.moved[found.effect])
        still = bool(np.all(np.isfinite(sd) & (moved <= np.maximum(STILL * np.nan_to_num(sd), 1e-6))))
        fine = bool(np.all(sd <= FINE))
        if still and (fine or samples.widening(run, linear, found) <= QUIET):
            break


def sharpen(run: Run) -> None:
    """Solve again with more samples where there are far too few, before weights are made from what is taken for noise.

    A pixel whose highlight the samples miss would get a noise as large as that, and then no weight to put it right.
    """
    assert run.problem is not None and run.x is not None
    for _ in range(GUIDES):
        before, guided = run.x, bool(run.guides)
        if not samples.guide(run) or not samples.fits(run, run.levels[-1]):
            run.guides = []
            if guided:  # as the problem is from which weights will be made: its pixels are in another order
                run.problem = run.build(run.levels[-1], run.seed + 1000)
            return
        run.problem = run.build(run.levels[-1], run.seed + 1000)
        run.solve("equal weights")
        if np.all(np.abs(run.x - before) < MOVED):
            return


def differenced(parameters: Parameters, integrator: mi.Integrator) -> list[int]:
    """Components whose derivatives are taken from differences, with common random numbers.

    Through `effects` all: differences see the edges that move in glass and mirrors, which no derivative along a path
    does, and take a fraction of its time. Through another integrator those of models that declare that it gives a wrong
    gradient in them, or none.
    """
    kind = kind_of(integrator)
    out = []
    for i, f in enumerate([free for free in parameters.free for _ in range(free.size)]):
        model = getattr(f.material.bsdf, "model", None)
        if kind == "effects" or (model is not None and f"gradient_{kind}" in model.faults()):
            out.append(i)
    return out


def begin(run: Run, count: int) -> None:
    """Take up the problem with this many samples a half."""
    run.problem = run.build(count, run.seed + 1000)
    run.levels.append(count)


def check_samples(run: Run, count: int) -> None:
    """How far four times the samples would move the answer."""
    assert run.problem is not None and run.x is not None
    weights = run.problem.weights
    finer = run.build(4 * count, run.seed + 1000).linearize(run.x)
    h, g = finer.hessian(weights), finer.gradient(weights)
    run.moved = np.asarray(np.clip(np.linalg.lstsq(h, -g, rcond=1e-9)[0], -1.0, 1.0), dtype=np.float64)
