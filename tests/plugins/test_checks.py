"""The checks of any BSDF find what is wrong, by name, and nothing else."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf import UsageError
from brdf.checks import CHECKS, QUESTIONS
from plugins import registry
from plugins.checks import check, check_scene, parametrize, render
from plugins.checks.subject import BsdfSubject, from_dict
from tests import toys

ROOT = Path(__file__).parents[2]
#: What is asked without rendering.
QUICK = list(QUESTIONS)


@pytest.fixture(autouse=True)
def variant(monkeypatch: pytest.MonkeyPatch) -> None:
    mi.set_variant("llvm_ad_rgb")
    monkeypatch.setattr(registry, "_known", {})
    plugins.register()


def failed(results: dict[str, Any]) -> set[str]:
    return {name for name, result in results.items() if not result.passed}


@pytest.mark.parametrize(
    ("model", "caught"),
    [
        (toys.DoubleDensity, {"sampling", "energy"}),  # half the weight: half the energy
        (toys.OneSided, {"reciprocity"}),
        (toys.Ragged, {"finite"}),
        (toys.HalfAttached, {"gradient"}),
        (toys.Glowing, {"energy"}),
        (toys.Blocked, {"sampling", "energy"}),  # what is not sampled is lost
        (toys.Paper, set()),
        (toys.Uncoupled, {"coupling"}),
    ],
    ids=lambda x: x.__name__ if isinstance(x, type) else None,
)
def test_a_bad_model_is_caught_by_the_check_meant_for_it(model: Any, caught: set[str]) -> None:
    """As a formula, and as a BSDF of which nothing is known."""
    for results in (check(model, only=QUICK), check(mi.load_dict({"type": model.name}), only=QUICK)):
        assert list(results) == QUICK
        assert failed(results) == caught
        for name, result in results.items():
            assert result.expected == (name not in caught or model is toys.Uncoupled)
            assert (result.figure is None) <= bool(result.reason)
            if name in caught:
                assert result.figure is not None and result.reason
                assert "figure" in result.case


def test_a_bsdf_written_for_mitsuba() -> None:
    """Its samples lack the cosine: their weights are wrong, and with them the energy."""
    importlib.reload(importlib.import_module("tests.plugins.badbsdf"))
    results = check("nocosine", only=QUICK)
    assert failed(results) == {"sampling", "energy"}
    assert "do not weigh f cos / pdf" in results["sampling"].reason
    assert "add up to 1" in results["energy"].reason  # albedo over the mean cosine, 0.5 / 0.5, and not 0.5


def test_what_a_failure_says() -> None:
    """Enough to see it again: the pair of directions, the two values; and all of it as JSON."""
    result = check(toys.OneSided, only=["reciprocity"])["reciprocity"]
    assert result.outcome == "failed"
    case = result.case
    f = BsdfSubject(mi.load_dict({"type": "onesided"})).f
    for name, i, o in (("there", case["wi"], case["wo"]), ("back", case["wo"], case["wi"])):
        again = np.asarray(f(mi.Vector3f(*i), mi.Vector3f(*o)), dtype=float).ravel()
        np.testing.assert_allclose(again, case[name], rtol=1e-5)
    assert case["command"] == "brdf check onesided"
    assert case["parameters"] == {"reflectance": 0.5}
    read = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert set(read) == {"passed", "expected", "figure", "limit", "reason", "case"}


def test_declared_failures() -> None:
    """One that occurs is expected; one that does not is not, except at values of somebody's choice."""
    found = check(toys.Pious, only=QUICK)
    assert found["coupling"].outcome == "expected to fail"
    assert found["coupling"].reason == "the two lobes are added"
    assert found["reciprocity"].outcome == "unexpectedly passed"
    assert "it is only said to be so" in found["reciprocity"].reason
    assert {name for name, r in found.items() if not r.expected} == {"reciprocity"}
    dim = check(toys.Pious, {"reflectance": 0.3}, only=["coupling", "reciprocity"])
    assert [r.outcome for r in dim.values()] == ["passed", "passed"]
    plugins.register(toys.Pious)
    assert {k: r.outcome for k, r in check("pious", {"reflectance": 0.3}, only=["coupling"]).items()} == {
        "coupling": "passed"
    }


def test_roughplastic_forgets_its_tables() -> None:
    """Mitsuba detaches the tables from which roughplastic takes what the coat lets through: both its derivatives are
    wrong, as found by differences before (FACTS: alpha +.003 against -.069, eta -.155 against -.026)."""
    result = check({"type": "roughplastic", "alpha": 0.1}, only=["gradient"])["gradient"]
    assert not result.passed and not result.expected
    assert {result.case["parameter"], *result.case["also"]} == {"alpha", "eta"}
    assert result.case["command"] == "brdf check roughplastic --set alpha=0.1"


