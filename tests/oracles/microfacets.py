"""Cook and Torrance's reflection as a function of float32 numbers: see `tests.oracles.exact`."""

from __future__ import annotations

from typing import Any

import mpmath
from mpmath import mpf

from tests.oracles import bricks, textbook
from tests.oracles.bricks import Answer

#: What printed versions have in place of Walter's 1.
CONSTANT = {"walter": lambda: mpf(1), "cook": lambda: mpf(4), "ngan": lambda: 4 / mpmath.pi}


def fresnel(model: Any, p: Any, c: Any) -> Any:
    if model.fresnel == "conductor":
        return bricks.fresnel_conductor(c, p.eta, p.k)
    return textbook.FRESNEL[model.fresnel](c, getattr(p, "eta", None))


def masking(model: Any, p: Any, pair: textbook.Pair) -> Any:
    if model.masking == "smith":
        g1 = textbook.SMITH[model.distribution]
        u, v = roughness(model, p)
        return g1(pair.i, textbook.roughness_towards(pair.i, u, v)) * g1(
            pair.o, textbook.roughness_towards(pair.o, u, v)
        )
    return textbook.vcavity_g(pair) if model.masking == "vcavity" else mpf(1)


def roughness(model: Any, p: Any) -> tuple[Any, Any]:
    return (p.m_u, p.m_v) if model.roughness == "anisotropic" else (p.m, p.m)


def value(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    pair = textbook.Pair(wi, wo)
    h = [a + b for a, b in zip(pair.i, pair.o, strict=True)]
    d = textbook.DISTRIBUTION[model.distribution](h, *roughness(model, p))
    f = d * masking(model, p, pair) * fresnel(model, p, pair.vh) / (4 * pair.ni * pair.no)
    return p.diffuse_reflectance / mpmath.pi + p.specular_reflectance * CONSTANT[model.normalization]() * f


def peak(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    """Without the exponential of D, and without F."""
    pair = textbook.Pair(wi, wo)
    u, v = roughness(model, p)
    return masking(model, p, pair) / (mpmath.pi * u * v * pair.nh**4 * 4 * pair.ni * pair.no)


def kink(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    pair = textbook.Pair(wi, wo)
    found = [bricks.vcavity_tie(pair)] if model.masking == "vcavity" else []
    if model.fresnel in ("exact", "conductor"):
        found.append(bricks.critical(pair.vh**2, 1 - pair.vh**2, p.eta, getattr(p, "k", 0)))
    return min(found, default=mpmath.inf)


ANSWERS = {"cooktorrance": Answer(value, peak, kink)}
