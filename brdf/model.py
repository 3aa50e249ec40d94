"""What a reflection model declares. Everything else (plugin, XML, gradients, fit, checks) follows from this."""

from __future__ import annotations

from enum import Enum
from types import SimpleNamespace
from typing import Any, ClassVar

import drjit as dr

from . import geometry
from .errors import UsageError
from .param import Param

Values = SimpleNamespace
"""Parameter values by name: numbers as Dr.Jit floats, colours as Dr.Jit colours, one entry a direction pair."""


class Lobe(Enum):
    """How a part of a model spreads light."""

    DIFFUSE = "diffuse"
    GLOSSY = "glossy"


class Model:
    """A reflection model: subclass it, name it, declare its parameters and lobes, write `f`.

    An instance is the model with its choices made: ``CookTorrance(fresnel="schlick").fresnel == "schlick"``.

    Conventions: directions are in the local frame, ``n = (0, 0, 1)``, unit length, away from the surface; `wi` is given
    (the viewer), `wo` is the other. A value that depends on a lobe is a tuple with one entry a lobe. Methods may assume
    ``wi.z > 0`` and ``wo.z > 0``: who calls them masks the rest (`evaluate` does). They are traced by Dr.Jit, in
    float32 or float64, on one direction or millions: branch with ``dr.select``, on choices with ``if``.

    Attributes
    ----------
    name : str
        One lower-case word: the Mitsuba type.
    summary : str
        One line: what it is for.
    source : tuple of str
        Keys of ``brdf/references.bib``, or a citation.
    params : tuple of Param
        Numbers, colours, then choices.
    lobes : tuple of Lobe
    """

    name: ClassVar[str]
    summary: ClassVar[str] = ""
    source: ClassVar[tuple[str, ...]] = ()
    params: ClassVar[tuple[Param, ...]] = ()
    lobes: ClassVar[tuple[Lobe, ...]] = (Lobe.DIFFUSE,)

    def __init__(self, **choices: str) -> None:
        declared = {p.name: p for p in type(self).params if p.kind == "choice"}
        for name in choices:
            if name not in declared:
                raise UsageError(
                    f"{self.name}: {name!r} is not a choice of this model. It has: {', '.join(declared) or 'none'}."
                )
        for name, p in declared.items():
            value = choices.get(name, p.default)
            p.check(self.name, value)
            setattr(self, name, value)

    def parameters(self) -> tuple[Param, ...]:
        """Numbers and colours that exist under the choices made, with the bounds and scale they then have.

        Override it where a choice changes what a parameter may be.
        """
        return tuple(p for p in self.params if p.kind != "choice")

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any, ...]:
        """The BRDF of each lobe [1/sr], without the cosine."""
        raise NotImplementedError(f"{self.name}: f is not written. A model needs at least f.")

    def sample(self, p: Values, wi: Any, u: Any, lobe: int) -> Any:
        """A direction `wo` from lobe number `lobe`, from `u` in [0, 1)^3. Default: cosine-weighted."""
        return geometry.cosine_hemisphere(u, wi)

    def pdf(self, p: Values, wi: Any, wo: Any) -> tuple[Any, ...]:
        """The density of `sample` of each lobe, with respect to solid angle [1/sr]."""
        return (wo.z * dr.inv_pi,) * len(self.lobes)

    def choose(self, p: Values, wi: Any) -> tuple[Any, ...]:
        """How often each lobe is sampled, up to a factor (a Dr.Jit float >= 0 each). Default: equally."""
        return (1.0,) * len(self.lobes)


def defaults(model: Model, like: Any, **values: Any) -> Values:
    """Parameter values of `model`: `values`, and defaults for the rest, as Dr.Jit numbers of the kind of `like`.

    Parameters
    ----------
    like : Dr.Jit 3-vector
        Gives the precision and the backend: ``drjit.llvm.ad.Array3f64`` and so on.
    values : float, 3-tuple or Dr.Jit arrays, by parameter name

    Raises
    ------
    UsageError
        An unknown name, or a plain number outside its bounds.
    """
    vector = like if isinstance(like, type) else type(like)
    scalar = dr.value_t(vector)
    out = {}
    for p in model.parameters():
        given = values.pop(p.name, p.default)
        if not dr.is_array_v(given):
            p.check(model.name, given)
        if p.kind == "number":
            out[p.name] = scalar(given)
        else:
            out[p.name] = vector(*given) if isinstance(given, tuple | list) else vector(given)
    if values:
        known = ", ".join(out)
        raise UsageError(f"{model.name}: {next(iter(values))!r} is not a parameter of this model. It has: {known}.")
    return Values(**out)


def evaluate(model: Model, p: Values, wi: Any, wo: Any) -> Any:
    """The whole BRDF [1/sr]: the sum of the lobes, and 0 where either direction is not above the surface."""
    above = (wi.z > 0) & (wo.z > 0)
    up = type(wi)(0, 0, 1)
    inside_i, inside_o = dr.select(above, wi, up), dr.select(above, wo, up)
    total = sum(model.f(p, inside_i, inside_o))
    return dr.select(above, total, 0)
