"""`hanrahankrueger` and `orennayar` in Mitsuba: directions as the pdf says, XML, textures, and furnaces in each variant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import drjit.llvm.ad as wide
import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf import Lobe, UsageError, defaults
from brdf.models.hanrahankrueger import HanrahanKrueger
from tests.oracles import directions
from tests.plugins.hits import VARIANTS, array, components, interaction, types

#: Chi-square tests in this file: the level of each is chosen so that all pass with 99 % probability if all is right.
COUNT = 8
MODEL = HanrahanKrueger()
#: A layer through which, at 45 degrees, each of the three lobes sends a good part of the light.
LAYER = {"sigma_s": 2.0, "sigma_a": 0.1, "thickness": 0.4, "g": 0.6, "eta": 1.3}
ABOVE, BELOW = 45.0, 135.0


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def chi2(bsdf: mi.BSDF, context: mi.BSDFContext, wi: Any) -> None:
    def hit(n: int) -> mi.SurfaceInteraction3f:
        return interaction(np.broadcast_to(wi, (n, 3)))

    def sample(u: mi.Vector3f) -> tuple[mi.Vector3f, mi.Float]:
        bs, weight = bsdf.sample(context, hit(dr.width(u)), u.x, mi.Point2f(u.y, u.z))
        return bs.wo, dr.select(dr.any(weight != 0), 1.0, 0.0)

    def density(wo: mi.Vector3f) -> mi.Float:
        return bsdf.pdf(context, hit(dr.width(wo)), wo)

    test = mi.chi2.ChiSquareTest(mi.chi2.SphericalDomain(), sample, density, sample_dim=3, res=101, ires=16)
    assert test.run(test_count=COUNT, quiet=True), test.messages


@pytest.mark.parametrize("g", [-0.8, 0.0, 0.6])
@pytest.mark.parametrize(("cos", "side"), [(0.8, 1), (0.1, -1)])
def test_directions_of_both_scattered_lobes(cos: float, side: int, g: float, tmp_path: Path, monkeypatch: Any) -> None:
    """Reflected and transmitted, chosen as the model says, seen from above and from below."""
    monkeypatch.chdir(tmp_path)  # a failing test leaves its tables in the working directory
    bsdf = mi.load_dict({"type": "hanrahankrueger", **LAYER, "g": g})
    both = types(mi.BSDFFlags.DiffuseReflection, mi.BSDFFlags.DiffuseTransmission)
    chi2(bsdf, both, directions.unit(cos, 0.4) * [1, 1, side])


@pytest.mark.parametrize("variant_", ["full", "fast"])
def test_directions_of_orennayar(variant_: str, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    chi2(mi.load_dict({"type": "orennayar", "variant": variant_}), mi.BSDFContext(), directions.unit(0.3, 0.4))


def test_flags() -> None:
    flags = mi.BSDFFlags
    sides = flags.FrontSide | flags.BackSide
    bsdf = mi.load_dict({"type": "hanrahankrueger"})
    want = [flags.DiffuseReflection, flags.DiffuseTransmission, flags.DeltaTransmission]
    assert [bsdf.flags(i) for i in range(bsdf.component_count())] == [int(f | sides) for f in want]


def test_chances() -> None:
    """All three lobes are sampled; the mean weight is what leaves, and the part of each lobe is what it sends out alone."""
    bsdf = mi.load_dict({"type": "hanrahankrueger", **LAYER})
    n = 1 << 18
    rng = np.random.default_rng(5)
    hit = interaction(np.tile(directions.unit(np.cos(np.radians(ABOVE)), 0.4), (n, 1)))
    u, v = mi.Float(rng.random(n)), mi.Point2f(rng.random((2, n)))
    bs, weight = bsdf.sample(mi.BSDFContext(), hit, u, v)
    kind, weight = array(bs.sampled_component), array(weight)[0]
    for at, (context, want) in enumerate(zip(components(bsdf), albedos(ABOVE, 0), strict=True)):
        parts = weight * (kind == at)
        alone = array(bsdf.sample(context, hit, u, v)[1])[0]
        for got in (parts, alone):
            assert abs(got.mean() - want) < 4.5 * got.std() / np.sqrt(n) + 1e-5
        assert 0.05 < (kind == at).mean() < 0.9
    # No lobe is starved: none of the weights is far above what leaves.
    assert weight.max() < 5 * weight.mean()


def albedos(degrees: float, channel: int, **p: Any) -> list[float]:
    """What each lobe sends out, by quadrature of the model in float64."""
    vector = wide.Array3f64
    values = defaults(MODEL, vector, **{**LAYER, **p})
    wi = vector(float(np.sin(np.radians(degrees))), 0, float(np.cos(np.radians(degrees))))
    x, w = np.polynomial.legendre.leggauss(100)
    root, phi = (x + 1) / 2, (np.arange(128) + 0.5) * 2 * np.pi / 128
    cos, angle = (a.ravel() for a in np.meshgrid(root**2, phi, indexing="ij"))
    area = np.repeat(root * w, 128) * 2 * np.pi / 128
    sin = np.sqrt((1 - cos) * (1 + cos))
    found = []
    for at, lobe in enumerate(MODEL.lobes):
        if lobe is Lobe.STRAIGHT:
            found.append(float(array(MODEL.ideal(values, wi, at).weight)[channel].item()))
            continue
        side = (1 if wi.z[0] > 0 else -1) * (-1 if lobe.transmits else 1)
        wo = vector(sin * np.cos(angle), sin * np.sin(angle), side * cos)
        found.append(float(np.sum(array(MODEL.f(values, wi, wo)[at])[channel] * cos * area)))
    return found


def furnace(bsdf: dict[str, Any], degrees: float, spp: int) -> Any:
    """A large square under light from everywhere, seen from the same angle in all pixels."""
    a = np.radians(degrees)
    eye = [float(np.sin(a)), 0, float(np.cos(a))]
    scene = {
        "type": "scene",
        "integrator": {"type": "path"},
        "light": {"type": "constant"},
        "square": {"type": "rectangle", "bsdf": bsdf},
        "sensor": {
            "type": "orthographic",
            "to_world": mi.ScalarTransform4f().look_at(origin=eye, target=[0, 0, 0], up=[0, 1, 0])
            @ mi.ScalarTransform4f().scale([0.5, 0.5, 1]),
            "film": {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
        },
    }
    return array(mi.render(mi.load_dict(scene), spp=spp))


@pytest.mark.parametrize("degrees", [ABOVE, BELOW])
@pytest.mark.parametrize("name", VARIANTS)
def test_furnace(name: str, degrees: float) -> None:
    """Through Mitsuba's path tracer: reflected, transmitted and straight light add up, from both sides."""
    mi.set_variant(name)
    plugins.register()
    image = furnace({"type": "hanrahankrueger", **LAYER}, degrees, 4 if name.startswith("scalar") else 512)
    want = sum(albedos(degrees, 0))
    assert 0.5 < want < 0.95
    for channel in range(image.shape[2]):
        got = image[..., channel]
        noise = got.std() / 16
        assert abs(got.mean() - want) < 4.5 * noise + (5e-3 if mi.is_spectral else 1e-4)
        assert noise < 0.02


