"""Cook-Torrance with the choices that are not the first: distributions, two roughnesses, conductors, constants."""

from __future__ import annotations

import itertools
import math
from typing import Any

import drjit as dr
import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import Values, defaults, evaluate
from brdf.checks.energy import BATCHES, stratified
from brdf.geometry import cosine_hemisphere
from brdf.models.cooktorrance import CookTorrance
from tests.brdf.arrays import EPS, VECTORS, call, error, to_numpy
from tests.oracles import directions, optics, textbook

DISTRIBUTIONS = ("beckmann", "ggx", "blinn")
MASKING = ("vcavity", "smith", "none")
ROUGHNESS = ("isotropic", "anisotropic")
WIDE = ("float32", "float64")
#: Aluminium: Mitsuba's measured spectra in linear sRGB, as its `roughconductor` has them.
ETA, K = (1.6575009, 0.8804047, 0.52124447), (9.223811, 6.269502, 4.837004)

#: All that act on each other; masking that is left out needs no more than one of each.
SHAPES = [
    *itertools.product(DISTRIBUTIONS, ("vcavity", "smith"), ROUGHNESS),
    ("ggx", "none", "isotropic"),
    ("blinn", "none", "anisotropic"),
]
facets = pytest.mark.parametrize(("distribution", "masking", "roughness"), SHAPES)


def metal(distribution: str, masking: str, roughness: str) -> CookTorrance:
    return CookTorrance(fresnel="conductor", distribution=distribution, masking=masking, roughness=roughness)


def values(like: Any, u: Any, v: Any, eta: Any = ETA[1], k: Any = K[1]) -> Values:
    """A white tint, no diffuse base; `u` is also the one roughness, and `eta` and `k` are alike in all channels."""
    colour = type(like)
    return Values(
        m=u, m_u=u, m_v=v, eta=colour(eta), k=colour(k), diffuse_reflectance=colour(0), specular_reflectance=colour(1)
    )


def specular(model: CookTorrance) -> Any:
    """The specular lobe in one channel, as a function of directions and numbers."""
    return lambda wi, wo, u, v, eta, k: model.f(values(wi, u, v, eta, k), wi, wo)[1].x


def reflected(
    model: CookTorrance, vector: Any, mu: Any, given: dict[str, Any], side: int = 32, cosine: bool = False
) -> tuple[Any, Any]:
    """The albedo of the specular lobe at each of the cosines `mu`, and its standard error, all in one kernel.

    From the model's own sampling of that lobe, or the cosine's. `given` are numbers, one for each `mu`.
    """
    number = dr.value_t(vector)
    size = BATCHES * side * side
    z = np.repeat(mu, size)
    wi = vector(np.sqrt((1 - z) * (1 + z)), 0 * z, z)
    u = vector(*np.tile(stratified(side, BATCHES, 0), len(mu)))
    p = defaults(model, vector, **{name: number(np.repeat(value, size)) for name, value in given.items()})
    wo = cosine_hemisphere(u, wi) if cosine else model.sample(p, wi, u, 1)
    up = wo.z > 0
    wo = vector(wo.x, wo.y, dr.select(up, wo.z, 1))
    density = wo.z * dr.inv_pi if cosine else model.pdf(p, wi, wo)[1]
    good = up & (density > 0)
    weight = dr.select(good, model.f(p, wi, wo)[1].y * wo.z / dr.select(good, density, 1), 0)
    means = to_numpy(weight).reshape(len(mu), BATCHES, -1).mean(axis=2)
    return means.mean(axis=1), means.std(axis=1, ddof=1) / math.sqrt(BATCHES)


def inputs() -> tuple[Any, ...]:
    """Directions, m_u, m_v, eta and k: metals, near and far from the mirror direction."""
    wi, wo, u = directions.grid((0.01, 0.1, 0.3, 1.0))
    n = np.arange(len(u))
    found = wi, wo, u, u * np.array([0.3, 0.7])[n % 2], np.array(ETA)[n % 3], np.array(K)[n % 3]
    return tuple(a.astype(np.float32).astype(float) for a in found)


