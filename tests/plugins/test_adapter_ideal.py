"""Ideal lobes as Mitsuba asks for them: samples, chances, components, sides, transport modes, pictures."""

from __future__ import annotations

from typing import Any

import drjit as dr
import drjit.llvm.ad as wide
import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf import Lobe, Model, builtin, defaults
from plugins.adapter import flag_of
from tests.oracles import directions
from tests.plugins.hits import VARIANTS, array, components, interaction, types

N = 2000
NAMES = ("mirror", "metal", "glass", "glazed")
models = pytest.mark.parametrize("name", NAMES)
TINT = (0.9, 0.5, 0.2)
#: What each is given, by name: tints that differ by channel.
GIVEN: dict[str, dict[str, Any]] = {
    "mirror": {"specular_reflectance": TINT},
    "metal": {"eta": (0.2, 0.9, 1.4), "k": (3.9, 2.5, 1.9), "specular_reflectance": TINT},
    "glass": {"eta": 1.5, "specular_reflectance": TINT, "specular_transmittance": (0.3, 0.6, 0.8)},
    "glazed": {"eta": 1.5, "specular_reflectance": TINT, "diffuse_reflectance": (0.7, 0.4, 0.1)},
}


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def load(name: str) -> mi.BSDF:
    rgb = {k: {"type": "rgb", "value": list(v)} if isinstance(v, tuple) else v for k, v in GIVEN[name].items()}
    return mi.load_dict({"type": name, **rgb})


def views(name: str) -> Any:
    """Above, and for what transmits also below."""
    w = directions.hemisphere(N, 7)
    if builtin()[name]().transmits:
        w[::2, 2] *= -1
    return w


def numbers(seed: int = 3) -> tuple[mi.Float, mi.Point2f]:
    rng = np.random.default_rng(seed)
    return mi.Float(rng.random(N)), mi.Point2f(rng.random((2, N)))


def said(name: str, wi: Any) -> tuple[Model, Any, Any, list[Any]]:
    """The model in float64, its values and directions, and how often each lobe is chosen."""
    model = builtin()[name]()
    vector = wide.Array3f64
    p, i = defaults(model, vector, **GIVEN[name]), vector(wi.T)
    chances = [np.broadcast_to(array(c), len(wi)) for c in model.choose(p, i)]
    total = np.sum(chances, axis=0)
    return model, p, i, [c / total for c in chances]


@models
def test_flags(name: str) -> None:
    bsdf = load(name)
    flags = mi.BSDFFlags
    sides = flags.FrontSide | flags.BackSide if name == "glass" else flags.FrontSide
    want = {
        "mirror": [flags.DeltaReflection],
        "metal": [flags.DeltaReflection],
        "glass": [flags.DeltaReflection, flags.DeltaTransmission | flags.NonSymmetric],
        "glazed": [flags.DeltaReflection, flags.DiffuseReflection],
    }[name]
    assert [bsdf.flags(i) for i in range(bsdf.component_count())] == [int(f | sides) for f in want]
    assert str(bsdf).startswith(f"{name}[")


@models
def test_each_component_alone(name: str) -> None:
    """By number and by type: the direction and the weight that the model says, with certainty."""
    bsdf, w = load(name), views(name)
    model, p, i, _ = said(name, w)
    for at, lobe in enumerate(model.lobes):
        if not lobe.ideal:
            continue
        ideal = model.ideal(p, i, at)
        by_type = types(flag_of(lobe))
        for context in (components(bsdf)[at], by_type):
            context.mode = mi.TransportMode.Importance
            bs, weight = bsdf.sample(context, interaction(w), *numbers())
            want = np.broadcast_to(array(ideal.weight), (3, N))
            np.testing.assert_allclose(array(weight), want, atol=1e-4 if name == "glass" else 1e-6)
            moves = want[0] > 0.01  # by the critical angle rounding of wi moves it
            np.testing.assert_allclose(array(bs.wo)[:, moves], array(ideal.wo)[:, moves], atol=2e-5)
            np.testing.assert_array_equal(array(bs.pdf), 1)
            np.testing.assert_allclose(array(bs.eta), np.broadcast_to(array(ideal.eta), N), rtol=1e-6)
            assert (array(bs.sampled_component) == at).all()
            assert (array(bs.sampled_type) == int(flag_of(lobe))).all()


