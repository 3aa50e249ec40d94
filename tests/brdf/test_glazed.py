"""A diffuse base under a smooth coat."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mpmath
import numpy as np
import pytest
from mpmath import mpf

from brdf import Lobe, Model, UsageError, Values, defaults, evaluate
from brdf.models.glazed import Glazed
from tests.brdf.arrays import EPS, VECTORS, call, precision, single, to_numpy
from tests.brdf.slopes import slope
from tests.oracles import directions, optics, textbook

WIDE = ("float32", "float64")
LAWS = ("exact", "schlick", "constant")
wide = pytest.mark.parametrize("kind", WIDE)
laws = pytest.mark.parametrize("law", LAWS)
MIRROR, DIFFUSE = 0, 1

COSINES = single([1, 0.7, 0.1, 1e-4])
ETAS = single([1.001, 1.333, 1.5, 2.419, 9.0])


def law_of(name: str) -> Any:
    """F of a cosine and an index; constant: that of normal incidence."""
    if name == "constant":
        return lambda c, n: ((n - 1) / (n + 1)) ** 2
    return textbook.FRESNEL[name]


def mean_of(name: str) -> Any:
    """Its mean over directions outside: of the exact law as Walsh has it, of Schlick's ``1/21 + 20/21 F0``."""
    f0 = law_of("constant")
    return {
        "exact": optics.fresnel_mean_closed,
        "schlick": lambda n: mpf(1) / 21 + mpf(20) / 21 * f0(1, n),
        "constant": lambda n: f0(1, n),
    }[name]


def pairs() -> tuple[Any, Any, Any]:
    i, o, n = (a.ravel() for a in np.meshgrid(COSINES, COSINES, ETAS))
    return i, o, n


def base(model: Model, vector: Any, wi: Any, wo: Any, eta: Any, diffuse: Any) -> Any:
    p = Values(eta=eta, diffuse_reflectance=vector(diffuse), specular_reflectance=vector(1))
    return model.f(p, wi, wo)[DIFFUSE].x


def toward(c: Any) -> Any:
    return np.array([directions.unit(x, 0.0) for x in c])


@laws
@pytest.mark.parametrize("kind", VECTORS)
@pytest.mark.parametrize("diffuse", [0.25, 0.75])
def test_value(kind: str, law: str, diffuse: float) -> None:
    """In, then any number of reflections between base and coat, then out, in 60 digits."""
    i, o, n = pairs()
    F, mean = law_of(law), mean_of(law)
    want = [float(optics.glazed(mpf(a), mpf(b), mpf(e), mpf(diffuse), F, mean(mpf(e)))) for a, b, e in zip(i, o, n, strict=True)]  # fmt: skip
    vector = VECTORS[kind]
    model = Glazed(fresnel=law)
    got = call(lambda a, b, e: base(model, vector, a, b, e, diffuse), vector, toward(i), toward(o), n)
    np.testing.assert_allclose(got, want, rtol=4e-6 if precision(kind) == "float32" else 1e-14)


@laws
@wide
@pytest.mark.parametrize("name", ["eta", "diffuse_reflectance"])
def test_gradient(kind: str, law: str, name: str) -> None:
    i, o, n = pairs()
    F, mean = law_of(law), mean_of(law)
    vector = VECTORS[kind]
    number, model = dr.value_t(vector), Glazed(fresnel=law)
    wi, wo = vector(*toward(i).T), vector(*toward(o).T)
    kd = 0.75

    def of_eta(a: float, b: float, e: float) -> Any:
        return mpmath.diff(lambda x: optics.glazed(mpf(a), mpf(b), x, mpf(kd), F, mean(x)), mpf(e))

    def of_diffuse(a: float, b: float, e: float) -> Any:
        return mpmath.diff(lambda x: optics.glazed(mpf(a), mpf(b), mpf(e), x, F, mean(mpf(e))), mpf(kd))

    if name == "eta":
        want = [float(of_eta(*row)) for row in zip(i, o, n, strict=True)]
        got = slope(lambda x: base(model, vector, wi, wo, x, kd), kind, n)
    else:
        want = [float(of_diffuse(*row)) for row in zip(i, o, n, strict=True)]
        got = slope(lambda x: base(model, vector, wi, wo, number(n), x), kind, np.full(len(n), kd))
    value = to_numpy(base(model, vector, wi, wo, number(n), kd))
    # d/d eta is a difference of what the coat lets in and what it keeps in: relative to the value as well.
    scale = np.abs(want) + value
    assert (np.abs(got - want) / scale).max() < (1e-5 if kind == "float32" else 2e-14)


@laws
@wide
def test_reciprocal_bit_for_bit(kind: str, law: str) -> None:
    wi, wo = directions.hemisphere(500, 1), directions.hemisphere(500, 2)
    vector = VECTORS[kind]
    model = Glazed(fresnel=law)
    p = defaults(model, vector, diffuse_reflectance=(0.1, 0.5, 1.0))
    i, o = vector(*wi.T), vector(*wo.T)
    there, back = to_numpy(evaluate(model, p, i, o)), to_numpy(evaluate(model, p, o, i))
    assert (there > 0).all()
    np.testing.assert_array_equal(there, back)


