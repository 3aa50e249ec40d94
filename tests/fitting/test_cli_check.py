"""``brdf check``: what it prints and writes, what it refuses, and how it ends. The checks themselves: tests/brdf, tests/plugins."""

from __future__ import annotations

import json
import re
import signal
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from rich.console import Console

import plugins
from brdf import DataError, Lobe, Model, UsageError, builtin, choice, number
from brdf.checks import CHECKS, Result
from fitting import checking, figures
from fitting.checking import Asked, Checked
from fitting.cli import check as verb
from fitting.cli import check_tables
from fitting.cli.app import main
from fitting.portrait import portrait
from fitting.report import checks as page
from plugins import registry
from tests.fitting.command import contents, strict
from tests.fitting.test_report import Reader, words

SCENE = """<scene version="3.0.0">
  <default name="rough" value="0.3"/>
  <bsdf type="cooktorrance" id="paint"><float name="m" value="$rough"/></bsdf>
  <shape type="sphere"><ref id="paint"/></shape>
  <shape type="sphere"><bsdf type="diffuse" id="chalk"/></shape>
</scene>"""


class Toy(Model):
    """Diffuse with a slope that breaks reciprocity: declared for `kind` = slanted, though not for hidden.

    With `kind` = cured the fault is declared, and does not occur.
    """

    name = "toy"
    summary = "for tests"
    params = (
        number("albedo", 0.5, (0.0, 1.0), "albedo"),
        choice("kind", ("fair", "slanted", "hidden", "cured"), "what is wrong"),
    )
    lobes = (Lobe.DIFFUSE,)
    kind: str

    def faults(self) -> dict[str, str]:
        return {"reciprocity": "it leans towards the light"} if self.kind in ("slanted", "cured") else {}

    def f(self, p: Any, wi: Any, wo: Any) -> tuple[Any]:
        slope = 1 + 0.5 * wo.z if self.kind in ("slanted", "hidden") else 1
        return (p.albedo / 5 * slope + 0 * wi.z,)


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Each test has its own models, two real ones and the toy, and works in its own folder."""
    real = {name: builtin()[name] for name in ("cooktorrance", "lambertian")}
    monkeypatch.setattr(registry, "_known", {**real, "toy": Toy})
    plugins.register()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.xml").write_text(SCENE)


def run(arguments: str, capfd: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Exit code, standard output and standard error."""
    capfd.readouterr()
    code = main(["check", *arguments.split()])
    out, err = capfd.readouterr()
    return code, out, err


def test_json_is_what_was_asked_for(capfd: pytest.CaptureFixture[str]) -> None:
    code, out, err = run("lambertian --only energy --only reciprocity --json", capfd)
    assert (code, err) == (0, "")
    found = strict(out)
    assert list(found) == ["lambertian"]
    assert list(found["lambertian"]) == ["reciprocity", "energy"]
    for result in found["lambertian"].values():
        assert list(result) == ["passed", "expected", "figure", "limit", "reason", "case"]
        assert result["passed"] is result["expected"] is True
    # A Lambertian surface reflects its reflectance, 0.5.
    assert found["lambertian"]["energy"]["figure"] == pytest.approx(0.5, rel=1e-6)
    assert found["lambertian"]["energy"]["case"]["command"].endswith("--only energy")


def test_a_model_is_checked_under_each_choice(capfd: pytest.CaptureFixture[str]) -> None:
    """One at a time; what is declared is expected, what is not, and what does not occur, is exit code 1."""
    code, out, _ = run("toy --only reciprocity --json", capfd)
    assert code == 1
    found = {name: results["reciprocity"] for name, results in strict(out).items()}
    as_expected = {name: (r["passed"], r["expected"]) for name, r in found.items()}
    assert as_expected == {
        "toy": (True, True),
        "toy[kind=slanted]": (False, True),
        "toy[kind=hidden]": (False, False),
        "toy[kind=cured]": (True, False),
    }
    assert found["toy[kind=slanted]"]["reason"] == "it leans towards the light"
    # f is 1 + z / 2 in units: at grazing against normal the larger is 3/2, the smaller 1, and the difference a third.
    assert found["toy[kind=hidden]"]["figure"] == pytest.approx(1 / 3, abs=0.02)


