"""What a fit says of itself: each remark where it is due, and none where all is well; never converged if undetermined."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting
from brdf import UsageError
from fitting import samples
from fitting.output import command
from fitting.run import Run
from fitting.solution import Solution
from tests.fitting import studio
from tests.fitting.studio import BALL, KEY, RIM, SPHERE, camera

SIZE = 40
TINTED = """<bsdf type="cooktorrance" id="ball"> <float name="m" value="$m"/> <float name="eta" value="$eta"/>
    <rgb name="diffuse_reflectance" value="$base"/> <rgb name="specular_reflectance" value="{tint}"/> </bsdf>"""
#: The camera's own lamp: light returns the way it came, and Fresnel's formula is asked for one angle alone.
FLASH = '<emitter type="point"><point name="position" x="0" y="0" z="4.2"/><rgb name="intensity" value="30"/></emitter>'


def said(solution: Solution, words: str) -> list[str]:
    return [remark for remark in solution.remarks if words in remark]


def noisy(path: Path, seed: int = 1, relative: float = 0.02, **values: Any) -> np.ndarray:
    return studio.noisy(studio.picture(path, 1024, **values), relative, seed, floor=0.003)


def test_nothing_is_said_when_all_is_well(tmp_path: Path) -> None:
    path = studio.standard(tmp_path, SIZE)
    solution = fitting.fit(path, {"camera": noisy(path, m=0.25)}, ["ball.m", "ball.eta", "ball.diffuse_reflectance"])
    assert solution.converged
    assert solution.status.startswith("Converged in ")
    assert solution.status.endswith(".")
    assert solution.remarks == ()
    assert not any(e.at_bound for e in solution.parameters.values())


def test_two_parameters_that_cannot_be_told_apart(tmp_path: Path) -> None:
    """Seen along the light, a stronger tint and a higher index look the same; roughness and the base do not."""
    names = ["ball.specular_reflectance", "ball.eta"]
    ball = TINTED.format(tint="0.5,0.6,0.7")
    flash = studio.write(tmp_path, ball, SPHERE, camera(SIZE), FLASH, name="flash.xml")
    start = {"ball.specular_reflectance": [0.5, 0.5, 0.5], "ball.eta": [1.5]}
    solution = fitting.fit(flash, {"camera": noisy(flash)}, start)
    apart = said(solution, "can hardly be told apart")
    lost = said(solution, "is not determined")
    assert apart or lost
    for name in names:
        assert any(name in remark for remark in apart + lost)
    if lost:
        assert not solution.converged
    grazing = RIM.replace('z="-0.5"', 'z="-3"')
    both = studio.write(tmp_path, ball, SPHERE, camera(SIZE), KEY, grazing, name="both.xml")
    solution = fitting.fit(both, {"camera": noisy(both)}, ["ball.m", "ball.diffuse_reflectance"])
    assert solution.converged
    assert not said(solution, "told apart")
    assert not said(solution, "not determined")


@pytest.mark.parametrize("name", ["ball.eta", "ball.m"])
def test_a_parameter_without_effect(name: str, tmp_path: Path) -> None:
    """What does not reflect has no index, and no roughness; what does has both."""
    black = studio.write(tmp_path, TINTED.format(tint="0"), SPHERE, camera(SIZE), KEY, name="black.xml")
    solution = fitting.fit(black, {"camera": noisy(black)}, [name, "ball.diffuse_reflectance"])
    assert len(said(solution, f"{name} has no effect on any pixel")) == 1
    assert not said(solution, "diffuse_reflectance has no effect")
    assert not solution.converged
    assert solution.status.startswith("Not determined by the pictures: " + name)
    found, base = solution.parameters[name], solution.parameters["ball.diffuse_reflectance"]
    for bar in (found.sd, found.low, found.high):
        assert np.isnan(bar).all()
    # The other parameter is fitted all the same.
    assert np.all(np.abs(base.value - [0.25, 0.08, 0.04]) < 4 * base.sd)
    shiny = studio.write(tmp_path, TINTED.format(tint="1"), SPHERE, camera(SIZE), KEY, name="shiny.xml")
    solution = fitting.fit(shiny, {"camera": noisy(shiny)}, [name, "ball.diffuse_reflectance"])
    assert not said(solution, "no effect")
    assert solution.converged


def test_a_material_in_the_dark(tmp_path: Path) -> None:
    """In view, but no light falls on it."""
    floor = """<bsdf type="diffuse" id="floor"><rgb name="reflectance" value="0.5"/></bsdf> <shape type="rectangle">
      <transform name="to_world"> <scale value="5"/> <translate z="-3"/> </transform> <ref id="floor"/> </shape>"""
    behind = '<emitter type="spot"><transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform><rgb name="intensity" value="20"/><float name="cutoff_angle" value="8"/></emitter>'
    direct = '<integrator type="direct"/>'
    path = studio.write(tmp_path, BALL, SPHERE, floor, camera(SIZE, fov=45), behind, integrator=direct)
    solution = fitting.fit(path, {"camera": noisy(path)}, ["ball.diffuse_reflectance", "floor.reflectance"])
    assert len(said(solution, "floor.reflectance")) >= 1
    assert said(solution, "has no effect on any pixel")
    assert not solution.converged
    assert "floor.reflectance.r" in solution.status
    assert "ball" not in solution.status


def test_at_a_bound(tmp_path: Path) -> None:
    """A picture brighter than any surface: the remark names the bound, and what lies inside its bounds is not mentioned."""
    ball = '<bsdf type="lambertian" id="ball"><rgb name="reflectance" value="0.5"/></bsdf>'
    path = studio.write(tmp_path, ball, SPHERE, camera(SIZE), KEY)
    bright = noisy(path) * [4, 1, 1]
    solution = fitting.fit(path, {"camera": bright}, ["ball.reflectance"])
    found = solution.parameters["ball.reflectance"]
    assert found.at_bound
    assert found.value[0] == pytest.approx(1, abs=1e-4)
    assert np.all(np.abs(found.value[1:] - 0.5) < 4 * found.sd[1:])
    assert len(said(solution, "ball.reflectance.r lies at its upper bound [0, 1]")) == 1
    assert len(said(solution, "bound")) == 1
    # The picture asks for more than the model has, and that is a misfit too; but it is arrived.
    assert solution.converged
    assert np.all(found.high <= 1)


def test_the_wrong_model_is_called_a_misfit(tmp_path: Path) -> None:
    """A GGX lobe fitted with Beckmann's; the right one is not called so. The error says how large."""
    metal = '<bsdf type="roughconductor" id="metal"> <string name="material" value="Al"/> <string name="distribution" value="{kind}"/> <float name="alpha" value="0.25"/> </bsdf>'
    shape = '<shape type="sphere"><ref id="metal"/></shape>'
    beckmann, ggx = (
        studio.write(tmp_path, metal.format(kind=kind), shape, camera(SIZE), KEY, name=f"{kind}.xml")
        for kind in ("beckmann", "ggx")
    )
    picture = noisy(ggx)
    wrong, right = (fitting.fit(path, {"camera": picture}, ["metal.alpha"]) for path in (beckmann, ggx))
    assert len(said(wrong, "is not noise")) == 1
    assert f"{100 * wrong.rms:.2g} % of the picture" in said(wrong, "is not noise")[0]
    assert not said(right, "is not noise")
    assert right.rms < 0.05 < wrong.rms
    assert abs(right.parameters["metal.alpha"].value[0] - 0.25) < 4 * right.parameters["metal.alpha"].sd[0]


