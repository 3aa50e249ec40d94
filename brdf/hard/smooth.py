"""Models with smooth surfaces, layers and grooves, under their choices."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import drjit as dr
import numpy as np

from ..model import Model
from ..models.diffusion import Diffusion, total_reflectance
from ..models.glass import Glass
from ..models.glazed import Glazed
from ..models.grooved import Grooved
from ..models.hanrahankrueger import HanrahanKrueger
from ..models.metal import Metal
from ..models.mirror import Mirror
from . import grid
from .formulas import (
    ALBEDO,
    CONDUCTOR,
    DIELECTRIC,
    FACETS,
    SHARP,
    WI,
    WO,
    Formula,
    Function,
    Limits,
    Points,
    directions,
    values,
    whole,
)
from .grid import HARD, METAL, Array, Draw, among

#: A product of two transmittances with what is as exact as `SHARP`. The derivative of either may be off as `DIELECTRIC`
#: says; the scale of the sum ``T_i' T_o + T_i T_o'`` is the sum of theirs, so that it is off by no more roundings.
THROUGH = Limits(SHARP.value, DIELECTRIC.slope)
#: Grooves: closed form, and derivatives in which what the floor gains and the arcs lose is put together first.
ARCS = Limits(SHARP.value, 8)
#: The lobe in a groove: Phong's. Near grazing the integral is nearly proportional to `spacing`, over which it is taken:
#: the derivative in it is the small difference between the lobe at an end and on the mean, and of either the power of a
#: cosine is off by as many roundings as the exponent has of it.
GROOVED = Limits(FACETS.value, 32)
#: Of a layer without a name: from next to nothing to all.
DECADES = among(tuple(10.0**e for e in range(-8, 7)))
ASYMMETRY = among((-0.95, -0.5, -1e-3, 0.0, 1e-6, 0.1, 0.5, 0.9, 0.95))


def one_side(draws: Mapping[str, Draw], below: bool) -> Points:
    """Directions and parameters; often special for `eta`, if it is a dielectric's. Half of them from below, if any."""

    def points(rng: np.random.Generator, n: int) -> Mapping[str, Array]:
        p = {name: draw(rng, n) for name, draw in draws.items()}
        side = np.where(below & (rng.random(n) < 0.5), -1, 1)
        dielectric = "eta" in p and "k" not in p
        c = grid.special(rng, p["eta"] ** side) if dielectric else grid.cosines(rng, n)
        wi = grid.unit(c, rng.uniform(0, 2 * np.pi, n))
        wi[:, 2] *= side
        return {**directions(wi), **p}

    return points


def ideal(
    model: Model, lobe: int, called: str, limits: Limits, draws: Mapping[str, Draw], by: tuple[str, ...] = ()
) -> Formula:
    """What of the light an ideal lobe sends on; by all parameters that it depends on."""

    def function(vector: Any, v: SimpleNamespace) -> Any:
        weight = model.ideal(values(model, vector, v), vector(v.wi_x, v.wi_y, v.wi_z), lobe).weight
        return weight.x if dr.size_v(weight) == 3 else weight

    return of_direction(f"{model.name}, {called}", model, function, limits, draws, by)


def of_direction(
    name: str, model: Model, function: Function, limits: Limits, draws: Mapping[str, Draw], by: tuple[str, ...] = ()
) -> Formula:
    """A function of one direction and the parameters of a model."""
    numbers = tuple(p.name for p in model.parameters())
    points = one_side({q: draws.get(q, ALBEDO) for q in numbers}, model.transmits)
    return Formula(name, model.name, (*WI, *numbers), by or numbers, function, points, limits)


def refracted(component: Callable[[Any], Any]) -> Function:
    """Of the direction behind the surface."""

    def function(vector: Any, v: SimpleNamespace) -> Any:
        return component(Glass().ideal(values(Glass(), vector, v), vector(v.wi_x, v.wi_y, v.wi_z), 1).wo)

    return function


def sine(w: Any) -> Any:
    """Of the angle to the normal; with derivative 0 at the normal itself."""
    square = w.x * w.x + w.y * w.y
    return dr.select(square > 0, dr.sqrt(dr.select(square > 0, square, 1)), 0)


def glazed(**choices: str) -> list[Formula]:
    """Base and mirror under a choice."""
    model = Glazed(**choices)
    chosen = "".join(f"{c} " for c in choices.values())
    draws = {"eta": among(HARD["index above 1"]), "diffuse_reflectance": ALBEDO, "specular_reflectance": ALBEDO}
    exact = model.fresnel == "exact"
    mirror = ideal(model, 0, f"{chosen}mirror", DIELECTRIC if exact else SHARP, draws, ("eta", "specular_reflectance"))
    return [whole(model, THROUGH if exact else SHARP, draws, independent), mirror]


