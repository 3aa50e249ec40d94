"""How far a formula is from its exact answer, in roundings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import drjit as dr
import drjit.llvm.ad as wide
import numpy as np
import numpy.typing as npt

from .formulas import WI, WO, Formula
from .table import Exact

Array = npt.NDArray[np.float64]

#: Vector type, rounding and the smallest normal number, by precision.
VECTOR = {"float32": wide.Array3f, "float64": wide.Array3f64}
EPS = {"float32": 2.0**-23, "float64": 2.0**-52}
TINY = {"float32": 2.0**-126, "float64": 2.0**-1022}
PRECISIONS = tuple(VECTOR)
#: Where a rounding of the inputs changes the answer by more than this part of it, it need only be finite.
ILL = 0.1
#: Numbers that have underflowed are forgiven this many times the smallest normal number, in units of the peak.
UNDERFLOW = 1e4
#: And a derivative as many times more. What is lost of an exponential exp(-E) is, in its derivative by ln p, multiplied
#: by dE / d ln p: 2 E for a roughness p, E for an exponent or an optical depth. Where exp(-E) is a normal number, E <
#: ln(1 / tiny), 87 in float32; float64, where it is 708, makes do with that. A power of p has its exponent there, which
#: is less in every model.
LONGER = -2 * math.log(TINY["float32"])
#: Roundings of its inputs within which a derivative that jumps may be that of the other side.
AT_KINK = 8
#: A derivative by a parameter that is 0 is known to this: of what else the value has, no digits are left for less.
AT_ZERO = 1e-45
#: Points below the horizon, where everything is 0.
BELOW = 300


@dataclass(frozen=True)
class Verdict:
    """What was found of one formula in one precision; figures in roundings.

    Attributes
    ----------
    name, precision : str
    points : int
    value, slope : float
        The largest error of the value, and of a derivative.
    value_p99, slope_p99 : float
    ill, slope_ill : float
        Share of the values, and of the derivatives, where the problem itself does not permit an answer: only that it is
        finite is asked.
    kinks : int
        Points so close to where a derivative jumps, or refraction ends, that they are not compared.
    not_finite : int
        Values and derivatives, forward and reverse, that are infinite or NaN.
    reciprocal : bool or None
        Whether exchanging the directions changes no bit; None where that is not declared.
    dark : bool
        Whether value and derivatives are exactly 0 below the horizon.
    worst : dict
        The inputs of the worst value and of the worst derivative, with what came and what is right.
    """

    name: str
    precision: str
    points: int
    value: float
    value_p99: float
    slope: float
    slope_p99: float
    ill: float
    slope_ill: float
    kinks: int
    not_finite: int
    reciprocal: bool | None
    dark: bool
    limits: tuple[float, float] = (0.0, 0.0)
    worst: dict[str, Any] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        within = self.value <= self.limits[0] and self.slope <= self.limits[1]
        return (
            within
            and max(self.ill, self.slope_ill) < 1
            and self.not_finite == 0
            and self.reciprocal is not False
            and self.dark
        )

    def sentence(self) -> str:
        """What is wrong, and where; empty if nothing is."""
        said = []
        if self.value > self.limits[0]:
            said.append(f"value off by {self.value:.3g} roundings (limit {self.limits[0]:g}) at {self.worst['value']}")
        if self.slope > self.limits[1]:
            said.append(
                f"derivative off by {self.slope:.3g} roundings (limit {self.limits[1]:g}) at {self.worst['slope']}"
            )
        if self.not_finite:
            said.append(
                f"{self.not_finite} values or derivatives that are not finite, one at {self.worst['not_finite']}"
            )
        for what, ill in (("value", self.ill), ("derivatives", self.slope_ill)):
            if ill == 1:
                said.append(f"{what} not to be judged: a rounding changes the answer at every point")
        if self.reciprocal is False:
            said.append("not the same with the directions exchanged")
        if not self.dark:
            said.append("not exactly 0 below the horizon")
        return f"{self.name} in {self.precision}: {'; '.join(said)}" if said else ""


@dataclass(frozen=True)
class Computed:
    """Values, shape (n,), and derivatives in reverse and forward mode, shape (n_by, n) each."""

    value: Array
    reverse: Array
    forward: Array


def compute(formula: Formula, inputs: Array, precision: str) -> Computed:
    """A formula with its derivatives at some points."""
    n = inputs.shape[1]
    v, f = traced(formula, inputs, precision)
    value = numpy(f, n)
    reverse = []
    if formula.by:
        dr.backward(dr.sum(f))
        reverse = [numpy(dr.grad(getattr(v, name)), n) for name in formula.by]
    forward = []
    for name in formula.by:  # one at a time: its own pass through the graph
        v, f = traced(formula, inputs, precision, name)
        dr.forward(getattr(v, name))
        forward.append(numpy(dr.grad(f), n))
    return Computed(value, np.array(reverse).reshape(-1, n), np.array(forward).reshape(-1, n))


def traced(formula: Formula, inputs: Array, precision: str, *by: str) -> tuple[SimpleNamespace, Any]:
    """The arguments, with derivatives by some of them (default: all of the formula's), and the function of them."""
    vector = VECTOR[precision]
    number = dr.value_t(vector)
    v = SimpleNamespace()
    for name, column in zip(formula.inputs, inputs, strict=True):
        x = number(column)
        if name in (by or formula.by):
            dr.enable_grad(x)
        setattr(v, name.replace(".", "_"), x)
    return v, formula.function(vector, v)


def numpy(x: Any, n: int) -> Array:
    """n numbers."""
    return np.broadcast_to(np.asarray(x, dtype=np.float64), (n,)).copy()


def judge(formula: Formula, exact: Exact, precision: str) -> Verdict:
    """Hold a formula against its exact answers.

    ``|f - f*| <= C eps (|f*| + sum_i |x_i df/dx_i|)`` plus what underflow takes; C is what is found, in roundings. For
    a derivative by p the same with g = df/dp, and ``|f*/p|`` added: what a rounding of the value is in it. One that is
    nothing beside that, as where a value hardly depends on p, may have any sign.
    """
    eps = EPS[precision]
    allowed = UNDERFLOW * TINY[precision] * np.maximum(exact.peak, 1)
    got = compute(formula, exact.inputs, precision)
    with np.errstate(all="ignore"):
        value_c = off(got.value, exact.value, allowed, eps * exact.value_scale)
        well = eps * exact.value_scale <= ILL * np.abs(exact.value)
        p = exact.inputs[[formula.inputs.index(name) for name in formula.by]].reshape(-1, len(exact))
        # What the value underflows by, the derivative does by 1/p more, and that in p^2, on the way to it, by p, on a
        # longer way; at p = 0 nothing underflows by it.
        longer = LONGER * allowed
        size = np.abs(p)
        forgiven = np.where(p == 0, np.maximum(longer, AT_ZERO), longer * np.maximum(np.maximum(1 / size, size), 1))
        # And as many times more as a derivative, near grazing say, is larger than the value that has underflowed.
        forgiven = np.fmax(forgiven, allowed * (exact.slope_scale / exact.value_scale))
        slope_c = np.maximum(
            *(off(g, exact.slope, forgiven, eps * exact.slope_scale) for g in (got.reverse, got.forward))
        )
        size = np.abs(exact.slope) + np.abs(exact.value / np.where(p == 0, np.inf, p))
        sound = eps * exact.slope_scale <= ILL * size
    smooth = exact.kink > AT_KINK * eps
    value_c = np.where(well & smooth, value_c, 0)
    slope_c = np.where(sound & smooth, slope_c, 0)
    bad = ~(np.isfinite(got.value) & np.isfinite(got.reverse).all(0) & np.isfinite(got.forward).all(0))
    count = sum(int(np.sum(~np.isfinite(x))) for x in (got.value, got.reverse, got.forward))
    flat = slope_c.ravel()
    return Verdict(
        name=formula.name,
        precision=precision,
        points=len(exact),
        value=largest(value_c),
        value_p99=largest(value_c, 0.99),
        slope=largest(flat),
        slope_p99=largest(flat, 0.99),
        ill=float(np.mean(~well)),
        slope_ill=float(np.mean(~sound)) if formula.by else 0.0,
        kinks=int(np.sum(~smooth)),
        not_finite=count,
        reciprocal=reciprocal(formula, exact, precision) if formula.reciprocal else None,
        dark=dark(formula, exact, precision),
        limits=(formula.limits.value, formula.limits.slope),
        worst=worst(formula, exact, got, value_c, slope_c, bad),
    )


def off(got: Array, want: Array, allowed: Array, scale: Array) -> Array:
    """Error in units of `scale`; one that is not finite counts elsewhere."""
    error = np.maximum(np.abs(got - want) - allowed, 0)
    return np.where(np.isfinite(got) & (error > 0), error / scale, 0)


def largest(c: Array, share: float = 1.0) -> float:
    """The largest of that share of them."""
    return float(np.quantile(c, share, method="higher")) if c.size else 0.0


def reciprocal(formula: Formula, exact: Exact, precision: str) -> bool:
    """Whether the value is the same, bit for bit, with the two directions exchanged."""
    order = [formula.inputs.index(swapped(name)) for name in formula.inputs]
    there, back = (numpy(traced(formula, x, precision)[1], len(exact)) for x in (exact.inputs, exact.inputs[order]))
    return bool(np.array_equal(there, back, equal_nan=True))


def swapped(name: str) -> str:
    """The input that takes its place when the directions are exchanged."""
    return {**dict(zip(WI, WO, strict=True)), **dict(zip(WO, WI, strict=True))}.get(name, name)


def dark(formula: Formula, exact: Exact, precision: str) -> bool:
    """Whether a model that does not transmit is 0, with its derivatives, where a direction is not above the surface."""
    if formula.model is None or formula.model.transmits:
        return True
    x = exact.inputs[:, :BELOW].copy()
    i, o = formula.inputs.index("wi.z"), formula.inputs.index("wo.z")
    x[i, ::3] *= -1
    x[o, 1::3] *= -1
    x[i, 2::6] = 0
    x[o, 5::6] = 0
    got = compute(formula, x, precision)
    return not (got.value.any() or got.reverse.any() or got.forward.any())


def worst(formula: Formula, exact: Exact, got: Computed, value_c: Array, slope_c: Array, bad: Any) -> dict[str, Any]:
    """Where it is worst, in plain numbers."""

    def at(i: int) -> dict[str, float]:
        return {name: float(x) for name, x in zip(formula.inputs, exact.inputs[:, i], strict=True)}

    i = int(np.argmax(value_c))
    found: dict[str, Any] = {"value": {**at(i), "got": float(got.value[i]), "exact": float(exact.value[i])}}
    if slope_c.size:
        j, i = np.unravel_index(int(np.argmax(slope_c)), slope_c.shape)
        found["slope"] = {
            **at(int(i)),
            "by": formula.by[int(j)],
            "reverse": float(got.reverse[j, i]),
            "forward": float(got.forward[j, i]),
            "exact": float(exact.slope[j, i]),
        }
    if bad.any():
        i = int(np.argmax(bad))
        found["not_finite"] = {**at(i), "got": float(got.value[i])}
    return found
