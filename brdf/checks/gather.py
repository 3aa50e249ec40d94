"""All checks of a model, at all settings that it names, held against the faults that it declares."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

from drjit.llvm.ad import Array3f, Array3f64

from ..errors import UsageError
from ..model import Model
from . import energy, finite, gradient, peak, reciprocity, sampling
from .result import CHECKS, Finding, Result, judge
from .subject import ModelSubject, Subject

Ask = Callable[[Subject, int], Finding]
#: Called with the name of a check, how many steps are done, and how many there are.
Progress = Callable[[str, int, int], None]

QUESTIONS: dict[str, Ask] = {
    "reciprocity": reciprocity.ask,
    "energy": energy.ask,
    "coupling": energy.ask_sum,
    "sampling": sampling.ask,
    "gradient": gradient.ask,
    "finite": finite.ask,
    "peak": peak.ask,
}
"""The checks that need no renderer, by name."""


def check_model(
    model: Model | type[Model],
    values: Mapping[str, Any] | None = None,
    *,
    only: Collection[str] | None = None,
    progress: Progress | None = None,
    seed: int = 0,
) -> dict[str, Result]:
    """Ask a model everything that can be asked without a renderer, in float64; `finite` in float32 as well.

    >>> for name, result in check_model(CookTorrance(masking="smith")).items():
    ...     print(name, result.outcome, result.figure, result.limit, result.reason)

    Parameters
    ----------
    model : Model or subclass
        With its choices made, or the class for its default choices.
    values : dict
        Values of parameters at which to look, the defaults for the rest; without it, all of ``model.trials``. A fault
        that the model declares need then not occur.
    only : names of checks
        All if left out.
    progress : callable
    seed : int

    Returns
    -------
    dict of Result, by the name of the check

    Raises
    ------
    UsageError
        An unknown check or parameter, or a value outside its bounds.
    """
    made = model if isinstance(model, Model) else model()
    wanted = selected(only, QUESTIONS)
    settings = trials(made) if values is None else [dict(values)]
    findings: dict[str, list[Finding]] = {}
    for done, name in enumerate(wanted):
        if progress:
            progress(name, done, len(wanted))
        findings[name] = [QUESTIONS[name](subject, seed) for subject in subjects(made, settings, name, values is None)]
    faults = made.faults()
    return {name: judge(name, found, faults.get(name, ""), values is None) for name, found in findings.items()}


def subjects(model: Model, settings: list[dict[str, Any]], check: str, everywhere: bool) -> Iterable[Subject]:
    """What a check asks: `finite` also in float32, and, if `everywhere`, at the bounds of the parameters."""
    if check == "finite":
        settings = settings + (at_bounds(model) if everywhere else [])
        for values in settings:
            yield ModelSubject(model, Array3f, **values)
    for values in settings:
        yield ModelSubject(model, Array3f64, **values)


def trials(model: Model) -> list[dict[str, Any]]:
    """The settings at which a model wants to be looked at, as far as they exist under its choices, each once."""
    known = {p.name for p in model.parameters()}
    found: list[dict[str, Any]] = []
    for trial in model.trials:
        setting = {name: value for name, value in trial.items() if name in known}
        if setting not in found:
            found.append(setting)
    return found


def at_bounds(model: Model) -> list[dict[str, Any]]:
    """Settings with each parameter at each of its finite bounds in turn, then with all of them at once."""
    ends: list[dict[str, Any]] = []
    corners: tuple[dict[str, Any], dict[str, Any]] = ({}, {})
    for p in model.parameters():
        for bound, corner in zip(p.bounds, corners, strict=True):
            if math.isfinite(bound):
                corner[p.name] = bound
                ends.append({p.name: bound})
    return ends + [corner for corner in corners if corner]


def selected(only: Collection[str] | None, known: Collection[str]) -> list[str]:
    """The checks that are wanted, in their usual order."""
    for name in only or ():
        if name not in known:
            raise UsageError(f"there is no check {name!r}. There are: {', '.join(c for c in CHECKS if c in known)}.")
    return [name for name in CHECKS if name in known and (only is None or name in only)]
