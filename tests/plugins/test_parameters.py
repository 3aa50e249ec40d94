"""What a parameter may be in a scene: number, colour, spectrum, texture; and what is said of the rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import drjit.llvm.ad as wide
import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf import defaults, evaluate
from brdf.models.cooktorrance import CookTorrance
from tests.oracles import directions
from tests.plugins.hits import BLUE, GREEN, RED, TINTED, VARIANTS, WI, WO, array, interaction


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def test_traverse() -> None:
    """Parameters by their names, all differentiable; choices are not parameters."""
    names = ["diffuse_reflectance.value", "specular_reflectance.value", "m.value", "eta.value"]
    params = mi.traverse(mi.load_dict(TINTED))
    assert list(params.keys()) == names
    assert all(params.flags(name) == mi.ParamFlags.Differentiable for name in names)
    assert list(mi.traverse(mi.load_dict({"type": "cooktorrance", "fresnel": "constant"})).keys()) == names[:3]

    bsdf = mi.load_dict(TINTED)
    params = mi.traverse(bsdf)
    params["m.value"] = 0.5
    params["diffuse_reflectance.value"] = mi.Color3f(0.3, 0.2, 0.1)
    params.update()
    changed = mi.load_dict({**TINTED, "m": 0.5, "diffuse_reflectance": {"type": "rgb", "value": [0.3, 0.2, 0.1]}})
    got, want = (b.eval(mi.BSDFContext(), interaction(WI), mi.Vector3f(WO.T)) for b in (bsdf, changed))
    np.testing.assert_array_equal(array(got), array(want))


def test_a_number_for_a_colour_has_three_components() -> None:
    params = mi.traverse(mi.load_dict({"type": "cooktorrance", "diffuse_reflectance": 0.25}))
    assert array(params["diffuse_reflectance.value"]).ravel().tolist() == [0.25] * 3


def bitmap(data: Any) -> dict[str, Any]:
    """A texture of these numbers as they are."""
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.asarray(data, dtype=np.float32)),
        "raw": True,
        "filter_type": "nearest",
    }


UV = np.array([[0.25, 0.75, 0.25, 0.75], [0.25, 0.25, 0.75, 0.75]])


def at_pixels() -> tuple[mi.SurfaceInteraction3f, mi.Vector3f]:
    """The middle of each pixel of a 2 x 2 texture, at one pair of directions."""
    si = interaction(np.tile(directions.unit(0.8, 0.3), (4, 1)))
    si.uv = mi.Point2f(UV)
    return si, mi.Vector3f(np.tile(directions.unit(0.7, 2.9), (4, 1)).T)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("m", [0.1, 0.2, 0.4, 0.8]),
        ("eta", [1.2, 1.5, 2.0, 9.5]),
        ("diffuse_reflectance", [0.0, 0.2, 0.5, 1.0]),
        ("specular_reflectance", [0.0, 0.2, 0.5, 1.0]),
    ],
)
def test_textures(name: str, values: list[float]) -> None:
    """On every parameter: each pixel is the BSDF with that number, and the gradient with respect to a pixel's number is the
    difference quotient."""
    channels = 3 if "reflectance" in name else 1
    data = np.repeat(np.array(values).reshape(2, 2, 1), channels, axis=2)
    bsdf = mi.load_dict({"type": "cooktorrance", name: bitmap(data)})
    si, wo = at_pixels()
    got = array(bsdf.eval(mi.BSDFContext(), si, wo))

    def single(value: float) -> Any:
        one = mi.load_dict({"type": "cooktorrance", name: value})
        return array(one.eval(mi.BSDFContext(), si, wo))[:, 0]

    np.testing.assert_allclose(got, np.array([single(v) for v in values]).T, rtol=1e-6)

    params = mi.traverse(bsdf)
    key = f"{name}.data"
    dr.enable_grad(params[key])
    params.update()
    dr.backward(dr.sum(bsdf.eval(mi.BSDFContext(), si, wo), axis=None))
    gradient = array(params[key].grad).reshape(4, channels)
    model = CookTorrance()
    i, o = (wide.Array3f64(np.tile(d, (4, 1)).T) for d in (directions.unit(0.8, 0.3), directions.unit(0.7, 2.9)))
    step = 1e-6

    def f(shift: float) -> Any:
        p = defaults(model, i)
        given = wide.Float64(np.array(values) + shift)
        setattr(p, name, wide.Array3f64(given) if channels == 3 else given)
        return array(evaluate(model, p, i, o) * o.z)

    quotient = (f(step) - f(-step)).T / (2 * step)
    if channels == 1:
        quotient = quotient.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(gradient, quotient, rtol=1e-4, atol=1e-6)


def test_texture_files(tmp_path: Path) -> None:
    """``<texture type="bitmap">`` in XML: a float image as it is, for a number and for a colour."""
    mi.Bitmap(np.array([[0.1, 0.2], [0.4, 0.8]], dtype=np.float32)[..., None]).write(str(tmp_path / "m.exr"))
    mi.Bitmap(np.full((2, 2, 3), [0.1, 0.2, 0.3], dtype=np.float32)).write(str(tmp_path / "kd.exr"))
    (tmp_path / "scene.xml").write_text("""<bsdf version="3.0.0" type="cooktorrance">
        <texture name="m" type="bitmap"><string name="filename" value="m.exr"/><boolean name="raw" value="true"/>
            <string name="filter_type" value="nearest"/></texture>
        <texture name="diffuse_reflectance" type="bitmap"><string name="filename" value="kd.exr"/></texture>
    </bsdf>""")
    bsdf: Any = mi.load_file(str(tmp_path / "scene.xml"))
    params = mi.traverse(bsdf)
    np.testing.assert_allclose(array(params["m.data"]).ravel(), [0.1, 0.2, 0.4, 0.8], rtol=1e-3)
    np.testing.assert_allclose(array(params["diffuse_reflectance.data"])[0, 0], [0.1, 0.2, 0.3], rtol=1e-3)


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_kind_of_parameter_in_each_variant(variant: str) -> None:
    """Number, RGB, spectrum, texture of one and of three channels, checkerboard: finite and lit."""
    mi.set_variant(variant)
    one = np.array([[0.1, 0.2], [0.4, 0.8]], dtype=np.float32)[..., None]
    texture = {"type": "bitmap", "raw": True}
    spectrum = {"type": "spectrum", "value": [(400, 0.1), (500, 0.5), (700, 0.9)]}
    for name, value in (
        ("diffuse_reflectance", 0.25),
        ("diffuse_reflectance", {"type": "rgb", "value": [RED, GREEN, BLUE]}),
        ("diffuse_reflectance", spectrum),
        ("specular_reflectance", {"type": "spectrum", "value": 0.5}),
        ("m", {**texture, "bitmap": mi.Bitmap(one)}),
        ("eta", {**texture, "bitmap": mi.Bitmap(one + 1)}),
        ("diffuse_reflectance", {"type": "bitmap", "bitmap": mi.Bitmap(np.repeat(one, 3, axis=2))}),
        ("m", {"type": "checkerboard", "color0": 0.1, "color1": 0.6}),
        ("diffuse_reflectance", {"type": "checkerboard", "color0": {"type": "rgb", "value": [RED, GREEN, BLUE]}}),
    ):
        bsdf = mi.load_dict({"type": "cooktorrance", name: value})
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = mi.Vector3f(0, 0.6, 0.8)
        si.uv = mi.Point2f(0.3, 0.4)
        if mi.is_spectral:
            si.wavelengths = mi.Spectrum(450, 500, 550, 600)
        got = array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(0, -0.6, 0.8)))
        assert np.isfinite(got).all() and (got > 0).all(), (name, value)


def test_a_spectrum_is_a_spectrum() -> None:
    """In a spectral variant the lobe has the reflectance of each wavelength."""
    mi.set_variant("llvm_ad_spectral")
    bsdf = mi.load_dict({
        "type": "cooktorrance",
        "diffuse_reflectance": {"type": "spectrum", "value": [(400, 0.1), (700, 0.7)]},
        "specular_reflectance": 0.0,
    })  # fmt: skip
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(0, 0.6, 0.8)
    si.wavelengths = mi.Spectrum(400, 450, 550, 700)
    got = array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(0, -0.6, 0.8))).ravel()
    np.testing.assert_allclose(got, np.array([0.1, 0.2, 0.4, 0.7]) * 0.8 / np.pi, rtol=1e-6)


M_RANGE = "is outside [1e-4, 1.5]. m is the rms slope; an artist's roughness r is m = r**2."
HAS = (
    "It has: diffuse_reflectance, specular_reflectance, m, m_u, m_v, eta, k, fresnel, masking, distribution, roughness, "
    "normalization."
)
ERRORS = [
    ('<float name="m" value="1.7"/>', f"cooktorrance: m = 1.7 {M_RANGE}"),
    ('<float name="m" value="nan"/>', f"cooktorrance: m = nan {M_RANGE}"),
    ('<float name="m" value="0"/>', f"cooktorrance: m = 0 {M_RANGE}"),
    (
        '<float name="eta" value="0.9"/>',
        "cooktorrance: eta = 0.9 is outside [1.000001, 10]. eta is inside over outside; a dielectric seen from air has eta > 1.",
    ),
    (
        '<rgb name="diffuse_reflectance" value="0.1, 1.2, 0"/>',
        "cooktorrance: diffuse_reflectance = 1.2 is outside [0, 1].",
    ),
    ('<float name="diffuse_reflectance" value="-1"/>', "cooktorrance: diffuse_reflectance = -1 is outside [0, 1]."),
    (
        '<float name="difuse_reflectance" value="1"/>',
        f"cooktorrance: 'difuse_reflectance' is not a parameter of this model. Did you mean diffuse_reflectance? {HAS}",
    ),
    ('<float name="zzz" value="1"/>', f"cooktorrance: 'zzz' is not a parameter of this model. {HAS}"),
    (
        '<string name="fresnel" value="snell"/>',
        "cooktorrance: fresnel = 'snell' is not one of exact, schlick, constant, conductor.",
    ),
    (
        '<float name="fresnel" value="1"/>',
        "cooktorrance: fresnel takes a <string>: one of exact, schlick, constant, conductor.",
    ),
    (
        '<string name="fresnel" value="constant"/><float name="eta" value="1.5"/>',
        "cooktorrance: 'eta' is not a parameter with fresnel = constant, masking = vcavity, distribution = beckmann, "
        "roughness = isotropic, normalization = walter. "
        "It has: diffuse_reflectance, specular_reflectance, m.",
    ),
    (
        '<string name="m" value="rough"/>',
        "cooktorrance: m is given as string. It takes a number in [1e-4, 1.5] or a texture.",
    ),
    (
        '<boolean name="m" value="true"/>',
        "cooktorrance: m is given as bool. It takes a number in [1e-4, 1.5] or a texture.",
    ),
    (
        '<rgb name="m" value="0.1, 0.2, 0.3"/>',
        "cooktorrance: m is given as a colour. It takes one number in [1e-4, 1.5] or a texture.",
    ),
    (
        '<spectrum name="m" value="400:0.1, 700:0.3"/>',
        "cooktorrance: m is given as a spectrum. It takes one number in [1e-4, 1.5] or a texture.",
    ),
    (
        '<bsdf name="m" type="diffuse"/>',
        "cooktorrance: m is given as BSDF. It takes a number in [1e-4, 1.5] or a texture.",
    ),
    (
        '<texture name="m" type="checkerboard"><float name="color0" value="0.3"/><float name="color1" value="0"/></texture>',
        f"cooktorrance: in the texture: m = 0 {M_RANGE}",
    ),
]


@pytest.mark.parametrize(("body", "message"), ERRORS, ids=[m.removeprefix("cooktorrance: ")[:40] for _, m in ERRORS])
def test_errors_when_loading(body: str, message: str) -> None:
    """The last line says plugin, parameter, what came, and what is allowed."""
    with pytest.raises(RuntimeError) as raised:
        mi.load_string(f'<bsdf version="3.0.0" type="cooktorrance">{body}</bsdf>')
    assert str(raised.value).strip().splitlines()[-1] == f"UsageError: {message}"


@pytest.mark.parametrize(
    ("name", "data", "shown"),
    [
        ("m", [0.1, 0.2, 0.3, 1.75], "1.75"),
        ("m", [0.1, 0.2, np.nan, 0.1], "nan"),
        # The first value is a rounding outside the bounds, which is allowed; the last is not.
        ("m", [np.nextafter(np.float32(1.5), np.float32(1)), 1.5, 1.5, -0.5], "-0.5"),
    ],
)
def test_values_in_a_texture(name: str, data: list[float], shown: str) -> None:
    with pytest.raises(RuntimeError) as raised:
        mi.load_dict({"type": "cooktorrance", name: bitmap(np.array(data).reshape(2, 2, 1))})
    message = f"cooktorrance: in the texture: {name} = {shown} {M_RANGE}"
    assert str(raised.value).strip().splitlines()[-1] == f"UsageError: {message}"


def test_a_texture_that_cannot_be_asked() -> None:
    """A spectrum sampled by wavelength has no value in an RGB variant."""
    spectrum = {"type": "regular", "wavelength_min": 400.0, "wavelength_max": 700.0, "values": "0.1, 0.9"}
    with pytest.raises(RuntimeError) as raised:
        mi.load_dict({"type": "cooktorrance", "diffuse_reflectance": spectrum})
    last = str(raised.value).strip().splitlines()[-1]
    assert last.startswith(
        "UsageError: cooktorrance: diffuse_reflectance takes a colour, which this texture does not give"
    )


def test_a_reference() -> None:
    scene: Any = mi.load_string("""<scene version="3.0.0">
        <texture type="checkerboard" id="board"><float name="color0" value="0.2"/><float name="color1" value="0.4"/></texture>
        <shape type="sphere"><bsdf type="cooktorrance"><ref name="m" id="board"/></bsdf></shape>
    </scene>""")
    assert "m = Checkerboard[" in str(scene.shapes()[0].bsdf())
