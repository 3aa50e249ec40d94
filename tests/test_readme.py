"""What the README shows is run as it stands there, and what it lists is compared with what the code declares."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from brdf import builtin
from brdf.checks import CHECKS
from fitting.cli import app
from plugins import peers

REPOSITORY = Path(__file__).parents[1]
NOTEBOOKS = REPOSITORY / "notebooks"
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """The fenced blocks of one language, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.DOTALL | re.MULTILINE)


def section(title: str) -> str:
    """The text under a heading, up to the next."""
    found = re.search(rf"^##+ {re.escape(title)}\n(.*?)(?=^##|\Z)", README, re.DOTALL | re.MULTILINE)
    assert found, f"no section {title!r}"
    return found[1]


def run(command: list[str], folder: Path) -> str:
    """Standard output of a command that must succeed, with the repository and `folder` to import from."""
    path = os.pathsep.join((str(REPOSITORY), str(folder)))
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{shlex.join(command)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def python(code: str, folder: Path) -> str:
    return run([sys.executable, "-c", code], folder)


def shell(block: str, folder: Path) -> str:
    """Output of the lines of a block, all of which call `brdf`."""
    said = []
    for line in block.replace("\\\n", " ").splitlines():
        program, *arguments = shlex.split(line, comments=True)
        assert program == "brdf", line
        said.append(run([sys.executable, "-m", "fitting.cli.app", *arguments], folder))
    return "\n".join(said)


def value(folder: Path, name: str) -> float:
    """An estimate in a folder of results."""
    return json.loads((folder / "fit.json").read_text())["parameters"][name]["value"]


MAKE, PAINT, MOON, CHECK, HARD, EFFECTS = blocks("sh")
USE, MODEL, REGISTER, TESTED, EXACT = blocks("python")
SCENE, DUST, VASES, INTEGRATOR = blocks("xml")


def test_what_make_does() -> None:
    targets = re.findall(r"^make (\w+)", MAKE, re.MULTILINE)
    assert targets == ["fit", "test"]
    makefile = (REPOSITORY / "Makefile").read_text()
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)
    (out,) = re.findall(r"example into (\S+)", MAKE)
    assert f"brdf example --out {out}\n" in makefile


def test_what_make_fit_prints(tmp_path: Path) -> None:
    """Line for line, but for the figures and what the README leaves out."""

    def shape(line: str) -> str:
        return " ".join(re.sub(r"[+-]?\d+(\.\d+)?(e[+-]?\d+)?", "#", line).split())

    printed = iter([shape(line) for line in shell("brdf example --out out/example", tmp_path).splitlines()])
    (block,) = blocks("text")
    for line in block.splitlines():
        assert shape(line) in printed, line


def test_fit_your_own_picture_and_from_python(tmp_path: Path) -> None:
    """Found from the values of the picture, and from others: a fit looks for its own start."""
    (tmp_path / "paint.xml").write_text(SCENE)
    said = shell(PAINT, tmp_path)
    assert "Converged" in said
    out = tmp_path / "out/paint"
    assert value(out, "paint.m") == pytest.approx(0.2, rel=1e-3)
    assert value(out, "paint.eta") == pytest.approx(1.5, rel=1e-3)
    listed = set(re.findall(r"`(\w+\.(?:html|xml|json|exr|csv))`", section("What comes out")))
    assert listed == {path.name for path in out.iterdir()}
    (look,) = re.findall(r"open `(\S+report\.html)`", README)
    assert (tmp_path / look).is_file()

    (tmp_path / "paint.xml").write_text(SCENE.replace('"0.2"', '"0.6"').replace('"1.5"', '"2.5"'))
    said = python(USE, tmp_path).splitlines()
    assert said[0].startswith("Converged")
    assert [line.split()[0] for line in said[1:]] == ["paint.m", "paint.eta", "paint.diffuse_reflectance"]
    assert float(said[1].split("[")[1].split("]")[0]) == pytest.approx(0.2, rel=1e-3)


def test_the_model_is_the_file_and_short() -> None:
    assert (NOTEBOOKS / "lommelseeliger.py").read_text() == MODEL
    assert MODEL.count("\n") < 40
    assert DUST in (NOTEBOOKS / "moon.xml").read_text()


