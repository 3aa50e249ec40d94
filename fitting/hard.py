"""Models, and the bricks they are made of, at the points where they are hard: which, by what, and what was found."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from brdf import DataError, Model, UsageError
from brdf.checks.result import plain
from brdf.hard import FORMULAS, Formula, Verdict, judge, load, outsider
from brdf.hard.criterion import PRECISIONS
from plugins import registered

#: Called before each formula, with the number of those done, its name, and which part of it is done, in [0, 1].
Progress = Callable[[int, str, float], None]
BRICKS = "bricks"
#: By what a formula is judged, as it is said.
ORACLES = {"table": "exact answers", "mpmath": "its formula in mpmath", "float64": "float32 against float64"}


@dataclass(frozen=True)
class Asked:
    """A formula, and by what it is judged: a key of `ORACLES`."""

    formula: Formula
    oracle: str = "table"


@dataclass
class Hard:
    """What was found: ``{formula: {precision: Verdict}}``, and of which formula nothing, with what went wrong."""

    asked: Sequence[Asked]
    verdicts: dict[str, dict[str, Verdict]] = field(default_factory=dict)
    errors: dict[str, str] = field(default_factory=dict)
    complete: bool = False

    def failed(self) -> list[Verdict]:
        """Those that are beyond a limit."""
        return [v for found in self.verdicts.values() for v in found.values() if not v.passed]

    def to_json(self) -> dict[str, Any]:
        """``{OWNER: {"passed", "value_c", "gradient_c", ..., "formulas": {FORMULA: {PRECISION: ...}}}}``."""
        owners = {asked.formula.owner: None for asked in self.asked}
        return {owner: self.summary(owner) for owner in owners}

    def summary(self, owner: str) -> dict[str, Any]:
        """The worst over the formulas of one owner, in both precisions."""
        asked = [a for a in self.asked if a.formula.owner == owner and a.formula.name in self.verdicts]
        verdicts = [v for a in asked for v in self.verdicts[a.formula.name].values()]
        if not verdicts:
            return {}
        paired = [a for a in asked if "wo.x" in a.formula.inputs]  # the others have no direction to exchange
        exchanged = [v.reciprocal for a in paired for v in self.verdicts[a.formula.name].values()]
        found = {
            "passed": all(v.passed for v in verdicts),
            "value_c": max(v.value for v in verdicts),
            "value_p99": max(v.value_p99 for v in verdicts),
            "gradient_c": max(v.slope for v in verdicts),
            "gradient_p99": max(v.slope_p99 for v in verdicts),
            "gradient_max": max(v.slope for v in verdicts),
            "non_finite": sum(v.not_finite for v in verdicts),
            "reciprocal": reciprocal(exchanged),
            "dark_below_horizon": all(v.dark for v in verdicts),
            "points": sum(v.points for v in verdicts),
            "ill_conditioned": max(v.ill for v in verdicts),
            "gradient_ill_conditioned": max(v.slope_ill for v in verdicts),
            "formulas": {
                a.formula.name: {
                    "oracle": a.oracle,
                    **{k: plain({**asdict(v), "passed": v.passed}) for k, v in self.verdicts[a.formula.name].items()},
                }
                for a in asked
            },
        }
        return {key: value if key == "formulas" else plain(value) for key, value in found.items()}


def reciprocal(found: Sequence[bool | None]) -> bool | None:
    """Of several formulas together: None if one of them does not declare it, or there are none."""
    if False in found:
        return False
    return None if None in found or not found else True


def all_formulas() -> list[Asked]:
    """Bricks, our models, and those of installed packages."""
    strangers = [m for name, m in registered().items() if not known(name) and not all(x.ideal for x in m.lobes)]
    return [*(Asked(f) for f in FORMULAS.values()), *(a for model in strangers for a in of_stranger(model))]


def by_name(name: str) -> list[Asked]:
    """Those of one model, or of the bricks.

    Raises
    ------
    UsageError
        There is no such model.
    """
    if known(name):
        return [Asked(f) for f in FORMULAS.values() if f.owner == name]
    model = registered().get(name)
    if model is None:
        has = ", ".join([BRICKS, *registered()])
        raise UsageError(
            f"--hard asks our models and those that are registered, and {name} is neither. There are: {has}. "
            "Of Mitsuba's own some are asked by --hard --peers."
        )
    return of_stranger(model)


def known(name: str) -> bool:
    """Whether there is a table for it."""
    return any(f.owner == name for f in FORMULAS.values())


def strangers_terms() -> str:
    """How many points the formula of a model that is not ours is asked at, and what it is allowed there."""
    value, slope = outsider.LIMITS
    return (
        f"At {outsider.POINTS} points, where a value may be off by {value:g} roundings and a derivative by {slope:g}."
    )


def of_stranger(model: type[Model]) -> list[Asked]:
    """Under its default choices, and each other option of each choice.

    Raises
    ------
    UsageError
        All its lobes are ideal, or it has no continuous parameters to ask about.
    """
    choices = [p for p in model.params if p.kind == "choice"]
    made = [{}, *({p.name: o} for p, o in itertools.chain(*([(p, o) for o in p.options[1:]] for p in choices)))]
    models = [model(**chosen) for chosen in made]
    if all(lobe.ideal for lobe in models[0].lobes):
        raise UsageError(f"--hard: all lobes of {model.name} are ideal: there is no f to ask about.")
    return [Asked(outsider.formula(m), "mpmath" if outsider.has_exact(m) else "float64") for m in models]


def run(asked: Sequence[Asked], progress: Progress | None = None) -> Hard:
    """Judge one after the other. An interruption ends it early; what was found stays."""
    hard = Hard(asked)

    def tell(done: int, name: str) -> Callable[[float], None]:
        return lambda part: progress(done, name, part) if progress else None

    try:
        for done, one in enumerate(asked):
            try:
                hard.verdicts[one.formula.name] = verdicts(one, tell(done, one.formula.name))
            except DataError as error:
                if len({a.formula.owner for a in asked}) == 1:
                    raise
                hard.errors[one.formula.name] = str(error)  # somebody's formula must not take the rest with it
        hard.complete = True
    except KeyboardInterrupt:
        pass
    return hard


def verdicts(asked: Asked, tell: Callable[[float], None]) -> dict[str, Verdict]:
    """In both precisions; float64 cannot be judged by itself."""
    tell(0.0)
    formula, oracle = asked.formula, asked.oracle
    if oracle == "table":
        exact = load(formula.name)
    else:
        inputs = formula.draw(1, outsider.POINTS)
        if oracle == "mpmath":
            exact = outsider.by_mpmath(formula, inputs, lambda done: tell(done / outsider.POINTS))
        else:
            exact = outsider.by_float64(formula, inputs)
    return {p: judge(formula, exact, p) for p in PRECISIONS if oracle != "float64" or p == "float32"}