@models
def test_chances(name: str) -> None:
    """Of all lobes: pdf is the chance, weight times pdf what the lobe does, and lobes come as often as their chance says."""
    bsdf, w = load(name), views(name)
    model, p, i, chances = said(name, w)
    context = mi.BSDFContext(mi.TransportMode.Importance)
    bs, weight = bsdf.sample(context, interaction(w), *numbers())
    lobe, pdf = array(bs.sampled_component), array(bs.pdf)
    for at, kind in enumerate(model.lobes):
        here = lobe == at
        assert here.any()
        often, chance = here.mean(), chances[at].mean()
        assert abs(often - chance) <= 4 * np.sqrt(chance * (1 - chance) / N)
        if kind.ideal:
            np.testing.assert_allclose(pdf[here], chances[at][here], rtol=1e-3)
            want = np.broadcast_to(array(model.ideal(p, i, at).weight), (3, N))
            np.testing.assert_allclose((array(weight) * pdf)[:, here], want[:, here], atol=1e-4)
            assert (array(bs.sampled_type)[here] == int(flag_of(kind))).all()


@models
def test_all_lobes_add_up(name: str) -> None:
    """The mean weight is the sum of the lobes' weights: nothing is lost or counted twice in choosing."""
    bsdf = load(name)
    context = mi.BSDFContext(mi.TransportMode.Importance)
    n = 1 << 16
    side = -1 if name == "glass" else 1
    w = np.tile(directions.unit(0.9, 0.4) * [1, 1, side], (n, 1))
    rng = np.random.default_rng(1)
    u = mi.Float((np.arange(n) + 0.5) / n), mi.Point2f(rng.random((2, n)))
    _, weight = bsdf.sample(context, interaction(w), *u)
    alone = sum(array(bsdf.sample(c, interaction(w), *u)[1]).mean(axis=1) for c in lit(components(bsdf)))
    np.testing.assert_allclose(array(weight).mean(axis=1), alone, rtol=2e-3)


def lit(contexts: list[mi.BSDFContext]) -> list[mi.BSDFContext]:
    for context in contexts:
        context.mode = mi.TransportMode.Importance
    return contexts


@models
def test_eval_and_pdf_know_no_ideal_lobe(name: str) -> None:
    """Also in the mirror direction itself: 0, or what the diffuse lobe is worth."""
    bsdf, w = load(name), views(name)
    model = builtin()[name]()
    si, context = interaction(w), mi.BSDFContext()
    mirrored = mi.Vector3f((w * [-1, -1, 1]).T)
    value, pdf = bsdf.eval_pdf(context, si, mirrored)
    if name == "glazed":
        diffuse = components(bsdf)[1]
        np.testing.assert_array_equal(array(value), array(bsdf.eval(diffuse, si, mirrored)))
        chance = said(name, w)[3][1]
        np.testing.assert_allclose(array(pdf), chance * w[:, 2] / np.pi, rtol=1e-5)
    else:
        assert (array(value) == 0).all() and (array(pdf) == 0).all()
    np.testing.assert_array_equal(array(bsdf.eval(context, si, mirrored)), array(value))
    np.testing.assert_array_equal(array(bsdf.pdf(context, si, mirrored)), array(pdf))
    for at, lobe in enumerate(model.lobes):
        if lobe.ideal:
            alone = components(bsdf)[at]
            assert (array(bsdf.eval(alone, si, mirrored)) == 0).all()
            assert (array(bsdf.pdf(alone, si, mirrored)) == 0).all()