def test_what_the_model_reflects(tmp_path: Path) -> None:
    """Isotropic and white, it reflects ``(1 - mu ln(1 + 1/mu)) / 2`` (Hanrahan and Krueger 1993, an infinite layer)."""
    (tmp_path / "lommelseeliger.py").write_text(MODEL)
    code = """
from drjit.llvm.ad import Array3f64
from brdf import defaults, evaluate
from brdf.checks.energy import albedo, cosine_weight
from lommelseeliger import LommelSeeliger
model = LommelSeeliger()
p = defaults(model, Array3f64, albedo=1.0, g=0.0)
for mu in (1, 0.7, 0.3, 0.1):
    print(albedo(cosine_weight(lambda wi, wo: evaluate(model, p, wi, wo)), mu, Array3f64)[0])
up = Array3f64(0, 0, 1)
print(evaluate(model, defaults(model, Array3f64, albedo=1.0, g=-0.5), up, up).x[0])
"""
    *found, back = [float(line) for line in python(code, tmp_path).splitlines()]
    np.testing.assert_allclose(found, [0.1534, 0.1894, 0.2800, 0.3801], atol=2e-4)
    # Straight back, Henyey and Greenstein's function is (1 + g) / (1 - g)^2 with g = 0.5.
    assert back == pytest.approx(6 / (8 * np.pi), rel=1e-12)


def test_the_model_is_registered_rendered_and_fitted(tmp_path: Path) -> None:
    (tmp_path / "lommelseeliger.py").write_text(MODEL)
    (tmp_path / "moon.xml").write_text((NOTEBOOKS / "moon.xml").read_text())
    g = float(python(REGISTER, tmp_path).strip(" []\n"))
    assert g == pytest.approx(-0.25, abs=0.005)


def test_the_model_in_an_installed_package(tmp_path: Path) -> None:
    """The file beside the metadata that an installation writes, with the README's entry point."""
    (tmp_path / "lommelseeliger.py").write_text(MODEL)
    (tmp_path / "moon.xml").write_text((NOTEBOOKS / "moon.xml").read_text())
    ((group, point),) = re.findall(r'^\[project\.entry-points\."(.*)"\]\n(.*)\n', "".join(blocks("toml")))
    info = tmp_path / "dust-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: dust\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{group}]\n{point.replace(chr(34), '')}\n")
    said = shell(MOON, tmp_path)
    assert "fraction of the light that a grain scatters" in said
    assert value(tmp_path / "out/moon", "dust.g") == pytest.approx(-0.25, abs=0.005)
    assert 'type="lommelseeliger"' in (tmp_path / "out/moon/material.xml").read_text()


def test_check_a_bsdf(tmp_path: Path) -> None:
    """Each line ends as declared; the checks are those there are."""
    (tmp_path / "paint.xml").write_text(SCENE)
    said = shell(CHECK, tmp_path)
    assert said.count(" 0 unexpected") == 3
    assert '"finite": {' in said
    assert {path.name for path in (tmp_path / "out/phong").iterdir()} >= {"report.html", "checks.json", "phong.png"}
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \|", section("Check a BSDF"), re.MULTILINE)
    assert [name.strip("`") for row in rows for name in row.split(", ")] == list(CHECKS)


def test_checks_from_python(tmp_path: Path) -> None:
    (tmp_path / "test_mine.py").write_text(TESTED)
    assert python(TESTED, tmp_path).startswith("failed")
    said = run([sys.executable, "-m", "pytest", "-q", "-k", "reciprocity or energy", "test_mine.py"], tmp_path)
    assert "2 passed" in said


@pytest.mark.slow
def test_hard_cases(tmp_path: Path) -> None:
    """Each line passes, and every model is in them."""
    said = shell(HARD, tmp_path)
    assert "none beyond the limits" in said
    found = json.loads(said[said.index("{") : said.rindex("}") + 1])["models"]
    assert set(found) == {"bricks", *builtin()}
    for model in found.values():
        assert model["passed"]
        assert model["non_finite"] == 0
        assert model["reciprocal"] is not False
    assert "roughdielectric, reflection" in said


