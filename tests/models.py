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