@facets
@pytest.mark.parametrize("kind", WIDE)
def test_value(kind: str, distribution: str, masking: str, roughness: str) -> None:
    given = inputs()
    want, peak = [], []
    for i, o, u, v, eta, k in zip(*given, strict=True):
        p = textbook.Pair(i, o)
        u, v = mpf(u), mpf(v) if roughness == "anisotropic" else mpf(u)
        match masking:
            case "vcavity":
                g = textbook.vcavity_g(p)
            case "smith":
                g1 = textbook.SMITH[distribution]
                g = g1(p.i, textbook.roughness_towards(p.i, u, v)) * g1(p.o, textbook.roughness_towards(p.o, u, v))
            case _:
                g = mpf(1)
        rest = g * optics.fresnel_conductor(p.vh, mpf(eta), mpf(k)) / (4 * p.ni * p.no)
        h = [a + b for a, b in zip(p.i, p.o, strict=True)]
        want.append(float(textbook.DISTRIBUTION[distribution](h, u, v) * rest))
        peak.append(float(rest / (mpmath.pi * u * v * p.nh**4)))
    got = call(specular(metal(distribution, masking, roughness)), VECTORS[kind], *given)
    assert error(got, np.array(want), np.array(peak)).max() < (1e-5 if kind == "float32" else 2e-14)


@facets
def test_gradient_is_the_central_difference(distribution: str, masking: str, roughness: str) -> None:
    """In float64, in both roughnesses, eta and k: the difference is good to (step)^2 and to rounding over step."""
    function = specular(metal(distribution, masking, roughness))
    vector = VECTORS["float64"]
    number = dr.value_t(vector)
    wi, wo, *given = inputs()
    given[0] = np.minimum(given[0], 0.99)  # a step up stays where Blinn's holds
    numbers = [number(a) for a in given]
    dr.enable_grad(*numbers)
    dr.backward(dr.sum(function(vector(*wi.T), vector(*wo.T), *numbers)))
    value = call(function, vector, wi, wo, *given)
    for i in (0, 1, 2, 3) if roughness == "anisotropic" else (0, 2, 3):
        step = 1e-6 * given[i]
        low, high = (call(function, vector, wi, wo, *given[:i], given[i] + s, *given[i + 1 :]) for s in (-step, step))
        quotient = (high - low) / (2 * step)
        got = to_numpy(numbers[i].grad)
        assert np.abs(got).max() > 0
        assert (np.abs(got - quotient) <= 2e-6 * (np.abs(quotient) + value / given[i])).all()


@facets
@pytest.mark.parametrize("kind", VECTORS)
def test_reciprocal_bit_for_bit(kind: str, distribution: str, masking: str, roughness: str) -> None:
    function = specular(metal(distribution, masking, roughness))
    wi, wo, *rest = inputs()
    if kind.endswith("scalar"):
        wi, wo, rest = wi[::7], wo[::7], [a[::7] for a in rest]
    there, back = (call(function, VECTORS[kind], *pair, *rest) for pair in ((wi, wo), (wo, wi)))
    assert (there > 0).any()
    assert (there == back).all()


