"""The bricks by themselves: D, G and F."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import drjit as dr
import numpy as np

from .. import fresnel, geometry, microfacet
from . import grid
from .formulas import CONDUCTOR, DIELECTRIC, SHARP, WI, WO, Formula, Limits, Points, directions
from .grid import HARD, METAL, Array, Draw, among


def one_direction(width: str = "roughness") -> Points:
    """A direction, and a roughness `m`."""

    def points(rng: np.random.Generator, n: int) -> Mapping[str, Array]:
        wi = grid.unit(grid.cosines(rng, n), rng.uniform(0, 2 * np.pi, n))
        return {**directions(wi), "m": among(HARD[width])(rng, n)}

    return points


def half_vectors(width: str = "roughness") -> Points:
    """A half vector: near the normal on the scale of the roughness `m`, and anywhere."""

    def points(rng: np.random.Generator, n: int) -> Mapping[str, Array]:
        m = among(HARD[width])(rng, n)
        wi, wo = grid.pairs(rng, m)
        return {**directions(grid.single(wi + wo)), "m": m}

    return points


INDEX = {"eta": among(HARD["index"])}


def facets(**parameters: Draw) -> Points:
    """The angle between light and facet, as ``H = |wi + wo|^2`` and ``Q = |wi - wo|^2``, often special for `eta`."""

    def points(rng: np.random.Generator, n: int) -> Mapping[str, Array]:
        p = {name: draw(rng, n) for name, draw in parameters.items()}
        c = grid.special(rng, p["eta"])
        return {"H": 4 * c * c, "Q": 4 * (1 - c) * (1 + c), **p}

    return points


def angle(v: SimpleNamespace) -> tuple[Any, Any]:
    """Cosine and squared sine between light and facet."""
    total = v.H + v.Q
    return dr.sqrt(v.H / total), v.Q / total


def tan2(v: SimpleNamespace) -> Any:
    """Of the half vector, which is given as wi."""
    return (v.wi_x * v.wi_x + v.wi_y * v.wi_y) / (v.wi_z * v.wi_z)


def pairs_at_any_roughness(rng: np.random.Generator, n: int) -> Mapping[str, Array]:
    """Both directions."""
    return directions(*grid.pairs(rng, among(HARD["roughness"])(rng, n)))


def indices(rng: np.random.Generator, n: int) -> Mapping[str, Array]:
    """An index alone."""
    return {"eta": among(HARD["index"])(rng, n)}


def distribution(name: str, width: str = "roughness") -> Formula:
    """D of a facet normal."""

    def function(vector: Any, v: SimpleNamespace) -> Any:
        return dr.square(microfacet.DISTRIBUTIONS[name].d_half(tan2(v), v.m)) * dr.inv_pi

    return Formula(f"{name}_d", "bricks", (*WI, "m"), ("m",), function, half_vectors(width), SHARP)


def smith(name: str) -> Formula:
    """G1 of a direction."""

    def function(vector: Any, v: SimpleNamespace) -> Any:
        return getattr(microfacet, name)(vector(v.wi_x, v.wi_y, v.wi_z), v.m)

    return Formula(name, "bricks", (*WI, "m"), ("m",), function, one_direction(), SHARP)


def vcavity(vector: Any, v: SimpleNamespace) -> Any:
    """G of V-cavities."""
    g = geometry.half(vector(v.wi_x, v.wi_y, v.wi_z), vector(v.wo_x, v.wo_y, v.wo_z))
    return microfacet.vcavity_g(v.wi_z, v.wo_z, g.hh, g.hz)


def of_facet(name: str, limits: Limits, **parameters: Draw) -> Formula:
    """F or 1 - F of a facet."""
    by = tuple(parameters)

    def function(vector: Any, v: SimpleNamespace) -> Any:
        return getattr(fresnel, name)(*angle(v), *(getattr(v, p) for p in by))

    return Formula(name, "bricks", ("H", "Q", *by), by, function, facets(**parameters), limits)


def mean(vector: Any, v: SimpleNamespace) -> Any:
    """F averaged over directions."""
    return fresnel.fresnel_dielectric_mean(v.eta)


BRICKS = [
    distribution("beckmann"),
    distribution("ggx"),
    distribution("blinn", "roughness up to 1"),
    smith("smith_g1"),
    smith("ggx_g1"),
    Formula("vcavity_g", "bricks", (*WI, *WO), (), vcavity, pairs_at_any_roughness, SHARP),
    of_facet("fresnel_dielectric", DIELECTRIC, **INDEX),
    of_facet("transmittance_dielectric", DIELECTRIC, **INDEX),
    of_facet("fresnel_conductor", CONDUCTOR, **METAL),
    of_facet("fresnel_schlick", SHARP, **INDEX),
    of_facet("transmittance_schlick", SHARP, **INDEX),
    Formula("fresnel_dielectric_mean", "bricks", ("eta",), ("eta",), mean, indices, DIELECTRIC),
]
