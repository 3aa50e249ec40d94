"""Fits from the far ends of the bounds: 200 pictures and 200 tables of a rough dielectric, and what became of them.

``.venv/bin/python -m tests.fitting.bad_starts`` prints the figures.

Pictures: a ball under two lamps, rendered by Mitsuba's `path` with samples of its own, in passes, so that the noise of the
mean can be read off their scatter; and noise is added. Tables: pairs of directions and the BRDF there, evaluated in numpy
as the textbooks have it, with noise; half vectors have slopes up to `REACH` times m. Each fit starts at an end of the
bounds of m, of eta and of the base; all eight corners take turns.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import brdf  # before drjit: it chooses the libLLVM  # noqa: F401  # isort: skip
import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

import fitting
from fitting import finish
from fitting.parameters import Parameters, resolve
from fitting.picture.exact import ExactPicture
from fitting.problem import Linear, Problem
from fitting.run import Run, refine, search
from fitting.solution import Solution
from fitting.solvers import methods
from fitting.uncertainty import blocks_of
from fitting.views import prepare
from plugins import scene as scenes
from tests.fitting import studio

Array = npt.NDArray[np.float64]

NAMES = ("ball.m", "ball.eta", "ball.diffuse_reflectance")
#: Ends of the bounds: of m, eta, and the base.
ENDS = ((1e-4, 1.5), (1 + 2.0**-20, 10.0), (0.0, 1.0))
#: Truths: ranges of eta and of the base; m's begins here and ends at 1.
ETA, BASE, M_FROM = (1.1, 3.0), (0.02, 0.8), {"pictures": 0.02, "tables": 1e-3}
#: Side of a picture, passes of the target and samples a pixel of each.
SIZE, PASSES, SPP = 32, 4, 64
SAMPLER = f'<sampler type="multijitter"><integer name="sample_count" value="{SPP}"/></sampler>'
#: Noise added: the range of its standard deviation, relative to each value; in pictures this fraction of it, of the mean.
NOISE, FLOOR = {"pictures": (0.002, 0.03), "tables": (0.005, 0.3)}, 0.2
#: Pixels this far apart share no noise through the film's filter.
BLOCK = 4
#: Pairs of directions in a table; slopes of their half vectors over m, at most; least cosine of a direction.
SIDE, REACH, GRAZING = 20, 2.5, 0.05
#: Below this predicted standard deviation of log m a fit has to find m, to within `WITHIN`.
DETERMINED, WITHIN = 0.003, 0.01
#: Half a normal distribution's 95 % interval, in standard deviations; the precision that the fits are asked for.
NORMAL_95 = 1.959964
PRECISION = NORMAL_95 * DETERMINED


@dataclass(frozen=True)
class Truth:
    m: float
    eta: float
    base: tuple[float, float, float]
    noise: float

    @property
    def values(self) -> Array:
        return np.array([self.m, self.eta, *self.base])


@dataclass(frozen=True)
class Outcome:
    """One fit.

    ``predicted`` is the standard deviation of log m that the information in the data at the truth gives, with the noise
    that was put in; ``solution`` is None if the fit raised, ``error`` then says what.
    """

    truth: Truth
    start: tuple[float, float, float]
    predicted: float
    solution: Solution | None
    error: str
    seconds: float

    @property
    def determined(self) -> bool:
        return self.predicted < DETERMINED

    @property
    def off(self) -> float:
        """Relative error of m."""
        return abs(self.solution.parameters["ball.m"].value[0] / self.truth.m - 1) if self.solution else np.inf

    @property
    def own(self) -> float:
        """The standard deviation of log m that the fit's 95 % interval stands for; infinite if there is none."""
        if self.solution is None:
            return np.inf
        e = self.solution.parameters["ball.m"]
        half = 0.5 * np.log(e.high[0] / e.low[0])
        return float(half / NORMAL_95) if np.isfinite(half) else np.inf

    @property
    def claimed(self) -> bool:
        """Whether the fit says of m that it is determined to `PRECISION`."""
        return self.solution is not None and self.own <= DETERMINED

    @property
    def finite(self) -> bool:
        """No NaN: in values and losses; in error bars of a fit that says it converged."""
        if self.solution is None:
            return False
        estimates = self.solution.parameters.values()
        numbers = [e.value for e in estimates] + [np.array([step.loss]) for step in self.solution.history]
        if self.solution.converged:
            numbers += [part for e in estimates for part in (e.sd, e.low, e.high)]
        return all(np.isfinite(a).all() for a in numbers)

    @property
    def covered(self) -> Array:
        """Of each component: whether its interval holds the truth (1, 0), NaN if it has none."""
        if self.solution is None:
            return np.full(len(self.truth.values), np.nan)
        ends = [np.concatenate([getattr(e, k) for e in self.solution.parameters.values()]) for k in ("low", "high")]
        inside = (ends[0] <= self.truth.values) & (self.truth.values <= ends[1])
        return np.where(np.isfinite(ends[0]), inside, np.nan)

    def __str__(self) -> str:
        t, s = self.truth, self.solution
        m = f"{s.parameters['ball.m'].value[0]:.5g} (sd {self.own:.2g}), {s.status}" if s else self.error
        base = ",".join(f"{c:.2f}" for c in t.base)
        return (
            f"m {t.m:.5g} eta {t.eta:.3f} base {base} noise {t.noise:.2g} sd {self.predicted:.2g}, "
            f"from {self.start[0]:g} {self.start[1]:.7g} {self.start[2]:g}: {m} {self.seconds:.1f} s"
        )