def albedo(model: Model, p: Values, cos: float) -> Any:
    """Of both lobes, by Gauss-Legendre quadrature; `cos` is the fourth power of the variable: F has a root at grazing."""
    vector = VECTORS["float64"]
    t, w = np.polynomial.legendre.leggauss(200)
    t, w = (t + 1) / 2, w / 2
    wi = vector(*directions.unit(cos, 0.0).tolist())
    wo = vector(*toward(t**4).T)
    diffuse = to_numpy(model.f(p, wi, wo)[DIFFUSE]) * t**4
    return np.sum(diffuse * 2 * np.pi * 4 * t**3 * w, axis=1) + to_numpy(model.ideal(p, wi, MIRROR).weight).ravel()


@laws
@pytest.mark.parametrize("eta", [1 + 2.0**-20, 1.01, 1.5, 3.0, 10.0])
def test_white_furnace(eta: float, law: str) -> None:
    """A white base reflects all, under any coat, at every angle; a grey one less; a black one what the coat does."""
    vector = VECTORS["float64"]
    model = Glazed(fresnel=law)
    p = defaults(model, vector, eta=eta, diffuse_reflectance=(1.0, 0.5, 0.0))
    for cos in (1.0, 0.5, 0.1, 1e-3):
        white, grey, black = albedo(model, p, cos)
        assert white == pytest.approx(1, abs=2e-8)
        assert black < grey < white
        assert black == pytest.approx(float(law_of(law)(mpf(cos), mpf(eta))), rel=1e-9)


@wide
def test_black_is_a_mirror(kind: str) -> None:
    """The lecture's black glazed ball: Fresnel reflection and nothing else; the tint is of the mirror."""
    vector = VECTORS[kind]
    p = defaults(Glazed(), vector, diffuse_reflectance=0.0, specular_reflectance=(0.25, 0.5, 1.0))
    wi, wo = vector(0.6, 0, 0.8), vector(0, 0.28, 0.96)
    assert (to_numpy(evaluate(Glazed(), p, wi, wo)) == 0).all()
    out, weight, _ = Glazed().ideal(p, wi, MIRROR)
    np.testing.assert_array_equal(to_numpy(out).ravel(), to_numpy(wi).ravel() * [-1, -1, 1])
    F = float(textbook.fresnel_dielectric(mpf("0.8"), mpf("1.5")))
    np.testing.assert_allclose(to_numpy(weight).ravel(), [F / 4, F / 2, F], rtol=8 * EPS[kind])
    assert to_numpy(Glazed().choose(p, wi)[DIFFUSE]) == 0


@laws
@wide
def test_chances_are_albedos(kind: str, law: str) -> None:
    """How much each lobe reflects."""
    vector = VECTORS[kind]
    model = Glazed(fresnel=law)
    p = defaults(model, vector, diffuse_reflectance=0.7, specular_reflectance=0.9)
    wi = vector(0.6, 0, 0.8)
    mirror, diffuse = model.choose(p, wi)
    np.testing.assert_allclose(to_numpy(mirror), to_numpy(model.ideal(p, wi, MIRROR).weight)[0], rtol=4 * EPS[kind])
    q = defaults(model, VECTORS["float64"], diffuse_reflectance=0.7, specular_reflectance=0.9)
    want = albedo(model, q, 0.8)[0] - float(0.9 * law_of(law)(mpf("0.8"), mpf("1.5")))
    np.testing.assert_allclose(to_numpy(diffuse), want, rtol=2e-6)


def test_what_constant_means() -> None:
    """F of normal incidence, at every angle."""
    vector = VECTORS["float64"]
    model = Glazed(fresnel="constant")
    for wi in (vector(0, 0, 1), vector(0.6, 0, 0.8), vector(1, 0, 1e-6)):
        assert to_numpy(model.ideal(defaults(model, vector), wi, MIRROR).weight).ravel() == pytest.approx(0.04)


@laws
@wide
def test_finite_everywhere(kind: str, law: str) -> None:
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    cosines = [1.0, 1 - 1e-7, 0.5, 1e-3, 1e-7, 1e-12]
    rows = [(a, b, n, k) for a in cosines for b in cosines for n in (1 + 2.0**-20, 1.5, 10.0) for k in (0.0, 0.5, 1.0)]
    a, b, n, k = np.array(rows).T
    wi, wo = vector(*toward(a).T), vector(*toward(b).T)
    model = Glazed(fresnel=law)
    p = Values(eta=number(n), diffuse_reflectance=vector(number(k)), specular_reflectance=vector(1))
    dr.enable_grad(p.eta, p.diffuse_reflectance)
    f, weight = evaluate(model, p, wi, wo), model.ideal(p, wi, MIRROR).weight
    assert (to_numpy(f) >= 0).all() and np.isfinite(to_numpy(f)).all()
    assert ((to_numpy(weight) >= 0) & (to_numpy(weight) <= 1)).all()
    dr.backward(dr.sum(f + weight, axis=None))
    assert np.isfinite(to_numpy(p.eta.grad)).all()
    assert np.isfinite(to_numpy(p.diffuse_reflectance.grad)).all()


def test_declaration() -> None:
    assert Glazed.lobes == (Lobe.MIRROR, Lobe.DIFFUSE)
    with pytest.raises(UsageError, match=r"^glazed: eta = 0\.9 is outside .* a coat seen from air has eta > 1\.$"):
        defaults(Glazed(), VECTORS["float64"], eta=0.9)
