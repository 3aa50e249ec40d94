"""Glass, metal and glazed against Mitsuba's own `dielectric`, `conductor` and `plastic`; and what XML says of them."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import mpmath
import numpy as np
import pytest

import plugins
from tests.oracles import directions, optics
from tests.plugins.hits import VARIANTS, array, components, interaction

N = 4000


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def numbers() -> tuple[mi.Float, mi.Point2f]:
    rng = np.random.default_rng(3)
    return mi.Float(rng.random(N)), mi.Point2f(rng.random((2, N)))


def spectral(si: mi.SurfaceInteraction3f) -> mi.SurfaceInteraction3f:
    if mi.is_spectral:
        si.wavelengths = mi.Spectrum(450, 520, 590, 660)
    return si


@pytest.mark.parametrize("mode", ["Radiance", "Importance"])
@pytest.mark.parametrize("component", [0, 1, None])
@pytest.mark.parametrize("indices", [("bk7", "air"), ("water", 1.0), ("air", "water"), (2.0, 1.0)])
def test_glass(indices: tuple[Any, Any], component: int | None, mode: str) -> None:
    """Weights, directions, chances and indices of both branches from both sides, with total internal reflection."""
    given = {"int_ior": indices[0], "ext_ior": indices[1]}
    ours, theirs = (mi.load_dict({"type": kind, **given}) for kind in ("glass", "dielectric"))
    w = directions.hemisphere(N, 5)
    w[::2, 2] *= -1
    eta = array(mi.traverse(ours)["eta.value"]).item()
    assert eta == pytest.approx(array(mi.traverse(theirs)["eta"]).item(), rel=1e-6)
    context = mi.BSDFContext(getattr(mi.TransportMode, mode))
    if component is not None:
        context.component = component
    (a, x), (b, y) = (bsdf.sample(context, interaction(w), *numbers()) for bsdf in (ours, theirs))
    far = np.where(w[:, 2] > 0, eta, 1 / eta)
    cos2 = 1 - (1 - w[:, 2] ** 2) / far**2
    away = np.abs(cos2) > 0.01  # theirs loses the critical angle
    same = np.broadcast_to(array(a.sampled_component) == array(b.sampled_component), N)
    assert same.mean() > 0.999
    good = away & same
    np.testing.assert_allclose(array(x)[:, good], array(y)[:, good], rtol=1e-4, atol=1e-6)
    assert (component is None) == (array(a.pdf).min() < 1)
    for name in ("pdf", "eta", "sampled_type"):
        mine, native = (np.broadcast_to(array(getattr(bs, name)), N)[good] for bs in (a, b))
        np.testing.assert_allclose(mine, native, rtol=1e-4 if name == "pdf" else 1e-6)
    lit = good & (array(y)[0] > 0)
    np.testing.assert_allclose(array(a.wo)[:, lit], array(b.wo)[:, lit], atol=1e-5)
    beyond = cos2 < -0.01
    assert beyond.sum() > 100
    if component == 1:
        assert (array(x)[:, beyond] == 0).all()
    else:
        np.testing.assert_allclose(array(x)[:, beyond], 1, rtol=1e-6)


@pytest.mark.parametrize("name", ["llvm_ad_rgb", "llvm_ad_spectral", "llvm_ad_mono"])
@pytest.mark.parametrize(
    "given", [{"material": "Al"}, {"material": "Au"}, {"material": "none"}, {"eta": 1.5, "k": 2.0}]
)
def test_metal(given: dict[str, Any], name: str) -> None:
    """With the indices that Mitsuba has measured, and with numbers."""
    mi.set_variant(name)
    ours, theirs = (mi.load_dict({"type": kind, **given}) for kind in ("metal", "conductor"))
    w = directions.hemisphere(N, 5)
    (a, x), (b, y) = (bsdf.sample(mi.BSDFContext(), spectral(interaction(w)), *numbers()) for bsdf in (ours, theirs))
    np.testing.assert_allclose(array(x), array(y), rtol=2e-5)
    np.testing.assert_array_equal(array(a.wo), array(b.wo))
    for value in (a.pdf, b.pdf, a.eta, b.eta):
        assert (array(value) == 1).all()


def exact_mean(eta: float) -> float:
    return float(1 - (1 - optics.fresnel_mean_closed(mpmath.mpf(eta))) / mpmath.mpf(eta) ** 2)


#: What `plastic` takes for the reflectance of the coat from inside: a polynomial (d'Eon and Irving 2011), at 1/1.5.
THEIR_MEAN = 0.596811


@pytest.mark.parametrize("reflectance", [0.1, 0.5, 0.95])
def test_glazed(reflectance: float) -> None:
    """Mirror and Fresnel factors are those of `plastic`. Its base is another by a factor that does not depend on
    direction: the mean reflectance from inside is .596811 by a polynomial where .596346 is exact, and without
    ``nonlinear`` all light that returns to the base is taken to be reflected."""
    coat = {"int_ior": 1.5, "ext_ior": 1.0, "diffuse_reflectance": reflectance, "specular_reflectance": 0.8}
    ours = mi.load_dict({"type": "glazed", **coat})
    w, v = directions.hemisphere(N, 5), directions.hemisphere(N, 6)
    si, wo = interaction(w), mi.Vector3f(v.T)
    inside = exact_mean(1.5)
    assert inside == pytest.approx(0.596346, abs=5e-7)
    for nonlinear in (True, False):
        theirs = mi.load_dict({"type": "plastic", "nonlinear": nonlinear, **coat})
        mirror, diffuse = components(ours)
        (a, x), (b, y) = (bsdf.sample(mirror, si, *numbers()) for bsdf in (ours, theirs))
        np.testing.assert_allclose(array(x), array(y), rtol=1e-4)
        np.testing.assert_array_equal(array(a.wo), array(b.wo))
        ratio = array(ours.eval(diffuse, si, wo))[0] / array(theirs.eval(diffuse, si, wo))[0]
        returned = reflectance * THEIR_MEAN if nonlinear else THEIR_MEAN
        want = (1 - returned) / (1 - reflectance * inside)
        np.testing.assert_allclose(ratio, want, rtol=1e-4)  # their F near grazing, in float32
        assert abs(want - 1) > (1e-5 if nonlinear else 0.01)


@pytest.mark.parametrize("variant", VARIANTS)
def test_xml(variant: str) -> None:
    """Indices by name and by number, in each variant; what is left out is bk7 or air; `eta` is what is traversed."""
    mi.set_variant(variant)
    for name in ("glass", "glazed", "diffusion"):
        for body, want in (
            ("", 1.5),
            ('<float name="eta" value="1.7"/>', 1.7),
            ('<string name="int_ior" value="water"/>', 1.333 / 1.000277),
            ('<string name="int_ior" value="bk7"/><string name="ext_ior" value="water"/>', 1.5046 / 1.333),
            ('<float name="int_ior" value="1.8"/><float name="ext_ior" value="1.2"/>', 1.5),
            ('<float name="ext_ior" value="1"/>', 1.5046),
        ):
            bsdf: Any = mi.load_string(f'<bsdf version="3.0.0" type="{name}">{body}</bsdf>')
            params = mi.traverse(bsdf)
            assert np.ravel(params["eta.value"])[0] == pytest.approx(want, rel=1e-6)
            assert "int_ior" not in params and "ext_ior" not in params


NEITHER = "is neither a number above 0 nor a medium that Mitsuba knows: air, water, bk7, ... A texture goes on eta."
TWICE = "are both given. They say the same: leave one out."
ERRORS = [
    (
        "glass",
        '<float name="eta" value="1.5"/><string name="int_ior" value="bk7"/>',
        f"glass: int_ior and eta {TWICE}",
    ),
    (
        "metal",
        '<string name="material" value="Al"/><float name="k" value="2"/>',
        f"metal: material and k {TWICE}",
    ),
    (
        "glass",
        '<string name="int_ior" value="jelly"/>',
        f"glass: int_ior = 'jelly' {NEITHER}",
    ),
    ("glass", '<float name="ext_ior" value="0"/>', f"glass: ext_ior = 0.0 {NEITHER}"),
    ("glass", '<boolean name="int_ior" value="true"/>', f"glass: int_ior = True {NEITHER}"),
    ("glass", '<texture name="int_ior" type="checkerboard"/>', f"glass: int_ior = Texture {NEITHER}"),
    (
        "metal",
        '<texture name="material" type="checkerboard"/>',
        "metal: material = Texture is no metal that Mitsuba has measured: Ag, Al, Au, Cr, Cu, W, ...",
    ),
    (
        "metal",
        '<string name="material" value="Jelly"/>',
        "metal: material = 'Jelly' is no metal that Mitsuba has measured: Ag, Al, Au, Cr, Cu, W, ...",
    ),
    (
        "glazed",
        '<float name="int_ior" value="1.5"/><float name="ext_ior" value="2"/>',
        "glazed: eta = 0.75 is outside [1.000001, 10]. eta is inside over outside; a coat seen from air has eta > 1.",
    ),
    (
        "mirror",
        '<string name="int_ior" value="bk7"/>',
        "mirror: 'int_ior' is not a parameter of this model. It has: specular_reflectance.",
    ),
    (
        "metal",
        '<string name="int_ior" value="bk7"/>',
        "metal: 'int_ior' is not a parameter of this model. It has: eta, k, specular_reflectance.",
    ),
]


@pytest.mark.parametrize(("name", "body", "message"), ERRORS, ids=[m[:30] for _, _, m in ERRORS])
def test_errors(name: str, body: str, message: str) -> None:
    with pytest.raises(RuntimeError) as raised:
        mi.load_string(f'<bsdf version="3.0.0" type="{name}">{body}</bsdf>')
    assert str(raised.value).strip().splitlines()[-1] == f"UsageError: {message}"


def test_an_rgb_index_in_a_spectral_variant() -> None:
    """Through its three values at 450, 550 and 650 nm: not cut off at 1 as a reflectance would be."""
    mi.set_variant("llvm_ad_spectral")
    rgb = {"eta": [0.2, 0.9, 1.4], "k": [3.9, 2.5, 1.9]}
    bsdf = mi.load_dict({"type": "metal", **{name: {"type": "rgb", "value": v} for name, v in rgb.items()}})
    si = interaction(np.array([[0.0, 0.0, 1.0]]))
    si.wavelengths = mi.Spectrum(450, 550, 600, 650)
    eta, k = (np.array([v[2], v[1], (v[0] + v[1]) / 2, v[0]]) for v in rgb.values())
    _, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(0.5), mi.Point2f(0.5))
    want = ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2)
    np.testing.assert_allclose(array(weight).ravel(), want, rtol=1e-5)
    with pytest.raises(
        RuntimeError, match=r"UsageError: metal: k is given as RGB in a texture, which llvm_ad_spectral"
    ):
        data = np.full((2, 2, 3), 3, dtype=np.float32)
        mi.load_dict({"type": "metal", "k": {"type": "bitmap", "bitmap": mi.Bitmap(data)}})


def test_a_texture_on_the_index() -> None:
    """Its derivative goes to the pixel that was hit."""
    data = np.array([[1.2, 1.5], [1.8, 2.4]], dtype=np.float32)[..., None]
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(data), "raw": True, "filter_type": "nearest"}
    bsdf = mi.load_dict({"type": "glass", "eta": texture})
    si = interaction(np.tile([0.0, 0.0, 1.0], (4, 1)))
    si.uv = mi.Point2f([0.25, 0.75, 0.25, 0.75], [0.25, 0.25, 0.75, 0.75])
    params = mi.traverse(bsdf)
    dr.enable_grad(params["eta.data"])
    params.update()
    _, weight = bsdf.sample(components(bsdf)[0], si, mi.Float(0.5), mi.Point2f(0.5))
    n = data.ravel().astype(float)
    np.testing.assert_allclose(array(weight)[0], ((n - 1) / (n + 1)) ** 2, rtol=1e-6)
    dr.backward(dr.sum(weight.x))
    slope = 4 * (n - 1) / (n + 1) ** 3  # of ((n - 1) / (n + 1))^2
    np.testing.assert_allclose(array(params["eta.data"].grad).ravel(), slope, rtol=1e-5)
