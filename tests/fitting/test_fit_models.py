"""Every model of brdf.models is recovered from a picture of it, through ``brdf fit``: a new file joins by existing.

A ball of the model with values away from its defaults, rendered by Mitsuba's `path`, and fitted from a start that the fit
looks for. What a single picture cannot tell apart is left at the truth, with a reason.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from brdf import Lobe, Model, Param, builtin
from fitting import images
from tests.fitting import studio
from tests.fitting.command import run

#: How far the truth is from the default, in the coordinate of the scale; and of a colour, its channels.
AWAY, CHANNELS = 0.35, (0.7, 0.2, -0.5)
#: What is not fitted in one picture, and why.
CONFOUNDED = {
    "specular_reflectance": "with an index of refraction, it is the strength of the same highlight",
}
KNOWN: dict[str, dict[str, str]] = {
    "diffusion": {
        "sigma_s": "the ratio of sigma_a to sigma_s (1 - g) is all that Rd depends on",
        "g": "the ratio of sigma_a to sigma_s (1 - g) is all that Rd depends on",
        "eta": "it darkens as absorption does, all over the ball",
    },
    "metal": {"k": "at most angles one number, the reflectance, is all that the two make"},
    "hanrahankrueger": {
        "thickness": "only its product with sigma_s and sigma_a is seen",
        "eta": "it darkens as absorption does",
    },
}
#: Where the rule of `truth` gives what a picture says little of: a metal that reflects all light looks like any other.
GIVEN = {"metal": {"eta": (0.3, 0.6, 1.2), "k": (3.0, 2.5, 1.9)}}
#: Samples a pixel of the target.
SPP = 4096


def truth(p: Param) -> Any:
    """A value away from the default and inside the bounds."""
    low, high = p.interior()
    if p.kind == "number":
        usual = p.to_free(p.default)
        span = (p.to_free(high) - p.to_free(low)) if np.isfinite(high) else np.inf
        step = min(AWAY, 0.1 * span) if p.scale != "linear" else 0.15 * (high - low if np.isfinite(high) else 1.0)
        other = usual + step if usual + step < p.to_free(high) else usual - step
        return float(p.to_value(other))
    usual = np.clip(p.default, 0.1, 0.9) if p.scale == "logit" and p.bounds == (0.0, 1.0) else np.array(p.default)
    shifted = p.to_free(usual) + np.array(CHANNELS) * (1.0 if p.scale != "linear" else 0.3 * np.mean(usual))
    return tuple(float(v) for v in np.clip(p.to_value(shifted), low, high))


def material(model: Model, values: dict[str, Any]) -> str:
    """The XML of the ball's BSDF."""
    lines = [
        f'<rgb name="{name}" value="{", ".join(f"{v:.9g}" for v in value)}"/>'
        if isinstance(value, tuple)
        else f'<float name="{name}" value="{value:.9g}"/>'
        for name, value in values.items()
    ]
    return f'<bsdf type="{model.name}" id="ball">{"".join(lines)}</bsdf>'


def sky(folder: Path) -> str:
    """An environment with soft lamps on a gradient: something to see in a mirror."""
    height, width = 32, 64
    y, x = np.mgrid[0:height, 0:width]
    theta, phi = np.pi * (y + 0.5) / height, 2 * np.pi * (x + 0.5) / width
    d = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], axis=-1)
    light = 0.3 + 0.2 * d[..., [1]] + np.array([0.0, 0.05, 0.1])
    for centre, sharpness, colour in (
        ((0.5, 0.6, 0.6), 12.0, (3.0, 2.6, 2.2)),
        ((-0.8, 0.2, 0.5), 20.0, (1.2, 1.8, 2.6)),
        ((0.1, -0.5, -0.8), 8.0, (1.5, 1.0, 1.2)),
    ):
        c = np.array(centre) / np.linalg.norm(centre)
        light = light + np.exp(sharpness * (d @ c - 1))[..., None] * np.array(colour)
    images.write(folder / "sky.exr", light)
    return '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>'


#: What shows nothing but its surroundings.
REFLECTED = (Lobe.MIRROR, Lobe.REFRACTION)
#: A sheet, and lamps before and behind it.
SHEET = """<shape type="rectangle"><transform name="to_world"><scale value="1.2"/><rotate y="1" angle="25"/></transform>
  <ref id="ball"/></shape>"""
LAMPS = tuple(
    f'<emitter type="point"><point name="position" x="{x}" y="{y}" z="{z}"/><rgb name="intensity" value="{i}"/></emitter>'
    for x, y, z, i in ((-1.2, 0.8, 1.6, 12), (0.9, -0.7, -1.1, 9))
)


def stage(model: type[Model], folder: Path) -> tuple[str, ...]:
    """What shows a model: something to mirror, light from behind as well, or two lamps."""
    if any(lobe in REFLECTED for lobe in model.lobes):
        return (studio.SPHERE, studio.camera(32), sky(folder))
    if any(lobe.transmits for lobe in model.lobes):
        return (SHEET, studio.camera(64), *LAMPS)
    return (studio.SPHERE, studio.camera(64), studio.KEY, studio.RIM)


def quick(name: str, model: type[Model]) -> Any:
    """Fits through an integrator take longer."""
    return pytest.param(name, marks=[pytest.mark.slow] if any(lobe in REFLECTED for lobe in model.lobes) else [])


@pytest.mark.parametrize("name", [quick(name, model) for name, model in builtin().items()])
def test_recovered(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    studio.use()
    model = builtin()[name]()
    true = {p.name: truth(p) for p in model.parameters()} | GIVEN.get(name, {})
    if "eta" in true and "specular_reflectance" in true:
        left: dict[str, str] = dict(CONFOUNDED)
        true["specular_reflectance"] = (1.0, 1.0, 1.0)
    else:
        left = {}
    left |= KNOWN.get(name, {})
    wanted = [p.name for p in model.parameters() if p.name not in left]
    given = {p.name: p.default for p in model.parameters() if p.name in wanted}
    integrator = '<integrator type="path"><integer name="max_depth" value="8"/></integrator>'
    parts = stage(type(model), tmp_path)
    for file, values in (("true", true), ("scene", {**true, **given})):
        text = studio.text(material(model, values), *parts, integrator=integrator).replace(studio.NAMES, "")
        (tmp_path / f"{file}.xml").write_text(text)
    scene = mi.load_file(str(tmp_path / "true.xml"))
    images.write(tmp_path / "target.exr", np.array(mi.render(scene, spp=SPP, seed=77))[..., :3])
    asked = " ".join(f"--fit ball.{name}" for name in wanted)
    code, said, found = run(tmp_path, tmp_path / "out", f"fit scene.xml --target camera=target.exr {asked}", capfd)
    print(said)
    assert code == 0, found["status"]
    for parameter in wanted:
        estimate = found["parameters"][f"ball.{parameter}"]
        for value, sd, want in zip(
            *(np.atleast_1d(v) for v in (estimate["value"], estimate["sd"], true[parameter])), strict=True
        ):
            print(f"{name}.{parameter}: {value:.6g} +- {sd:.2g}, truth {want:.6g}")
            assert abs(value - want) < max(4 * sd, 1e-3 * abs(want)), parameter
            assert abs(value - want) < 0.03 * max(abs(want), 0.1), parameter
