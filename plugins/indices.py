"""Indices of refraction as Mitsuba's XML gives them: two media by number or name, or a measured metal."""

from __future__ import annotations

import contextlib
import functools
from typing import Any

import mitsuba as mi
import numpy as np

from brdf import Model, UsageError

#: What may stand in XML for `eta`: the media inside and outside, and what they are if left out, as in Mitsuba.
MEDIA = {"int_ior": "bk7", "ext_ior": "air"}
#: What may stand for `eta` and `k`: Al, Au, Cu, ... of Mitsuba's measured tables.
MATERIAL = "material"


def accepted(model: type[Model]) -> tuple[str, ...]:
    """What XML may give instead of the indices that a model declares: by their names, `eta`, or `eta` and `k`."""
    names = {p.name for p in model.params}
    kinds = {p.name: p.kind for p in model.params}
    media = tuple(MEDIA) if kinds.get("eta") == "number" else ()
    return media + ((MATERIAL,) if {"eta", "k"} <= names else ())


def resolve(model: type[Model], props: mi.Properties) -> None:
    """Replace ``int_ior``, ``ext_ior`` and ``material`` in the properties of a plugin by `eta` and `k`.

    Raises
    ------
    UsageError
        Both are given, or a name is not known.
    """
    may = accepted(model)
    given = [name for name in may if name in props]
    if not given:
        return
    twice = [name for name in ("eta", "k") if name in props]
    if twice or (MATERIAL in given and len(given) > 1):
        raise UsageError(
            f"{model.name}: {' and '.join(given + twice)} are both given. They say the same: leave one out."
        )
    if MATERIAL in given:
        for name, value in metal(model.name, props[MATERIAL]).items():
            props[name] = value
    else:
        inside, outside = (index(model.name, name, props[name] if name in props else MEDIA[name]) for name in MEDIA)
        props["eta"] = inside / outside
    for name in given:
        del props[name]


def index(owner: str, name: str, given: Any) -> float:
    """An index of refraction given as a number, or by name as Mitsuba does: ``air`` is 1.000277."""
    if isinstance(given, int | float) and not isinstance(given, bool) and given > 0:
        return float(given)
    if isinstance(given, str):
        with contextlib.suppress(RuntimeError):
            return named(given)
    raise UsageError(
        f"{owner}: {name} = {shown(given)} is neither a number above 0 nor a medium that Mitsuba knows: air, water, "
        "bk7, ... A texture goes on eta."
    )


def shown(given: Any) -> str:
    """What was given, in one line."""
    return type(given).__name__ if isinstance(given, mi.Object) else repr(given)


@functools.cache
def named(medium: str) -> float:
    """The index of a medium that Mitsuba knows; `RuntimeError` for another."""
    between = mi.load_dict({"type": "dielectric", "int_ior": 1.0, "ext_ior": medium})
    return 1.0 / float(np.asarray(mi.traverse(between)["eta"]).ravel()[0])


def metal(owner: str, material: str) -> dict[str, Any]:
    """``eta`` and ``k`` of a measured metal: colours in the RGB variants, else spectra."""
    if material == "none":  # as in Mitsuba: a perfect mirror
        return {"eta": 0.0, "k": 1.0}
    try:
        made = mi.load_dict({"type": "roughconductor", "material": material})
    except RuntimeError:
        raise UsageError(
            f"{owner}: material = {shown(material)} is no metal that Mitsuba has measured: Ag, Al, Au, Cr, Cu, W, ..."
        ) from None
    if mi.is_rgb:
        params = mi.traverse(made)
        return {name: mi.ScalarColor3d(*np.asarray(params[f"{name}.value"]).ravel()) for name in ("eta", "k")}

    class Pick(mi.TraversalCallback):  # exists only once a variant is set
        def put(self, name: str, value: Any, flags: Any, cpptype: Any = None) -> None:
            if isinstance(value, mi.Object):
                self.put_object(name, value, flags)

        def put_value(self, name: str, ptr: Any, flags: Any, cpptype: Any) -> None:
            pass

        def put_object(self, name: str, obj: Any, flags: Any) -> None:
            found[name] = obj

    found: dict[str, Any] = {}
    made.traverse(Pick())
    return {name: found[name] for name in ("eta", "k")}