def summary(kind: str, out: Sequence[Outcome]) -> dict[str, Any]:
    """The figures that the requirements are about."""
    known, rest = [o for o in out if o.determined], [o for o in out if not o.determined]
    covered = np.array([o.covered for o in out])
    found: dict[str, Any] = {
        "kind": kind,
        "fits": len(out),
        "determined": len(known),
        "of these within 1 %": sum(o.off < WITHIN for o in known),
        "others": len(rest),
        "others not converged": sum(o.solution is not None and not o.solution.converged for o in rest),
        "others said to be determined": sum(o.claimed for o in rest),
        "said to be determined, and off by more than 1 %": sum(o.claimed and o.off >= WITHIN for o in out),
        "not finite": sum(not o.finite for o in out),
        "crashed": sum(bool(o.error) for o in out),
        "coverage of m": round(float(np.nanmean(covered[:, 0])), 3),
        "coverage of eta": round(float(np.nanmean(covered[:, 1])), 3),
        "coverage of base": round(float(np.nanmean(covered[:, 2:])), 3),
        "median own sd / predicted": round(float(np.median([o.own / o.predicted for o in out])), 2),
        "seconds": round(sum(o.seconds for o in out), 1),
    }
    return {name: int(value) if isinstance(value, np.integer) else value for name, value in found.items()}


