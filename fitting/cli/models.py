"""``brdf models``: the models there are, and what each declares."""

from __future__ import annotations

import difflib
import math
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from brdf.errors import UsageError

from .output import Json, print_json, print_table

if TYPE_CHECKING:
    from brdf import Model, Param


def command(
    name: Annotated[str | None, typer.Argument(metavar="[MODEL]", help="Show the parameters of this model.")] = None,
    as_json: Json = False,
) -> None:
    """List the reflection models, or show the parameters of one."""
    from plugins import registered

    known = registered()
    if name is None:
        if as_json:
            print_json([{"name": key, "summary": model.summary} for key, model in known.items()])
        else:
            table = Table("model", "", box=None, padding=(0, 2, 0, 0))
            for key, model in known.items():
                table.add_row(key, model.summary)
            print_table(table)
        return
    if name not in known:
        near = difflib.get_close_matches(name, known, 1)
        guess = f"Did you mean {near[0]}? " if near else ""
        raise UsageError(f"there is no model {name!r}. {guess}There are: {', '.join(known)}.")
    model = known[name]
    if as_json:
        print_json(describe(model))
    else:
        print_model(model)


def describe(model: type[Model]) -> dict[str, Any]:
    """The declaration of a model as plain values."""
    return {
        "name": model.name,
        "summary": model.summary,
        "source": list(model.source),
        "lobes": [lobe.value for lobe in model.lobes],
        "parameters": [
            {
                "name": p.name,
                "kind": p.kind,
                "default": p.default,
                "bounds": None if p.kind == "choice" else [b if math.isfinite(b) else None for b in p.bounds],
                "options": list(p.options),
                "unit": p.unit,
                "scale": None if p.kind == "choice" else p.scale,
                "meaning": p.meaning,
            }
            for p in model.params
        ],
        "choices": consequences(model),
    }


def consequences(model: type[Model]) -> dict[str, dict[str, str]]:
    """How each choice that is not the default changes the parameters: ``{"fresnel = constant": {"eta": "none"}}``."""
    usual = {p.name: p for p in model().parameters()}
    found: dict[str, dict[str, str]] = {}
    for choice in (p for p in model.params if p.kind == "choice"):
        for option in choice.options:
            other = {p.name: p for p in model(**{choice.name: option}).parameters()}
            names = [*usual, *(n for n in other if n not in usual)]
            changed = {n: becomes(usual.get(n), other.get(n)) for n in names if usual.get(n) != other.get(n)}
            if changed:
                found[f"{choice.name} = {option}"] = changed
    return found


def becomes(usual: Param | None, p: Param | None) -> str:
    """What a choice makes of a parameter, in a few words: ``number in [1e-4, 1.5]``, ``0 by default``, ``none``."""
    if p is None:
        return "none"
    if usual is not None and (usual.kind, usual.bounds) == (p.kind, p.bounds):
        return f"{default_text(p)} by default"
    return f"{p.kind} in {p.range_text()}"


def print_model(model: type[Model]) -> None:
    """The declaration of a model as a table."""
    print(f"{model.name}: {model.summary}")
    print(f"lobes: {', '.join(lobe.value for lobe in model.lobes)}; source: {', '.join(model.source) or 'not given'}\n")
    table = Table("parameter", "kind", "default", "allowed", "unit", "scale", "meaning", box=None, padding=(0, 2, 0, 0))
    for p in model.params:
        choice = p.kind == "choice"
        unit, scale = ("", "") if choice else (p.unit, p.scale)
        table.add_row(p.name, p.kind, default_text(p), p.range_text(), unit, scale, p.meaning)
    print_table(table)
    for made, changed in consequences(model).items():
        print(f"\nwith {made}: " + "; ".join(f"{name}: {what}" for name, what in changed.items()))


def default_text(p: Param) -> str:
    """A default as it is written in XML."""
    if p.kind == "choice":
        return p.default
    components = p.default if isinstance(p.default, tuple) else (p.default,)
    return f"{components[0]:g}" if len(set(components)) == 1 else ", ".join(f"{c:g}" for c in components)