def test_texture() -> None:
    """Two texels of coefficients, each with three of its own: each half of the picture has the albedo of its own."""
    texels = np.array([[[0.5, 1.0, 3.0], [4.0, 2.0, 0.0]]], dtype=np.float32)
    bitmap = {"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": True, "filter_type": "nearest"}
    image = furnace({"type": "hanrahankrueger", **LAYER, "sigma_s": bitmap}, ABOVE, 1024)
    for half, sigma_s in zip(np.split(image, 2, axis=1), texels[0].tolist(), strict=True):
        found = half.reshape(-1, 3)
        reached = [sum(albedos(ABOVE, c, sigma_s=tuple(sigma_s))) for c in range(3)]
        assert len({round(r, 2) for r in reached}) == 3
        np.testing.assert_array_less(
            np.abs(found.mean(axis=0) - reached), 4.5 * found.std(axis=0) / np.sqrt(128) + 1e-4
        )


@pytest.mark.parametrize(
    ("given", "eta"),
    [
        ({"int_ior": 1.4, "ext_ior": 1.0}, 1.4),
        ({"int_ior": "water"}, 1.333 / 1.000277),
        ({"ext_ior": "water"}, 1.5046 / 1.333),
        ({"eta": 1.0}, 1.0),
    ],
)
def test_indices(given: dict[str, Any], eta: float) -> None:
    """Mitsuba's names; a layer without sides is allowed."""
    bsdf = mi.load_dict({"type": "hanrahankrueger", **given})
    assert float(array(mi.traverse(bsdf)["eta.value"]).item()) == pytest.approx(eta, rel=1e-6)


def test_xml_and_its_errors() -> None:
    xml = (
        '<bsdf version="3.0.0" type="hanrahankrueger"><rgb name="sigma_s" value="3, 2, 1"/>'
        '<float name="sigma_a" value="0"/><float name="thickness" value="1e6"/></bsdf>'
    )
    params = mi.traverse(mi.load_string(xml))
    np.testing.assert_allclose(array(params["sigma_s.value"]).ravel(), [3, 2, 1])
    np.testing.assert_allclose(array(params["sigma_a.value"]).ravel(), 0)
    assert array(params["thickness.value"]).item() == 1e6
    for wrong, message in (
        ({"int_ior": 1.0, "ext_ior": 1.5}, "eta = 0.66666666. is outside"),
        ({"g": 1.0}, "g = 1 is outside"),
        ({"thickness": -1.0}, "thickness = -1 is outside"),
        ({"sigma_t": 1.0}, "'sigma_t' is not a parameter of this model"),
    ):
        with pytest.raises((UsageError, RuntimeError), match=message):
            mi.load_dict({"type": "hanrahankrueger", **wrong})


def test_straight_light_leaves_the_rest_in_a_picture() -> None:
    """A sheet under a lamp with nothing behind it: `path` shows what `direct` does. It drops a sample that went on as
    Null and met nothing, with all that the lamp had sent to it."""
    to = mi.ScalarTransform4f
    view = to().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
    scene = mi.load_dict({
        "type": "scene",
        "sheet": {"type": "rectangle", "bsdf": {"type": "hanrahankrueger"}},
        "lamp": {"type": "point", "position": [0.5, 0.3, 2], "intensity": 5.0},
        "camera": {"type": "perspective", "fov": 20, "to_world": view, "film": {"type": "hdrfilm", "width": 8, "height": 8}},
    })  # fmt: skip
    path, direct = (
        np.array(mi.render(scene, spp=64, integrator=mi.load_dict({"type": name}))).mean()
        for name in ("path", "direct")
    )
    assert path == pytest.approx(direct, rel=1e-3)
