"""``brdf check --hard``: what it prints, of ours and of an outsider's models, and how it ends."""

from __future__ import annotations

import inspect
import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import pytest

import plugins
from brdf import Lobe, Model, choice, number
from brdf.hard import FORMULAS, judge, load, outsider
from fitting import hard
from fitting.cli import check
from fitting.cli.app import main
from plugins import registry
from tests.fitting.command import strict

REPOSITORY = Path(__file__).parents[2]


class Powder(Model):
    """Minnaert's reflection; `written` says how well."""

    name = "powder"
    summary = "for tests"
    params = (
        number("exponent", 1.5, (1.0, 10.0), "how fast it darkens", scale="log"),
        choice("written", ("well", "badly"), "a product of cosines, or what is left of 1 by it"),
    )
    lobes = (Lobe.DIFFUSE,)
    written: str

    def f(self, p: Any, wi: Any, wo: Any) -> tuple[Any]:
        product = wi.z * wo.z
        if self.written == "badly":
            product = 1 - (1 - product)
        return (dr.exp((p.exponent - 1) * dr.log(dr.maximum(product, 1e-30))) * dr.inv_pi,)


class Stated(Powder):
    """With its formula in mpmath."""

    name = "stated"

    def exact(self, p: Any, wi: Any, wo: Any) -> Any:
        import mpmath

        return (wi[2] * wo[2]) ** (p.exponent - 1) / mpmath.pi


@pytest.fixture(autouse=True)
def known() -> Iterator[None]:
    plugins.register(Powder, Stated)
    yield
    for name in ("powder", "stated"):
        registry._known.pop(name, None)