@pytest.mark.parametrize(
    "xml",
    [
        {"type": "diffuse"},
        {"type": "roughconductor", "alpha": 0.2, "material": "Al"},
        {"type": "conductor", "eta": 1.5, "k": 2.0},
        {"type": "dielectric"},
        {"type": "plastic"},
        {"type": "roughdielectric", "alpha": 0.3},
        {"type": "twosided", "nested": {"type": "roughconductor", "alpha": 0.1, "material": "Al"}},
        {"type": "mask", "opacity": 0.3, "nested": {"type": "diffuse"}},
    ],
    ids=lambda x: x["type"],
)
def test_no_false_alarm(xml: dict[str, Any]) -> None:
    """What is right of Mitsuba's own passes. `finite` is left out: a direction exactly in the surface gives NaN in the
    density of some."""
    only = [name for name in QUICK if name != "finite"]
    results = check(xml, only=only)
    assert failed(results) == set(), {name: r.reason for name, r in results.items() if not r.passed}


def test_normalmap_is_not_reciprocal() -> None:
    """A frame that leans cuts off directions of one side that it keeps of the other."""
    image = mi.Bitmap(np.full((2, 2, 3), [0.6, 0.5, 0.95], dtype=np.float32))
    leaning = {"type": "bitmap", "raw": True, "bitmap": image}
    xml = {"type": "normalmap", "normalmap": leaning, "nested": {"type": "diffuse"}}
    assert failed(check(xml, only=["reciprocity"])) == {"reciprocity"}


def test_components() -> None:
    """Lobes are the components of a BSDF; those of `principled` cannot be asked one by one."""
    plastic = from_dict({"type": "plastic"})
    assert [(p.ideal, p.smooth) for p in plastic.lobes] == [(True, False), (False, True)]
    principled = from_dict({"type": "principled"})
    assert len(principled.lobes) == 1 and principled.lobes[0].glossy
    glass = from_dict({"type": "dielectric"})
    assert [p.transmits for p in glass.lobes] == [False, True]
    two = from_dict({"type": "twosided", "nested": {"type": "roughplastic"}})
    assert len(two.lobes) == 2 and not two.transmits


def test_what_does_not_arise_says_so() -> None:
    results = check({"type": "conductor"}, only=["sampling", "coupling", "peak"])
    for result in results.values():
        assert result.passed and result.figure is None and result.reason


def test_only_and_progress() -> None:
    told: list[tuple[str, int, int]] = []
    found = check("lambertian", only=["finite", "energy"], progress=lambda *step: told.append(step))
    assert list(found) == ["energy", "finite"]
    assert told == [("energy", 0, 2), ("finite", 1, 2)]
    with pytest.raises(UsageError, match=r"^there is no check 'energie'\. There are: reciprocity, energy, "):
        check("lambertian", only=["energie"])


def test_a_bsdf_of_a_scene(tmp_path: Path) -> None:
    (tmp_path / "s.xml").write_text(
        '<scene version="3.0.0"><shape type="sphere"><bsdf type="lambertian" id="ball"/></shape></scene>'
    )
    found = check_scene(tmp_path / "s.xml", "ball", only=["energy"])
    assert found["energy"].figure == pytest.approx(0.5, abs=1e-5)
    assert found["energy"].case["command"] == f"brdf check {tmp_path / 's.xml'} --bsdf ball"


def test_values_of_a_scene_may_be_called_anything(tmp_path: Path) -> None:
    """As the arguments of the functions they are handed through, for one."""
    names = {"seed": 0.25, "name": 0.5, "path": 0.125, "only": 0.3, "values": 0.2, "out": 0.1, "comment": 0.4}
    for name, given in names.items():
        text = f'<rgb name="reflectance" value="${name}"/>'
        text = f'<scene version="3.0.0"><bsdf type="lambertian" id="ball">{text}</bsdf></scene>'
        (tmp_path / "s.xml").write_text(
            text.replace("</scene>", '<shape type="sphere"><ref id="ball"/></shape></scene>')
        )
        found = check_scene(tmp_path / "s.xml", "ball", only=["energy"], defaults={name: given})
        assert found["energy"].figure == pytest.approx(given, rel=1e-5), name


def outsider(tmp_path: Path, body: str) -> str:
    """What pytest says of a test file in somebody else's package."""
    (tmp_path / "test_mine.py").write_text(body)
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-rxfX", "-p", "no:cacheprovider", "-c", "/dev/null", "test_mine.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    return run.stdout


