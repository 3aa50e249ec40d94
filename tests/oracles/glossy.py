"""Lobes and rough diffuse surfaces as functions of float32 numbers: see `tests.oracles.exact`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mpmath
from mpmath import mpf

from tests.oracles import diffuse, lobes
from tests.oracles.bricks import Answer


def power(cosine: Sequence[Any], n: Any) -> Any:
    """Of a cosine given as the terms of its sum; 0 from 90 degrees on."""
    a: Any = mpmath.fsum(cosine)
    return a**n if a > 0 else mpf(0)


def right_angle(cosine: Callable[..., Any]) -> Callable[..., Any]:
    """Relative distance of such a cosine from 0, where the lobe ends."""

    def kink(model: Any, wi: Any, wo: Any, p: Any) -> Any:
        terms = cosine(wi, wo)
        return abs(mpmath.fsum(terms)) / mpmath.fsum(abs(t) for t in terms)

    return kink


def based(lobe: Callable[..., Any]) -> Callable[..., Any]:
    """Over a diffuse base."""
    return lambda model, wi, wo, p: p.diffuse_reflectance / mpmath.pi + p.specular_reflectance * lobe(model, wi, wo, p)


def phong_scale(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    return 1 / wo[2] if model.normalization == "classic" else (p.exponent + 2) / (2 * mpmath.pi)


def phong(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    return phong_scale(model, wi, wo, p) * power(lobes.phong_cosine(wi, wo), p.exponent)


BLINN = {"exact": lobes.blinn_exact, "common": lobes.blinn_common}


def blinn(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    h = half(wi, wo)
    return BLINN[model.normalization](p.exponent, h[2] / mpmath.sqrt(lobes.square(h)))


def blinn_peak(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    return BLINN[model.normalization](p.exponent, mpf(1))


def half(wi: Any, wo: Any) -> list[Any]:
    return [a + b for a, b in zip(wi, wo, strict=True)]


def ward(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    h = half(wi, wo)
    return lobes.ward_gaussian(h, p.alpha_u, p.alpha_v) * lobes.WARD[model.variant](h, wi[2], wo[2])


def ward_peak(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    return lobes.WARD[model.variant](half(wi, wo), wi[2], wo[2]) / (4 * mpmath.pi * p.alpha_u * p.alpha_v)


def kajiyakay(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    """What is seen as Kajiya and Kay print it, over the cosine."""
    cone = power(lobes.cone_cosine(wi, wo), p.exponent)
    return (p.diffuse_reflectance * lobes.sine_x(wo) + p.specular_reflectance * cone) / wo[2]


def orennayar(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    """0 where it is negative as printed."""
    return max(diffuse.orennayar(model.variant, wi, wo, p.reflectance, p.sigma), mpf(0))


def orennayar_dark(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    """Distance from where it is cut off at 0, in units of Lambert's."""
    some = p.reflectance or mpf(2) ** -200  # any: the limit for a black one
    return abs(diffuse.orennayar(model.variant, wi, wo, some, p.sigma)) * mpmath.pi / some


ANSWERS = {
    "phong": Answer(based(phong), phong_scale, right_angle(lobes.phong_cosine)),
    "blinnphong": Answer(based(blinn), blinn_peak),
    "ward": Answer(based(ward), ward_peak),
    "kajiyakay": Answer(kajiyakay, lambda model, wi, wo, p: 1 / wo[2], right_angle(lobes.cone_cosine)),
    "orennayar": Answer(orennayar, kink=orennayar_dark),
    "lambertian": Answer(lambda model, wi, wo, p: p.reflectance / mpmath.pi),
}
