"""The models: one file, one model. A file put here is found; no list is edited."""

from __future__ import annotations

import importlib
import pkgutil

from ..model import Model


def builtin() -> dict[str, type[Model]]:
    """Every model in this folder by its name, in alphabetical order."""
    found: dict[str, type[Model]] = {}
    for info in pkgutil.iter_modules(__path__):
        module = importlib.import_module(f"{__name__}.{info.name}")
        for value in vars(module).values():
            if isinstance(value, type) and issubclass(value, Model) and value.__module__ == module.__name__:
                found[value.name] = value
    return dict(sorted(found.items()))