def test_parametrize(tmp_path: Path) -> None:
    """A check a test; a declared failure is an expected one with its reason, and strict."""
    said = outsider(
        tmp_path,
        """
import mitsuba as mi
from plugins.checks import parametrize
from tests.toys import Paper, Pious

mi.set_variant("llvm_ad_rgb")

@parametrize(Paper, Pious, only=["reciprocity", "coupling", "finite"])
def test_it(check):
    check()
""",
    )
    assert "4 passed, 1 xfailed" in said or "1 failed, 4 passed, 1 xfailed" in said, said
    assert "pious-coupling" in said and "the two lobes are added" in said
    assert "[XPASS(strict)] it is only said to be so" in said


def test_the_docstring_of_parametrize() -> None:
    """Its example names what there is."""
    text = parametrize.__doc__ or ""
    assert "from plugins.checks import parametrize" in text and "@parametrize(" in text


def test_the_derivative_of_a_picture() -> None:
    """`direct` weighs light and BSDF samples by their densities: one with a gradient makes it wrong (roughconductor,
    alpha: 8 %; cooktorrance before its density was detached, m: 75 %)."""
    name = "gradient_direct"
    result = check("cooktorrance", {"m": 0.3, "eta": 1.8}, only=[name])[name]
    assert result.passed, result.reason
    assert result.figure is not None, result.reason


def judged(automatic: float, differences: float, spread: float) -> Any:
    rng = np.random.default_rng(1)
    noise = rng.normal(0, spread, (2, 8))
    noise -= noise.mean(axis=1, keepdims=True)
    values = {"automatic": automatic + noise[0], "differences": differences + noise[1], "mean": [1.0], "value": [0.5]}
    return render.row("m", {k: list(v) for k, v in values.items()}, {"integrator": "path"})


def test_how_a_picture_is_judged() -> None:
    assert judged(1.0, 1.0, 0.01).passed
    assert not judged(1.0, 1.1, 0.001).passed
    assert not judged(float("nan"), 1.0, 0.01).passed
    noisy = judged(1.0, 1.1, 1.0)
    assert noisy.passed and noisy.figure is None and "too noisy" in noisy.reason
    raised = render.judged({"error": "RuntimeError: no"}, {}, "prb", 0)
    assert not raised.passed and "`prb` raises: RuntimeError: no" in raised.reason


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["path", "prb", "direct"])
def test_a_wrong_gradient_in_a_picture(integrator: str) -> None:
    name = f"gradient_{integrator}"
    result = check(toys.HalfAttached, only=[name])[name]
    assert not result.passed
    assert result.case["automatic"] == pytest.approx(result.case["differences"] / 2, rel=0.02)


@pytest.mark.slow
def test_prb_with_a_mirror_over_a_diffuser() -> None:
    """FACTS: plastic, diffuse_reflectance: .427 by prb against .3555."""
    found = check("plastic", only=["gradient_prb"])["gradient_prb"]
    assert not found.passed and found.case["parameter"] == "diffuse_reflectance.value"
    assert found.case["automatic"] > 1.05 * found.case["differences"]


@pytest.mark.slow
def test_prb_with_a_mirror_raises() -> None:
    """FACTS: conductor, eta: prb raises, path is right."""
    found = check({"type": "conductor", "eta": 1.5, "k": 2.0}, only=["gradient_prb", "gradient_path"])
    assert found["gradient_path"].passed, found["gradient_path"].reason
    assert not found["gradient_prb"].passed and "raises" in found["gradient_prb"].reason


@pytest.mark.slow
def test_the_weight_of_a_blend() -> None:
    """FACTS: blendbsdf of a conductor and a diffuser: d/d weight by path .024 and by prb .552 against -.214."""
    xml = {"type": "blendbsdf", "weight": 0.4, "a": {"type": "conductor"}, "b": {"type": "diffuse"}}
    for name, result in check(xml, only=["gradient_path", "gradient_prb"]).items():
        assert not result.passed, name
        off = {result.case["parameter"], *result.case.get("also", {})}
        assert "weight.value" in off


@pytest.mark.slow
def test_a_bsdf_registered_by_hand_is_rendered() -> None:
    """By a process that imports what registers it. It has no parameters."""
    importlib.reload(importlib.import_module("tests.plugins.badbsdf"))
    found = check("nocosine", only=["gradient_path"], setup=["tests.plugins.badbsdf"])["gradient_path"]
    assert found.passed and "no parameter" in found.reason
    found = check("nocosine", only=["gradient_path"])["gradient_path"]
    assert not found.passed and "raises" in found.reason


def test_every_check_has_a_sentence() -> None:
    assert all(text.endswith("?") for text in CHECKS.values())
    assert dr.is_jit_v(mi.Float)
