"""All checks of any BSDF: what needs no renderer, chi-square tests, and derivatives of pictures."""

from __future__ import annotations

import inspect
import os
import tempfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import mitsuba as mi

from brdf import Model, UsageError
from brdf.checks.gather import QUESTIONS, Progress, check_model, selected, trials
from brdf.checks.result import CHECKS, Finding, Result, judge, not_asked
from brdf.checks.subject import ModelSubject

from .. import scene as scenes
from .. import xmlfile
from ..adapter import choose
from ..registry import register, registered
from . import chi2, render
from .render import Source
from .subject import BsdfSubject, from_dict, plain_settings

#: The checks that render, by name.
RENDERS = {f"gradient_{integrator}": integrator for integrator in render.INTEGRATORS}


def check(
    what: str | Mapping[str, Any] | Model | type[Model] | mi.BSDF,
    values: Mapping[str, Any] | None = None,
    *,
    only: Collection[str] | None = None,
    progress: Progress | None = None,
    seed: int = 0,
    setup: Sequence[str] = (),
    source: Mapping[str, Any] | str | None = None,
) -> dict[str, Result]:
    """Ask a BSDF everything: one of our models, one of Mitsuba's plugins, or a third party's.

    >>> mi.set_variant("llvm_ad_rgb")
    >>> check("cooktorrance", {"m": 0.2})["energy"].figure
    >>> check({"type": "roughplastic", "alpha": 0.1}, only=["gradient"])["gradient"].case

    A model is asked in float64, as a formula, and through its plugin where that matters: the distribution of samples
    and the derivatives of pictures. Any other BSDF is asked through ``eval``, ``pdf`` and ``sample``, in the variant
    now set. Pictures are rendered in processes of their own.

    Parameters
    ----------
    what : str, dict, Model, subclass of Model, or mi.BSDF
        A type name, a dictionary as for ``mi.load_dict``, a model, or a live BSDF.
    values : dict
        Parameters and choices, as in the dictionary. If a parameter of a model is given, it is checked at these values,
        and faults that it declares need not occur; else at all its trials.
    only : names of checks
        All if left out.
    progress : callable
        Called with the name of a check, the number of steps done, and that of all.
    seed : int
    setup : names of modules
        Imported by the processes that render, after the variant is set: for BSDFs that are registered by hand.
    source : dict or XML text
        From what those processes make a live BSDF. Without it, nothing is rendered of one.

    Returns
    -------
    dict of Result, by the name of the check, in the order of ``brdf.checks.CHECKS``

    Raises
    ------
    UsageError
        No variant with arrays is set; an unknown check, model or parameter; a value outside its bounds.
    """
    if mi.variant() is None:
        raise UsageError("no Mitsuba variant is set. Call mi.set_variant('llvm_ad_rgb') first.")
    wanted = selected(only, CHECKS)
    register()
    given = dict(values or {})
    if isinstance(what, type) and issubclass(what, Model):
        register(what)
        return of_model(what, given, wanted, progress, seed, setup)
    if isinstance(what, Model):
        register(type(what))
        choices = {p.name: getattr(what, p.name) for p in what.params if p.kind == "choice"}
        return of_model(type(what), {**choices, **given}, wanted, progress, seed, setup)
    if isinstance(what, mi.BSDF):
        if given:
            raise UsageError("check: values are given for a live BSDF. Set them in it, or give a dictionary.")
        subject = BsdfSubject(what)
        made = Source(source, models_known(), tuple(setup), bounds_of(subject)) if source is not None else None
        return of_bsdf([subject], made, faults_of(what), False, wanted, progress, seed)
    whole: dict[str, Any] = {"type": what} if isinstance(what, str) else dict(what)  # type: ignore[arg-type]
    whole |= given
    model = registered().get(str(whole.get("type")))
    settings = plain_settings(whole)
    if model is not None and set(settings) == set(whole) - {"type"} and set(settings) <= {p.name for p in model.params}:
        return of_model(model, settings, wanted, progress, seed, setup)
    subject = from_dict(whole)
    made = Source(whole, models_known(), tuple(setup), bounds_of(subject))
    return of_bsdf([subject], made, faults_of(subject.bsdf), False, wanted, progress, seed)


def check_scene(
    path: str | os.PathLike[str],
    name: str,
    *,
    only: Collection[str] | None = None,
    progress: Progress | None = None,
    seed: int = 0,
    setup: Sequence[str] = (),
    defaults: Mapping[str, Any] | None = None,
) -> dict[str, Result]:
    """Ask a BSDF of a scene file everything, by its name: see `plugins.scene.load` and `check`.

    `defaults` are values for ``$name`` in the file.

    Raises
    ------
    UsageError, DataError
        As `plugins.scene.load` and `check`.
    """
    loaded = scenes.load(path, **(defaults or {}))
    found = scenes.find(loaded, name)
    text = alone_as_xml(path, name, **(defaults or {}))
    line = f"brdf check {os.fspath(path)} --bsdf {name}"
    subject = BsdfSubject(found.bsdf, name, {"type": found.plugin, **found.props}, line)
    source = Source(text, models_known(), tuple(setup), bounds_of(subject))
    return of_bsdf([subject], source, faults_of(found.bsdf), False, selected(only, CHECKS), progress, seed)


def alone_as_xml(path: str | os.PathLike[str], name: str, /, **defaults: Any) -> str:
    """One BSDF of a scene file as XML text that stands alone: the `source` of a live BSDF."""
    with tempfile.TemporaryDirectory() as folder:
        alone = Path(folder) / "material.xml"
        xmlfile.material(path, name, {}, alone, **defaults)
        return alone.read_text(encoding="utf-8")


