"""What the tests of models with a diffuse base and one glossy lobe share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np

from brdf import Model, Values, evaluate
from brdf.checks.energy import BATCHES, cosine_weight, lobe_weight, stratified, summarise
from brdf.checks.reciprocity import channels
from tests.brdf.arrays import EPS, VECTORS, Array, call, to_numpy
from tests.oracles import directions

WIDE = ("float32", "float64")
#: An exponential just above 0 has lost its digits: 1e4 times the least normal number, times the highest peak here.
LOST = {"float32": 1e12 * 2.0**-126, "float64": 1e12 * 2.0**-1022}
COSINES = (1.0, 1 - 1e-7, 0.999, 0.5, 1e-2, 1e-4, 1e-7, 1e-12)
#: Directions a way of sampling is measured with.
SIDE = 128


def white(like: Any, diffuse: float = 0.0, **numbers: Any) -> Values:
    """Parameters with a white lobe over a base of this albedo."""
    colour = like if isinstance(like, type) else type(like)
    return Values(diffuse_reflectance=colour(diffuse), specular_reflectance=colour(1), **numbers)


def glossy(model: Model, names: Sequence[str]) -> Any:
    """The white lobe as a function of directions and of the parameters `names`."""
    return lambda wi, wo, *p: model.f(white(wi, **dict(zip(names, p, strict=True))), wi, wo)[1].x


def slopes(function: Any, kind: str, by: int, wi: Array, wo: Array, *p: Array) -> Array:
    """Derivative by the parameter number `by`, by reverse-mode differentiation, each pair on its own."""
    vector = VECTORS[kind]
    numbers = [dr.value_t(vector)(q) for q in p]
    dr.enable_grad(numbers[by])
    dr.backward(dr.sum(function(vector(*wi.T), vector(*wo.T), *numbers)))
    return to_numpy(numbers[by].grad)


def worst(got: Array, want: Array, scale: Array, kind: str) -> float:
    """The largest error, in roundings of the inputs, beyond what the smallest numbers have lost."""
    off = (np.abs(got - want) - LOST[kind]).clip(0)
    return float(np.max(off / np.maximum(EPS[kind] * scale, LOST["float64"])))


def holds(
    model: Model, names: Sequence[str], by: int, kind: str, wi: Array, wo: Array, p: Sequence[Array], want: list[Any]
) -> tuple[float, float]:
    """Errors of value and derivative against the oracle, in roundings; ``want`` has None where the lobe is 0."""
    function = glossy(model, names)
    value, slope = call(function, VECTORS[kind], wi, wo, *p), slopes(function, kind, by, wi, wo, *p)
    dark = np.array([w is None for w in want])
    assert (value[dark] == 0).all()
    assert (slope[dark] == 0).all()
    d = np.array([w for w in want if w is not None])  # columns as `Derivatives` has them
    return worst(value[~dark], d[:, 0], d[:, 2], kind), worst(slope[~dark], d[:, 1], d[:, 3], kind)


def against_differences(model: Model, names: Sequence[str], by: int, wi: Array, wo: Array, p: list[Array]) -> None:
    """Derivative against the central difference in float64, good to step^2 and to rounding over step."""
    function, step = glossy(model, names), 1e-6
    low, high = ([q * (1 + s * step) if i == by else q for i, q in enumerate(p)] for s in (-1, 1))
    vector = VECTORS["float64"]
    value = call(function, vector, wi, wo, *p)
    quotient = call(function, vector, wi, wo, *high) - call(function, vector, wi, wo, *low)
    quotient /= high[by] - low[by]
    got = slopes(function, "float64", by, wi, wo, *p)
    assert (np.abs(got - quotient) <= 2e-6 * (np.abs(quotient) + value / p[by])).all()
    assert np.abs(got).max() > 0


def nothing_below_the_horizon(model: Model, kind: str, **numbers: float) -> None:
    """Exactly 0, in value and gradient, where either direction is at or below it."""
    n = 120
    wi, wo = directions.hemisphere(n, 1), directions.hemisphere(n, 2)
    wi[:60, 2] *= -1
    wo[30:90, 2] *= -1
    wi[90:105, 2] = 0
    wo[105:, 2] = 0
    vector = VECTORS[kind]
    i, o = vector(*wi.T), vector(*wo.T)
    p = white(i, 0.5, **{name: dr.value_t(vector)(np.full(n, x)) for name, x in numbers.items()})
    given = [*vars(p).values(), i, o]
    dr.enable_grad(*given)
    f = evaluate(model, p, i, o)
    assert (to_numpy(f) == 0).all()
    dr.backward(dr.sum(f, axis=None))
    for x in given:
        assert (to_numpy(dr.grad(x)) == 0).all()


def finite_everywhere(model: Model, kind: str, **numbers: Sequence[float]) -> None:
    """Value, density and derivatives by the parameters (both modes): cosines down to 1e-12, directions equal, opposite, at
    the mirror direction and a little off it, parameters at their bounds. Nothing is negative."""
    rows = [
        (directions.unit(a, start), directions.unit(b, start + turn), *p)
        for a in COSINES
        for b in COSINES
        for start in (0.0, 0.3)
        for turn in (0, 1e-6, np.pi / 2, np.pi - 1e-6, np.pi)
        for p in zip(*numbers.values(), strict=True)
    ]
    wi, wo, *values = (np.array(column) for column in zip(*rows, strict=True))
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    i, o = vector(*wi.T), vector(*wo.T)
    p = white(i, 0.5, **{name: number(x) for name, x in zip(numbers, values, strict=True)})
    given = [getattr(p, name) for name in numbers]
    dr.enable_grad(*given)
    f = evaluate(model, p, i, o).x
    for x in (f, *model.pdf(p, i, o), *model.choose(p, i)):
        assert np.isfinite(to_numpy(x)).all()
        assert (to_numpy(x) >= 0).all()
    for x in given:
        dr.forward(x, flags=dr.ADFlag.ClearVertices)
        assert np.isfinite(to_numpy(f.grad)).all()
        dr.clear_grad(f)
    dr.backward(dr.sum(f))
    for x in given:
        assert np.isfinite(to_numpy(x.grad)).all()


def symmetric(model: Model, names: Sequence[str], kind: str, wi: Array, wo: Array, p: Sequence[Array]) -> None:
    """Reciprocal bit for bit, the base with the lobe."""

    def f(i: Any, o: Any, *numbers: Any) -> Any:
        return evaluate(model, white(i, 0.3, **dict(zip(names, numbers, strict=True))), i, o).x

    there, back = (call(f, VECTORS[kind], *pair, *p) for pair in ((wi, wo), (wo, wi)))
    assert (there > 0).all()
    assert (there == back).all()


def sampling(model: Model, p: Values, mu: float, azimuth: float = 0.5) -> tuple[Array, Array]:
    """``f cos / pdf`` of the lobe that is not black, by the model's own sampling and by the cosine, of 16 batches each."""
    vector = VECTORS["float64"]
    wi, u = vector(*directions.unit(mu, azimuth).tolist()), vector(*stratified(SIDE, BATCHES, 5))
    dr.make_opaque(wi, vars(p))  # one kernel for all parameters
    both = lobe_weight(model, p), cosine_weight(lambda i, o: evaluate(model, p, i, o))
    own, plain = (channels(weight(wi, u))[0] for weight in both)
    return own, plain


def mean(weights: Array) -> tuple[float, float]:
    """The albedo and its standard error."""
    return summarise(weights.reshape(1, BATCHES, -1))


def report(title: str, own: Array, plain: Array) -> None:
    """A line of the table that ``pytest -s -k weights`` prints: largest weight and variance, each over the albedo."""
    albedo = own.mean()
    figures = " ".join(f"{w.max() / albedo:10.3g} {w.var() / albedo**2:10.3g}" for w in (own, plain))
    print(f"\n{title:44} albedo {albedo:7.4f}   own max, variance; cosine max, variance: {figures}", end="")