def independent(p: Mapping[str, Array]) -> Array:
    """No lobe: as wide as any."""
    return np.ones_like(next(iter(p.values())))


def dipole(vector: Any, v: SimpleNamespace) -> Any:
    """What comes up of even light inside."""
    return total_reflectance(values(Diffusion(), vector, v)).x


def coefficients(rng: np.random.Generator, n: int) -> Mapping[str, Array]:
    """Of scattering, and the index."""
    return {name: draw(rng, n) for name, draw in SCATTERING.items()}


GLASS = {"eta": among(HARD["index"])}
SCATTERING = {
    "sigma_s": among((1e-3, 0.1, 1.0, 10.0, 1e4)),
    "sigma_a": DECADES,
    "g": ASYMMETRY,
    "eta": among(HARD["index above 1"]),
}
GROOVES = {
    "reflectance": ALBEDO,
    "specular_reflectance": ALBEDO,
    "exponent": among((1.0, 1.5, 2.0, 3.0, 10.0, 30.0, 100.0, 1e3, 1e4)),
    "spacing": among((2.0, 2 + 2.0**-20, 2.1, 2.5, 4.0, 8.0, 20.0)),
    "height": among((0.0, 1e-6, 1e-3, 0.1, 0.3, 0.7, 0.99, 0.999)),
}
#: Optical depths from nothing to a million, most of them below a hundred.
LAYER = {
    "sigma_s": among((0.0, 1e-8, 1e-4, 1e-2, 0.1, 1.0, 10.0, 1e3)),
    "sigma_a": among((0.0, 1e-8, 1e-4, 1e-2, 0.1, 1.0, 10.0, 1e3)),
    "thickness": among((1e-3, 1e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 1e3)),
    "g": ASYMMETRY,
    "eta": among((1.0, *HARD["index above 1"])),
}


def grooved(part: str, numbers: tuple[str, ...], limits: Limits) -> Formula:
    """The part of a row of grooves that one of its reflectances weighs."""
    model = Grooved()
    formula = whole(model, limits, GROOVES, lambda p: 1 / np.sqrt(p["exponent"]))
    black = {"reflectance": 0.0, "specular_reflectance": 0.0, "exponent": 1.0}

    def function(vector: Any, v: SimpleNamespace) -> Any:
        return formula.function(vector, SimpleNamespace(**{**black, **vars(v)}))

    return replace(
        formula, name=f"grooved, {part}", inputs=(*WI, *WO, *numbers), by=numbers, function=function, model=model
    )


def index_1() -> Formula:
    """A layer whose sides neither reflect nor refract: what scattering does, by itself."""
    formula = whole(HanrahanKrueger(), SHARP, {**LAYER, "eta": among((1.0,))}, lambda p: 1 - np.abs(p["g"]))
    return replace(formula, name="hanrahankrueger, index 1", by=tuple(q for q in formula.by if q != "eta"))


SMOOTH: list[Formula] = [
    ideal(Mirror(), 0, "reflected", SHARP, {}),
    ideal(Metal(), 0, "reflected", CONDUCTOR, METAL),
    ideal(Glass(), 0, "reflected", DIELECTRIC, GLASS, ("eta", "specular_reflectance")),
    ideal(Glass(), 1, "refracted", DIELECTRIC, GLASS, ("eta", "specular_transmittance")),
    of_direction("glass, refracted cosine", Glass(), refracted(lambda w: w.z), DIELECTRIC, GLASS, ("eta",)),
    of_direction("glass, refracted sine", Glass(), refracted(sine), DIELECTRIC, GLASS, ("eta",)),
    *glazed(),
    *glazed(fresnel="schlick"),
    *glazed(fresnel="constant"),
    whole(Diffusion(), THROUGH, SCATTERING, independent),
    Formula("diffusion, dipole", "diffusion", tuple(SCATTERING), tuple(SCATTERING), dipole, coefficients, SHARP),
    whole(HanrahanKrueger(), THROUGH, LAYER, lambda p: 1 - np.abs(p["g"])),
    index_1(),
    grooved("diffuse", ("reflectance", "spacing", "height"), ARCS),
    grooved("phong", ("specular_reflectance", "exponent", "spacing", "height"), GROOVED),
    ideal(HanrahanKrueger(), 2, "unscattered", DIELECTRIC, LAYER, ("sigma_s", "sigma_a", "thickness", "eta")),
]