@facets
@pytest.mark.parametrize("kind", WIDE)
def test_finite_everywhere(kind: str, distribution: str, masking: str, roughness: str) -> None:
    """Value, density and each gradient, at the bounds of every parameter, grazing, and with directions equal, opposite, at
    the mirror direction and a little off it; the first two are never negative."""
    model = metal(distribution, masking, roughness)
    bounds = {p.name: p.bounds for p in model.parameters()}
    low, high = bounds["m_u" if roughness == "anisotropic" else "m"]
    cosines = [1.0, 1 - 1e-7, 0.999, 0.5, 1e-2, 1e-4, 1e-7, 1e-12]
    rows = [
        (directions.unit(a, 0.3), directions.unit(b, 0.3 + turn), u, v, eta, k)
        for a in cosines
        for b in cosines
        for turn in (0, 1e-6, np.pi / 2, np.pi - 1e-6, np.pi)
        for u, v in ((low, low), (low, high), (0.1, 0.3), (high, high))
        for eta, k in itertools.product(bounds["eta"], bounds["k"])
    ]
    wi, wo, *rest = (np.array(a) for a in zip(*rows, strict=True))
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    i, o, numbers = vector(*wi.T), vector(*wo.T), [number(a) for a in rest]
    used = numbers if roughness == "anisotropic" else [numbers[0], *numbers[2:]]
    dr.enable_grad(*used)
    p = values(i, *numbers)
    f = model.f(p, i, o)[1].x
    density = model.pdf(p, i, o)[1]
    dr.backward(dr.sum(f), flags=dr.ADFlag.ClearEdges)
    found = [dr.detach(f), dr.detach(density), *(given.grad for given in used)]
    dr.eval(found)
    assert all(np.isfinite(to_numpy(x)).all() for x in found)
    assert all((to_numpy(x) >= 0).all() for x in found[:2])


@pytest.mark.parametrize("kind", WIDE)
def test_nothing_below_the_horizon(kind: str) -> None:
    """Exactly 0, in value and gradient."""
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    wi, wo = directions.hemisphere(90, 1), directions.hemisphere(90, 2)
    wi[:30, 2] *= -1
    wo[30:60, 2] *= -1
    wi[60:, 2] = 0
    i, o, u = vector(*wi.T), vector(*wo.T), number(np.full(90, 0.3))
    dr.enable_grad(u)
    f = evaluate(metal("ggx", "smith", "anisotropic"), values(i, u, 0.5 * u), i, o)
    assert (to_numpy(f) == 0).all()
    dr.backward(dr.sum(f, axis=None))
    assert (to_numpy(u.grad) == 0).all()


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("masking", MASKING)
def test_equal_roughnesses_are_one(masking: str, distribution: str) -> None:
    wi, wo, u, _, eta, k = inputs()
    one, two = (
        call(specular(metal(distribution, masking, r)), VECTORS["float64"], wi, wo, u, u, eta, k) for r in ROUGHNESS
    )
    assert error(two, one, one.max()).max() < 1e-12


def test_turned_by_a_right_angle() -> None:
    """With the surface turned, x is y: the two roughnesses change places."""
    wi, wo, u, v, eta, k = inputs()
    turned = [np.stack([w[:, 1], -w[:, 0], w[:, 2]], axis=1) for w in (wi, wo)]
    function = specular(metal("ggx", "smith", "anisotropic"))
    a, b = (
        call(function, VECTORS["float64"], wi, wo, u, v, eta, k),
        call(function, VECTORS["float64"], *turned, v, u, eta, k),
    )
    np.testing.assert_allclose(a, b, rtol=1e-12)
    assert (np.abs(call(function, VECTORS["float64"], *turned, u, v, eta, k) / a - 1) > 0.1).any()


def test_constants() -> None:
    """As Cook and Torrance 1982 print it, ``F/pi D G / (N.L N.V)`` with ``D = exp(-(tan a / m)^2) / (m^2 cos^4 a)``; as
    Ngan et al. 2005, with another 1/pi in D."""
    wi, wo, m = np.array([[0.48, 0.64, 0.6]]), np.array([[-0.6, 0.0, 0.8]]), 0.4
    h = (wi + wo)[0] / np.linalg.norm(wi + wo)
    vh, a = float(wi[0] @ h), math.acos(h[2])
    D = math.exp(-((math.tan(a) / m) ** 2)) / (m**2 * math.cos(a) ** 4)
    G = min(1, 2 * h[2] * wi[0, 2] / vh, 2 * h[2] * wo[0, 2] / vh)
    eta = 1.5
    c, g = vh, math.sqrt(eta**2 + vh**2 - 1)
    F = 0.5 * ((g - c) / (g + c)) ** 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)
    printed = F / math.pi * D * G / (wi[0, 2] * wo[0, 2])
    for name, want in (("cook", printed), ("ngan", printed / math.pi), ("walter", printed / 4)):
        model = CookTorrance(normalization=name)
        vector = VECTORS["float64"]
        i, o = vector(*wi.T), vector(*wo.T)
        p = defaults(model, vector, m=m, eta=eta)
        np.testing.assert_allclose(to_numpy(model.f(p, i, o)[1]).ravel(), want, rtol=1e-13)