@models
def test_what_is_off_is_black(name: str) -> None:
    """A type that is not there, and inactive lanes."""
    bsdf, w = load(name), views(name)
    bs, weight = bsdf.sample(types(mi.BSDFFlags.GlossyReflection), interaction(w), *numbers())
    assert (array(weight) == 0).all() and (array(bs.pdf) == 0).all()
    active = dr.arange(mi.UInt32, N) % 3 == 0
    bs, weight = bsdf.sample(mi.BSDFContext(), interaction(w), *numbers(), active)
    off = ~array(active).astype(bool)
    assert (array(weight)[:, off] == 0).all() and (array(bs.pdf)[off] == 0).all()
    assert (array(weight)[:, ~off] > 0).any()


@pytest.mark.parametrize("name", ["mirror", "metal", "glazed"])
def test_sides(name: str) -> None:
    """Black from below, and the same from both sides under `twosided`."""
    one = load(name)
    two = mi.load_dict({"type": "twosided", "nested": one})
    w = views(name)
    below = interaction(w * [1, 1, -1])
    bs, weight = one.sample(mi.BSDFContext(), below, *numbers())
    assert (array(weight) == 0).all() and (array(bs.pdf) == 0).all()
    over, above = one.sample(mi.BSDFContext(), interaction(w), *numbers())
    bs, weight = two.sample(mi.BSDFContext(), below, *numbers())
    np.testing.assert_array_equal(array(weight), array(above))
    np.testing.assert_array_equal(array(bs.wo) * [[1], [1], [-1]], array(over.wo))


def test_glass_has_two_sides_already() -> None:
    with pytest.raises(RuntimeError, match="without a transmission component"):
        mi.load_dict({"type": "twosided", "nested": {"type": "glass"}})


def test_radiance_changes_with_the_index() -> None:
    """By ``1 / eta^2`` on the way in and ``eta^2`` on the way out, for radiance alone; reflection as it is."""
    bsdf, w = load("glass"), views("glass")
    radiance, importance = (mi.BSDFContext(mode) for mode in (mi.TransportMode.Radiance, mi.TransportMode.Importance))
    bs, a = bsdf.sample(radiance, interaction(w), *numbers())
    _, b = bsdf.sample(importance, interaction(w), *numbers())
    a, b = array(a)[0], array(b)[0]
    through = array(bs.sampled_component) == 1
    lit = b > 0
    into = w[:, 2] > 0
    np.testing.assert_allclose((a / b)[lit & through & into], 1 / 2.25, rtol=1e-6)
    np.testing.assert_allclose((a / b)[lit & through & ~into], 2.25, rtol=1e-6)
    np.testing.assert_array_equal(a[~through], b[~through])
    np.testing.assert_allclose(array(bs.eta)[through & into], 1.5, rtol=1e-6)
    np.testing.assert_allclose(array(bs.eta)[through & ~into], 1 / 1.5, rtol=1e-6)
    np.testing.assert_array_equal(array(bs.eta)[~through], 1)


def test_gradients() -> None:
    """Weight and refracted direction carry the derivative of eta; pdf, choice and the direction of a mirror do not."""
    w = np.tile(directions.unit(0.8, 0.0), (2, 1))
    model = builtin()["glass"]()
    u = mi.Float([0.01, 0.99]), mi.Point2f(0.5, 0.5)  # one is mirrored, one refracted

    def exact(eta: float) -> tuple[Any, Any]:
        p = defaults(model, wide.Array3f64, eta=eta)
        i = wide.Array3f64(w[0].tolist())
        through = model.ideal(p, i, 1)
        scale = array(through.eta).ravel() ** 2
        weights = [array(model.ideal(p, i, 0).weight)[0].item(), (array(through.weight)[0] / scale).item()]
        return np.array(weights), array(through.wo).ravel()

    h = 1e-6
    (high, wo_high), (low, wo_low) = exact(1.5 + h), exact(1.5 - h)
    for at in range(2):
        bsdf = mi.load_dict({"type": "glass", "eta": 1.5})
        params = mi.traverse(bsdf)
        dr.enable_grad(params["eta.value"])
        params.update()
        bs, weight = bsdf.sample(mi.BSDFContext(), interaction(w), *u)
        assert array(bs.sampled_component).tolist() == [0, 1]
        assert not dr.grad_enabled(bs.pdf) and not dr.grad_enabled(bs.eta)
        dr.forward(params["eta.value"])
        got = array(weight.x.grad)[at] * array(bs.pdf)[at]
        assert got == pytest.approx((high - low)[at] / (2 * h), rel=1e-5)
        want = (wo_high - wo_low) / (2 * h) if at == 1 else np.zeros(3)
        np.testing.assert_allclose([array(c.grad)[at] for c in bs.wo], want, atol=1e-6)