def test_a_choice_that_is_set_is_checked_alone(capfd: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run("toy --set kind=slanted --set albedo=0.25 --only reciprocity --json", capfd)
    assert code == 0
    ((name, results),) = strict(out).items()
    assert name == "toy[kind=slanted, albedo=0.25]"
    assert results["reciprocity"]["case"]["parameters"] == {"albedo": 0.25, "kind": "slanted"}


def test_the_command_of_a_case_finds_it_again(capfd: pytest.CaptureFixture[str]) -> None:
    _, out, _ = run("toy --set kind=hidden --set albedo=0.25 --only reciprocity --seed 3 --json", capfd)
    ((_, first),) = strict(out).items()
    command = first["reciprocity"]["case"]["command"]
    assert command.startswith("brdf check toy ")
    _, out, _ = run(command.removeprefix("brdf check ") + " --json", capfd)
    assert strict(out)["toy[albedo=0.25, kind=hidden]"] == first


def test_all_are_all_models_under_all_choices() -> None:
    names = [asked.name for asked in checking.all_models()]
    options = [(p.name, o) for p in builtin()["cooktorrance"].params for o in p.options if o != p.default]
    assert options
    assert [name for name in names if name.startswith("cooktorrance[")] == [
        f"cooktorrance[{p}={o}]" for p, o in options
    ]
    assert names[0] == "cooktorrance"
    assert names[-5:] == ["lambertian", "toy", "toy[kind=slanted]", "toy[kind=hidden]", "toy[kind=cured]"]


def test_choices_that_follow_from_what_is_given() -> None:
    """As in XML: `k` makes a conductor."""
    (asked,) = checking.by_name("cooktorrance", {"k": (3.0, 2.0, 1.0)})
    assert asked.name == "cooktorrance[k=3,2,1]"
    assert asked.described["fresnel"] == "conductor"
    assert asked.command == "brdf check cooktorrance --set k=3,2,1"


def test_mitsubas_own_with_numbers_colours_text_and_truth(capfd: pytest.CaptureFixture[str]) -> None:
    given = "alpha=0.2 distribution=ggx nonlinear=true diffuse_reflectance=0.1,0.2,0.3"
    sets = " ".join(f"--set {word}" for word in given.split())
    code, out, _ = run(f"roughplastic {sets} --only peak --json", capfd)
    assert code == 0
    ((name, results),) = strict(out).items()
    assert name == f"roughplastic[{', '.join(given.split())}]"
    assert results["peak"]["figure"] > results["peak"]["limit"]


def test_the_bsdfs_of_a_scene(capfd: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run("scene.xml --only peak --json", capfd)
    assert code == 0
    assert list(strict(out)) == ["paint", "chalk"]
    code, out, _ = run("scene.xml --bsdf paint -D rough=0.2 --only peak --json", capfd)
    ((name, results),) = strict(out).items()
    assert (code, name) == (0, "paint")
    assert results["peak"]["case"]["parameters"]["m"] == pytest.approx(0.2)
    assert results["peak"]["case"]["command"] == "brdf check scene.xml -D rough=0.2 --bsdf paint --only peak"


def test_a_module_that_registers_its_own(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """A plugin in Python that is no model of ours."""
    (tmp_path / "outsider.py").write_text(
        "import mitsuba as mi\n"
        "def make(props):\n"
        "    class Outsider(mi.BSDF):\n"
        "        def __init__(self, props):\n"
        "            mi.BSDF.__init__(self, props)\n"
        "            self.m_flags = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide\n"
        "            self.m_components = [self.m_flags]\n"
        "        def eval(self, ctx, si, wo, active=True):\n"
        "            return mi.Spectrum(0.1 * mi.Float(wo.z) * (1 + wo.z)) & (wo.z > 0) & (si.wi.z > 0)\n"
        "        def pdf(self, ctx, si, wo, active=True):\n"
        "            return mi.warp.square_to_cosine_hemisphere_pdf(wo) & (si.wi.z > 0)\n"
        "        def sample(self, ctx, si, sample1, sample2, active=True):\n"
        "            bs = mi.BSDFSample3f()\n"
        "            bs.wo = mi.warp.square_to_cosine_hemisphere(sample2)\n"
        "            bs.pdf = self.pdf(ctx, si, bs.wo)\n"
        "            bs.eta, bs.sampled_type, bs.sampled_component = 1, mi.UInt32(+self.m_flags), mi.UInt32(0)\n"
        "            return bs, self.eval(ctx, si, bs.wo) / bs.pdf & (bs.pdf > 0)\n"
        "        def traverse(self, callback): pass\n"
        "        def to_string(self): return 'Outsider[]'\n"
        "    return Outsider(props)\n"
        "mi.register_bsdf('outsider', make)\n"
    )
    code, out, err = run("outsider --import outsider --only reciprocity --only energy", capfd)
    assert err == ""
    assert code == 1
    # f is 0.1 (1 + z): twice as much at the normal as at grazing; all of it together is 2 pi 0.1 (1/2 + 1/3).
    assert re.search(r"^reciprocity +✗ failed +0\.(49\d|5) ", out, re.M)
    assert re.search(r"^energy +✓ passed +0\.52\d ", out, re.M)


def test_what_is_printed_of_one(capfd: pytest.CaptureFixture[str]) -> None:
    """A table each, then what failed with its reason, the case and the command, then the count."""
    code, out, err = run("toy --only reciprocity --only peak", capfd)
    assert (code, err) == (1, "")
    assert re.search(r"^toy\[kind=hidden\]\ncheck +outcome +figure +limit +the figure is *\n", out, re.M)
    row = r"^reciprocity +✗ failed +0\.33\d? +≤ 1e-09 +\|f\(wi, wo\) - f\(wo, wi\)\| / the larger *$"
    assert len(re.findall(row, out, re.M)) == 1
    assert "≈ expected to fail" in out
    assert "! unexpectedly passed" in out
    assert "· does not arise" in out
    declared, unexpected = out.split("Failed as declared:\n")[1].split("Unexpected:\n")
    assert declared.startswith("reciprocity of toy[kind=slanted]: it leans towards the light\n  0.33")
    assert "brdf check toy --set kind=slanted --only reciprocity" in declared
    assert re.search(r"wi = \(.*\); wo = \(.*\); there = .*; back = ", unexpected)
    assert "    albedo = 0.5; kind = hidden\n    brdf check toy --set kind=hidden --only reciprocity\n" in unexpected
    assert "It is declared to fail (it leans towards the light), and does not." in unexpected
    last = "8 checks of 4 BSDFs: 1 passed, 1 failed as declared, 2 unexpected, 4 do not arise."
    assert out.splitlines()[-1] == last


def test_what_is_printed_of_all(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """One table, a row each, and the symbols explained."""
    monkeypatch.delitem(registry._known, "cooktorrance")
    code, out, _ = run("--all --only reciprocity --only peak", capfd)
    assert code == 1
    rows = {line.split("  ")[0]: line.split()[1:] for line in out.splitlines()[1:6]}
    assert rows == {
        "lambertian": ["✓", "ok", "·"],
        "toy": ["✓", "ok", "·"],
        "toy[kind=slanted]": ["≈", "declared", "·"],
        "toy[kind=hidden]": ["✗", "FAILED", "·"],
        "toy[kind=cured]": ["!", "NO", "FAULT", "·"],
    }
    assert "≈ failed as declared" in out.splitlines()[6]
    assert "brdf check toy --set kind=slanted --only reciprocity" in out


def results(passed: bool = True, figure: float | None = 0.5, check: str = "energy") -> dict[str, Result]:
    return {check: Result(check, passed, True, figure, 1.0, "because", {"figure": "albedo", "command": "brdf check a"})}


def test_names_stay_whole_in_a_narrow_terminal() -> None:
    every = {check: next(iter(results(check=check).values())) for check in CHECKS}
    name = "cooktorrance[roughness=anisotropic]"

    def drawn(width: int) -> str:
        console = Console(width=width, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
        console.print(check_tables.overview({name: every}, console))
        return console.export_text()

    assert "✓ ok" in drawn(200)
    for width in (80, 110):
        text = drawn(width)
        assert "✓ ok" not in text
        assert "…" not in text
        assert all(len(line) <= width for line in text.splitlines())
        column = text.splitlines()[0].index("recip")
        assert "".join(line[:column].strip() for line in text.splitlines()) == name


@pytest.mark.parametrize(
    ("result", "shown"),
    [
        (Result("energy", True, True, 0.51234, 1.0), ("0.512", "≤ 1")),
        # Alike to three digits, and yet above: as many digits as tell them apart.
        (Result("energy", False, False, 1.00042, 1.0), ("1.0004", "≤ 1")),
        (Result("peak", True, True, 14.0, 0.02), ("14", "≥ 0.02")),
        (Result("peak", False, False, 1e-12, 0.02), ("1e-12", "≥ 0.02")),
        (Result("finite", True, True, 0.0, 0.0), ("0", "≤ 0")),
        (Result("finite", False, False, float("inf"), 0.0), ("infinite", "≤ 0")),
        (Result("finite", False, False, float("nan"), 0.0), ("undefined", "≤ 0")),
        (Result("peak", True, True), ("", "")),
    ],
)
def test_figures_and_limits(result: Result, shown: tuple[str, str]) -> None:
    assert (figures.figure(result), figures.limit(result)) == shown


def test_what_is_written(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, out, _ = run("toy --only reciprocity --only peak --out out --plot", capfd)
    assert code == 1
    names = ["report.html", "checks.json", "toy.png", *(f"toy-kind-{k}.png" for k in ("slanted", "hidden", "cured"))]
    assert set(contents(tmp_path / "out")) == set(names)
    assert "Look at out/report.html, out/toy.png, out/toy-kind-slanted.png" in out
    saved = strict((tmp_path / "out/checks.json").read_text())
    assert saved["complete"] is True
    assert saved["command"] == "brdf check toy --only reciprocity --only peak --seed 0 --out DIR"
    assert list(saved["results"]) == ["toy", "toy[kind=slanted]", "toy[kind=hidden]", "toy[kind=cured]"]
    for name in names[2:]:
        assert mi.Bitmap(str(tmp_path / "out" / name)).size()[0] > 1000

    text = (tmp_path / "out/report.html").read_text()
    reader = Reader(text)
    assert reader.unmatched == []
    assert not re.search(r"(?:src|href)=\"(?!data:|#)", text)
    said = words(reader.text)
    for part in (
        "Not as declared: reciprocity of toy[kind=hidden], reciprocity of toy[kind=cured].",
        "It leans towards the light.",
        "brdf check toy --set kind=hidden --only reciprocity",
        "Is it the same with the two directions exchanged?",
        saved["command"],
    ):
        assert part in said
    anchors = {a["id"] for _, a in reader.tags if a.get("id", "").startswith("bsdf-")}
    assert {a["href"].removeprefix("#") for a in reader.all("a")} == anchors
    assert len(anchors) == 4
    alts = [a["aria-label"] for a in reader.all("div") if a.get("role") == "img"]
    assert len(alts) == 4 * 3
    assert sum(
        alt.startswith("Map of the reciprocity of toy[kind=hidden]. The largest difference is 0.3") for alt in alts
    )


def test_a_report_of_one_and_text_that_looks_like_html() -> None:
    asked = [Asked("<b>$x$&", {}, "brdf check", Path("scene.xml"))]
    checked = Checked(asked, {"<b>$x$&": results(False)}, complete=True)
    text = page.html(checked, {"command": "brdf <i>", "seed": 0, "versions": {}})
    reader = Reader(text)
    assert reader.unmatched == []
    assert "<b>$x$&" in reader.text
    assert "Everything is as declared." in reader.text
    assert not reader.all("i")


def test_pictures_go_here_without_a_folder(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, out, _ = run("lambertian --only peak --plot", capfd)
    assert (code, out.splitlines()[-1]) == (0, "Look at lambertian.png.")
    assert set(contents(tmp_path)) == {"lambertian.png", "scene.xml"}


def test_names_of_files() -> None:
    names = ["a/b", "a b", "../up", "shape[2].bsdf", "", "a[m=0.3, k=1,2,3]"]
    files = checking.file_names(names)
    assert files == {
        "a/b": "a-b",
        "a b": "a-b-2",
        "../up": "-up",
        "shape[2].bsdf": "shape-2-.bsdf",
        "": "bsdf",
        "a[m=0.3, k=1,2,3]": "a-m-0.3-k-1-2-3",
    }


@pytest.mark.parametrize("as_json", [False, True])
def test_an_interruption_keeps_what_was_found(
    as_json: bool, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    true, count = Asked.check, 0

    def interrupted(self: Asked, **options: Any) -> Any:
        nonlocal count
        count += 1
        if count == 4:
            signal.raise_signal(signal.SIGINT)
        return true(self, **options)

    monkeypatch.setattr(Asked, "check", interrupted)
    code, out, err = run("toy --only reciprocity --only peak --out out" + " --json" * as_json, capfd)
    assert (code, err) == (130, "brdf: interrupted\n")
    if as_json:
        assert out == ""
    else:
        assert "Interrupted at 2 of 4 BSDFs.\n" in out
    saved = strict((tmp_path / "out/checks.json").read_text())
    assert saved["complete"] is False
    assert {name: list(results) for name, results in saved["results"].items()} == {
        "toy": ["reciprocity", "peak"],
        "toy[kind=slanted]": ["reciprocity"],
    }
    assert "Interrupted at 2 of 4 BSDFs." in Reader((tmp_path / "out/report.html").read_text()).text


def test_progress_is_told_before_each_check() -> None:
    told: list[tuple[int, str, str, float]] = []
    asked = checking.by_name("lambertian") + checking.by_name("toy", {"kind": "cured"})
    checking.run(asked, ["reciprocity", "peak"], progress=lambda *step: told.append(step))
    assert told == [
        (0, "lambertian", "reciprocity", 0.0),
        (0, "lambertian", "peak", 0.5),
        (1, "toy[kind=cured]", "reciprocity", 0.0),
        (1, "toy[kind=cured]", "peak", 0.5),
    ]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        ("", UsageError.exit_code, "nothing is named"),
        ("toy --all", UsageError.exit_code, "toy and --all are both given"),
        ("cooktorance", UsageError.exit_code, "there is no BSDF 'cooktorance'. Did you mean cooktorrance?"),
        ("roughplastik", UsageError.exit_code, "Did you mean roughplastic"),
        ("sphere", UsageError.exit_code, "sphere is not a BSDF, but a type of shape"),
        ("blendbsdf", UsageError.exit_code, "blendbsdf is nothing without a BSDF inside"),
        ("cooktorrance --set m=7", UsageError.exit_code, "m = 7 is outside [1e-4, 1.5]"),
        ("cooktorrance --set mm=0.1", UsageError.exit_code, "'mm' is not a parameter of this model. Did you mean m?"),
        ("cooktorrance --set fresnel=shlick", UsageError.exit_code, "fresnel = 'shlick' is not one of exact"),
        ("cooktorrance --set m", UsageError.exit_code, "--set 'm' is not of the form PARAM=VALUE"),
        ("cooktorrance --set m=1 --set m=1", UsageError.exit_code, "--set m is given twice"),
        (
            "roughplastic --set alpa=0.1",
            UsageError.exit_code,
            "'alpa' is not a parameter of this BSDF. Did you mean alpha",
        ),
        ("roughplastic --set type=plastic", UsageError.exit_code, "'type' is not a parameter"),
        ("measured", UsageError.exit_code, 'measured: Property "filename" cannot be found'),
        ("toy --only energ", UsageError.exit_code, "--only energ: there is no such check. Did you mean energy?"),
        ("toy --bsdf a", UsageError.exit_code, "--bsdf goes with a SCENE.xml alone"),
        ("--all --set m=1", UsageError.exit_code, "--set goes with a NAME alone"),
        ("scene.xml --set m=1", UsageError.exit_code, "--set goes with a NAME alone"),
        ("scene.xml --bsdf pant", UsageError.exit_code, "Did you mean paint? It has: paint, chalk."),
        ("scene.xml -D rouh=1", UsageError.exit_code, "The scene has no such $name"),
        ("toy --seed -1", UsageError.exit_code, "'--seed'"),
        ("nowhere.xml", DataError.exit_code, "nowhere.xml: no such file"),
        ("broken.xml", DataError.exit_code, "broken.xml:1: not well-formed XML"),
        ("toy --import nowhere", DataError.exit_code, "--import nowhere: No module named 'nowhere'"),
        ("toy --out scene.xml", DataError.exit_code, "scene.xml: cannot be made"),
    ],
)
def test_wrong_use_is_one_line(
    arguments: str, code: int, said: str, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "broken.xml").write_text("<scene")
    before = contents(tmp_path)
    got, out, err = run(arguments, capfd)
    assert (got, out) == (code, "")
    assert err.startswith("brdf: ")
    assert err.count("\n") == 1
    assert said in err
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.3", 0.3),
        ("1", 1.0),
        ("1,0.5,.25", (1.0, 0.5, 0.25)),
        ("true", True),
        ("false", False),
        ("Au", "Au"),
        ("1,2", "1,2"),
    ],
)
def test_what_is_typed_as_a_value(text: str, value: Any) -> None:
    got = verb.value(text)
    assert got == value
    assert type(got) is type(value)
    if text != ".25":
        assert verb.value(checking.text(value)) == value


def test_the_portrait_of_a_lambertian_surface() -> None:
    """f = reflectance / pi whatever the directions; half of the light is reflected; exchange changes nothing."""
    (asked,) = checking.by_name("lambertian")
    drawn = portrait(asked.subject())
    np.testing.assert_allclose(drawn.f, 0.5 / np.pi, rtol=1e-12)
    np.testing.assert_allclose(drawn.total, 0.5, rtol=1e-9)
    assert drawn.rays == ()
    assert drawn.difference is not None
    np.testing.assert_array_equal(drawn.difference, 0)


def test_the_portrait_of_a_mirror_and_of_glass() -> None:
    """Rays go where Snell says, with the share that Fresnel says, and add up to all."""
    (mirror,) = checking.by_name("conductor")
    drawn = portrait(mirror.subject())
    assert not drawn.f.any()
    assert drawn.difference is None
    np.testing.assert_allclose([ray.angle for ray in drawn.rays], drawn.incident, rtol=1e-5)
    np.testing.assert_allclose([ray.weight for ray in drawn.rays], 1, rtol=1e-5)  # eta = 0, k = 1 reflects all

    (glass,) = checking.by_name("dielectric", {"int_ior": 1.5, "ext_ior": 1.0})
    drawn = portrait(glass.subject())
    assert drawn.outgoing.max() > np.pi / 2
    for angle in drawn.incident:
        up, down = sorted((r for r in drawn.rays if r.incident == angle), key=lambda ray: ray.angle)
        assert up.angle == pytest.approx(angle, rel=1e-5)
        assert down.angle == pytest.approx(np.pi - np.arcsin(np.sin(angle) / 1.5), rel=1e-5)
        c, t = np.cos(angle), np.cos(np.pi - down.angle)
        fresnel = (((c - 1.5 * t) / (c + 1.5 * t)) ** 2 + ((1.5 * c - t) / (1.5 * c + t)) ** 2) / 2
        assert (up.weight, down.weight) == pytest.approx((fresnel, 1 - fresnel), rel=1e-4)


def test_a_ray_is_what_it_weighs_times_how_often_it_is_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where lobes cannot be asked one by one, an ideal one is chosen now and then and weighs the more."""
    (mirror,) = checking.by_name("conductor")
    subject = mirror.subject()
    true = subject.sample

    def now_and_then(*arguments: Any) -> Any:
        drawn = true(*arguments)
        return drawn._replace(weight=drawn.weight * 4, pdf=drawn.pdf / 4)

    monkeypatch.setattr(subject, "sample", now_and_then)
    np.testing.assert_allclose([ray.weight for ray in portrait(subject).rays], 1, rtol=1e-5)


def test_the_portrait_of_what_is_not_reciprocal() -> None:
    """With f = 1 + z_o / 2 the difference is that of the two, over the larger."""
    (asked,) = checking.by_name("toy", {"kind": "hidden"})
    drawn = portrait(asked.subject())
    assert drawn.difference is not None
    value = 1 + np.cos(drawn.theta) / 2
    larger = np.maximum.outer(value, value)
    np.testing.assert_allclose(drawn.difference, np.abs(np.subtract.outer(value, value)) / larger, atol=1e-12)


@pytest.mark.slow
def test_every_model_is_as_it_declares(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_known", {})
    code, out, err = run("--all --json", capfd)
    found = strict(out)
    unexpected = [
        (name, check, result["reason"], result["case"])
        for name, checks in found.items()
        for check, result in checks.items()
        if not result["expected"]
    ]
    assert (unexpected, code, err) == ([], 0, "")
    assert {name.partition("[")[0] for name in found} == set(builtin())
    assert all(list(checks) == list(CHECKS) for checks in found.values())
    declared = [result for checks in found.values() for result in checks.values() if not result["passed"]]
    assert all(result["reason"] and result["case"]["command"] for result in declared)
    json.dumps(found, allow_nan=False)