def truths(kind: str, count: int, m_from: float | None = None) -> Iterator[tuple[Truth, tuple[float, float, float]]]:
    """Truths, and the corner of the bounds from which each is sought."""
    rng = np.random.default_rng(4 if kind == "pictures" else 5)
    for i in range(count):
        m = float(np.exp(rng.uniform(np.log(m_from or M_FROM[kind]), 0)))
        r, g, b = rng.uniform(*BASE, 3)
        noise = float(np.exp(rng.uniform(*np.log(NOISE[kind]))))
        yield (
            Truth(m, float(rng.uniform(*ETA)), (float(r), float(g), float(b)), noise),
            (ENDS[0][i % 2], ENDS[1][i // 2 % 2], ENDS[2][i // 4 % 2]),
        )


def sd_of_log_m(linear: Linear, variance: Array, scatter: Array | None = None, block: Any = None) -> float:
    """What the information matrix at the truth says, for independent noise of this variance in each residual.

    `scatter`, shape (k, n), are samples of further noise, which is shared by neighbours: its variance is that of the sums
    over each `block`.
    """
    jacobian = 0.5 * (linear.jacobian[0] + linear.jacobian[1])
    w = 1 / (variance if scatter is None else variance + scatter.var(axis=0))
    inverse = np.linalg.pinv(jacobian.T @ (w[:, None] * jacobian), hermitian=True)
    row = (inverse @ (jacobian * w[:, None]).T)[0]
    further = 0.0 if scatter is None else np.var([np.bincount(block, row * s) for s in scatter], axis=0).sum()
    return float(np.sqrt(row**2 @ variance + further))


class Pictures:
    """The studio of all pictures: the scene is loaded once for the fits, and once for the targets."""

    def __init__(self, folder: Path) -> None:
        path = studio.standard(folder, SIZE)
        self.scene = scenes.load(path)
        # Lamp by lamp: `path` picks one of several at random, which is noise.
        seen = studio.camera(SIZE).replace("<film", SAMPLER + "<film")
        self.real = [
            mi.load_file(str(studio.write(folder, studio.BALL, studio.SPHERE, seen, lamp, name=f"lamp{i}.xml")))
            for i, lamp in enumerate((studio.KEY, studio.RIM))
        ]
        free = resolve(self.scene, dict.fromkeys(NAMES))
        grey = np.full((SIZE, SIZE, 3), 0.25, dtype=np.float32)
        (view,) = prepare(self.scene, {"camera": grey}, {}, free)
        picture = ExactPicture(self.scene.scene, view.sensor, view.groups, 256, 987)
        self.problem = Problem(Parameters(free), [picture], [grey])

    def passes(self, truth: Truth, seed: int) -> Array:
        """Mitsuba's own pictures, shape (`PASSES`, height, width, 3)."""
        out = np.zeros((PASSES, SIZE, SIZE, 3))
        for lamp, scene in enumerate(self.real):
            entries = mi.traverse(scene)
            for name, value in (("m", truth.m), ("eta", truth.eta)):
                entries[f"ball.{name}.value"] = dr.opaque(mi.Float, value)
            entries["ball.diffuse_reflectance.value"] = mi.Color3f(*(dr.opaque(mi.Float, c) for c in truth.base))
            entries.update()
            for k in range(PASSES):
                number = dr.opaque(mi.UInt32, (PASSES * seed + k) * 2 + lamp)
                out[k] += np.array(mi.render(scene, spp=SPP, seed=number), dtype=np.float64)[..., :3]
        return out

    def fit(self, truth: Truth, start: tuple[float, float, float], seed: int) -> tuple[float, Solution]:
        each = self.passes(truth, 10_000 + seed)
        clean = each.mean(axis=0)
        relative, floor = truth.noise, truth.noise * FLOOR
        target = studio.noisy(clean, relative, seed, floor)
        p = self.problem
        linear = p.linearize(p.parameters.free_of(truth.values))
        there, *scatter = (a.reshape(-1, 3)[p.pictures[0].pixels].T.ravel() for a in (clean, *(each - clean)))
        variance = (relative * there) ** 2 + (floor * clean.mean()) ** 2
        scatter = np.array(scatter) / np.sqrt(PASSES - 1)  # of the mean
        predicted = sd_of_log_m(linear, variance, scatter, blocks_of(p, BLOCK))
        starts = dict(zip(NAMES, start, strict=True))
        return predicted, fitting.fit(self.scene, {"camera": target}, starts, seed=seed, precision=PRECISION)


def directions(m: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Pairs ``wi, wo`` rounded to float32, shape (n, 3), whose half vectors have slopes up to `REACH` m."""
    wi, wo = np.empty((0, 3)), np.empty((0, 3))
    while len(wi) < SIDE * SIDE:
        n = 4000
        z, phi = rng.uniform(GRAZING, 1, n), rng.uniform(0, 2 * np.pi, n)
        s = np.sqrt(1 - z * z)
        i = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=1)
        slope, turn = REACH * m * np.sqrt(rng.random(n)), rng.uniform(0, 2 * np.pi, n)
        h = np.stack([slope * np.cos(turn), slope * np.sin(turn), np.ones(n)], axis=1)
        h /= np.linalg.norm(h, axis=1, keepdims=True)
        o = 2 * np.sum(i * h, axis=1, keepdims=True) * h - i
        good = (o[:, 2] > GRAZING) & (np.sum(i * h, axis=1) > 0)
        wi, wo = np.concatenate([wi, i[good]]), np.concatenate([wo, o[good]])
    wi, wo = (w[: SIDE * SIDE].astype(np.float32).astype(np.float64) for w in (wi, wo))
    h = wi + wo
    outward = np.argsort((h[:, 0] ** 2 + h[:, 1] ** 2) / h[:, 2] ** 2)  # as one measures: neighbours are alike
    return wi[outward], wo[outward]


def textbook(truth: Truth, wi: Array, wo: Array) -> Array:
    """Cook and Torrance's f, shape (n, 3): Beckmann, V-cavities, and Fresnel's amplitudes with Snell's law."""
    h = wi + wo
    length = np.linalg.norm(h, axis=1)
    tan2 = (h[:, 0] ** 2 + h[:, 1] ** 2) / h[:, 2] ** 2
    cos = h[:, 2] / length
    d = np.exp(-tan2 / truth.m**2) / (np.pi * truth.m**2 * cos**4)
    c = 0.5 * length
    g = np.minimum(1, 2 * cos * np.minimum(wi[:, 2], wo[:, 2]) / c)
    t = np.sqrt(1 - (1 - np.minimum(c, 1) ** 2) / truth.eta**2)
    rs, rp = (c - truth.eta * t) / (c + truth.eta * t), (truth.eta * c - t) / (truth.eta * c + t)
    specular = 0.5 * (rs**2 + rp**2) * d * g / (4 * wi[:, 2] * wo[:, 2])
    return np.array(truth.base) / np.pi + specular[:, None]


class Table:
    """A table as a `fitting.picture.Picture`: each pair of directions is a pixel, and there are no samples to differ."""

    samples = 1

    def __init__(self, bsdf: mi.BSDF, wi: Array, wo: Array) -> None:
        self.pixels = np.arange(len(wi))
        self.bsdf, self.wo = bsdf, mi.Vector3f(wo.T.astype(np.float32))
        self.si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
        self.si.wi = mi.Vector3f(wi.T.astype(np.float32))
        dr.eval(self.si, self.wo)

    def predict(self, reverse: bool = False) -> Iterator[mi.Color3f]:
        yield mi.Color3f(self.bsdf.eval(mi.BSDFContext(), self.si, self.wo, True)) / self.wo.z

    def fold(self, parts: Sequence[mi.Color3f]) -> tuple[Array, Array]:
        values = np.array(parts[0], dtype=np.float64)
        return values, values

    def unfold(self, halves: tuple[Array, Array]) -> list[mi.Color3f]:
        return [mi.Color3f((halves[0] + halves[1]).astype(np.float32))]


class TableRun(Run):
    """A fit to a table."""

    table: Table
    f: npt.NDArray[np.float32]

    def build(self, samples: int, seed: int, every: int = 1, halves: int = 2) -> Problem:
        return Problem(self.parameters, [self.table], [self.f])


class Tables:
    """All tables: the BSDF is that of one scene."""

    def __init__(self, folder: Path) -> None:
        self.scene = scenes.load(studio.standard(folder, SIZE))

    def run(self, truth: Truth, start: tuple[float, float, float], seed: int) -> tuple[float, TableRun]:
        """The predicted standard deviation of log m, and a fit about to begin."""
        rng = np.random.default_rng([77, seed])
        wi, wo = directions(truth.m, rng)
        f = textbook(truth, wi, wo)
        noisy = np.maximum(f * (1 + truth.noise * rng.standard_normal(f.shape)), 0).astype(np.float32)
        run = TableRun(
            parameters=Parameters(resolve(self.scene, dict(zip(NAMES, start, strict=True)))),
            views=[],
            integrator=self.scene.scene.integrator(),
            method="exact",
            solver=methods()["lm"],
            max_iterations=50,
            precision=PRECISION,
            seed=seed,
            report=lambda step: None,
            scene=self.scene,
        )
        run.table, run.f = Table(self.scene.bsdfs["ball"].bsdf, wi, wo), noisy.reshape(SIDE, SIDE, 3)
        p = run.build(1, 0)
        linear = p.linearize(p.parameters.free_of(truth.values))
        return sd_of_log_m(linear, ((truth.noise * f) ** 2).T.ravel()), run

    def fit(self, truth: Truth, start: tuple[float, float, float], seed: int) -> tuple[float, Solution]:
        predicted, run = self.run(truth, start, seed)
        search(run)
        refine(run, 2)
        return predicted, finish.solution(run, {}, False)


def outcomes(kind: str, count: int, folder: Path, m_from: float | None = None) -> Iterator[Outcome]:
    """Fit them one after another; `m_from` is the least m, if not that of `M_FROM`."""
    studio.use()
    made = Pictures(folder) if kind == "pictures" else Tables(folder)
    for seed, (truth, start) in enumerate(truths(kind, count, m_from)):
        began = time.perf_counter()
        solution, predicted, error = None, np.nan, ""
        try:
            predicted, solution = made.fit(truth, start, seed)
        except Exception as e:  # whatever it is, it is what is counted
            error = repr(e)
        yield Outcome(truth, start, predicted, solution, error, time.perf_counter() - began)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fitting.bad_starts", description="Fits from bad starts.")
    parser.add_argument("kinds", nargs="*", default=["pictures", "tables"], metavar="pictures|tables")
    parser.add_argument("--fits", type=int, default=200, help="of each kind; default 200")
    parser.add_argument("--all", action="store_true", help="show each fit, as it ends")
    parser.add_argument("--json", action="store_true", help="a line of JSON for each kind")
    asked = parser.parse_args()
    for kind in asked.kinds:
        with tempfile.TemporaryDirectory() as folder:
            out = []
            for o in outcomes(kind, asked.fits, Path(folder)):
                out.append(o)
                if asked.all:
                    print(o, flush=True)
        found = summary(kind, out)
        print(
            json.dumps(found) if asked.json else "\n".join(f"{name:50s}{value}" for name, value in found.items()) + "\n"
        )


if __name__ == "__main__":
    main()
