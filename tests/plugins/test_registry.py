"""Which models Mitsuba knows, in which variant, and what is said of a class that is no model."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drjit.llvm.ad import Array3f64

import plugins
from brdf import Lobe, Model, UsageError, builtin, choice, number
from brdf.checks.energy import albedo, lobe_weight
from brdf.model import defaults
from plugins import registry
from tests.plugins.minnaert import Minnaert

VARIANTS = ["llvm_ad_rgb", "llvm_ad_mono", "llvm_ad_spectral", "scalar_rgb"]


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> dict[str, type[Model]]:
    """Each test has its own set of models."""
    mi.set_variant("llvm_ad_rgb")
    copy: dict[str, type[Model]] = {}
    monkeypatch.setattr(registry, "_known", copy)
    return copy


def ends_with(raised: pytest.ExceptionInfo[Any], text: str) -> None:
    """The last line is ours (Mitsuba puts its own before)."""
    assert str(raised.value).strip().splitlines()[-1].removeprefix("UsageError: ") == text


def test_ours_are_registered() -> None:
    plugins.register()
    assert set(plugins.registered()) >= set(builtin())
    for name in builtin():
        assert mi.load_dict({"type": name}).to_string().startswith(f"{name}[")


def test_twice_is_once() -> None:
    plugins.register()
    before = plugins.registered()
    plugins.register()
    plugins.register(Minnaert)
    plugins.register(Minnaert)
    assert plugins.registered() == {**before, "minnaert": Minnaert}


def test_asking_registers() -> None:
    assert set(plugins.registered()) >= set(builtin())


def test_before_and_after_set_variant_and_back() -> None:
    """In a process of its own, where no variant is set."""
    code = """
import plugins, mitsuba as mi
from tests.plugins.minnaert import Minnaert
assert mi.variant() is None
plugins.register(Minnaert)
for variant in ("llvm_ad_rgb", "scalar_rgb", "llvm_ad_rgb", "llvm_ad_mono", "llvm_ad_mono", "scalar_rgb"):
    mi.set_variant(variant)
    for name in ("cooktorrance", "minnaert"):
        bsdf = mi.load_dict({"type": "twosided", "nested": {"type": name}})
        assert isinstance(bsdf, mi.BSDF) and name in str(bsdf)
