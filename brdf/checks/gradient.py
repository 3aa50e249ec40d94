"""Is the derivative in each parameter that of the value?"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from .differences import Step, derivative, step
from .directions import hemisphere, pairs, row
from .result import Finding, at_most, not_asked, worst_parameter
from .subject import BELOW_ONE, Quantity, Subject
from .values import channels

Array = npt.NDArray[np.float64]

#: Pairs of directions at which the value is differentiated.
PAIRS = 1_000
#: (float32, float64) The relative error allowed, and the rounding of a value.
LIMIT, ROUNDING = (1e-2, 1e-5), (2.0**-24, 2.0**-53)
#: The error of the differences counts this often: it is itself estimated.
DOUBT = 10.0
#: (float32, float64) An error is measured against the derivative, but at least against this share of value over
#: parameter.
FLOOR = (2e-2, 1e-3)
#: A parameter smaller than this is taken to be of this size.
REACHED = 1e-2
#: Derivatives below this are nothing, and their rounding is not that of other numbers.
TINY = 1e-30
#: (float32, float64) Values below this share of the largest are cut off by some, and count for nothing.
DIM = (1e-8, 1e-30)
#: If no more than this share of the pairs is off, steps that are smaller by these factors are tried there.
FEW, CLOSER = 0.02, (0.03, 1e-3)


def ask(subject: Subject, seed: int = 0) -> Finding:
    """Automatic differentiation against differences: of ``f``, and of the power that an ideal lobe sends on."""
    quantities = subject.quantities()
    if not quantities:
        return not_asked("There is no parameter to differentiate in.")
    findings = []
    asked = [(None, "f"), *((i, "power") for i, part in enumerate(subject.lobes) if part.ideal and not part.smooth)]
    for lobe, what in asked:
        if lobe is None and not subject.smooth:
            continue
        value, where = measured(subject, lobe, seed)
        findings += [compare(subject, q, value, what, where) for q in quantities]
    return worst_parameter(findings)


def measured(
    subject: Subject, lobe: int | None, seed: int
) -> tuple[Callable[[], Any], Callable[[int], dict[str, Any]]]:
    """What is differentiated, and a description of an entry of it."""
    if lobe is None:
        wi, wo = pairs(subject, PAIRS, seed)
        return lambda: subject.f(wi, wo), lambda i: {"wi": row(wi, i), "wo": row(wo, i)}
    rng = np.random.default_rng(seed)
    given = hemisphere(PAIRS, rng)
    if subject.transmits:
        given[2] *= np.where(rng.random(PAIRS) < 0.5, -1, 1)
    wi, u = subject.vector(given), subject.vector(np.minimum(rng.random((3, PAIRS)), BELOW_ONE))
    name = subject.lobes[lobe].name
    return lambda: subject.sample(wi, u, lobe).weight, lambda i: {"wi": row(wi, i), "u": row(u, i), "lobe": name}


def forward(subject: Subject, quantity: Quantity, value: Callable[[], Any]) -> Array:
    """The derivative of `value` along all components of a parameter, by automatic differentiation."""
    base = subject.get(quantity.name)
    t = dr.value_t(subject.vector)(0)
    dr.enable_grad(t)
    try:
        subject.set(quantity.name, base + moved(base, t))
        y = value()
        if not dr.grad_enabled(y):
            return np.zeros_like(channels(y))
        dr.set_grad(t, 1)
        return channels(dr.forward_to(y))
    finally:
        subject.set(quantity.name, base)


def moved(base: Any, t: Any) -> Any:
    """`t` in the shape of a parameter."""
    if dr.is_tensor_v(base):
        return type(base)(dr.repeat(type(base.array)(t), dr.prod(base.shape)), base.shape)
    return t


def apart(got: Array, want: Array, error: Array, here: Array, plain: Array, double: bool) -> Array:
    """How far two derivatives are apart, relative, as far as that exceeds what the second is uncertain by."""
    natural = here / max(float(np.abs(plain).max()), REACHED)
    scale = np.maximum(np.maximum(np.abs(want), np.abs(got)), FLOOR[double] * natural)
    counts = np.isfinite(want) & np.isfinite(error) & np.isfinite(got)  # what is not finite is another check's
    counts &= (here > DIM[double] * here.max(initial=0)) | (here == 0)
    counts &= scale > TINY
    with np.errstate(invalid="ignore"):
        difference = np.abs(got - want)
        known = DOUBT * error <= LIMIT[double] * scale  # else only what exceeds the doubt counts
        excess = np.where(known, difference, np.maximum(difference - DOUBT * error, 0))
        return np.where(counts, excess / np.where(counts, scale, 1), 0)


def compare(
    subject: Subject,
    quantity: Quantity,
    value: Callable[[], Any],
    what: str,
    where: Callable[[int], dict[str, Any]],
) -> Finding:
    """The derivative in one parameter against differences."""
    base = subject.get(quantity.name)
    plain = np.asarray(base, dtype=np.float64).ravel()
    low, high = quantity.bounds
    steps = [step(float(x), (low, high)) for x in (plain.min(), plain.max())]
    size = min(steps, key=lambda s: (s.side == 0, s.reach))

    def at(t: float) -> Array:
        subject.set(quantity.name, base + moved(base, dr.opaque(dr.value_t(subject.vector), t)))
        return channels(value())

    number = subject.double
    got = forward(subject, quantity, value)
    try:
        here = np.abs(at(0.0))
        want, error = derivative(at, size, ROUNDING[number])
        off = apart(got, want, error, here, plain, number)
        failed = (off > LIMIT[number]).any(axis=0)
        if 0 < failed.mean() <= FEW:
            # Differences do not see a fold between two of their points. Where only few are off, nearer points decide.
            for closer in CLOSER:
                nearer = derivative(at, Step(size.reach * closer, size.side), ROUNDING[number])
                off_near = apart(got, *nearer, here, plain, number)
                use = failed & (off_near.max(axis=0) < off.max(axis=0))
                want, error, off = (
                    np.where(use, a, b) for a, b in ((nearer[0], want), (nearer[1], error), (off_near, off))
                )
    finally:
        subject.set(quantity.name, base)
    off = off.max(axis=0)
    index = int(np.argmax(off))
    channel = int(np.argmax(np.abs(got - want)[:, index]))
    case = subject.case(
        figure="relative error of the derivative",
        parameter=quantity.name,
        of=what,
        **where(index),
        automatic=float(got[channel, index]),
        differences=float(want[channel, index]),
        uncertainty=float(error[channel, index]),
    )
    said = (
        f"d {what} / d {quantity.name} is {got[channel, index]:.5g} by automatic differentiation, "
        f"{want[channel, index]:.5g} by differences."
    )
    return at_most(float(off[index]), LIMIT[number], said, case)
