"""What the user should know about a solution, in sentences."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from brdf import Param

from .parameters import Parameters
from .uncertainty import Uncertainty

Array = npt.NDArray[np.float64]

#: Two parameters with a correlation beyond this cannot be told apart.
INSEPARABLE = 0.95
#: Residuals four pixels apart that correlate more than this are not noise.
NOT_NOISE = 0.3
#: Below this standard deviation, in the coordinate of its scale, nobody asks for more samples.
FINE = 1e-3
#: Half of a 95 % interval, in a logarithmic coordinate, beyond which a parameter is not determined: its ends differ by
#: a factor of 2.
PRECISION = 0.35
#: Share of the fit's own sampling noise in the residual from which more samples would help.
OWN_NOISE = 0.5


def about(
    parameters: Parameters,
    uncertainty: Uncertainty,
    sd: Array,
    at_bound: npt.NDArray[np.bool_],
    values: Array,
    half: Array,
    precision: float,
    rms: float,
    misfit: bool,
) -> list[str]:
    """All remarks that hold, the gravest first; `half` is what `half_widths` says."""
    names, correlation = parameters.components, uncertainty.confusion
    out = []
    for i, name in enumerate(names):
        if not uncertainty.effect[i]:
            out.append(f"{name} has no effect on any pixel used.")
        elif uncertainty.drowned[i]:
            out.append(
                f"{name} is not determined: what it does to the pictures is lost in the noise of the fit's own "
                "samples, and the error bars of the others lack what they owe to it. Take more samples (--spp)."
            )
        elif np.isnan(sd[i]):
            out.append(
                f"{name} is not determined: some combination of the parameters changes no pixel. Fix one of them."
            )
    for first, second, strongest in pairs(parameters, correlation):
        way = "rise together" if strongest > 0 else "make up for each other"
        out.append(
            f"{first} and {second} can hardly be told apart: they {way} (correlation {strongest:.3f}). "
            "Fix one, or add a picture with other angles of light and view."
        )
    for i, (name, p) in enumerate(zip(names, parameters.params, strict=True)):
        if at_bound[i] and uncertainty.effect[i]:
            end = "lower" if abs(values[i] - p.bounds[0]) < abs(values[i] - p.bounds[1]) else "upper"
            out.append(f"{name} lies at its {end} bound {p.range_text()}; its interval ends there.")
        if half[i] > precision and uncertainty.effect[i]:
            of = f"{name} - 1" if origin(p) else "it"
            out.append(
                f"{name} is not determined: the ends of its 95 % interval differ by {spread(half[i])} of {of}, where "
                f"{spread(precision)} is asked for."
            )
    if misfit or uncertainty.correlation_at_4 > NOT_NOISE:
        out.append(
            f"The residual ({100 * rms:.2g} % of the picture) is not noise: pixels err alike (correlation "
            f"{uncertainty.correlation_at_4:.2f} four pixels apart). The model does not explain the picture fully, "
            "and the error bars do not include that."
        )
    if uncertainty.sampling_share > OWN_NOISE and np.nanmax(uncertainty.sd, initial=0.0) > FINE:
        out.append(
            f"{100 * uncertainty.sampling_share:.0f} % of the residual's variance is the fit's own sampling noise: "
            "more samples (--spp) would narrow the error bars."
        )
    return out


def origin(p: Param) -> float:
    """Where a logarithmic scale counts from: ``m - 0``, ``eta - 1``."""
    return 1.0 if p.scale == "log_minus_one" else 0.0


def spread(half: float) -> str:
    """By how much the ends of an interval differ, in words, by half of it in a logarithmic coordinate."""
    return f"a factor {np.exp(2 * half):.2g}" if half > 0.2 else f"{100 * np.expm1(2 * half):.2g} %"


def half_widths(parameters: Parameters, low: Array, high: Array, at_bound: npt.NDArray[np.bool_]) -> Array:
    """Half of each 95 % interval in the logarithm of its scale; 0 for components of other scales.

    And for what lies at a bound where its scale ends, as no extinction or an index of 1: it has a place on no such
    scale.
    """
    out = np.zeros(len(low))
    for i, p in enumerate(parameters.params):
        at_end = at_bound[i] and p.bounds[0] <= origin(p)
        if p.scale in ("log", "log_minus_one") and np.isfinite(low[i]) and not at_end:
            below = max(low[i] - origin(p), 0.0)
            out[i] = 0.5 * np.log((high[i] - origin(p)) / below) if below > 0 else np.inf
    return out


def pairs(parameters: Parameters, correlation: Array) -> list[tuple[str, str, float]]:
    """Pairs of parameters that cannot be told apart, with the strongest correlation between their components.

    The components of one colour are not compared: they rise and fall together with whatever is common to them.
    """
    owner = np.repeat(np.arange(len(parameters.free)), [f.size for f in parameters.free])
    out = []
    for j in range(len(parameters.free)):
        for i in range(j):
            block = correlation[np.ix_(owner == i, owner == j)]
            if np.isfinite(block).any():
                strongest = float(block.flat[np.nanargmax(np.abs(block))])
                if abs(strongest) > INSEPARABLE:
                    out.append((parameters.free[i].name, parameters.free[j].name, strongest))
    return out
