"""Reciprocity and energy of whole BSDFs: ours, Mitsuba's own, nested ones, and bad ones."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi
import pytest
from drjit.llvm.ad import Array3f64

import plugins
from brdf import Model, UsageError, builtin, defaults
from brdf.checks.energy import albedo, lobe_weight
from brdf.models.cooktorrance import CookTorrance
from plugins import registry
from plugins.checks.glance import glance

#: eval is a product with the cosine and is divided by it again: two roundings of float32 on each side.
ROUNDING = 4 * 2.0**-24


@pytest.fixture(autouse=True)
def variant(monkeypatch: pytest.MonkeyPatch) -> None:
    mi.set_variant("llvm_ad_rgb")
    monkeypatch.setattr(registry, "_known", {})
    plugins.register()


@pytest.mark.parametrize("name", builtin())
@pytest.mark.parametrize("nested", [False, True])
def test_our_models_with_their_defaults(name: str, nested: bool) -> None:
    """Reciprocal to rounding and no brighter than the light, but for what the model declares."""
    model = builtin()[name]()
    if nested and model.transmits:
        pytest.skip("Mitsuba's twosided takes no BSDF that transmits")
    xml: dict[str, Any] = {"type": name}
    found = glance(mi.load_dict({"type": "twosided", "nested": xml} if nested else xml))
    faults = model.faults()
    assert found.reciprocity_max <= ROUNDING or "reciprocity" in faults
    assert found.albedo_max < 1 + 3 * found.albedo_sd + 1e-6 or faults.keys() & {"energy", "coupling"}


@pytest.mark.parametrize("variant_name", ["llvm_ad_rgb", "llvm_ad_mono", "llvm_ad_spectral"])
def test_what_is_known(variant_name: str) -> None:
    """A white diffuser reflects all, a grey one half; V-cavities with F = 1 nearly all, most at 89.9 degrees, where the
    quadrature of brdf.checks in float64 finds the same."""
    mi.set_variant(variant_name)
    assert glance(mi.load_dict({"type": "lambertian", "reflectance": 1.0})).albedo_max == pytest.approx(1, abs=1e-6)
    assert glance(mi.load_dict({"type": "diffuse", "reflectance": 0.5})).albedo_max == pytest.approx(0.5, abs=1e-6)
    white = {"type": "cooktorrance", "m": 0.3, "fresnel": "constant", "diffuse_reflectance": 0.0}
    found = glance(mi.load_dict(white))
    assert found.albedo_angle == pytest.approx(math.radians(89.9))
    model = CookTorrance(fresnel="constant")
    p = defaults(model, Array3f64, m=0.3, diffuse_reflectance=0.0)
    want, error = albedo(lobe_weight(model, p), math.cos(found.albedo_angle), Array3f64)
    assert found.albedo_max == pytest.approx(want, abs=4 * (found.albedo_sd + error))
    assert 0 < found.albedo_sd < 0.01


@pytest.mark.parametrize("m", [1e-3, 0.02, 1.0])
def test_sharp_and_rough(m: float) -> None:
    found = glance(mi.load_dict({"type": "cooktorrance", "m": m, "diffuse_reflectance": 0.0}))
    assert found.reciprocity_max <= ROUNDING
    assert 0.2 < found.albedo_max < 1 + 3 * found.albedo_sd


def test_the_brightest_channel() -> None:
    tint = {"type": "rgb", "value": [0.2, 0.9, 0.4]}
    found = glance(mi.load_dict({"type": "lambertian", "reflectance": tint}))
    assert found.albedo_max == pytest.approx(0.9, abs=1e-6)


def test_mitsubas_own() -> None:
    """What is physical passes, a mirror and a refracting surface too; their F takes the cosine from a rounded half vector,
    so that they are reciprocal to some 1e-3."""
    for xml in (
        {"type": "roughconductor", "alpha": 0.2, "material": "Al"},
        {"type": "roughplastic", "alpha": 0.1},
        {"type": "roughdielectric", "alpha": 0.3},
        {"type": "dielectric"},
        {"type": "conductor"},
        {"type": "principled", "roughness": 0.3},
    ):
        found = glance(mi.load_dict(xml))
        assert found.reciprocity_max < 1e-3, xml
        assert 0.1 < found.albedo_max < 1 + 3 * found.albedo_sd + 1e-5, xml


def test_more_light_than_arrives() -> None:
    """Diffuse and specular are not coupled: together too bright, most so at grazing."""
    found = glance(mi.load_dict({"type": "cooktorrance", "m": 0.01, "diffuse_reflectance": 0.9}))
    assert found.albedo_max > 1.5
    assert found.albedo_angle == pytest.approx(math.radians(89.9))


def test_not_reciprocal() -> None:
    """A lobe with one cosine too many is found; so is one that is not finite."""

    class OneSided(Model):
        name = "onesided"

        def f(self, p: Any, wi: Any, wo: Any) -> Any:
            return (wi.z * 0.3,)

    class Unbounded(Model):
        name = "unbounded"

        def f(self, p: Any, wi: Any, wo: Any) -> Any:
            return (dr.select(wi.z > 0.9, dr.nan, 0.1),)

    plugins.register(OneSided, Unbounded)
    assert glance(mi.load_dict({"type": "onesided"})).reciprocity_max > 0.9
    found = glance(mi.load_dict({"type": "unbounded"}))
    assert found.reciprocity_max == math.inf
    assert math.isnan(found.albedo_max)


def test_the_mirror_direction_is_looked_at() -> None:
    """A lobe as sharp as 1e-3 that is reciprocal everywhere else."""

    class Sharp(Model):
        name = "sharp"

        def f(self, p: Any, wi: Any, wo: Any) -> Any:
            h = wi + wo
            near = dr.square(h.x) + dr.square(h.y) < dr.square(1e-3 * h.z)
            return (dr.select(near, wi.z, 0.1),)

    plugins.register(Sharp)
    assert glance(mi.load_dict({"type": "sharp"})).reciprocity_max > 1e-4


def test_scalar_variants_are_refused() -> None:
    mi.set_variant("scalar_rgb")
    with pytest.raises(UsageError, match=r"^check: the variant scalar_rgb has no arrays\. Set llvm_ad_rgb, or another"):
        glance(mi.load_dict({"type": "lambertian"}))
