"""What a reflection model declares. Everything else (plugin, XML, gradients, fit, checks) follows from this."""

from __future__ import annotations

from enum import Enum
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import drjit as dr

from . import geometry
from .errors import UsageError
from .param import Param

#: Cosines up to here are in the surface. Above, the sharpest lobe over the product of two cosines, and its derivatives
#: in the parameters, are finite in float32.
TANGENT = 2.0**-43

Values = SimpleNamespace
"""Parameter values by name: numbers as Dr.Jit floats, colours as Dr.Jit colours, one entry a direction pair."""


class Lobe(Enum):
    """How a part of a model spreads light: over many directions, or, if it is `ideal`, into one."""

    DIFFUSE = "diffuse"
    GLOSSY = "glossy"
    MIRROR = "mirror"
    DIFFUSE_TRANSMISSION = "diffuse transmission"
    GLOSSY_TRANSMISSION = "glossy transmission"
    REFRACTION = "refraction"
    STRAIGHT = "straight"

    @property
    def ideal(self) -> bool:
        """Whether all light of one direction goes into one direction: see `Model.ideal`."""
        return self in (Lobe.MIRROR, Lobe.REFRACTION, Lobe.STRAIGHT)

    @property
    def transmits(self) -> bool:
        """Whether light leaves on the other side of the surface."""
        return self not in (Lobe.DIFFUSE, Lobe.GLOSSY, Lobe.MIRROR)


class Ideal(NamedTuple):
    """What an ideal lobe does with the light of one direction.

    ``wo`` is where it goes, a unit vector; ``weight`` the fraction of the power that goes there, in [0, 1] (a number or
    a colour); ``eta`` the index of refraction on the side of `wo` over that on the side of `wi`, 1 but for refraction.
    """

    wo: Any
    weight: Any
    eta: Any = 1.0


class Model:
    """A reflection model: subclass it, name it, declare its parameters and lobes, write `f`.

    An instance is the model with its choices made: ``CookTorrance(fresnel="schlick").fresnel == "schlick"``.

    Conventions: directions are in the local frame, ``n = (0, 0, 1)``, unit length, away from the surface; `wi` is given
    (the viewer), `wo` is the other. A value that depends on a lobe is a tuple with one entry a lobe. Methods may assume
    ``wi.z > 0`` and ``wo.z > 0``: who calls them masks the rest (`evaluate` does). They are traced by Dr.Jit, in
    float32 or float64, on one direction or millions: branch with ``dr.select``, on choices with ``if``.

    A model with a lobe that transmits is asked from both sides: `wi` and `wo` may each be above or below, but not in
    the surface. What a reflecting lobe says of a pair on opposite sides is masked as well, and what a transmitting one
    says of a pair on the same side; it must only be finite. A smooth lobe that transmits leads into a medium of the
    same index, as a sheet does. An ideal lobe says all in `ideal`; its entries in `f` and `pdf` are 0.

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
    trials : tuple of dict
        Where the checks look, each as values of some parameters: the defaults, and the corners where it is hard.
    """

    name: ClassVar[str]
    summary: ClassVar[str] = ""
    source: ClassVar[tuple[str, ...]] = ()
    params: ClassVar[tuple[Param, ...]] = ()
    lobes: ClassVar[tuple[Lobe, ...]] = (Lobe.DIFFUSE,)
    trials: ClassVar[tuple[dict[str, Any], ...]] = ({},)

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

    @property
    def transmits(self) -> bool:
        """Whether any lobe lets light through."""
        return any(lobe.transmits for lobe in self.lobes)

    @property
    def anisotropic(self) -> bool:
        """Whether it changes when the surface turns about its normal, under the choices made."""
        return False

    def faults(self) -> dict[str, str]:
        """What the model is known to break, under the choices made: ``{check: reason}``, by the names of the checks.

        A check named here is expected to fail, for this reason; that it does not fail is then a failure.
        """
        return {}

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any, ...]:
        """The BRDF of each lobe [1/sr], without the cosine; 0 for an ideal lobe."""
        if all(lobe.ideal for lobe in self.lobes):
            return (0.0,) * len(self.lobes)
        raise NotImplementedError(f"{self.name}: f is not written. A model needs at least f.")

    def exact(self, p: Values, wi: Any, wo: Any) -> Any:
        """The sum of `f` over the smooth lobes once more, plainly, in mpmath: optional, for ``brdf check --hard``.

        `wi` and `wo` are triples, parameters are numbers, those of colours too. Directions are rounded, not quite of
        unit length: write what `f` does with such ones.
        """
        raise NotImplementedError(f"{self.name}: exact is not written.")

    def ideal(self, p: Values, wi: Any, lobe: int) -> Ideal:
        """What lobe number `lobe`, an ideal one, does with light from `wi`."""
        raise NotImplementedError(f"{self.name}: ideal is not written. A model with an ideal lobe needs it.")

    def sample(self, p: Values, wi: Any, u: Any, lobe: int) -> Any:
        """A direction `wo` from lobe number `lobe`, a smooth one, from `u` in [0, 1)^3. Default: cosine-weighted."""
        wo = geometry.cosine_hemisphere(u, wi)
        z = -wo.z if self.lobes[lobe].transmits else wo.z
        return type(wi)(wo.x, wo.y, dr.mulsign(z, wi.z) if self.transmits else z)

    def pdf(self, p: Values, wi: Any, wo: Any) -> tuple[Any, ...]:
        """The density of `sample` of each lobe, with respect to solid angle [1/sr]; 0 for an ideal lobe."""
        z = abs(wo.z) if self.transmits else wo.z
        return tuple(0.0 if lobe.ideal else z * dr.inv_pi for lobe in self.lobes)

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
    """The whole BSDF [1/sr] but for its ideal lobes: the sum of the others.

    It is 0, and so are its derivatives, where either direction is not above the surface; if the model transmits, where
    either is in the surface. Elsewhere it is NaN where a component of a direction is NaN, or a parameter that the value
    depends on. (NaN as a literal of Dr.Jit does not count: LLVM folds it into anything. Values of a scene are opaque.)
    """
    dark = unlit(model, wi, wo)
    up = type(wi)(0, 0, 1)
    i, o = dr.select(dark, up, wi), dr.select(dark, up, wo)
    total = type(wi)(unknown(wi, wo))
    for lobe, f in zip(model.lobes, model.f(p, i, o), strict=True):
        if not lobe.ideal:
            total += dr.select(opposite(i, o) == lobe.transmits, f, 0) if model.transmits else f
    return dr.select(dark, 0, total)


def unlit(model: Model, wi: Any, wo: Any) -> Any:
    """Whether one of the directions is where `model` has nothing to say: below the surface, or in it."""
    zi, zo = (abs(wi.z), abs(wo.z)) if model.transmits else (wi.z, wo.z)
    return (zi <= TANGENT) | (zo <= TANGENT)


def unknown(wi: Any, wo: Any) -> Any:
    """NaN where a component of either direction is NaN, else 0, without gradient."""
    return dr.select(dr.isnan(wi.x + wi.y + wi.z + wo.x + wo.y + wo.z), dr.nan, 0)


def opposite(wi: Any, wo: Any) -> Any:
    """Whether two directions are on opposite sides of the surface."""
    return (wi.z > 0) != (wo.z > 0)