def of_model(
    model: type[Model],
    given: Mapping[str, Any],
    wanted: Sequence[str],
    progress: Progress | None,
    seed: int,
    setup: Sequence[str],
) -> dict[str, Result]:
    """The checks of a model: its formula in float64, its plugin where that matters."""
    choices = {p.name: given[p.name] for p in model.params if p.kind == "choice" and p.name in given}
    values = {name: value for name, value in given.items() if name not in choices}
    made = choose(model, choices, list(values))
    settings = [values] if values else trials(made)
    everywhere = not values
    steps = Steps(wanted, progress)
    faults = made.faults()
    plain = [name for name in wanted if name in QUESTIONS]
    results: dict[str, Result] = {}
    for name in plain:
        steps.begin(name)
        found = check_model(made, values or None, only=[name], seed=seed)[name]
        if name == "sampling" and (found.passed or not found.expected):
            subjects = [plugin_subject(made, setting) for setting in settings]
            distribution = judge(name, [chi2.ask(s, seed) for s in subjects], faults.get(name, ""), everywhere)
            if found.passed or not distribution.passed:
                found = distribution if distribution.figure is not None or found.figure is None else found
        results[name] = found
    rendered = [name for name in wanted if name in RENDERS]
    if rendered:
        where = place_of(model)
        if isinstance(where, str):
            findings = {name: not_asked(where) for name in rendered}
        else:
            subject = ModelSubject(made, **settings[0])
            bounds = {f"{p.name}.value": p.bounds for p in made.parameters()}
            source = Source(as_dict(made, settings[0]), models_known(where), tuple(setup), bounds)
            findings = pictures(source, subject.case(), rendered, seed, steps)
        results |= {name: judge(name, [f], faults.get(name, ""), everywhere) for name, f in findings.items()}
    return {name: results[name] for name in wanted}


def of_bsdf(
    subjects: Sequence[BsdfSubject],
    source: Source | None,
    faults: Mapping[str, str],
    must_occur: bool,
    wanted: Sequence[str],
    progress: Progress | None,
    seed: int,
) -> dict[str, Result]:
    """The checks of a BSDF as a black box."""
    steps = Steps(wanted, progress)
    findings: dict[str, list[Finding]] = {}
    for name in (n for n in wanted if n in QUESTIONS):
        steps.begin(name)
        findings[name] = [QUESTIONS[name](subject, seed) for subject in subjects]
        if name == "sampling" and all(f.passed for f in findings[name]):
            distributions = [chi2.ask(subject, seed) for subject in subjects]
            findings[name] = [
                b if b.figure is not None else a for a, b in zip(findings[name], distributions, strict=True)
            ]
    rendered = [name for name in wanted if name in RENDERS]
    if rendered and source is None:
        why = "It is a live BSDF: another process cannot make it. Give what it is made from as `source`."
        findings |= {name: [not_asked(why)] for name in rendered}
    elif rendered and source is not None:
        found = pictures(source, subjects[0].case(), rendered, seed, steps)
        findings |= {name: [f] for name, f in found.items()}
    return {name: judge(name, findings[name], faults.get(name, ""), must_occur) for name in wanted}


def pictures(
    source: Source, case: Mapping[str, Any], names: Sequence[str], seed: int, steps: Steps
) -> dict[str, Finding]:
    """The checks that render."""
    by_integrator = {RENDERS[name]: name for name in names}
    found = render.ask(source, case, list(by_integrator), seed, lambda i: steps.begin(by_integrator[i]))
    return {by_integrator[integrator]: f for integrator, f in found.items()}


class Steps:
    """Counts the checks that were begun."""

    def __init__(self, wanted: Sequence[str], progress: Progress | None) -> None:
        self.total, self.progress, self.done = len(wanted), progress, 0

    def begin(self, name: str) -> None:
        if self.progress:
            self.progress(name, self.done, self.total)
        self.done += 1


def as_dict(model: Model, values: Mapping[str, Any]) -> dict[str, Any]:
    """A model at some values, for ``mi.load_dict``."""
    out: dict[str, Any] = {"type": model.name}
    out |= {p.name: getattr(model, p.name) for p in model.params if p.kind == "choice"}
    for p in model.parameters():
        value = values.get(p.name, p.default)
        out[p.name] = {"type": "rgb", "value": list(value)} if isinstance(value, tuple | list) else value
    return out


def plugin_subject(model: Model, values: Mapping[str, Any]) -> BsdfSubject:
    """The plugin of a model at some values."""
    formula = ModelSubject(model, **values)
    return BsdfSubject(mi.load_dict(as_dict(model, values)), model.name, formula.settings, formula.command())


def faults_of(bsdf: mi.BSDF) -> Mapping[str, str]:
    """What a BSDF declares, if it is one of our models."""
    model = getattr(bsdf, "model", None)
    return model.faults() if isinstance(model, Model) else {}


def bounds_of(subject: BsdfSubject) -> dict[str, Sequence[float]]:
    """The ranges of the parameters of a subject."""
    return {q.name: q.bounds for q in subject.quantities()}


def place_of(model: type[Model]) -> tuple[str, str, str] | str:
    """Where another process finds a class: module, qualified name, file; or why it cannot."""
    if "<locals>" in model.__qualname__:
        return f"{model.__qualname__} is defined inside a function: another process cannot import it."
    try:
        return model.__module__, model.__qualname__, str(Path(inspect.getfile(model)).resolve())
    except (TypeError, OSError):
        return f"{model.__qualname__} is not in a file: another process cannot import it."


def models_known(*more: tuple[str, str, str]) -> tuple[tuple[str, str, str], ...]:
    """Where the registered models of others are, as far as another process can find them."""
    found = [place_of(model) for model in registered().values() if not model.__module__.startswith("brdf.models.")]
    return (*dict.fromkeys([*more, *(place for place in found if isinstance(place, tuple))]),)
