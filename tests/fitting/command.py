"""``brdf fit`` in the process of the test, on a small ball."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import pytest

from fitting import images
from fitting.cli.app import main
from tests.fitting import studio

SIZE = 48
TRUTH = {"m": 0.3, "eta": 1.5, "base": "0.25,0.08,0.04"}
#: What a fit of one material to one picture leaves.
RESULTS = {"material.xml", "scene.xml", "render.exr", "error.exr", "history.csv", "report.html", "fit.json"}


def ball(folder: Path) -> tuple[Path, studio.Picture]:
    """``scene.xml`` and ``target.exr`` in a folder, and what is in the latter."""
    scene = studio.standard(folder, SIZE)
    target = studio.noisy(studio.picture(scene, 512, **TRUTH), 0.01, 1)
    images.write(folder / "target.exr", target)
    return scene, target


def of(target: str = "target.exr", scene: str = "scene", fit: str = "ball.m") -> str:
    """A fit, as it is typed."""
    return f"fit {scene}.xml --target camera={target} --fit {fit}"


#: The simplest fit of all.
FIT = of()


def contents(folder: Path) -> dict[str, bytes | None]:
    """Everything in a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


def strict(text: str) -> Any:
    """JSON without the numbers that JSON does not have."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def run(place: Path, out: Path, arguments: str, capfd: pytest.CaptureFixture[str]) -> tuple[int, str, dict[str, Any]]:
    """Fit; code, standard output, fit.json. A fit that is not watched says nothing on standard error."""
    capfd.readouterr()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        code = main([*shlex.split(arguments), "--out", str(out)])
    text, err = capfd.readouterr()
    assert err == ""
    return code, text, strict((out / "fit.json").read_text())