def run(arguments: str, capfd: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    capfd.readouterr()
    code = main(shlex.split(arguments))
    out, err = capfd.readouterr()
    return code, out, err


def test_bricks(capfd: pytest.CaptureFixture[str]) -> None:
    code, out, err = run("check bricks --hard", capfd)
    assert (code, err) == (0, "")
    assert "fresnel_conductor" in out
    assert "none beyond the limits" in out


def test_json(capfd: pytest.CaptureFixture[str]) -> None:
    """All that the issue of numbers to trust asks for, of a model as of its formulas."""
    code, out, _ = run("check lambertian --hard --json", capfd)
    found = strict(out)
    assert code == 0
    assert found["command"] == "brdf check lambertian --hard"
    model = found["models"]["lambertian"]
    assert model["passed"] and model["reciprocal"] is True and model["non_finite"] == 0
    assert model["points"] >= 2000 * 2
    assert 0 <= model["value_p99"] <= model["value_c"] <= 4
    assert 0 <= model["gradient_p99"] <= model["gradient_max"]
    assert 0 <= model["ill_conditioned"] <= 1 and 0 <= model["gradient_ill_conditioned"] <= 1
    assert set(model["formulas"]["lambertian"]) == {"oracle", "float32", "float64"}


@pytest.mark.parametrize(
    ("name", "said"),
    [("phong", None), ("blinnphong", True), ("mirror", None), ("glazed", True), ("bricks", None)],
)
def test_reciprocal_is_said_of_what_declares_it(name: str, said: bool | None) -> None:
    """Phong's is under one of its choices alone; a mirror has no second direction, nor has that in a glaze."""
    assert hard.run(hard.by_name(name)).to_json()[name]["reciprocal"] is said


def test_reciprocity_that_fails_is_said() -> None:
    found = hard.run(hard.by_name("phong"))
    (good,) = (per for per in found.verdicts.values() if per["float32"].reciprocal)
    good["float32"] = replace(good["float32"], reciprocal=False)
    assert found.to_json()["phong"]["reciprocal"] is False


def test_derivatives_that_are_not_judged_are_counted(capfd: pytest.CaptureFixture[str]) -> None:
    """Apart from values: a quarter, where one of four is made worse than any rounding permits. As drawn and as in JSON."""
    exact = load("ward, duer")
    worse = exact.slope_scale.copy()
    worse[1] = np.inf
    plain, verdict = (judge(FORMULAS["ward, duer"], e, "float32") for e in (exact, replace(exact, slope_scale=worse)))
    assert 0 < plain.slope_ill != plain.ill > 0
    assert verdict.ill == plain.ill
    assert 0.25 <= verdict.slope_ill <= 0.25 + plain.slope_ill
    code, out, _ = run("check ward --hard", capfd)
    (row,) = (line.split() for line in out.splitlines() if line.startswith("ward, duer "))
    assert code == 0
    assert row[-2:] == [f"{100 * x:.1f}%" for x in (plain.ill, plain.slope_ill)]
    model = hard.run(hard.by_name("ward")).to_json()["ward"]
    assert model["gradient_ill_conditioned"] == max(f["float32"]["slope_ill"] for f in model["formulas"].values())


def test_derivatives_of_which_none_can_be_judged_fail() -> None:
    verdict = replace(judge(FORMULAS["mirror, reflected"], load("mirror, reflected"), "float32"), slope_ill=1.0)
    assert not verdict.passed
    assert verdict.sentence().endswith("derivatives not to be judged: a rounding changes the answer at every point")


def test_an_outsiders_terms_are_told(capfd: pytest.CaptureFixture[str]) -> None:
    """Where they are read before, and with the result."""
    points, (value, slope) = outsider.POINTS, outsider.LIMITS
    _, out, _ = run("check powder --hard", capfd)
    assert (
        f"At {points} points, where a value may be off by {value:g} roundings and a derivative by {slope:g}.\n" in out
    )
    assert "where a value may be off" not in run("check lambertian --hard", capfd)[1]
    told = f"at {points} points, where its value may be off by {value:g} roundings and a derivative by {slope:g}"
    assert told in " ".join((REPOSITORY / "CONTRIBUTING.md").read_text().split())
    told = f"at {points} hard points as well: its value may be off by {value:g} roundings, a derivative by {slope:g}"
    assert told in " ".join((REPOSITORY / "README.md").read_text().split())
    told = f"at {points} points, where its value may be off by {value:g} and a derivative by {slope:g}."
    assert told in " ".join(inspect.signature(check.command).parameters["hard"].annotation.split())


@pytest.mark.parametrize(("name", "oracle", "rows"), [("powder", "float64", 1), ("stated", "mpmath", 2)])
def test_an_outsiders(
    name: str, oracle: str, rows: int, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each choice is judged; the bad one fails, with the place; of float64 alone nothing can be said by itself."""
    monkeypatch.setattr(hard.outsider, "POINTS", 100)
    code, out, _ = run(f"check {name} --hard", capfd)
    assert code == 1
    assert hard.ORACLES[oracle] in out
    lines = [line for line in out.splitlines() if line.startswith(f"{name}, badly in ")]
    assert len(lines) == rows
    assert "roundings (limit 8) at {'wi.x': " in lines[0]
    assert not [line for line in out.splitlines() if line.startswith(f"{name} in ")]


def test_refused(capfd: pytest.CaptureFixture[str]) -> None:
    for arguments, said in (
        ("check --hard", "name a model, or bricks, or give --all"),
        ("check phong --all --hard", "phong and --all are both given"),
        ("check phong --peers", "--peers goes with --hard"),
        ("check phong --hard --seed 3", "--seed does not go with --hard"),
        ("check phong --hard --only energy", "--only does not go with --hard"),
        (
            "check roughconductor --hard",
            "and roughconductor is neither. There are: bricks, ",
        ),
    ):
        code, out, err = run(arguments, capfd)
        assert (code, out) == (2, "")
        assert said in err
        assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("exact", "said"),
    [
        (lambda self, p, wi, wo: 1 / (p.exponent - p.exponent), "exact failed at wi.x = "),
        (lambda self, p, wi, wo: p.expnent, "AttributeError"),
        (lambda self, p, wi, wo: p.exponent * float("nan"), "exact is nan at wi.x = "),
    ],
)
def test_a_formula_that_fails(
    exact: Any, said: str, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Stated, "exact", exact)
    code, _, err = run("check stated --hard", capfd)
    assert code == 3
    assert said in err
    assert err.count("\n") == 1


def test_a_formula_of_nothing(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Light where the exact answer is 0."""
    monkeypatch.setattr(hard.outsider, "POINTS", 50)
    monkeypatch.setattr(Stated, "exact", lambda self, p, wi, wo: 0 * p.exponent)
    code, out, _ = run("check stated --hard", capfd)
    assert code == 1
    assert "stated in float32: value off by inf roundings" in out


def test_one_that_fails_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Stated, "exact", lambda self, p, wi, wo: p.expnent)
    found = hard.run([*hard.by_name("stated"), *hard.by_name("lambertian")])
    assert found.complete
    assert set(found.errors) == {"stated", "stated, badly"}
    assert list(found.verdicts) == ["lambertian"]
