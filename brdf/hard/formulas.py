"""What a formula is, to be held against exact answers: its arguments, where they are hard, and how exact it must be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ..model import Model, Values, evaluate
from . import grid
from .grid import HARD, Array, Draw, among

Function = Callable[[Any, SimpleNamespace], Any]
Width = Callable[[Mapping[str, Array]], Array]
Points = Callable[[np.random.Generator, int], Mapping[str, Array]]
WI, WO = ("wi.x", "wi.y", "wi.z"), ("wo.x", "wo.y", "wo.z")

ALBEDO = among(HARD["albedo"])


def BLACK(rng: np.random.Generator, n: int) -> Array:
    """Albedos of a diffuse base, nine of ten 0: it would hide the lobe, to which it adds its albedo over pi."""
    return np.where(rng.random(n) < 0.1, ALBEDO(rng, n), 0.0)


class Limits(NamedTuple):
    """Roundings that value and derivatives may be off."""

    value: float
    slope: float


SHARP = Limits(4, 4)  # D, G, Ward, Blinn, Hanrahan and Krueger, dipole, Schlick
DIELECTRIC = Limits(8, 16)
#: At all points, not 99 of 100. Beyond there used to be metals near 1 and nearly clear ones, where the reflectance
#: goes to 1, and is 1 - T now; and k = 0 next to the critical angle, where the derivative in k is 0 and the exact
#: answers had what a step leaves of the second one.
CONDUCTOR = Limits(8, 32)
FACETS = Limits(4, 8)  # Cook and Torrance on a dielectric; Phong


@dataclass(frozen=True)
class Formula:
    """A function of float32 numbers.

    Attributes
    ----------
    name : str
        Unique; begins with the owner's.
    owner : str
        A model's name, or "bricks".
    inputs : tuple of str
        Names of its arguments: ``"wi.x"`` ... ``"wo.z"`` for components of directions.
    by : tuple of str
        The continuous parameters among them.
    function : callable
        ``function(vector type, arguments by name)``, ``.`` in names written as ``_``; traced by Dr.Jit.
    points : callable
        ``points(rng, n)``: where it is hard, by the names of the inputs.
    limits : Limits
    reciprocal : bool
        Whether the value must be the same with wi and wo exchanged, bit for bit.
    model : Model or None
        Whose `evaluate` it is.
    """

    name: str
    owner: str
    inputs: tuple[str, ...]
    by: tuple[str, ...]
    function: Function
    points: Points
    limits: Limits
    reciprocal: bool = False
    model: Model | None = field(default=None, compare=False)

    def draw(self, seed: int, n: int) -> Array:
        """Points, shape (n_in, n), float32 numbers."""
        rng = np.random.default_rng([seed, *self.name.encode()])
        found = self.points(rng, n)
        return grid.single([found[name] for name in self.inputs])


def directions(*arrays: Array) -> dict[str, Array]:
    """By component, of wi and, if given, wo."""
    names = (WI, WO)
    return {name: a for w, given in zip(names, arrays, strict=False) for name, a in zip(w, given.T, strict=True)}


def values(model: Model, vector: Any, v: SimpleNamespace) -> Values:
    """The parameters of a model; colours are grey."""
    p = Values()
    for q in model.parameters():
        x = getattr(v, q.name)
        setattr(p, q.name, vector(x) if q.kind == "colour" else x)
    return p


def of_model(model: Model) -> Function:
    """`evaluate`, of the first channel: colours are grey."""

    def function(vector: Any, v: SimpleNamespace) -> Any:
        wi, wo = vector(v.wi_x, v.wi_y, v.wi_z), vector(v.wo_x, v.wo_y, v.wo_z)
        return evaluate(model, values(model, vector, v), wi, wo).x

    return function


def model_points(model: Model, draws: Mapping[str, Draw], width: Width | None) -> Points:
    """Directions about the lobe, and parameters: by `draws`, else over their bounds. If the model transmits, half of
    the directions are below, of wi and of wo."""

    def points(rng: np.random.Generator, n: int) -> Mapping[str, Array]:
        p = {q.name: (draws.get(q.name) or grid.within(q))(rng, n) for q in model.parameters()}
        wi, wo = grid.pairs(rng, width(p) if width else 10 ** rng.uniform(-6, 0, n))
        if model.transmits:
            wi[:, 2] *= rng.choice([-1, 1], n)
            wo[:, 2] *= rng.choice([-1, 1], n)
        return {**directions(wi, wo), **p}

    return points


def whole(model: Model, limits: Limits, draws: Mapping[str, Draw], width: Width | None) -> Formula:
    """A model under its choices: over the bounds of what `draws` leaves out, half vectors on the scale of `width`."""
    numbers = tuple(q.name for q in model.parameters())
    return Formula(
        name=called(model),
        owner=model.name,
        inputs=(*WI, *WO, *numbers),
        by=numbers,
        function=of_model(model),
        points=model_points(model, draws, width),
        limits=limits,
        reciprocal="reciprocity" not in model.faults(),
        model=model,
    )


def called(model: Model) -> str:
    """``cooktorrance, conductor smith``: the name, and the choices that are not the default."""
    defaults = {p.name: p.default for p in model.params if p.kind == "choice"}
    made = [getattr(model, name) for name, default in defaults.items() if getattr(model, name) != default]
    return ", ".join([model.name, " ".join(made)]) if made else model.name
