"""BSDFs put through the checks one after the other: which ones a request means, what was found, how it is written."""

from __future__ import annotations

import itertools
import json
import os
import shlex
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from brdf import Model, UsageError
from brdf.checks import CHECKS, ModelSubject, Result, Subject
from plugins import checks, named, registered
from plugins.adapter import choose
from plugins.checks.gather import RENDERS, from_dict
from plugins.checks.subject import BsdfSubject
from plugins.scene import Scene, find, load

from .files import replacing
from .portrait import Portrait, portrait

#: Called before each check, with the number of BSDFs done, the name of the one at hand, the check, and which part of it
#: is done, in [0, 1].
Progress = Callable[[int, str, str, float], None]


@dataclass(frozen=True)
class Asked:
    """One BSDF to be checked: a type at some values, or one of a scene file.

    Attributes
    ----------
    name : str
        What it is called in the results.
    described : dict
        As for ``mi.load_dict``; empty for one of a scene.
    command : str
        A line for the shell that checks it again.
    scene : Path or None
        The file in which it is, under its name.
    defaults : dict
        Values for ``$name`` in the file.
    """

    name: str
    described: Mapping[str, Any]
    command: str
    scene: Path | None = None
    defaults: Mapping[str, Any] = field(default_factory=dict)

    @property
    def owner(self) -> str:
        """The type; of a BSDF of a scene its name. Variations of one model have one owner."""
        return str(self.described["type"]) if self.described else self.name

    def check(self, **options: Any) -> dict[str, Result]:
        """Its results: see `plugins.checks.check`."""
        if self.scene is None:
            return checks.check(self.described, **options)
        return checks.check_scene(self.scene, self.name, **options, defaults=self.defaults)

    def steps(self, only: Collection[str] | None) -> list[list[str]]:
        """The checks in the portions in which they are made, so that an interruption loses little.

        Those that render go together, at the same time; of a scene all, so that it is loaded once.
        """
        wanted = [name for name in CHECKS if only is None or name in only]
        if self.scene is not None:
            return [wanted]
        rendered = [name for name in wanted if name in RENDERS]
        return [[name] for name in wanted if name not in RENDERS] + ([rendered] if rendered else [])

    def subject(self) -> Subject:
        """The BSDF at the values asked for, the defaults for the rest."""
        if self.scene is not None:
            return BsdfSubject(find(load(self.scene, **self.defaults), self.name).bsdf, self.name)
        return model_subject(self.described) or from_dict(self.described)


@dataclass
class Checked:
    """What was found so far.

    Attributes
    ----------
    asked : sequence of Asked
    results : dict
        ``{name: {check: Result}}``.
    portraits : dict of Portrait
        For the plots, if they were wanted.
    complete : bool
        False after an interruption: the last one may then lack some checks.
    seconds : float
    """

    asked: Sequence[Asked]
    results: dict[str, dict[str, Result]] = field(default_factory=dict)
    portraits: dict[str, Portrait] = field(default_factory=dict)
    complete: bool = False
    seconds: float = 0.0

    def each(self) -> Iterator[tuple[str, Result]]:
        """Every result with the name of what was checked."""
        return ((name, result) for name, found in self.results.items() for result in found.values())

    def unexpected(self) -> list[tuple[str, Result]]:
        """What is not as declared."""
        return [(name, result) for name, result in self.each() if not result.expected]

    def declared(self) -> list[tuple[str, Result]]:
        """What failed as declared."""
        return [(name, result) for name, result in self.each() if result.expected and not result.passed]

    def count(self) -> Counter[str]:
        """How many results there are of each `kind`."""
        return Counter(kind(result) for _, result in self.each())

    def interruption(self) -> str:
        """How far it came, in words; empty if to the end."""
        if self.complete:
            return ""
        return f"Interrupted at {len(self.results)} of {counted(len(self.asked), 'BSDF')}."

    def sentence(self) -> str:
        """The same in words."""
        count = self.count()
        found = [f"{count['passed']} passed", f"{count['declared']} failed as declared"]
        found.append(f"{count['failed'] + count['undue']} unexpected")
        if count["not asked"]:
            found.append(f"{count['not asked']} do not arise")
        return f"{sum(count.values())} checks of {counted(len(self.results), 'BSDF')}: {', '.join(found)}."

    def to_json(self) -> dict[str, dict[str, dict[str, Any]]]:
        """``{MODEL: {CHECK: {"passed", "expected", "figure", "limit", "reason", "case"}}}``."""
        return {name: {key: r.as_dict() for key, r in found.items()} for name, found in self.results.items()}