plugins.register()
mi.load_dict({"type": "lambertian"})
"""
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


@pytest.mark.parametrize("variant", VARIANTS)
def test_an_outsiders_model(variant: str) -> None:
    """Name, summary, source, params and f are enough."""
    mi.set_variant(variant)
    plugins.register(Minnaert)
    bsdf = mi.load_string(
        '<bsdf version="3.0.0" type="minnaert"><float name="reflectance" value="0.8"/>'
        '<float name="exponent" value="2"/></bsdf>'
    )
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(0.6, 0, 0.8)
    wo = mi.Vector3f(0, 0.8, 0.6)
    value = np.asarray(bsdf.eval(mi.BSDFContext(), si, wo), dtype=float).ravel()
    np.testing.assert_allclose(value, 0.8 * 3 / (2 * np.pi) * (0.8 * 0.6) * 0.6, rtol=1e-5)
    density = np.asarray(bsdf.pdf(mi.BSDFContext(), si, wo), dtype=float).ravel()
    np.testing.assert_allclose(density, 0.6 / np.pi, rtol=1e-6)
    with pytest.raises(RuntimeError) as raised:
        mi.load_dict({"type": "minnaert", "exponent": 0.5})
    ends_with(raised, "minnaert: exponent = 0.5 is outside [1, 10].")


def test_the_outsiders_formula() -> None:
    """Its albedo is ``reflectance cos^(exponent - 1)``."""
    p = defaults(Minnaert(), Array3f64, reflectance=0.8, exponent=2.5)
    for mu in (1.0, 0.3):
        value, error = albedo(lobe_weight(Minnaert(), p), mu, Array3f64)
        assert value == pytest.approx(0.8 * mu**1.5, abs=4 * error)


def package(folder: Path, name: str, module: str, points: str) -> None:
    """An installed distribution: a module, and metadata with entry points."""
    (folder / f"{name}.py").write_text(module)
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[brdf.models]\n{points}\n")


def test_an_installed_package_offers_a_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = Path(__file__).with_name("minnaert.py").read_text().replace('"minnaert"', '"velvetine"')
    package(tmp_path, "velvet_models", module, "velvetine = velvet_models:Minnaert")
    monkeypatch.syspath_prepend(tmp_path)
    plugins.register()
    assert plugins.registered()["velvetine"].__module__ == "velvet_models"
    assert "velvetine[" in mi.load_dict({"type": "velvetine"}).to_string()


def test_a_broken_package_does_not_break_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    package(tmp_path, "broken_models", "import no_such_module_anywhere", "shiny = broken_models:Shiny")
    package(tmp_path, "clashing_models", "from brdf import Model\nclass M(Model):\n    name = 'lambertian'\n"
            "    def f(self, p, wi, wo): return (1.0,)", "lambertian = clashing_models:M")  # fmt: skip
    monkeypatch.syspath_prepend(tmp_path)
    plugins.register()
    assert set(plugins.registered()) >= set(builtin())
    assert plugins.registered()["lambertian"] is builtin()["lambertian"]
    said = capsys.readouterr().err
    assert (
        "brdf: the model 'shiny' of broken_models:Shiny is left out: No module named 'no_such_module_anywhere'" in said
    )
    assert (
        "the model 'lambertian' of clashing_models:M is left out: lambertian: this name is taken by brdf.models" in said
    )
    assert len(said.splitlines()) == 2


def model(**attributes: Any) -> type[Model]:
    return type("Mine", (Model,), {"name": "mine", "f": lambda self, p, wi, wo: (wi.z * wo.z,), **attributes})


BAD = [
    (3, "register takes subclasses of brdf.Model, got 3."),
    (model(name=None), "Mine: name = None. A model's name is one lower-case word."),
    (model(name="My Model"), "Mine: name = 'My Model'. A model's name is one lower-case word."),
    (model(f=Model.f), "mine: f is not written. A model needs at least f."),
    (model(lobes=()), "mine: lobes is empty. A model has at least one lobe."),
    (
        model(params=(number("a", 1, (0, 1), ""), number("a", 1, (0, 1), ""))),
        "mine: a parameter is declared twice: a, a.",
    ),
    (model(params=(number("a", 2, (0, 1), ""),)), "mine: a = 2 is outside [0, 1]."),
    (model(name="diffuse"), "diffuse: this name is taken by a plugin of Mitsuba's own. Choose another."),
    (model(name="lambertian"), "lambertian: this name is taken by brdf.models.lambertian.Lambertian. Choose another."),
    (
        model(f=lambda self, p, wi, wo: wi.z),
        "mine: f returned float. It returns a tuple with one entry a lobe, here 1.",
    ),
    (
        model(lobes=(Lobe.DIFFUSE, Lobe.GLOSSY)),
        "mine: f returned a tuple of 1. It returns a tuple with one entry a lobe, here 2.",
    ),
]


@pytest.mark.parametrize(("bad", "message"), BAD, ids=[m.split(": ")[-1][:30] for _, m in BAD])
def test_no_model(bad: Any, message: str) -> None:
    plugins.register()
    with pytest.raises(UsageError) as raised:
        plugins.register(bad)
    assert str(raised.value) == message
    assert "mine" not in plugins.registered()


def test_no_name() -> None:
    class Nameless(Model):
        def f(self, p: Any, wi: Any, wo: Any) -> Any:
            return (wi.z,)

    with pytest.raises(UsageError, match=r"Nameless: name = None\. A model's name is one lower-case word\."):
        plugins.register(Nameless)


def test_a_model_with_choices_and_lobes() -> None:
    """A number that exists under one choice only, and three lobes."""

    class Layered(Model):
        name = "layered"
        params = (number("depth", 0.5, (0, 1), ""), choice("coat", ("none", "thin"), ""))
        lobes = (Lobe.DIFFUSE, Lobe.GLOSSY, Lobe.GLOSSY)
        coat: str

        def parameters(self) -> Any:
            return self.params[:1] if self.coat == "thin" else ()

        def f(self, p: Any, wi: Any, wo: Any) -> Any:
            return (dr.inv_pi, 0.1, p.depth if self.coat == "thin" else 0.0)

    plugins.register(Layered)
    mi.load_dict({"type": "layered", "coat": "thin", "depth": 0.25})
    assert "coat = thin" in mi.load_dict({"type": "layered", "depth": 0.25}).to_string(), "what is given decides"
    with pytest.raises(RuntimeError) as raised:
        mi.load_dict({"type": "layered", "depth": 0.25, "coat": "none"})
    ends_with(raised, "layered: 'depth' is not a parameter with coat = none. It has: none.")