def test_the_precision_asked_for(tmp_path: Path) -> None:
    """One interval, against half of its own width and against twice it; nothing else of the answer changes."""
    path = studio.write(tmp_path, BALL, SPHERE, camera(SIZE), KEY)
    picture = noisy(path)
    usual = fitting.fit(path, {"camera": picture}, ["ball.m"])
    m = usual.parameters["ball.m"]
    half = 0.5 * np.log(m.high[0] / m.low[0])
    strict, lax = (fitting.fit(path, {"camera": picture}, ["ball.m"], precision=p * half) for p in (0.5, 2.0))
    assert usual.converged and lax.converged and not strict.converged
    assert "Not determined by the pictures: ball.m" in strict.status
    assert len(said(strict, "ball.m is not determined: the ends of its 95 % interval differ by")) == 1
    assert not said(lax, "not determined")
    for other in (strict, lax):
        assert other.parameters["ball.m"].value[0] == m.value[0]
    words = shlex.split(command(strict.settings))
    assert float(words[words.index("--precision") + 1]) == 0.5 * half
    assert "--precision" not in command(usual.settings)
    with pytest.raises(UsageError, match="precision = 0"):
        fitting.fit(path, {"camera": picture}, ["ball.m"], precision=0)


def test_a_sharp_highlight_that_is_none_after_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Weights are made for the pixels of the problem, in its order, also when samples are no longer placed by a guide."""
    path = studio.write(tmp_path, BALL, SPHERE, camera(SIZE), KEY)
    true_guide, true_reweigh = samples.guide, Run.reweigh
    looked = 0

    def guide(run: Run) -> bool:
        nonlocal looked
        looked += 1
        found = true_guide(run)
        assert found and run.x is not None  # m = .03 is sharp
        run.guides = run.guides if looked == 1 else []
        run.x = run.x + 0.1  # or there is no second look
        return looked == 1

    def reweigh(self: Run, whatever: bool = False) -> None:
        true_reweigh(self, whatever)
        assert self.problem is not None and self.other is not None
        for mine, other in zip(self.problem.pictures, self.other.pictures, strict=True):
            np.testing.assert_array_equal(mine.pixels, other.pixels)

    monkeypatch.setattr(samples, "guide", guide)
    monkeypatch.setattr(Run, "reweigh", reweigh)
    monkeypatch.setattr("fitting.run.MOVED", 0.0)
    fitting.fit(path, {"camera": noisy(path, m=0.03)}, {"ball.m": [0.03]}, spp=8)
    assert looked == 2


def test_hardly_determined(tmp_path: Path) -> None:
    """A highlight of a hundredth of the base, under noise, leaves its roughness open."""
    path = studio.write(tmp_path, TINTED.format(tint="0.01"), SPHERE, camera(SIZE), KEY)
    start = {"ball.m": [0.3], "ball.diffuse_reflectance": None}
    solution = fitting.fit(path, {"camera": noisy(path, relative=0.3, base="0.6")}, start)
    m = solution.parameters["ball.m"]
    assert m.sd[0] > 0.5 * m.value[0] or not np.isfinite(m.sd[0]) or m.at_bound
    assert said(solution, "ball.m is not determined") or said(solution, "ball.m lies at its") or not solution.converged


def test_too_few_samples_are_called_so(tmp_path: Path) -> None:
    """Four samples a pixel of a sharp lobe against a picture almost without noise; and enough, left to themselves."""
    path = studio.write(tmp_path, BALL, SPHERE, camera(SIZE), KEY)
    few = fitting.fit(path, {"camera": studio.picture(path, 1024, m=0.08)}, {"ball.m": [0.08]}, spp=4)
    assert len(said(few, "more samples (--spp)")) == 1
    assert few.settings["samples"] == [4]
    enough = fitting.fit(path, {"camera": noisy(path, m=0.2)}, ["ball.m"])
    assert not said(enough, "more samples")
    assert max(enough.settings["samples"]) > 2


def test_out_of_iterations_is_not_converged(tmp_path: Path) -> None:
    path = studio.standard(tmp_path, SIZE)
    start = {"ball.m": [1.4], "ball.eta": [9.0], "ball.diffuse_reflectance": [0.9, 0.9, 0.9]}
    solution = fitting.fit(path, {"camera": noisy(path)}, start, max_iterations=1, spp=4)
    assert not solution.converged
    assert solution.status.startswith("Not converged")
    assert "iterations" in solution.status


@pytest.mark.parametrize("solver", ["adam", "gd", "lbfgs"])
def test_first_order_methods_admit_that_they_have_not_arrived(solver: str, tmp_path: Path) -> None:
    """Few steps from afar: whatever the method's own criterion says, another Gauss-Newton step would go far."""
    path = studio.standard(tmp_path, SIZE)
    start = {"ball.m": [1.0], "ball.eta": [3.0], "ball.diffuse_reflectance": [0.9, 0.9, 0.9]}
    solution = fitting.fit(path, {"camera": noisy(path)}, start, max_iterations=3, solver=solver)
    assert not solution.converged
    assert solution.status.startswith("Not ")
