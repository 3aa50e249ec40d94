"""From the end of a fit to its `Solution`: error bars, remarks, pictures, checks."""

from __future__ import annotations

import platform
import time
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from plugins.checks.glance import glance

from . import method, remarks, uncertainty
from .parameters import Parameters
from .problem import Linear
from .solution import Estimate, Lobes, MaterialCheck, Solution, View
from .solvers import methods
from .uncertainty import Uncertainty

if TYPE_CHECKING:
    from .run import Run

Array = npt.NDArray[np.float64]

#: A number within this fraction of its range from an end (in the coordinate of its scale) lies at the bound.
AT_BOUND = 1e-4
#: Another Gauss-Newton step would move a parameter by this many standard deviations, or this much: not converged.
ARRIVED_SD, ARRIVED = 0.5, 1e-3
#: Beyond this standard deviation in the coordinate of its scale, an interval is taken symmetric in the value itself.
LINEAR_ENOUGH = 0.3
#: Samples a pixel of the pictures that are kept.
RENDER_SPP = 256
#: Angles of incidence shown [degrees], and points of a lobe's curve.
INCIDENT, OUTGOING = (10.0, 45.0, 75.0), 721


def solution(run: Run, settings: dict[str, Any], interrupted: bool) -> Solution:
    """Put together what the run found."""
    assert run.x is not None and run.problem is not None and run.start is not None
    x, problem, parameters = run.x, run.problem, run.parameters
    linear = problem.linearize(x)
    at_bound = np.array(ends(parameters, x))
    found = uncertainty.estimate(problem, linear, x, at_bound)
    covariance_x = found.covariance.copy()
    if run.moved is not None:
        # Of two sample counts that differ by a factor 4, the finer has a third of their difference left (error ~ 1/n).
        covariance_x[np.diag_indices_from(covariance_x)] += (run.moved / 3) ** 2
    slope = parameters.slope(x)
    values = parameters.values(x)
    covariance = covariance_x * np.outer(slope, slope)
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(sd, sd)
    low, high = interval(parameters, x, np.sqrt(np.maximum(np.diag(covariance_x), 0.0)), found.quantile, at_bound)
    mean = 0.5 * (linear.r[0] + linear.r[1])
    rms = rms_of(mean, problem.target)
    half = remarks.half_widths(parameters, low, high, at_bound)
    said = remarks.about(parameters, found, sd, at_bound, values, half, run.precision, rms, run.misfit)
    if run.elsewhere is not None:
        said.append(
            f"Another start than the one given, found by a search, leads to a mean square residual {run.elsewhere:.3g} "
            "times smaller: the fit went on from there."
        )
    if run.method == "rendered" and method.refracts(run.scene.scene):
        said.append(
            "Light is seen through glass, where it moves most next to the edge: few pixels decide, and the error bars "
            "may be too narrow."
        )
    said += [text for view in run.views for text in view.remarks]
    variance = problem.noise(linear.r) + problem.sampling(linear.r)
    misfit, _ = problem.misfit(linear.r, variance)
    converged, status = verdict(run, linear, found, sd, half > run.precision, interrupted)
    parameters.place(x)
    seconds = time.perf_counter() - run.began
    materials = {f.material.id: f.material.bsdf for f in parameters.free}
    split = [parameters.by_name(a) for a in (values, sd, low, high, parameters.values(run.start))]
    bounds_hit = parameters.by_name(np.array(at_bound, dtype=float))
    return Solution(
        status=status,
        converged=converged,
        interrupted=interrupted,
        parameters={
            f.name: Estimate(
                *(part[f.name] for part in split),
                kind=f.param.kind,
                unit=f.param.unit,
                meaning=f.param.meaning,
                bounds=f.param.bounds,
                at_bound=bool(bounds_hit[f.name].any()),
            )
            for f in parameters.free
        },
        components=tuple(parameters.components),
        covariance=covariance,
        correlation=correlation,
        remarks=tuple(said),
        history=tuple(run.history),
        loss=linear.loss(problem.weights),
        rms=rms,
        iterations=run.history[-1].iteration if run.history else 0,
        seconds=seconds,
        views=tuple(views(run, mean)),
        lobes={name: lobes(bsdf) for name, bsdf in materials.items()},
        checks={name: MaterialCheck(*glance(bsdf)) for name, bsdf in materials.items()},
        settings=settings,
        versions=versions(),
        misfit=misfit,
    )


def ends(parameters: Parameters, x: Array) -> list[bool]:
    """Which components lie at a bound."""
    out = []
    for value, p in zip(parameters.values(x), parameters.params, strict=True):
        low, high = p.bounds
        if p.scale == "logit":
            out.append(bool(min(value - low, high - value) <= AT_BOUND * (high - low)))
        else:
            free = p.to_free(value)
            out.append(any(abs(float(free - p.to_free(end))) <= AT_BOUND for end in p.interior() if np.isfinite(end)))
    return out


