"""Every model there is, for tests that hold them all."""

from __future__ import annotations

from brdf import Model, builtin


def variations() -> list[Model]:
    """Every model with its default choices, then with each other option of each choice, one at a time."""
    made = []
    for model in builtin().values():
        made.append(model())
        for p in model.params:
            if p.kind == "choice":
                made += [model(**{p.name: option}) for option in p.options[1:]]
    return made


def named(model: Model) -> str:
    """A test's id: the name, and the choices made."""
    return "-".join([model.name, *(str(v) for v in vars(model).values())])


def ends(model: Model) -> list[dict[str, float]]:
    """Settings at the bounds: the defaults, each number at either of its ends, and all of them at once.

    The colours at their ends are those that are not reflectances.
    """
    parameters = [p for p in model.parameters() if p.kind == "number" or p.bounds != (0.0, 1.0)]
    made: list[dict[str, float]] = [{}]
    for end in (0, 1):
        made += [{p.name: p.bounds[end] for p in parameters}, *({p.name: p.bounds[end]} for p in parameters)]
    return [one for i, one in enumerate(made) if one not in made[:i]]
