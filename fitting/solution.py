"""What a fit found: the one object that the command prints, the notebook shows and the files are made from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """One fitted parameter. Numbers have shape (1,), colours (3,): linear R, G, B.

    Attributes
    ----------
    value, sd, low, high, start : array, shape (n,)
        Estimate, standard deviation, ends of the 95 % interval, where the solver began; in the parameter's unit. `sd`,
        `low` and `high` are NaN where the picture does not determine the parameter.
    kind : {"number", "colour"}
    unit, meaning : str
    bounds : (float, float)
    at_bound : bool
        The estimate lies at an end of its bounds: the interval is then one-sided at best.
    """

    value: Array
    sd: Array
    low: Array
    high: Array
    start: Array
    kind: str
    unit: str
    meaning: str
    bounds: tuple[float, float]
    at_bound: bool


@dataclass(frozen=True)
class Step:
    """One iteration: number, weighted loss, parameter values by name, seconds since the start, stage of the fit."""

    iteration: int
    loss: float
    values: dict[str, Array]
    seconds: float
    stage: str


@dataclass(frozen=True)
class View:
    """One picture and its prediction at the solution.

    Attributes
    ----------
    sensor : str
        Id of the camera.
    path : str
        The target's file, or "(array)".
    target, render : array, shape (height, width, 3), linear RGB
        `render` is complete (it includes pixels that were left out of the fit).
    used : bool array, shape (height, width)
        Pixels that took part in the fit.
    rms : float
        Root mean square of render - target over the pixels used, relative to the rms of the target there.
    """

    sensor: str
    path: str
    target: npt.NDArray[np.float32]
    render: npt.NDArray[np.float32]
    used: npt.NDArray[np.bool_]
    rms: float


@dataclass(frozen=True)
class Lobes:
    """The fitted BRDF in the plane of incidence.

    Attributes
    ----------
    incident : array, shape (k,)
        Angle of `wi` from the normal [rad].
    outgoing : array, shape (n,)
        Signed angle of `wo` from the normal [rad]; the mirror direction of `incident` has the same sign.
    f : array, shape (k, n, 3)
        BRDF [1/sr].
    """

    incident: Array
    outgoing: Array
    f: Array


@dataclass(frozen=True)
class MaterialCheck:
    """Physical checks of one fitted material.

    ``reciprocity_max`` is the largest ``|f(wi,wo) - f(wo,wi)| / max`` found; ``albedo_max`` the largest directional
    albedo (any channel) and ``albedo_sd`` its standard error, found at the angle ``albedo_angle`` [rad] from the
    normal.
    """

    reciprocity_max: float
    albedo_max: float
    albedo_sd: float
    albedo_angle: float

    @property
    def sentence(self) -> str:
        """Both findings in words."""
        back = "reciprocal" if self.reciprocity_max < 1e-4 else "NOT reciprocal"
        degrees = np.degrees(self.albedo_angle)
        over = self.albedo_max - 1 > 3 * self.albedo_sd + 1e-6
        energy = (
            f"reflects {self.albedo_max:.3f} times the light that arrives at {degrees:.0f} degrees: it makes energy"
            if over
            else f"conserves energy (largest albedo {self.albedo_max:.3f}, at {degrees:.0f} degrees)"
        )
        return f"It is {back} (largest difference {self.reciprocity_max:.1g}) and {energy}."


@dataclass(frozen=True, repr=False)
class Solution:
    """Result of a fit.

    Attributes
    ----------
    status : str
        A sentence: why the fit ended, and what that means.
    converged, interrupted : bool
    parameters : dict of Estimate
        By ``ID.PARAM``, in the order in which they were asked for.
    components : tuple of str
        Names of the single numbers behind `covariance`: ``ball.m``, ``ball.diffuse_reflectance.r``, ...
    covariance, correlation : array, shape (p, p)
        Of the values; NaN rows where a component has no effect.
    remarks : tuple of str
        Sentences: parameters that cannot be told apart, have no effect, lie at a bound; pixels left out; misfit.
    history : tuple of Step
    loss : float
        Weighted mean square residual at the end.
    rms : float
        Root mean square residual relative to the rms of the targets, over all pixels used.
    iterations : int
    seconds : float
    views : tuple of View
    lobes : dict of Lobes
        By material id.
    checks : dict of MaterialCheck
        By material id.
    settings : dict
        All that is needed to run the fit again: scene, targets, parameters, solver, samples, seed, method ...
    versions : dict
        Versions of Python, brdf-fitting, mitsuba, drjit, numpy, scipy.
    misfit : float
        What the model does not explain, as a fraction of the variance of the noise: near 0 (of either sign) where the
        residual is noise; what to compare models by.
    """

    status: str
    converged: bool
    interrupted: bool
    parameters: dict[str, Estimate]
    components: tuple[str, ...]
    covariance: Array
    correlation: Array
    remarks: tuple[str, ...]
    history: tuple[Step, ...]
    loss: float
    rms: float
    iterations: int
    seconds: float
    views: tuple[View, ...]
    lobes: dict[str, Lobes]
    checks: dict[str, MaterialCheck]
    settings: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    misfit: float = 0.0

    def __str__(self) -> str:
        """What the command prints: a row a parameter, the status, the checks, the remarks."""
        rows = [("parameter", "value", "sd", "95 % interval")]
        for name, e in self.parameters.items():
            unit = "" if e.unit == "1" else f" {e.unit}"
            for i, component in enumerate([name] if e.kind == "number" else [f"{name}.{c}" for c in "rgb"]):
                interval = f"{e.low[i]:.6g} to {e.high[i]:.6g}"
                rows.append((component, f"{e.value[i]:.6g}{unit}", f"{e.sd[i]:.2g}", interval))
        widths = [max(len(row[k]) for row in rows) for k in range(4)]
        lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]
        lines += ["", f"{self.status} ({self.seconds:.1f} s, residual {100 * self.rms:.3g} % of the picture)"]
        lines += [f"{name}: {c.sentence}" for name, c in self.checks.items()]
        lines += [f"Note: {remark}" for remark in self.remarks]
        return "\n".join(lines)

    __repr__ = __str__

    def to_json(self) -> dict[str, Any]:
        """Everything but the pictures, as plain numbers, lists and strings; NaN becomes None."""
        return {
            "status": self.status,
            "converged": self.converged,
            "interrupted": self.interrupted,
            "parameters": {
                name: {
                    **{
                        key: plain(getattr(e, key), e.kind == "number")
                        for key in ("value", "sd", "low", "high", "start")
                    },
                    "unit": e.unit,
                    "at_bound": e.at_bound,
                }
                for name, e in self.parameters.items()
            },
            "seconds": self.seconds,
            "iterations": self.iterations,
            "loss": plain(np.array([self.loss]), True),
            "rms": plain(np.array([self.rms]), True),
            "misfit": plain(np.array([self.misfit]), True),
            "remarks": list(self.remarks),
            "components": list(self.components),
            "covariance": plain(self.covariance, False),
            "correlation": plain(self.correlation, False),
            "checks": {
                name: {
                    "reciprocity_max": c.reciprocity_max,
                    "albedo_max": c.albedo_max,
                    "albedo_sd": c.albedo_sd,
                    "albedo_angle": c.albedo_angle,
                    "sentence": c.sentence,
                }
                for name, c in self.checks.items()
            },
            "views": [
                {"sensor": v.sensor, "target": v.path, "rms": v.rms, "pixels": int(v.used.sum())} for v in self.views
            ],
            "settings": self.settings,
            "versions": self.versions,
        }

    def _repr_html_(self) -> str:
        """The table, the pictures and the remarks, for a notebook."""
        from .report import fragment

        return fragment(self)


def plain(values: Array, scalar: bool) -> Any:
    """Nested lists of Python floats, or one float; NaN as None (JSON has no NaN)."""
    if scalar:
        x = float(values[0])
        return x if np.isfinite(x) else None
    if values.ndim > 1:
        return [plain(row, False) for row in values]
    return [float(x) if np.isfinite(x) else None for x in values]