def test_only_what_a_scene_calls_for(tmp_path: Path) -> None:
    """Each line, the scenes being in the repository; and every property of the integrator is one."""
    (tmp_path / "plugins").symlink_to(REPOSITORY / "plugins")
    said = shell(EFFECTS, tmp_path)
    assert "Left out as asked: diffuse.indirect." in said
    assert {path.name for path in tmp_path.iterdir()} == {"plugins", "plan.html", "glass.exr", "cornell.exr"}
    (tmp_path / "integrator.xml").write_text(INTEGRATOR.replace(">", ' version="3.0.0">', 1))
    code = """
import plugins, mitsuba as mi
mi.set_variant("llvm_ad_rgb")
plugins.register()
print(mi.load_file("integrator.xml"))
"""
    assert "max_depth = 8" in python(code, tmp_path)


def test_an_exact_formula(tmp_path: Path) -> None:
    code = f"import mpmath, plugins, lommelseeliger\nfrom mpmath import mpf\n\nclass Exact:\n{EXACT}\n"
    code += "lommelseeliger.LommelSeeliger.exact = Exact.exact\nplugins.register(lommelseeliger.LommelSeeliger)\n"
    (tmp_path / "mine.py").write_text(code)
    (tmp_path / "lommelseeliger.py").write_text(MODEL)
    said = shell("brdf check lommelseeliger --hard --import mine", tmp_path)
    assert "Judged by its formula in mpmath: lommelseeliger." in said
    assert "none beyond the limits" in said


def test_the_vases(tmp_path: Path) -> None:
    """Left and right of the block are a material each, and load."""
    halves = zip(*((line[:56].rstrip(), line[56:]) for line in VASES.splitlines()), strict=True)
    for half, kind in zip(halves, ("conductor", "exact"), strict=True):
        (tmp_path / "vase.xml").write_text("\n".join(half).replace("<bsdf ", '<bsdf version="3.0.0" ', 1))
        code = f"""
import plugins, mitsuba as mi
mi.set_variant("llvm_ad_rgb")
plugins.register()
assert "fresnel = {kind}" in str(mi.load_file("vase.xml"))
"""
        python(code, tmp_path)


def test_tables_of_the_models() -> None:
    """What docs/tables.py writes is what stands there."""
    sys.path.insert(0, str(REPOSITORY / "docs"))
    import tables  # pyright: ignore[reportMissingImports]

    again = "run .venv/bin/python docs/tables.py"
    assert tables.page() == (REPOSITORY / "docs/models.md").read_text(encoding="utf-8"), again
    assert tables.in_readme(README) == README, again
    for name in builtin():
        assert f"[`{name}`](docs/models.md#{name})" in section("The models")


def test_table_of_mitsubas_own() -> None:
    lines = ["| BSDF | parameters |", "|---|---|"]
    lines += [f"| `{name}` | {', '.join(f'`{p.name}`' for p in params)} |" for name, params in peers.TABLE.items()]
    table = "\n".join(lines)
    assert table in section("Mitsuba's own"), f"\n{table}"


def test_exit_codes() -> None:
    told = app.app.info.epilog
    assert isinstance(told, str)
    for code in told.removeprefix("Exit codes: ").removesuffix(".").split("; "):
        assert code in README


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_links(page: str) -> None:
    """What a page points to in the repository is there."""
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in link]
    assert links or page == "CHANGELOG.md"
    assert [link for link in links if not (REPOSITORY / link.split("#")[0]).exists()] == []


def test_pictures() -> None:
    """They are there, and small."""
    pictures = re.findall(r"!\[.+\]\((.+)\)", README)
    drawn = (REPOSITORY / "docs").glob("*.png")
    assert sorted(pictures) == sorted(f"docs/{path.name}" for path in drawn)
    for picture in pictures:
        assert (REPOSITORY / picture).read_bytes()[:4] == b"\x89PNG"
        assert (REPOSITORY / picture).stat().st_size < 300_000


def test_the_order_of_imports_that_is_shown() -> None:
    """In what the README shows, mitsuba comes after ours."""
    for block in (USE, REGISTER, TESTED):
        ours, theirs = re.search(r"import (fitting|plugins)", block).start(), block.find("import mitsuba")  # type: ignore[union-attr]
        assert ours >= 0
        assert theirs == -1 or theirs > ours
