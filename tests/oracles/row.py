"""Grooves as functions of float32 numbers: the ends of what a direction reaches as Poulin and Fournier's figures give them
(`tests.oracles.grooves` finds the same by tracing lines), the Phong lobe by quadrature; see `tests.oracles.exact`.

Directions count as they are: their angles in the plane across by ``atan2(x, z)``, their projections on a normal by dot
products, and ``cos a = 2 R.wo / (|wi|^2 + |wo|^2)``, R the mirror image of wi about a normal.

In gmpy2's numbers, ten times as fast as mpmath's: a point takes fifty integrals. The rule is of double exponential kind, 20
digits for a lobe with or without a kink at its end; as its points move smoothly with the arguments, differences of
2^-90 of them are those of the rule, and so of the integral to as many digits.
"""

from __future__ import annotations

import importlib
import math
from functools import lru_cache
from itertools import combinations
from typing import Any

import mpmath
from mpmath import mpf

gmpy2: Any = importlib.import_module("gmpy2")  # it has no types

#: As `tests.oracles.exact.DIGITS`.
BITS = 320
#: The lobe is integrated where it is above exp(-this) of its maximum.
EFOLDS = 50.0
#: Step and number of steps of the rule to either side.
DE_STEP, DE_POINTS = 0.07, 48


def exactly(x: Any) -> Any:
    """mpmath's number as gmpy2's."""
    sign, man, exp, _ = mpf(x)._mpf_
    return (
        gmpy2.mul_2exp(gmpy2.mpfr(-man if sign else man), exp)
        if exp >= 0
        else gmpy2.div_2exp(gmpy2.mpfr(-man if sign else man), -exp)
    )


def back(x: Any) -> Any:
    """gmpy2's number as mpmath's."""
    man, exp = x.as_mantissa_exp()
    return mpmath.ldexp(mpf(int(man)), int(exp))


@lru_cache
def rule() -> list[tuple[Any, Any, Any]]:
    """Distances of the points from both ends of [0, 1], and their weights: tanh(pi/2 sinh t) at even steps of t."""
    points = []
    for j in range(-DE_POINTS, DE_POINTS + 1):
        t = gmpy2.mpfr(DE_STEP) * j
        u = gmpy2.exp(gmpy2.const_pi() * gmpy2.sinh(t))
        points.append((u / (1 + u), 1 / (1 + u), gmpy2.const_pi() * gmpy2.cosh(t) * u / (1 + u) ** 2 * DE_STEP))
    return points


class Row:
    """A pair of directions above a row: ends of the arc, `low` and `high`, length of the `floor`, and relative distance from
    where one of them passes from one rule to another."""

    def __init__(self, wi: Any, wo: Any, spacing: Any, height: Any) -> None:
        rim, foot = gmpy2.acos(height), gmpy2.sqrt(1 - height * height)
        ends: dict[int, dict[Any, Any]] = {-1: {"rim": rim}, 1: {"rim": rim}}
        floor: dict[int, list[Any]] = {-1: [foot], 1: [foot]}
        for w in (wi, wo):
            x, z = w[0], w[2]
            lean = 1 if x > 0 else -1
            e = gmpy2.atan2(z, abs(x))
            ends[-lean]["terminator", e] = e
            if spacing * gmpy2.sin(e) < 2:
                ends[lean]["next cylinder", e] = gmpy2.acos(1 - spacing * gmpy2.sin(e)) - e
            if gmpy2.cos(e) > height:
                floor[lean].append((1 - height * gmpy2.cos(e)) / gmpy2.sin(e))
        self.high, self.low = min(ends[1].values()), -min(ends[-1].values())
        covered = max(floor[-1]) + max(floor[1])
        self.floor = max(spacing - covered, gmpy2.mpfr(0))
        gaps = [abs(spacing - covered) / (spacing + covered)]
        for side in ends.values():
            least = min(side.values())
            for (one, a), (other, b) in combinations(side.items(), 2):
                if one != other and min(a, b) == least:
                    gaps.append(abs(a - b) / (a + b))
        self.kink = min(gaps)


def dot(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def diffuse(wi: Any, wo: Any, row: Row, spacing: Any) -> Any:
    """Of unit albedo."""
    ti, to = wi[0] / wi[2], wo[0] / wo[2]

    def upto(t: Any) -> Any:
        s, c = gmpy2.sin(t), gmpy2.cos(t)
        return (t + s * c + (ti + to) * s * s + ti * to * (t - s * c)) / 2

    return (row.floor + upto(row.high) - upto(row.low)) / (spacing * gmpy2.const_pi())


def phong(wi: Any, wo: Any, row: Row, spacing: Any, n: Any) -> Any:
    """Of unit tint."""
    lengths, ahead = dot(wi, wi) + dot(wo, wo), dot(wi, wo)
    across = gmpy2.sqrt((wi[0] ** 2 + wi[2] ** 2) * (wo[0] ** 2 + wo[2] ** 2))
    middle = (gmpy2.atan2(wi[0], wi[2]) + gmpy2.atan2(wo[0], wo[2])) / 2

    def cosine(s: Any, c: Any) -> Any:
        return 2 * (2 * (s * wi[0] + c * wi[2]) * (s * wo[0] + c * wo[2]) - ahead) / lengths

    def power(cos: Any) -> Any:
        return gmpy2.exp(n * gmpy2.log(cos)) if cos > 0 else gmpy2.mpfr(0)

    def at(angle: Any) -> Any:
        s, c = gmpy2.sin(angle), gmpy2.cos(angle)
        return power(cosine(s, c)) * (s * wi[0] + c * wi[2]) * (s * wo[0] + c * wo[2]) / (wi[2] * wo[2])

    # cos = best - swing sin^2 of the angle from the middle; it falls to `least` at the end of the lobe
    swing, best = 4 * across / lengths, cosine(gmpy2.sin(middle), gmpy2.cos(middle))
    nearest = min(max(middle, row.low), row.high)
    highest = best - swing * gmpy2.sin(nearest - middle) ** 2
    total = row.floor * power(cosine(gmpy2.mpfr(0), gmpy2.mpfr(1)))
    if highest > 0:
        drop = math.exp(-EFOLDS / float(n))
        least = gmpy2.mpfr(0) if drop < 1e-12 else gmpy2.mpfr(float(highest) * drop)
        sin2 = (best - least) / swing
        window = gmpy2.asin(gmpy2.sqrt(sin2)) if sin2 < 1 else gmpy2.const_pi()
        low, high = max(row.low, middle - window), min(row.high, middle + window)
        for a, b in ((low, min(max(middle, low), high)), (min(max(middle, low), high), high)):
            if b > a:
                total += (b - a) * sum(w * at(a + (b - a) * x if x < y else b - (b - a) * y) for x, y, w in rule())
    return total * (n + 2) / (2 * gmpy2.const_pi() * spacing)


def of_row(function: Any) -> Any:
    """A function of two directions, spacing, height and exponent, of mpmath's numbers; the last answers are kept, as what
    only weighs them is stepped too."""

    @lru_cache(maxsize=64)
    def answer(*x: Any) -> Any:
        with gmpy2.context(gmpy2.get_context(), precision=BITS):
            i, o, *rest = x[:3], x[3:6], *x[6:]
            return back(function([exactly(c) for c in i], [exactly(c) for c in o], *(exactly(c) for c in rest)))

    return lambda model, wi, wo, p: answer(*wi, *wo, p.spacing, p.height, getattr(p, "exponent", mpf(1)))