@models
def test_a_mirror_stands_still(name: str) -> None:
    """So that `path` need not cut the ray."""
    if name == "glass":
        return
    bsdf = load(name)
    params = mi.traverse(bsdf)
    for key in params.keys():  # noqa: SIM118
        dr.enable_grad(params[key])
    params.update()
    bs, weight = bsdf.sample(mi.BSDFContext(), interaction(views(name)), *numbers())
    assert dr.grad_enabled(weight) and not dr.grad_enabled(bs.wo)


@pytest.mark.parametrize("black", ["specular_reflectance", "specular_transmittance"])
def test_a_black_branch_is_not_sampled(black: str) -> None:
    """Where the other is not black as well, by total internal reflection."""
    bsdf = mi.load_dict({"type": "glass", black: 0.0})
    w = views("glass")
    bs, weight = bsdf.sample(mi.BSDFContext(), interaction(w), *numbers())
    assert np.isfinite(array(weight)).all()
    dark = (array(weight) == 0).all(axis=0)
    beyond = (w[:, 2] < 0) & (1 - w[:, 2] ** 2 > 1 / 2.25)
    if black == "specular_transmittance":
        assert not dark.any()
    else:
        np.testing.assert_array_equal(dark, beyond)
    assert (array(bs.sampled_component)[~dark] == (0 if black == "specular_transmittance" else 1)).all()


#: In a white furnace: what is on the ball, and the mean of its picture. A mirror, glass and a white base under a coat
#: reflect or pass on all; grey metal at normal incidence reflects ((1.5 - 1)^2 + 4) / ((1.5 + 1)^2 + 4) = .415, and more
#: further out; of the dipole's light some 3/4 come back.
FURNACE = [
    ("mirror", {}, 1.0, 1.0),
    ("metal", {"eta": 1.5, "k": 2.0}, 0.415, 0.6),
    ("glass", {}, 1.0, 1.0),
    ("glazed", {"diffuse_reflectance": 1.0}, 1.0, 1.0),
    ("glazed", {"diffuse_reflectance": 1.0, "fresnel": "schlick"}, 1.0, 1.0),
    ("diffusion", {}, 0.6, 0.8),
]


@pytest.mark.parametrize("variant", VARIANTS)
def test_furnace(variant: str) -> None:
    """Through Mitsuba's path tracer, in each variant. The light that is still inside the glass after 40 reflections is
    nothing; what is left is noise."""
    mi.set_variant(variant)
    for name, given, low, high in FURNACE:
        scene: Any = mi.load_dict({
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 40, "rr_depth": 100},
            "sensor": {
                "type": "perspective",
                "fov": 10,
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 8], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 6, "height": 6, "rfilter": {"type": "box"}},
            },
            "emitter": {"type": "constant"},
            "ball": {"type": "sphere", "bsdf": {"type": name, **given}},
        })  # fmt: skip
        image = array(mi.render(scene, spp=24 if variant.startswith("scalar") else 1024))
        assert np.isfinite(image).all()
        noise = 0.04 if variant.startswith("scalar") or mi.is_spectral else 0.01
        assert low - noise < image.mean() < high + noise, (name, given, image.mean())


def test_lobes_by_flag() -> None:
    """Every lobe has its flag, and every ideal one is a delta in Mitsuba's words."""
    delta = int(mi.BSDFFlags.Delta)
    for lobe in Lobe:
        assert bool(int(flag_of(lobe)) & delta) == lobe.ideal
