"""D, G and F as functions of float32 numbers: see `tests.oracles.exact`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import mpmath
from mpmath import mpf

from tests.oracles import optics, textbook


class Answer(NamedTuple):
    """An exact formula: value by arguments; its value without the exponential (default: the value); relative distance from
    where a derivative jumps (default: nowhere)."""

    value: Callable[..., Any]
    peak: Callable[..., Any] | None = None
    kink: Callable[..., Any] | None = None


def normal_cosine(x: Any, y: Any, z: Any) -> Any:
    return z / mpmath.sqrt(x**2 + y**2 + z**2)


def of_half_vector(d: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda x, y, z, m: d(normal_cosine(x, y, z), m)


def of_facet(f: Callable[..., Any]) -> Callable[..., Any]:
    return lambda H, Q, *p: f(mpmath.sqrt(H / (H + Q)), *p)


def critical(H: Any, Q: Any, eta: Any, k: Any = 0) -> Any:
    """Relative distance of ``g^2 = eta^2 - sin^2`` from 0."""
    s2 = Q / (H + Q)
    return abs(eta**2 - s2) / (eta**2 + s2) if k == 0 else mpmath.inf


def vcavity_tie(pair: textbook.Pair) -> Any:
    """Relative distance from where V-cavities begin to mask."""
    g = 2 * pair.nh * min(pair.ni, pair.no) / pair.half_length
    return abs(g - 1)


def fresnel_conductor(c: Any, eta: Any, k: Any) -> Any:
    return optics.fresnel_conductor(c, eta, k) if k else textbook.fresnel_dielectric(c, eta) if eta else mpf(1)


def dielectric_mean(eta: Any) -> Any:
    """Walsh's closed form; from inside by reciprocity."""
    if eta == 1:
        return mpf(0)
    return optics.fresnel_mean_closed(eta) if eta > 1 else 1 - eta**2 * (1 - optics.fresnel_mean_closed(1 / eta))


ANSWERS = {
    "beckmann_d": Answer(of_half_vector(textbook.beckmann_d), of_half_vector(textbook.beckmann_peak)),
    "ggx_d": Answer(of_half_vector(textbook.ggx_d)),
    "blinn_d": Answer(of_half_vector(textbook.blinn_d), lambda x, y, z, m: 1 / (mpmath.pi * m**2)),
    "smith_g1": Answer(lambda x, y, z, m: textbook.smith_g1((x, y, z), m)),
    "ggx_g1": Answer(lambda x, y, z, m: textbook.ggx_g1((x, y, z), m)),
    "vcavity_g": Answer(
        lambda *w: textbook.vcavity_g(textbook.Pair(w[:3], w[3:])),
        kink=lambda *w: vcavity_tie(textbook.Pair(w[:3], w[3:])),
    ),
    "fresnel_dielectric": Answer(of_facet(textbook.fresnel_dielectric), kink=critical),
    "transmittance_dielectric": Answer(of_facet(lambda c, eta: 1 - textbook.fresnel_dielectric(c, eta)), kink=critical),
    "fresnel_conductor": Answer(of_facet(fresnel_conductor), kink=critical),
    "fresnel_schlick": Answer(of_facet(textbook.fresnel_schlick)),
    "transmittance_schlick": Answer(of_facet(lambda c, eta: 1 - textbook.fresnel_schlick(c, eta))),
    "fresnel_dielectric_mean": Answer(dielectric_mean, kink=lambda eta: abs(eta - 1)),
}
