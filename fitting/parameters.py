"""The parameters of a fit: where they live in the scene, and the coordinates in which a solver moves them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from brdf import Param, UsageError
from plugins import peers
from plugins.scene import Bsdf, Scene, find, leaf

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Free:
    """One parameter to be fitted: its name ``ID.PARAM``, declaration, material, and its entry in the scene."""

    name: str
    param: Param
    material: Bsdf
    entry: Any
    key: str
    start: Array | None

    @property
    def size(self) -> int:
        return 3 if self.param.kind == "colour" else 1


def declared(material: Bsdf, others: Iterable[str] = ()) -> dict[str, Param]:
    """The parameters a material can be fitted in, by name: of our models as declared, of Mitsuba's own from a table.

    `others` are the names of all materials, for the message.

    Raises
    ------
    UsageError
        A BSDF that cannot be fitted.
    """
    model = getattr(material.bsdf, "model", None)
    params = model.parameters() if model is not None else peers.TABLE.get(material.plugin, ())
    if not params:
        inside = [name for name in others if name.startswith(f"{material.id}.bsdf")]
        if inside:
            raise UsageError(
                f"{material.id}: a BSDF of type {material.plugin!r} has nothing to fit. What is inside it is named "
                f"{' and '.join(inside)}."
            )
        raise UsageError(
            f"{material.id}: a BSDF of type {material.plugin!r} cannot be fitted. "
            f"Use a model that `brdf models` lists, or one of Mitsuba's: {', '.join(sorted(peers.TABLE))}."
        )
    return {p.name: p for p in params}


def asked(text: str) -> tuple[str, list[float] | None]:
    """Split ``ID.PARAM[=START]``: the name, and the start if there is one.

    Raises
    ------
    UsageError
        A start that is not a number, nor three with commas between.
    """
    name, equals, start = text.partition("=")
    try:
        return name, [float(part) for part in start.split(",")] if equals else None
    except ValueError:
        raise UsageError(
            f"{text!r}: the start {start!r} is not a number, nor R,G,B. Numbers and colours are fitted; a choice is "
            "made in the scene."
        ) from None


def resolve(scene: Scene, wanted: dict[str, Any]) -> list[Free]:
    """Find what ``{"ID.PARAM": start or None}`` names.

    Raises
    ------
    UsageError
        An unknown id or parameter (with the near names), a start outside the bounds, nothing to fit.
    """
    if not wanted:
        raise UsageError("nothing to fit: name at least one parameter, as in --fit ball.m.")
    found = []
    for name, start in wanted.items():
        identifier, dot, parameter = name.rpartition(".")
        if not dot:
            raise UsageError(f"{name!r} is not of the form ID.PARAM, as in ball.m.")
        material = find(scene, identifier)
        params = declared(material, scene.bsdfs)
        if parameter not in params:
            near = difflib.get_close_matches(parameter, params, 1)
            guess = f" Did you mean {near[0]}?" if near else ""
            raise UsageError(
                f"{identifier}: {parameter!r} is not a parameter to fit.{guess} It has: {', '.join(params)}."
            )
        param = params[parameter]
        size = 3 if param.kind == "colour" else 1
        value = None
        if start is not None:
            value = np.atleast_1d(np.asarray(start, dtype=float)).ravel()
            if value.size not in (1, size):
                raise UsageError(f"{name}: the start has {value.size} numbers, expected {size}.")
            param.check(identifier, value)
            value = np.broadcast_to(value, (size,)).copy()
        entry, key = leaf(material.bsdf, parameter)
        if param.kind == "colour" and not isinstance(entry[key], mi.Color3f):
            raise UsageError(f"{name}: given as one number in the scene. Write it as <rgb> to fit it as a colour.")
        found.append(Free(name, param, material, entry, key, value))
    return found


class Parameters:
    """All free parameters as one vector `x`, in the coordinates of their scales (log m, log(eta - 1), ...)."""

    def __init__(self, free: Sequence[Free]) -> None:
        self.free = list(free)
        self.components = [
            name for f in free for name in ([f.name] if f.size == 1 else [f"{f.name}.{c}" for c in "rgb"])
        ]
        self.params = [f.param for f in free for _ in range(f.size)]
        ends = [(p.to_free(p.interior()[0]), p.to_free(p.interior()[1])) for p in self.params]
        self.low = np.array([e[0] for e in ends])
        self.high = np.array([e[1] for e in ends])

    def __len__(self) -> int:
        return len(self.components)

    def values(self, x: Array) -> Array:
        """Physical values of `x`; at an end of a logit range, which the transform does not reach, the bound itself."""
        out = np.array([p.to_value(v) for p, v in zip(self.params, x, strict=True)])
        logit = np.array([p.scale == "logit" for p in self.params])
        bounds = np.array([p.bounds for p in self.params])
        out = np.where(logit & (x <= self.low), bounds[:, 0], out)
        return np.where(logit & (x >= self.high), bounds[:, 1], out)

    def free_of(self, values: Array) -> Array:
        """The `x` of physical values."""
        return np.array([p.to_free(v) for p, v in zip(self.params, values, strict=True)])

    def slope(self, x: Array) -> Array:
        """``d value / d x`` of each component."""
        return np.array([p.slope(v) for p, v in zip(self.params, x, strict=True)])

    def by_name(self, values: Array) -> dict[str, Array]:
        """Split a vector over components into one array a parameter."""
        out, i = {}, 0
        for f in self.free:
            out[f.name] = np.asarray(values[i : i + f.size])
            i += f.size
        return out

    def together(self) -> mi.SceneParameters:
        """All entries as one, which is how Mitsuba wants to be told what a rendering depends on."""
        properties = {f"{f.material.id}.{f.key}": f.entry.properties[f.key] for f in self.free}
        hierarchy = {node: above for f in self.free for node, above in f.entry.hierarchy.items()}
        return mi.SceneParameters(properties, hierarchy)

    def place(self, x: Array, differentiate: bool = False) -> list[mi.Float]:
        """Write the values of `x` into the scene; returns them as Dr.Jit variables, one a component.

        They are opaque to the compiler: a new value needs no new kernel.
        """
        variables = [dr.opaque(mi.Float, float(v)) for v in self.values(x)]
        if differentiate:
            dr.enable_grad(variables)
        i = 0
        for f in self.free:
            here = variables[i : i + f.size]
            f.entry[f.key] = here[0] if f.size == 1 else mi.Color3f(*here)
            i += f.size
        for entry in {id(f.entry): f.entry for f in self.free}.values():
            entry.update()
        return variables