def interval(
    parameters: Parameters, x: Array, sd: Array, quantile: Array, at_bound: npt.NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Ends of the 95 % interval, in values: symmetric in `x` where that is a fair coordinate, else in them.

    What lies at a bound has an interval that ends there.
    """
    value, slope = parameters.values(x), parameters.slope(x)
    near = sd <= LINEAR_ENOUGH
    reach = np.where(np.isfinite(sd), quantile * sd, np.nan)
    low_x, high_x = parameters.values(np.where(near, x - reach, x)), parameters.values(np.where(near, x + reach, x))
    low = np.where(near, low_x, value - reach * slope)
    high = np.where(near, high_x, value + reach * slope)
    bounds = np.array([p.bounds for p in parameters.params])
    below, above = at_bound & (value - bounds[:, 0] <= bounds[:, 1] - value), at_bound.copy()
    above &= ~below
    low, high = np.where(below, bounds[:, 0], low), np.where(above, bounds[:, 1], high)
    out = np.clip(low, bounds[:, 0], bounds[:, 1]), np.clip(high, bounds[:, 0], bounds[:, 1])
    return np.where(np.isfinite(sd), out[0], np.nan), np.where(np.isfinite(sd), out[1], np.nan)


def rms_of(residual: Array, target: Array) -> float:
    """Root mean square of a residual relative to that of the target."""
    return float(np.sqrt(np.mean(residual**2) / np.mean(target**2)))


def verdict(
    run: Run, linear: Linear, found: Uncertainty, sd: Array, loose: npt.NDArray[np.bool_], interrupted: bool
) -> tuple[bool, str]:
    """Whether the fit converged, and a sentence. `loose` marks components whose error bar is too wide to tell them."""
    assert run.result is not None or interrupted
    count = f"{run.history[-1].iteration} iterations" if run.history else "0 iterations"
    if interrupted:
        return (
            False,
            f"Interrupted after {count}: these are the best values so far. To go on from them, give them as starts.",
        )
    assert run.result is not None and run.problem is not None and run.x is not None
    names = np.array(run.parameters.components)
    lost = names[~np.isfinite(sd) | ~found.effect | loose]
    if not run.result.converged:
        return (
            False,
            f"Not converged: {run.result.reason}. Allow more iterations, or give a start nearer to the answer.",
        )
    if lost.size:
        return (
            False,
            f"Not determined by the pictures: {', '.join(lost)}. Fit fewer, add pictures, take more samples, or give "
            "no starts.",
        )
    x, w = run.x, run.problem.weights
    g, h = linear.gradient(w), linear.hessian(w)
    inside = ((x > run.parameters.low) | (g < 0)) & ((x < run.parameters.high) | (g > 0)) & (np.diag(h) > 0)
    step = np.zeros_like(x)
    if inside.any():
        step[inside] = -np.linalg.lstsq(h[np.ix_(inside, inside)], g[inside], rcond=None)[0]
    reach = np.clip(x + step, run.parameters.low, run.parameters.high) - x
    far = np.abs(reach) > np.maximum(ARRIVED_SD * found.sd, ARRIVED)
    if far.any():
        worst = int(np.argmax(np.abs(reach) / np.maximum(ARRIVED_SD * found.sd, ARRIVED)))
        advice = "Allow more iterations, or use --solver lm"
        if run.solver is methods()["lm"]:
            advice = "Fix one of the parameters that hardly differ in what they do"
        return False, (
            f"Not converged after {count}: {run.result.reason}, yet {names[worst]} would still move by "
            f"{abs(reach[worst]) / found.sd[worst]:.1f} standard deviations. {advice}."
        )
    return True, f"Converged in {count}: {run.result.reason}."


def views(run: Run, mean: Array) -> list[View]:
    """Target, rendering and misfit of each camera."""
    assert run.problem is not None
    out = []
    for number, view in enumerate(run.views):
        here = run.problem.view == number
        image = mi.render(
            run.scene.scene, sensor=view.sensor, integrator=run.integrator, spp=RENDER_SPP, seed=run.seed + number
        )
        render = np.array(image, dtype=np.float32)[..., :3].copy()
        # Where the fit predicted a pixel, from many more samples of the light, that is the better picture.
        channel, pixel = run.problem.channel[here], run.problem.pixel[here]
        render.reshape(-1, 3)[pixel, channel] = (run.problem.target + mean)[here]
        rms = rms_of(mean[here], run.problem.target[here])
        out.append(View(view.name, view.path, view.target, render, view.used, rms))
    return out


def lobes(bsdf: mi.BSDF) -> Lobes:
    """The BRDF in the plane of incidence, without its cosine."""
    incident = np.radians(INCIDENT)
    outgoing = np.linspace(-np.pi / 2, np.pi / 2, OUTGOING + 2)[1:-1]
    values = []
    for angle in incident:
        si = dr.zeros(mi.SurfaceInteraction3f, OUTGOING)
        si.wi = mi.Vector3f(float(np.sin(angle)), 0, float(np.cos(angle)))
        si.uv = mi.Point2f(0.5, 0.5)
        wo = mi.Vector3f(mi.Float(-np.sin(outgoing)), 0, mi.Float(np.cos(outgoing)))
        cosine = np.cos(outgoing)
        values.append((np.array(mi.Color3f(bsdf.eval(mi.BSDFContext(), si, wo, True))) / cosine).T)
    return Lobes(incident, outgoing, np.array(values, dtype=np.float64))


def versions() -> dict[str, str]:
    """What the result was made with."""
    out = {"python": platform.python_version()}
    for name in ("brdf-fitting", "mitsuba", "drjit", "numpy", "scipy"):
        try:
            out[name] = version(name)
        except PackageNotFoundError:
            out[name] = "not installed"
    return out
