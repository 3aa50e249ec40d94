"""What is in the wheel, and what the constraints pin."""

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest
from packaging.requirements import Requirement

REPOSITORY = Path(__file__).parents[1]
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
PACKAGES = ("brdf", "plugins", "fitting")


def pinned() -> dict[str, str]:
    lines = (REPOSITORY / "constraints.txt").read_text().splitlines()
    for line in lines:
        assert re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.]+", line), line
    return {canonical(name): number for name, number in (line.split("==") for line in lines)}


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_constraints_pin_every_requirement_and_agree_with_it() -> None:
    pins = pinned()
    assert (pins["mitsuba"], pins["drjit"]) == ("3.9.1", "1.5.0")
    listed = PROJECT["dependencies"] + [r for extra in PROJECT["optional-dependencies"].values() for r in extra]
    for requirement in map(Requirement, listed):
        if requirement.name != PROJECT["name"]:
            assert requirement.specifier.contains(pins[canonical(requirement.name)]), str(requirement)


def test_what_is_installed_is_what_is_pinned() -> None:
    """Of all that is pinned, what is here has that version."""
    different = {}
    for name, number in pinned().items():
        try:
            if version(name) != number:
                different[name] = (version(name), number)
        except PackageNotFoundError:
            continue
    assert different == {}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=REPOSITORY, check=True, capture_output=True)
    (made,) = folder.glob("*.whl")
    return made


def test_the_wheel_holds_all_three_packages_and_their_data(wheel: Path) -> None:
    assert wheel.name == f"brdf_fitting-{PROJECT['version']}-py3-none-any.whl"
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
        info = f"brdf_fitting-{PROJECT['version']}.dist-info"
        assert "brdf = fitting.cli.start:main" in archive.read(f"{info}/entry_points.txt").decode()
        assert f"{info}/licenses/LICENSE" in archive.namelist()
    there = {
        str(path.relative_to(REPOSITORY))
        for package in PACKAGES
        for path in (REPOSITORY / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert held == there
    assert {f"{package}/py.typed" for package in PACKAGES} <= held
    assert {Path(name).suffix for name in held} >= {".xml", ".exr", ".html", ".bib"}


@pytest.mark.slow
def test_the_example_runs_from_the_wheel_alone(wheel: Path, tmp_path: Path) -> None:
    """Nothing of the source tree is needed."""
    installed = tmp_path / "installed"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(installed)
    code = (
        "import sys, fitting; from fitting.cli.app import main; "
        f"assert fitting.__file__.startswith({str(installed)!r}), fitting.__file__; "
        "sys.exit(main(['example', '--out', 'out']))"
    )
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True)
    assert list((tmp_path / "out").rglob("report.html"))
