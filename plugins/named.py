"""A BSDF by the name of its type: ours, an installed package's, Mitsuba's own, or one that a program registered."""

from __future__ import annotations

import difflib
import functools
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mitsuba as mi

from brdf import UsageError

from .registry import RESERVED, registered
from .scene import one_line

#: Mitsuba's own that are nothing without another BSDF inside. Asked for one, 3.9.1 refuses or, for `blendbsdf`, ends
#: the process.
WRAPPERS = ("blendbsdf", "bumpmap", "mask", "normalmap", "twosided")


def types() -> list[str]:
    """Every type that a BSDF can be made of: our models and those of installed packages, then Mitsuba's own."""
    return [*registered(), *(name for name in builtin() if name not in WRAPPERS)]


@functools.cache
def builtin() -> tuple[str, ...]:
    """The types of Mitsuba's own BSDFs, in alphabetical order."""
    manager = mi.PluginManager.instance()
    names = sorted({path.stem for path in (Path(mi.__file__).parent / "plugins").iterdir()})
    return tuple(name for name in names if manager.plugin_type(name) == mi.ObjectType.BSDF)


def described(name: str, given: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A type and values of its parameters as ``mi.load_dict`` takes them, once they are seen to be allowed.

    Parameters
    ----------
    name : str
        The type, as in XML.
    given : dict
        Numbers, three numbers for a colour, text or bool, by the names of the XML.

    Raises
    ------
    UsageError
        An unknown type or parameter, or a value that is not allowed: one line.
    """
    given = dict(given or {})
    if name in WRAPPERS:
        raise UsageError(f"{name} is nothing without a BSDF inside. Write a scene with both, and name that.")
    for key in RESERVED:
        if key in given:
            raise UsageError(f"{name}: {key!r} is not a parameter.")
    described = {"type": name, **{key: as_dict(value) for key, value in given.items()}}
    with explained(name):
        made = mi.load_dict(described)
    if not isinstance(made, mi.BSDF):
        kind = mi.PluginManager.instance().plugin_type(name)
        other = "" if kind == mi.ObjectType.Unknown else f", but a type of {kind.name.lower()}"
        raise UsageError(f"{name} is not a BSDF{other}. {near(name)}")
    return described


def as_dict(value: Any) -> Any:
    """A value as ``mi.load_dict`` takes it: three numbers are a colour."""
    return {"type": "rgb", "value": list(value)} if isinstance(value, tuple | list) else value


def near(name: str) -> str:
    """The end of a message about an unknown type."""
    close = difflib.get_close_matches(name, types(), 3)
    guess = f"Did you mean {' or '.join(close)}? " if close else ""
    return f"{guess}There are: {', '.join(types())}."


def near_parameter(name: str, parameter: str) -> str:
    """The end of a message about an unknown parameter of one of Mitsuba's own."""
    try:
        keys = mi.traverse(mi.load_dict({"type": name})).keys()
    except RuntimeError:  # it cannot be made without any
        return "See its page in Mitsuba's documentation."
    names = list(dict.fromkeys(key.split(".")[0] for key in keys))
    close = difflib.get_close_matches(parameter, names, 3)
    guess = f"Did you mean {' or '.join(close)}? " if close else ""
    return f"{guess}It has, among others: {', '.join(names) or 'none'}."


@contextmanager
def explained(name: str) -> Iterator[None]:
    """Turn an exception of Mitsuba's into a `UsageError` of one line."""
    try:
        yield
    except RuntimeError as error:
        text = one_line(str(error))
        if re.search(rf'Plugin "{re.escape(name)}" not found', text):
            raise UsageError(f"there is no BSDF {name!r}. {near(name)}") from None
        text = re.sub(r"^(At|While loading) dictionary node \"root\": ", "", text)
        text = re.sub(r"^failed to instantiate (unknown|bsdf) plugin of type \"\w+\": ", "", text)
        text = re.sub(r"^\[\w+\] ", "", text)
        unknown = re.match(r'Found \d+ unreferenced propert(?:y|ies) in bsdf plugin of type "\w+": \w+ "(\w+)"', text)
        if unknown:
            text = f"{unknown[1]!r} is not a parameter of this BSDF. {near_parameter(name, unknown[1])}"
        raise UsageError(text if text.startswith(f"{name}: ") else f"{name}: {text}") from None