@pytest.mark.parametrize("kind", WIDE)
@pytest.mark.parametrize("cosine", [False, True])
def test_ggx_albedo(cosine: bool, kind: str) -> None:
    """Smith, F = 1, alpha .5: published with 4 digits. Both ways of sampling, so that the mean weight is the albedo."""
    model = CookTorrance(fresnel="constant", distribution="ggx", masking="smith")
    mu, want = (1.0, 0.7, 0.5, 0.3, 0.1), (0.6879, 0.6785, 0.6860, 0.7142, 0.7723)
    got, off = reflected(model, VECTORS[kind], mu, {"m": [0.5] * 5}, 128, cosine)
    assert (np.abs(got - want) < 4 * off + 1e-4).all()
    assert off.max() < 4e-3


@facets
def test_mean_weight_is_the_albedo(distribution: str, masking: str, roughness: str) -> None:
    """Of our sampling and of cosine sampling, at a roughness where both can tell."""
    model, mu = metal(distribution, masking, roughness), (0.9, 0.3)
    two = {"m": [0.6] * 2} if roughness == "isotropic" else {"m_u": [0.8] * 2, "m_v": [0.5] * 2}
    (a, da), (b, db) = (reflected(model, VECTORS["float64"], mu, two, 64, cosine) for cosine in (False, True))
    assert (np.abs(a - b) < 4 * np.hypot(da, db)).all()
    assert (np.hypot(da, db) < 0.02 * b).all()


@pytest.mark.parametrize("kind", WIDE)
@pytest.mark.parametrize(
    ("distribution", "masking"), [("ggx", "vcavity"), ("blinn", "vcavity"), ("ggx", "smith"), ("beckmann", "smith")]
)
@pytest.mark.parametrize("two", [(1e-4, 1e-4), (0.02, 0.3), (1.0, 1.0)])
def test_sampled_weight_is_bounded(kind: str, two: tuple[float, float], distribution: str, masking: str) -> None:
    """By 1 where facets are sampled as their masking shows them. Beckmann's under Smith's masking are sampled in V-cavities:
    at most ``sqrt(pi) tan / m``, and the largest tangent is 4.1 m in float32. The variance is below that of the cosine."""
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    model = CookTorrance(fresnel="constant", distribution=distribution, masking=masking, roughness="anisotropic")
    limit = 7.3 if (distribution, masking) == ("beckmann", "smith") else 1 + 64 * EPS[kind]
    u = vector(*np.random.default_rng(9).random((3, 1 << 15)))
    p = values(u, dr.opaque(number, two[0]), dr.opaque(number, two[1]))
    for cos in (1.0, 0.7, 0.1, 1e-3):
        wi = dr.opaque(vector, directions.unit(cos, 1.0).tolist())
        wo = model.sample(p, wi, u, 1)
        up = wo.z > 0
        safe = vector(wo.x, wo.y, dr.select(up, wo.z, 1))
        density = model.pdf(p, wi, safe)[1]
        good = up & (density > 0)
        weight = dr.select(good, model.f(p, wi, safe)[1].x * safe.z / dr.select(good, density, 1), 0)
        flat = model.f(p, wi, cosine_hemisphere(u, wi))[1].x * dr.pi
        dr.eval(wo, density, weight, flat)
        np.testing.assert_allclose(np.linalg.norm(to_numpy(wo), axis=0), 1, atol=8 * EPS[kind])
        assert (to_numpy(density)[to_numpy(up) > 0] > 0).mean() > 0.999
        assert np.isfinite(to_numpy(weight)).all()
        assert to_numpy(weight).max() <= limit
        if two == (0.02, 0.3):
            assert to_numpy(weight).var() < 0.2 * to_numpy(flat).var()


