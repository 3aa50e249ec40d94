"""The notebooks run from top to bottom, and show what their text says they show."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import jupytext
import pytest
from nbclient import NotebookClient

REPOSITORY = Path(__file__).parents[1]
FOLDER = REPOSITORY / "notebooks"
NOTEBOOKS = [path for path in sorted(FOLDER.glob("*.py")) if "# %%" in path.read_text(encoding="utf-8")]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def executed() -> dict[str, list[Any]]:
    """The code cells of each notebook after execution, by its name. A cell that fails raises."""
    found = {}
    for path in NOTEBOOKS:
        notebook = jupytext.read(path)
        client = NotebookClient(
            notebook, timeout=None, kernel_name="python3", resources={"metadata": {"path": str(FOLDER)}}
        )
        client.execute(env={**os.environ, "PYTHONPATH": str(REPOSITORY)})
        found[path.stem] = [cell for cell in notebook.cells if cell.cell_type == "code"]
    return found


def printed(cells: list[Any]) -> str:
    """Everything on standard output."""
    return "".join(o.text for cell in cells for o in cell.outputs if o.output_type == "stream" and o.name == "stdout")


def shown(cells: list[Any], kind: str) -> list[str]:
    """Everything that was displayed, of one MIME type."""
    return [o.data[kind] for cell in cells for o in cell.outputs if kind in o.get("data", {})]


def test_there_are_notebooks() -> None:
    assert "fit_a_sphere" in [path.stem for path in NOTEBOOKS]


def test_nothing_is_complained_of(executed: dict[str, list[Any]]) -> None:
    """No warning, and no output of Dr.Jit's."""
    for name, cells in executed.items():
        said = [o.text for cell in cells for o in cell.outputs if o.output_type == "stream" and o.name == "stderr"]
        assert said == [], name


def test_mitsubas_own(executed: dict[str, list[Any]]) -> None:
    """The faults that are known are found, each with a command; what is right is not called wrong."""
    text = printed(executed["mitsubas_own"])
    found = {name: set(failed.split(", ")) for name, failed in re.findall(r"^(\w+): (.+)$", text, re.MULTILINE)}
    assert found["diffuse"] == found["dielectric"] == {"all passed"}
    assert found["roughplastic"] >= {"gradient", "gradient_path", "gradient_prb", "gradient_direct"}
    assert "gradient_prb" in found["plastic"] and "gradient_prb" in found["conductor"]
    assert found["blendbsdf"] >= {"gradient_path", "gradient_prb"}
    assert "measured" not in found or "reciprocity" in found["measured"]
    assert "command: brdf check roughplastic --set alpha=0.2" in text
    (table,) = shown(executed["mitsubas_own"], "text/markdown")
    assert table.count("\n") == 1 + len(found)


def test_fit_a_sphere(executed: dict[str, list[Any]]) -> None:
    cells = executed["fit_a_sphere"]
    text = printed(cells)
    assert re.findall(r"^(ball\.(?:m|eta)): .* inside$", text, re.MULTILINE) == ["ball.m", "ball.eta"]

    sphere, full, both = shown(cells, "text/html")
    for page in (sphere, full, both):
        assert "Converged" in page
        assert "data:image/png" in page
    assert "told apart" in full
    assert "told apart" not in sphere + both

    ends = {solver: float(m) for solver, m in re.findall(r"^(lm|lbfgs|adam|gd) +m = (\S+)", text, re.MULTILINE)}
    assert set(ends) == {"lm", "lbfgs", "adam", "gd"}
    assert ends["lm"] == pytest.approx(0.3, rel=0.005)

    alone, together = re.findall(r"between (\S+) and (\S+)$", text, re.MULTILINE)[-2:]
    width = [float(high) - float(low) for low, high in (alone, together)]
    assert width[0] > 20 * width[1]
    assert float(alone[0]) < -0.25 < float(alone[1])

    assert len(shown(cells, "image/png")) == 4
    for file in ("fit.json", "material.xml", "report.html", "scene.xml"):
        assert file in text
    assert '<bsdf version="3.0.0" type="cooktorrance" id="ball">' in text
