"""What must hold whatever the parameters and directions are, at random ones: hypothesis looks for those where it fails.

An example is a batch: a seed from which thousands of pairs of directions are made, each with parameters of its own, and
for some parameters one value for all, which may be a bound. So an example costs one launch of a kernel, and the kernel
serves all examples.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brdf import Model, Param, Values, evaluate, fresnel, microfacet
from brdf.checks import ModelSubject
from brdf.checks.directions import hemisphere, near_mirror, stratified
from brdf.checks.values import channels
from brdf.models import diffusion, hanrahankrueger
from brdf.models.orennayar import OrenNayar
from brdf.stable import cosine_power
from tests.brdf.arrays import EPS, VECTORS, Array, to_numpy
from tests.models import named, variations

#: Models whose kernels take long to compile: tried with the slow tests.
HEAVY = {"grooved"}
SMOOTH = [m for m in variations() if not all(lobe.ideal for lobe in m.lobes)]
#: Pairs of directions of an example, and of these the share with one of the directions grazing.
PAIRS, GRAZING = 4096, 0.25
#: Cosines of directions that graze.
LOWEST = 1e-7
#: Where a range has no lower end in its scale, a fit starts there: see `Param.interior`. Parameters go down to it.
ENDS = 0.125
#: Directions of incidence at which an example measures an albedo; batches of samples, and in each samples squared.
INCIDENT, BATCHES, SIDE = 8, 32, 8
#: An albedo may exceed 1 by this many standard errors and by rounding.
SIGMA, ROUNDING = 6.0, 1e-5

#: A batch is a tenth of what a profile says of examples: each is thousands.
FEW = settings(max_examples=settings().max_examples // 10)
MANY = settings(settings.get_profile("deep"), max_examples=settings.get_profile("deep").max_examples // 10)


def every(models: list[Model]) -> Any:
    marks = {True: [pytest.mark.slow], False: []}
    return pytest.mark.parametrize(
        "model", [pytest.param(m, id=named(m), marks=marks[m.name in HEAVY]) for m in models]
    )


seeds = st.integers(0, 2**32 - 1)
#: A place between the bounds in the scale of a parameter, for all pairs; or None, and each pair has its own.
places = st.one_of(st.none(), st.sampled_from([0.0, 1.0]), st.floats(0, 1))
pinned = st.lists(places, min_size=8, max_size=8)


def at(p: Param, place: Array) -> Array:
    """The value of a parameter at places from 0 to 1 between its bounds, in its scale; at 0 and 1 the bounds."""
    low, high = (float(p.to_free(b)) for b in p.interior())
    x = np.asarray(p.to_value(low + (high - low) * place), dtype=float)
    return np.clip(np.where(place <= 0, p.bounds[0], np.where(place >= 1, p.bounds[1], x)), *p.bounds)


def parameters(model: Model, pins: list[float | None], n: int, rng: np.random.Generator) -> dict[str, Array]:
    """Values of all parameters, shape (n,) or (n, 3): where not pinned anywhere, and an eighth each at the bounds."""
    found = {}
    for p, pin in zip(model.parameters(), pins, strict=False):
        place = rng.random((n,) if p.kind == "number" else (n, 3))
        place = np.clip((place - ENDS) / (1 - 2 * ENDS), 0, 1)
        found[p.name] = at(p, place if pin is None else np.full_like(place, pin))
    return found


def directions(model: Model, rng: np.random.Generator) -> tuple[Array, Array]:
    """Pairs, shape (3, n): independent, near the mirror direction, equal, opposite; some of them grazing."""
    wi, wo = grazing(hemisphere(PAIRS, rng), rng), grazing(hemisphere(PAIRS, rng), rng)
    kind = rng.integers(0, 6, PAIRS)
    wo = np.select([kind < 3, kind == 3, kind == 4], [near_mirror(wi, rng), wi, wi * [[-1], [-1], [1]]], wo)
    up = wo[2] >= LOWEST
    wo = np.where(up, wo, wi)
    if model.transmits:
        wi[2] *= rng.choice([-1, 1], PAIRS)
        wo[2] *= rng.choice([-1, 1], PAIRS)
    return wi, wo


def grazing(w: Array, rng: np.random.Generator) -> Array:
    """Some of the directions turned towards the surface, to cosines even in their logarithm."""
    z = np.where(rng.random(w.shape[1]) < GRAZING, LOWEST ** rng.random(w.shape[1]), np.maximum(w[2], LOWEST))
    azimuth = np.arctan2(w[1], w[0])
    r = np.sqrt((1 - z) * (1 + z))
    return np.array([r * np.cos(azimuth), r * np.sin(azimuth), z])


def value_and_gradient(model: Model, kind: str, seed: int, pins: list[float | None]) -> None:
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    rng = np.random.default_rng(seed)
    values = parameters(model, pins, PAIRS, rng)
    wi, wo = directions(model, rng)
    inputs = {k: number(v) if v.ndim == 1 else vector(v.T) for k, v in values.items()}
    inputs |= {"wi": vector(wi), "wo": vector(wo)}
    p = Values(**{k: inputs[k] for k in values})
    dr.enable_grad(inputs)
    value = evaluate(model, p, inputs["wi"], inputs["wo"])
    back = evaluate(model, p, inputs["wo"], inputs["wi"])
    dr.eval(value, back)
    dr.backward(dr.sum(value))
    found = {"the value": value, **{f"the derivative by {k}": dr.grad(x) for k, x in inputs.items()}}

    def holds(what: str, good: Any) -> None:
        if not good.all():
            j = int(np.argmin(good.reshape(-1, PAIRS).all(axis=0)))
            inputs_there = {k: to_numpy(x)[..., j].tolist() for k, x in inputs.items()}
            raise AssertionError(f"{what} at {inputs_there}: {to_numpy(value)[:, j]}, {to_numpy(back)[:, j]} back")

    for what, x in found.items():
        holds(f"{what} is not finite", np.isfinite(to_numpy(x)))
    holds("the value is negative", to_numpy(value) >= 0)
    if "reciprocity" not in model.faults():
        holds("the value is not reciprocal", to_numpy(value) == to_numpy(back))
    if not model.transmits:
        below = evaluate(model, p, vector(wi), vector(wo * [[1], [1], [-1]]))
        holds("the value is not 0 below the horizon", to_numpy(below) == 0)


@every(SMOOTH)
@FEW
@given(seed=seeds, pins=pinned)
def test_value_and_gradient(model: Model, seed: int, pins: list[float | None]) -> None:
    """In float32: finite with all derivatives, not negative, reciprocal bit for bit if declared, 0 below the horizon."""
    value_and_gradient(model, "float32", seed, pins)


@pytest.mark.slow
@pytest.mark.parametrize("kind", EPS)
@pytest.mark.parametrize("model", [m for m in SMOOTH if m.name not in HEAVY], ids=named)
@MANY
@given(seed=seeds, pins=pinned)
def test_value_and_gradient_deep(model: Model, kind: str, seed: int, pins: list[float | None]) -> None:
    """The same in both precisions, at ten times as many examples."""
    value_and_gradient(model, kind, seed, pins)


def energy(model: Model, seed: int, pins: list[float | None]) -> None:
    rng = np.random.default_rng(seed)
    one = {k: v[0] for k, v in parameters(model, pins, 1, rng).items()}
    subject = ModelSubject(model, VECTORS["float32"])
    number = dr.value_t(subject.vector)
    for name, v in one.items():
        subject.set(
            name,
            dr.opaque(number, float(v)) if v.ndim == 0 else subject.vector(*(dr.opaque(number, float(c)) for c in v)),
        )
    n = BATCHES * SIDE * SIDE
    wi = grazing(hemisphere(INCIDENT, rng), rng)
    if model.transmits:
        wi[2] *= rng.choice([-1, 1], INCIDENT)
    u = subject.vector(np.tile(stratified(SIDE, BATCHES, seed), INCIDENT))
    given_wi = subject.vector(np.repeat(wi, n, axis=1))
    for lobe, part in enumerate(subject.lobes):
        weight = channels(subject.draw(given_wi, u, lobe).weight)
        weight = np.broadcast_to(weight, (len(weight), n * INCIDENT)).reshape(-1, INCIDENT, BATCHES, SIDE * SIDE)
        means = weight.mean(axis=3)
        mean, error = means.mean(axis=2), means.std(axis=2, ddof=1) / np.sqrt(BATCHES)
        bad = ~(mean <= 1 + SIGMA * error + ROUNDING)
        where = np.argwhere(bad)
        assert not bad.any(), f"{part.name} sends out {mean[bad]} +- {error[bad]} at {wi[:, where[0][1]]} with {one}"


@every([m for m in variations() if "energy" not in m.faults()])
@FEW
@given(seed=seeds, pins=pinned)
def test_energy(model: Model, seed: int, pins: list[float | None]) -> None:
    """No lobe sends out more than arrives: the mean weight of its samples, in float32, from wherever it comes."""
    energy(model, seed, pins)


class Order(NamedTuple):
    """A function of one number between two ends, and how it must move: +1 never down, -1 never up.

    `function` also gets a direction above the surface (wi), and numbers from 0 to 1 for what else it takes.
    """

    function: Callable[[Any, Any, Any], Any]
    low: float
    high: float
    sign: int


def layer(x: Any, w: Any, u: Any, **given: Any) -> Any:
    """What passes a layer unscattered."""
    p = Values(**{"sigma_s": 3 * u, "sigma_a": u, "thickness": u, "eta": 1 + u, "g": 0 * u, **given})
    return hanrahankrueger.unscattered(p, w)


def deep(u: Any, **given: Any) -> Any:
    """What deep material reflects."""
    p = Values(**{"sigma_s": 0.1 + u, "sigma_a": 0.01 + u, "eta": 1.01 + u, "g": 0.5 * u, **given})
    return diffusion.total_reflectance(p)


def s2(w: Any) -> Any:
    return w.x * w.x + w.y * w.y


#: All that must rise or fall, whatever else.
ORDERS = {
    "F at the normal rises with eta": Order(
        lambda x, w, u: fresnel.fresnel_dielectric(1 + 0 * x, 0 * x, x), 1.0, 1e6, 1
    ),
    "T at the normal falls with eta": Order(
        lambda x, w, u: fresnel.transmittance_dielectric(1 + 0 * x, 0 * x, x), 1.0, 1e6, -1
    ),
    "Schlick's F falls with the cosine": Order(
        lambda x, w, u: fresnel.fresnel_schlick(x, (1 - x) * (1 + x), 1 + 9 * u), 1e-7, 1.0, -1
    ),
    "Schlick's F rises with eta": Order(lambda x, w, u: fresnel.fresnel_schlick(w.z, s2(w), x), 1.0, 1e6, 1),
    "mean F rises with eta": Order(lambda x, w, u: fresnel.fresnel_dielectric_mean(x), 1 + 2.0**-20, 10.0, 1),
    "F of a metal at the normal rises with k": Order(
        lambda x, w, u: fresnel.fresnel_conductor(1 + 0 * x, 0 * x, 20 * u, x), 1e-6, 1e6, 1
    ),
    "peak of Beckmann's D falls with m": Order(lambda x, w, u: microfacet.beckmann_d(0 * x, x), 1e-6, 3.0, -1),
    "peak of GGX' D falls with m": Order(lambda x, w, u: microfacet.ggx_d_half(0 * x, x), 1e-6, 3.0, -1),
    "peak of Blinn's D falls with m": Order(lambda x, w, u: microfacet.blinn_d_half(0 * x, x), 1e-6, 1.0, -1),
    "Beckmann's D falls with the slope over m": Order(
        lambda x, w, u: microfacet.beckmann_d(x * x * 0.25, 0.5 + 0 * x), 1e-6, 0.5, -1
    ),
    "Smith's G1 falls with m": Order(lambda x, w, u: microfacet.smith_g1(w, x), 1e-6, 3.0, -1),
    "G1 of GGX falls with m": Order(lambda x, w, u: microfacet.ggx_g1(w, x), 1e-6, 3.0, -1),
    "a power of a cosine falls with the exponent": Order(
        lambda x, w, u: cosine_power(u, 1 - 0.5 * u, x), 1e-6, 1e6, -1
    ),
    "what passes a layer falls with its thickness": Order(lambda x, w, u: layer(x, w, u, thickness=x), 1e-8, 1e6, -1),
    "what passes a layer falls with absorption": Order(lambda x, w, u: layer(x, w, u, sigma_a=x), 1e-8, 1e4, -1),
    "what passes a layer falls with scattering": Order(lambda x, w, u: layer(x, w, u, sigma_s=x), 1e-8, 1e4, -1),
    "what deep material reflects falls with absorption": Order(lambda x, w, u: deep(u, sigma_a=x), 1e-6, 1e4, -1),
    "what deep material reflects rises with scattering": Order(lambda x, w, u: deep(u, sigma_s=x), 1e-3, 1e4, 1),
}


@pytest.mark.parametrize("name", ORDERS)
@pytest.mark.parametrize("kind", EPS)
@FEW
@given(seed=seeds, step=st.sampled_from([2.0**-20, 1e-3, 0.1, 1.0]))
def test_order(name: str, kind: str, seed: int, step: float) -> None:
    """Never the wrong way by more than rounding, for numbers apart by up to `step` of the range of logarithms."""
    order, vector, rng = ORDERS[name], VECTORS[kind], np.random.default_rng(seed)
    number = dr.value_t(vector)
    low, high = np.log(order.low), np.log(order.high)
    x = rng.uniform(low, high, PAIRS)
    y = np.minimum(x + step * (high - low) * rng.random(PAIRS), high)
    a, b = (number(np.clip(np.exp(t), order.low, order.high)) for t in (x, y))
    w, u = vector(grazing(hemisphere(PAIRS, rng), rng)), number(rng.random(PAIRS))
    first, second = (to_numpy(order.function(t, w, u)) for t in (a, b))
    assert np.isfinite(first).all() and (first >= 0).all()
    rounding = 16 * EPS[kind] * np.maximum(np.abs(first), np.abs(second))
    assert (order.sign * (second - first) >= -rounding).all()


@pytest.mark.parametrize("model", SMOOTH, ids=named)
@FEW
@given(seed=seeds, pins=pinned)
def test_brighter(model: Model, seed: int, pins: list[float | None]) -> None:
    """The value never falls when a reflectance rises."""
    tints = [p.name for p in model.parameters() if p.name.endswith("reflectance")]
    if not tints or model.name in HEAVY:
        return
    vector = VECTORS["float32"]
    number = dr.value_t(vector)
    rng = np.random.default_rng(seed)
    values = parameters(model, pins, PAIRS, rng)
    brighter = {k: v + (1 - v) * rng.random(v.shape) if k in tints else v for k, v in values.items()}
    wi, wo = (vector(w) for w in directions(model, rng))

    def at_values(given: dict[str, Array]) -> Array:
        p = Values(**{k: number(v) if v.ndim == 1 else vector(v.T) for k, v in given.items()})
        return to_numpy(evaluate(model, p, wi, wo))

    low, high = at_values(values), at_values(brighter)
    assert (high >= low * (1 - 16 * EPS["float32"])).all()


@pytest.mark.parametrize("variant", ["full", "fast"])
@FEW
@given(seed=seeds)
def test_smooth_clay_is_lambertian(variant: str, seed: int) -> None:
    """Oren and Nayar's model without roughness is Lambert's."""
    vector, rng = VECTORS["float32"], np.random.default_rng(seed)
    model = OrenNayar(variant=variant)
    wi, wo = (vector(w) for w in directions(model, rng))
    albedo = vector(rng.random((3, PAIRS)))
    got = evaluate(model, Values(reflectance=albedo, sigma=dr.zeros(dr.value_t(vector), PAIRS)), wi, wo)
    np.testing.assert_allclose(to_numpy(got), to_numpy(albedo) / np.pi, rtol=4 * EPS["float32"])