@pytest.mark.parametrize("m", [0.1, 0.2, 0.3])
def test_aluminium_peaks_off_the_mirror_direction(m: float) -> None:
    """Torrance and Sparrow 1967 measured it: the maximum lies beyond the mirror direction, the farther the more grazing."""
    model = CookTorrance(fresnel="conductor")
    vector = VECTORS["float64"]
    p = defaults(model, vector, m=m, eta=ETA, k=K)
    angle = np.radians(np.linspace(0, 89.9, 9000))
    o = vector(-np.sin(angle), 0 * angle, np.cos(angle))
    beyond = []
    for incidence in (10, 30, 45, 75):
        t = math.radians(incidence)
        f = to_numpy(model.f(p, vector(math.sin(t), 0, math.cos(t)), o)[1])
        assert f.shape == (3, len(angle))
        beyond.append(math.degrees(angle[f.sum(axis=0).argmax()]) - incidence)
    assert 0 < beyond[0] < beyond[1] < beyond[2]
    assert beyond[3] >= 9.9  # the horizon is 15 degrees on


def test_defaults_are_aluminium() -> None:
    """To the three decimals that are declared."""
    declared = {p.name: p.default for p in CookTorrance(fresnel="conductor").parameters()}
    np.testing.assert_allclose(declared["eta"], ETA, atol=6e-4)
    np.testing.assert_allclose(declared["k"], K, atol=6e-4)


@pytest.mark.parametrize(
    "choices",
    [
        {},
        {"masking": "none"},
        {"normalization": "cook"},
        {"normalization": "ngan"},
        {"normalization": "ngan", "distribution": "ggx", "masking": "smith"},
        {"fresnel": "conductor", "distribution": "blinn", "masking": "smith"},
        {"fresnel": "constant", "distribution": "blinn", "masking": "smith", "roughness": "anisotropic"},
        {"fresnel": "exact", "distribution": "blinn", "masking": "smith"},
        {"fresnel": "constant", "distribution": "ggx"},
        {"fresnel": "conductor", "masking": "smith", "roughness": "anisotropic"},
    ],
    ids=lambda c: "-".join(c.values()) or "default",
)
def test_faults(choices: dict[str, str]) -> None:
    """A lobe, or the sum of both, exceeds 1 at one of the trials exactly where it is declared."""
    model = CookTorrance(**choices)
    names = [p.name for p in model.parameters() if p.name in ("m", "m_u", "m_v")]
    usual = {p.name: p.default for p in model.parameters()}
    mu = np.cos(np.radians([0, 60, 85, 89.9]))
    settings = {name: [t.get(name, usual[name]) for t in model.trials for _ in mu] for name in names}
    assert len(model.trials) > 1 and not any(set(t) - {"m", "m_u", "m_v", "diffuse_reflectance"} for t in model.trials)
    base = usual["diffuse_reflectance"]
    assert base == ((0.0,) * 3 if model.fresnel == "conductor" else (0.5,) * 3)
    diffuse = np.repeat([t.get("diffuse_reflectance", base[0]) for t in model.trials], len(mu))
    value, off = reflected(model, VECTORS["float32"], np.tile(mu, len(model.trials)), settings)
    least = value - 4 * off - 1e-5
    found = {check for check, total in (("energy", least), ("coupling", least + diffuse)) if total.max() > 1}
    assert found == set(model.faults())
    assert all(model.faults().values())
