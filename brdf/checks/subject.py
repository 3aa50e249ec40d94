"""What the checks ask: a BSDF as a few functions, whatever it is made of."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from drjit.llvm.ad import Array3f64

from ..model import Lobe, Model, Values, defaults, opposite, unlit

#: The largest float32 below 1: a random number stays inside [0, 1) in both precisions.
BELOW_ONE = 1 - 2.0**-24


@dataclass(frozen=True)
class Part:
    """What a lobe does: `smooth` spreads light over directions, `ideal` sends all of one direction into one.

    A BSDF whose lobes cannot be asked one by one is a single part that may do all of it.
    """

    name: str
    smooth: bool = True
    ideal: bool = False
    glossy: bool = False
    reflects: bool = True
    transmits: bool = False


class Sample(NamedTuple):
    """Directions drawn. ``weight`` is the power over the density: ``f cos / pdf``, or that of an ideal lobe over how
    often it is chosen, which is then its ``pdf``; 0 where no direction came out. ``eta`` is the index of refraction on
    the side of `wo` over that on the side of `wi`."""

    wo: Any
    weight: Any
    pdf: Any
    lobe: Any
    ideal: Any
    eta: Any


class Quantity(NamedTuple):
    """A parameter in which one may differentiate: its name and the range in which the value may be moved."""

    name: str
    bounds: tuple[float, float] = (-math.inf, math.inf)


class Subject(ABC):
    """A BSDF to be checked.

    Directions are Dr.Jit vectors of the type `vector`, in the local frame, away from the surface; `wi` is the viewer.
    Every method may be asked for any pair of directions, and says 0 where there is nothing. With ``lobe=None`` all
    lobes count.

    Attributes
    ----------
    name : str
    vector : type of Dr.Jit 3-vector
        Gives precision and backend.
    lobes : tuple of Part
    anisotropic : bool
        Whether it changes when the surface turns about its normal.
    settings : dict
        Plain values that make this subject: parameters and choices.
    """

    name: str
    vector: Any
    lobes: tuple[Part, ...]
    anisotropic: bool
    settings: dict[str, Any]

    @abstractmethod
    def f(self, wi: Any, wo: Any, lobe: int | None = None) -> Any:
        """The BSDF [1/sr] for radiance, without the cosine, of the smooth lobes."""

    @abstractmethod
    def pdf(self, wi: Any, wo: Any, lobe: int | None = None) -> Any:
        """The density of `sample` [1/sr], of the smooth lobes."""

    @abstractmethod
    def sample(self, wi: Any, u: Any, lobe: int | None = None) -> Sample:
        """Directions from `u` in [0, 1)^3."""

    def draw(self, wi: Any, u: Any, lobe: int | None = None) -> Sample:
        """What `sample` says, computed at once instead of entry by entry."""
        drawn = self.sample(wi, u, lobe)
        dr.eval(drawn)
        return drawn

    @abstractmethod
    def quantities(self) -> tuple[Quantity, ...]:
        """The parameters in which one may differentiate."""

    @abstractmethod
    def get(self, name: str) -> Any:
        """The value of a parameter, a Dr.Jit array."""

    @abstractmethod
    def set(self, name: str, value: Any) -> None:
        """Give a parameter another value, which may carry a gradient."""

    def adjoint(self, wi: Any, wo: Any, lobe: int | None = None) -> Any:
        """The BSDF for power instead of radiance: ``f(wi, wo) = adjoint(wo, wi)`` if light can go back on its way.

        The two differ by the squared index of refraction, where light changes the medium.
        """
        return self.f(wi, wo, lobe)

    @property
    def transmits(self) -> bool:
        return any(part.transmits for part in self.lobes)

    @property
    def smooth(self) -> bool:
        return any(part.smooth for part in self.lobes)

    @property
    def double(self) -> bool:
        """Whether it computes in float64."""
        return dr.type_v(self.vector) == dr.VarType.Float64

    def command(self) -> str:
        """A line for the shell that checks this subject again; empty if there is none."""
        return ""

    def case(self, **more: Any) -> dict[str, Any]:
        """Plain values that say where something was found."""
        command = self.command()
        return {"parameters": dict(self.settings), **more, **({"command": command} if command else {})}


class ModelSubject(Subject):
    """A `Model` with its choices made, at some values of its parameters."""

    def __init__(self, model: Model, vector: Any = Array3f64, **values: Any) -> None:
        self.model, self.vector, self.name = model, vector, model.name
        self.lobes = tuple(part_of(i, lobe) for i, lobe in enumerate(model.lobes))
        self.anisotropic = model.anisotropic
        self.values: Values = defaults(model, vector, **values)
        dr.make_opaque(vars(self.values))  # one kernel for all values
        choices = {p.name: getattr(model, p.name) for p in model.params if p.kind == "choice"}
        shown = {p.name: values.get(p.name, p.default) for p in model.parameters()}
        self.settings = {**shown, **choices}

    def on_its_side(self, wi: Any, wo: Any, entries: Any, lobe: int | None) -> Any:
        """The sum of some entries, one a lobe, each where it counts."""
        good, i, o = self.harmless(wi, wo)
        total = 0
        for number, (kind, value) in enumerate(zip(self.model.lobes, entries(i, o), strict=True)):
            if not kind.ideal and lobe in (None, number):
                here = opposite(i, o) == kind.transmits if self.model.transmits else True
                total += dr.select(good & here, value, 0)
        return total

    def harmless(self, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
        """Where the model is asked, and the directions, those not asked made harmless before anyone divides by them."""
        good = ~unlit(self.model, wi, wo)
        return good, *(self.vector(w.x, w.y, dr.select(good, w.z, 1)) for w in (wi, wo))

    def f(self, wi: Any, wo: Any, lobe: int | None = None) -> Any:
        zero = self.vector(0) + 0 * (wi.z + wo.z)
        return zero + self.on_its_side(wi, wo, lambda i, o: self.model.f(self.values, i, o), lobe)

    def pdf(self, wi: Any, wo: Any, lobe: int | None = None) -> Any:
        def entries(i: Any, o: Any) -> Any:
            densities = self.model.pdf(self.values, i, o)
            if lobe is not None:
                return densities
            return tuple(c * q for c, q in zip(self.chances(i), densities, strict=True))

        return 0 * (wi.z + wo.z) + self.on_its_side(wi, wo, entries, lobe)

    def chances(self, wi: Any) -> list[Any]:
        """Probability of each lobe."""
        weights = [dr.detach(w) for w in self.model.choose(self.values, wi)]
        total = sum(weights, 0 * wi.z)
        black = total <= 0
        return [dr.select(black, 1 / len(weights), w / dr.select(black, 1, total)) for w in weights]

    def sample(self, wi: Any, u: Any, lobe: int | None = None) -> Sample:
        good, i, _ = self.harmless(wi, self.vector(0, 0, 1))
        numbers = range(len(self.lobes)) if lobe is None else [lobe]
        chances = self.chances(i) if lobe is None else {lobe: 1.0}
        start, rest, picked = 0 * i.z, u.z, dr.uint32_array_t(i.z)(numbers[0])
        for number in numbers if lobe is None else []:
            end = start + chances[number]
            here = (u.z >= start) & ((u.z < end) | (number == numbers[-1]))
            picked = dr.select(here, number, picked)
            within = (u.z - start) / dr.select(here & (chances[number] > 0), chances[number], 1)
            rest = dr.select(here, dr.clip(within, 0, BELOW_ONE), rest)
            start = end
        point = self.vector(u.x, u.y, rest)
        wo, weight = self.vector(0, 0, 1) + 0 * i, self.vector(0) + 0 * i
        pdf, eta, ideal = 0 * i.z, 1 + 0 * i.z, i.z != i.z
        for number in numbers:
            here = picked == number
            if self.lobes[number].ideal:
                sent = self.model.ideal(self.values, i, number)
                here &= chances[number] > 0
                wo = dr.select(here, sent.wo, wo)
                weight = dr.select(here, sent.weight / dr.select(here, chances[number], 1), weight)
                pdf, eta = dr.select(here, chances[number], pdf), dr.select(here, sent.eta, eta)
                ideal |= here
            else:
                wo = dr.select(here, self.model.sample(self.values, i, point, number), wo)
        density = self.pdf(i, wo, lobe)
        counts = ~ideal & (density > 0)
        value = self.f(i, wo, lobe) * (abs(wo.z) / dr.select(counts, density, 1))
        weight = dr.select(ideal, weight, dr.select(counts, value, 0))
        pdf = dr.select(ideal, pdf, dr.select(counts, density, 0))
        return Sample(wo, dr.select(good, weight, 0), dr.select(good, pdf, 0), picked, ideal, eta)

    def quantities(self) -> tuple[Quantity, ...]:
        return tuple(Quantity(p.name, p.bounds) for p in self.model.parameters())

    def get(self, name: str) -> Any:
        return getattr(self.values, name)

    def set(self, name: str, value: Any) -> None:
        setattr(self.values, name, value)

    def command(self) -> str:
        usual = {p.name: p.default for p in self.model.params}
        return shell_line(self.name, {name: v for name, v in self.settings.items() if v != usual[name]})


def part_of(number: int, lobe: Lobe) -> Part:
    """What a lobe of a model does."""
    glossy = lobe in (Lobe.GLOSSY, Lobe.GLOSSY_TRANSMISSION)
    return Part(f"{number} {lobe.value}", not lobe.ideal, lobe.ideal, glossy, not lobe.transmits, lobe.transmits)


def shell_line(name: str, settings: dict[str, Any]) -> str:
    """``brdf check NAME --set m=0.3 --set reflectance=0.2,0.4,0.8``."""
    words = [f"brdf check {name}"]
    for key, value in settings.items():
        parts = [value] if isinstance(value, str) else [f"{float(v):.9g}" for v in np.ravel(value)]
        words.append(f"--set {key}={parts[0] if len(set(parts)) == 1 else ','.join(parts)}")
    return " ".join(words)