def kind(result: Result) -> str:
    """The kinds of outcome: ``passed``, ``not asked``, ``declared``, ``failed``, ``undue`` (declared, but passed)."""
    if result.passed:
        return "undue" if not result.expected else "not asked" if result.figure is None else "passed"
    return "declared" if result.expected else "failed"


def counted(number: int, thing: str) -> str:
    """``1 BSDF``, ``2 BSDFs``."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def by_name(name: str, given: Mapping[str, Any] | None = None) -> list[Asked]:
    """A type of BSDF: at the values `given` alone, else one of our models under its default choices and each other one.

    A fault may depend on a choice. Options are tried one at a time, the other choices at their defaults.

    Raises
    ------
    UsageError
        An unknown type or parameter, or a value that is not allowed.
    """
    given = dict(given or {})
    described = named.described(name, given)
    model = registered().get(name)
    if given or model is None:
        implied = implied_choices(model, given) if model else {}
        return [Asked(called(name, given), {**described, **implied}, command(name, given))]
    return [Asked(called(name, v), {"type": name, **v}, command(name, v)) for v in variations(model)]


def all_models() -> list[Asked]:
    """Every model of ours and of installed packages."""
    return [asked for name in registered() for asked in by_name(name)]


def variations(model: type[Model]) -> list[dict[str, str]]:
    """The default choices, as nothing said, then each other option of each choice."""
    choices = [p for p in model.params if p.kind == "choice"]
    return [{}, *({p.name: option} for p in choices for option in p.options if option != p.default)]


def implied_choices(model: type[Model], given: Mapping[str, Any]) -> dict[str, str]:
    """The choices left open that follow from which parameters are given, as in XML."""
    choices = {p.name: p for p in model.params if p.kind == "choice"}
    made = choose(model, {k: v for k, v in given.items() if k in choices}, [k for k in given if k not in choices])
    return {k: getattr(made, k) for k, p in choices.items() if k not in given and getattr(made, k) != p.default}


def in_scene(scene: Scene, identifier: str | None = None, defaults: Mapping[str, Any] | None = None) -> list[Asked]:
    """The BSDFs of a scene, or the one of that id.

    Raises
    ------
    UsageError
        No such BSDF: the message names the near ones; or none at all.
    """
    chosen = scene.bsdfs if identifier is None else {identifier: find(scene, identifier)}
    if not chosen:
        raise UsageError(f"{scene.path}: there is no BSDF in the scene.")
    given = dict(defaults or {})
    more = [word for name, value in given.items() for word in ("-D", f"{name}={value}")]
    line = ["brdf", "check", str(scene.path), *more, "--bsdf"]
    return [Asked(name, {}, shlex.join([*line, name]), scene.path, given) for name in chosen]


def run(
    asked: Sequence[Asked],
    only: Collection[str] | None = None,
    seed: int = 0,
    portraits: bool = False,
    progress: Progress | None = None,
    modules: Sequence[str] = (),
) -> Checked:
    """Check one after the other. An interruption ends it early; what was found stays.

    Parameters
    ----------
    only : names of checks
        All if left out.
    seed : int
        Of the random directions.
    portraits : bool
        Whether what the plots show is to be found out as well.
    modules : names of modules
        What registers BSDFs, for the processes that render.
    """
    checked, began = Checked(asked), time.monotonic()
    try:
        for done, one in enumerate(asked):
            found = checked.results.setdefault(one.name, {})
            check_one(one, found, only, seed, modules, partial(progress, done, one.name) if progress else None)
            checked.results[one.name] = {name: found[name] for name in CHECKS if name in found}
            if portraits:
                checked.portraits[one.name] = portrait(one.subject(), seed)
        checked.complete = True
    except KeyboardInterrupt:
        checked.results = {name: found for name, found in checked.results.items() if found}
    checked.seconds = time.monotonic() - began
    return checked


def check_one(
    asked: Asked,
    found: dict[str, Result],
    only: Collection[str] | None,
    seed: int,
    modules: Sequence[str],
    progress: Callable[[str, float], None] | None,
) -> None:
    """Put the results of one BSDF into `found`, as they come."""
    steps = asked.steps(only)
    total = sum(map(len, steps))

    def tell(check: str, done: int, _: int) -> None:
        if progress:
            progress(check, (len(found) + done) / total)

    for names in steps:
        results = asked.check(only=names, progress=tell, seed=seed, setup=tuple(modules))
        found.update({name: repeatable(result, asked, seed) for name, result in results.items()})


def repeatable(result: Result, asked: Asked, seed: int) -> Result:
    """With a command that repeats this check, at the values where it was found."""
    found = str(result.case.get("command", "")) if asked.scene is None else ""
    words = [found or asked.command, f"--only {result.check}", *([f"--seed {seed}"] if seed else [])]
    return replace(result, case={**result.case, "command": " ".join(words)})


def model_subject(described: Mapping[str, Any]) -> Subject | None:
    """One of our models in float64; None if it is none, or is given otherwise than by its own parameters."""
    model = registered().get(str(described["type"]))
    values = {key: value["value"] if isinstance(value, dict) else value for key, value in described.items()}
    del values["type"]
    if model is None or not {p.name for p in model.params}.issuperset(values):
        return None
    choices = {p.name: values.pop(p.name) for p in model.params if p.kind == "choice" and p.name in values}
    return ModelSubject(choose(model, choices, list(values)), **values)


def called(name: str, given: Mapping[str, Any]) -> str:
    """``cooktorrance[masking=smith, m=0.3]``."""
    return f"{name}[{', '.join(f'{key}={text(value)}' for key, value in given.items())}]" if given else name


def command(name: str, given: Mapping[str, Any]) -> str:
    """The line that checks a type at these values."""
    return shlex.join(["brdf", "check", name, *(w for k, v in given.items() for w in ("--set", f"{k}={text(v)}"))])


def text(value: Any) -> str:
    """A value as it is typed."""
    if isinstance(value, tuple | list):
        return ",".join(f"{v:.9g}" for v in value)
    return str(value).lower() if isinstance(value, bool) else f"{value:.9g}" if isinstance(value, float) else str(value)


def write_json(checked: Checked, path: str | os.PathLike[str], about: Mapping[str, Any]) -> None:
    """Everything as a file: ``{"complete", ..., "results": {MODEL: {CHECK: ...}}}``, `about` in between."""
    whole = {"complete": checked.complete, **about, "seconds": checked.seconds, "results": checked.to_json()}
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(whole, indent=2, allow_nan=False, ensure_ascii=False) + "\n", encoding="utf-8")


def file_names(names: Collection[str]) -> dict[str, str]:
    """Each name as that of a file, without its ending, no two the same: ``cooktorrance-masking-smith``."""
    out: dict[str, str] = {}
    for name in names:
        plain = "-".join("".join(c if c.isalnum() or c in "._" else " " for c in name).split()).lstrip(".") or "bsdf"
        free = (plain if i == 1 else f"{plain}-{i}" for i in itertools.count(1))
        out[name] = next(word for word in free if word not in out.values())
    return out
