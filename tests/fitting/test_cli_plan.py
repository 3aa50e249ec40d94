"""``brdf plan``: the table of a scene as text, JSON and a page; what it cannot do is one line."""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib.image
import mitsuba as mi
import numpy as np
import pytest

from brdf.errors import DataError, UsageError
from fitting import planning
from fitting.cli.app import main
from fitting.images import from_srgb
from fitting.method import depth_of
from plugins.effects.table import CELLS
from plugins.scene import load
from plugins.scenes import FOLDER

SCENES = FOLDER / "effects"
KEYS = {"called_for", "why", "technique", "easy", "share", "share_se", "time", "drop_error", "drop_error_se"}
#: The light of each cell in the stand-in for the integrator: a tenth, two tenths, ...; no lamp is in view.
LIGHT = {cell: 0.1 * (i + 1) for i, cell in enumerate(CELLS)} | {"emitter": 0.0}


def layers(scene: Any, spp: int, seed: int, size: int) -> dict[str, np.ndarray]:
    """Without noise, the upper half of each dark."""
    half = np.ones((size, size, 3)) * (np.arange(size) >= size // 2)[:, None, None]
    return {cell: light * half for cell, light in LIGHT.items()}


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """Layers that are known instead of rendered ones; each cell takes a second."""
    monkeypatch.setattr(planning, "with_effects", lambda *_: (layers, lambda cells: float(len(cells))))


def said(capsys: pytest.CaptureFixture[str]) -> str:
    out, err = capsys.readouterr()
    assert err == ""
    return out


def test_json_has_every_cell_and_no_number_without_a_pilot(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(SCENES / "glass.xml"), "--json"]) == 0
    found = json.loads(said(capsys))
    assert list(found["cells"]) == list(CELLS)
    assert (found["max_depth"], found["pilot"]) == (8, None)
    for cell in found["cells"].values():
        assert set(cell) == KEYS
        assert (cell["technique"] is not None) == cell["called_for"]
        assert [cell[k] for k in ("share", "share_se", "time", "drop_error", "drop_error_se")] == [None] * 5
    called = {name for name, cell in found["cells"].items() if cell["called_for"]}
    assert called == {"diffuse.point", "diffuse.indirect", "mirror.indirect"}


def test_the_table_is_the_lectures_and_fits_80_columns(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(SCENES / "all.xml")]) == 0
    lines = said(capsys).splitlines()
    start = next(i for i, line in enumerate(lines) if "environment" in line and "point" in line)
    assert lines[start].split() == ["point", "area", "environment", "indirect"]
    assert [line.split() for line in lines[start + 1 : start + 5]] == [
        ["diffuse", "yes*", "yes", "yes", "yes"],
        ["glossy", "yes*", "yes", "yes", "yes"],
        ["mirror", "·", "yes*", "yes*", "yes*"],
        ["emitter", "yes*"],
    ]
    assert max(map(len, lines[: start + 7])) <= 80
    for cell in CELLS:
        assert sum(line.split()[:1] == [cell] for line in lines[start + 6 :]) == 1


@pytest.mark.usefixtures("stand_in")
def test_a_pilot_says_what_each_cell_is_worth(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(SCENES / "points.xml"), "--pilot", "--json"]) == 0
    found = json.loads(said(capsys))
    assert found["sensor"] == "camera"
    assert (found["pilot"]["runs"], found["pilot"]["size"]) == (4, 32)
    total = sum(LIGHT.values())
    for name, cell in found["cells"].items():
        assert cell["share"] == pytest.approx(LIGHT[name] / total)
        assert cell["share_se"] == pytest.approx(0, abs=1e-12)
    # Two are called for, each of which takes half of the time; the others take none.
    assert {name: cell["time"] for name, cell in found["cells"].items() if cell["time"]} == {
        "diffuse.point": 0.5,
        "glossy.point": 0.5,
    }
    # Half of the pixels lose this share of their light; those that are dark lose nothing.
    for name, cell in found["cells"].items():
        assert cell["drop_error"] == pytest.approx(np.sqrt(0.5) * LIGHT[name] / total)
        assert cell["drop_error_se"] == pytest.approx(0, abs=1e-9)
    assert found["pilot"]["white"] == pytest.approx(total)
    assert main(["plan", str(SCENES / "points.xml"), "--pilot"]) == 0
    lines = said(capsys).splitlines()
    start = next(i for i, line in enumerate(lines) if "environment" in line and "point" in line)
    assert max(map(len, lines[: start + 7])) <= 80
    assert f"{100 * LIGHT['diffuse.point'] / total:.1f} ±0.0 %*" in lines[start + 1]
    assert max(map(len, lines)) <= 80
    share = 100 * LIGHT["glossy.point"] / total
    numbers = [line for line in lines if line.startswith("glossy.point")][1]
    assert numbers.split() == [
        "glossy.point",
        f"{share:.1f}",
        "±0.0",
        "%",
        "50",
        "%",
        f"{share / 2**0.5:.1f}",
        "±0.0",
        "%",
    ]
    assert "4 runs of 32 pixels" in lines[-2]


@pytest.mark.parametrize("name", ["point", "points", "all"])
def test_progress_knows_its_end(name: str) -> None:
    from plugins.scene import load

    mi.set_variant("llvm_ad_rgb")
    plan = planning.static(load(SCENES / f"{name}.xml"))
    made = []
    planning.measured(
        plan,
        None,  # type: ignore[arg-type]
        lambda *given: (made.append("layers"), layers(*given))[1],
        lambda cells: (made.append("seconds"), 1.0)[1],
        0,
    )
    assert len(made) == planning.calls(plan)


class Page(HTMLParser):
    """What a page holds, and whether each element that is opened is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.images: list[dict[str, Any]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag == "img":
            self.images.append(dict(attrs))
        elif tag not in ("meta", "link", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data if self.open and self.open[-1] != "style" else ""


@pytest.mark.usefixtures("stand_in")
def test_the_page_has_a_picture_a_cell_on_one_scale(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "plan.html"
    assert main(["plan", str(SCENES / "all.xml"), "--out", str(out)]) == 0
    said(capsys)
    assert [p.name for p in tmp_path.iterdir()] == ["plan.html"]
    text = out.read_text()
    page = Page(text)
    assert page.open == []
    assert re.findall(r'(?:src|href)="(?!data:|#)', text) == []
    assert len(page.images) == 13  # twelve cells that this scene calls for, and the whole
    white = sum(LIGHT.values())
    for image in page.images[:-1]:
        cell = image["alt"].removeprefix("The light of ").partition(":")[0]
        pixels = matplotlib.image.imread(io.BytesIO(base64.b64decode(image["src"].partition(",")[2])))[..., :3]
        assert pixels.shape == (planning.PICTURE_SIZE, planning.PICTURE_SIZE, 3)
        # Eight bits: half a step is 1 / 510, and the curve of sRGB is at most 2.3 steep there.
        np.testing.assert_allclose(from_srgb(pixels[-1, -1]), min(LIGHT[cell] / white, 1), atol=2.3 / 510)
        assert pixels[0, 0].max() == 0
    for cell in CELLS:
        assert page.text.count(cell) >= 1
    assert "no ray meets a point" in page.text


def test_names_of_the_scene_are_not_markup(tmp_path: Path) -> None:
    from fitting.report import plan as page

    scene = tmp_path / "a<b>.xml"
    scene.write_text((SCENES / "point.xml").read_text().replace('id="ball"', 'id="&lt;i&gt;"'))
    mi.set_variant("llvm_ad_rgb")
    from plugins.scene import load

    text = page.html(planning.static(load(scene)), layers(None, 1, 0, 8))
    assert "<i>" not in text
    assert "a<b>" not in text
    assert "(&lt;i&gt;)" in text
    assert "<b>called for</b>" in text


@pytest.fixture
def broken(tmp_path: Path) -> Iterator[Path]:
    fog = '<medium type="homogeneous" name="interior"/></shape>'
    (tmp_path / "fog.xml").write_text((SCENES / "point.xml").read_text().replace("</shape>", fog))
    (tmp_path / "blind.xml").write_text('<scene version="3.0.0"/>')
    yield tmp_path


@pytest.mark.parametrize(
    ("arguments", "code", "what"),
    [
        (["no.xml"], DataError.exit_code, "no.xml: no such file"),
        (["fog.xml"], DataError.exit_code, "the shape 'ball' borders on a participating medium"),
        (["blind.xml", "--pilot"], DataError.exit_code, "blind.xml: the scene has no sensor"),
        (["blind.xml", "--out", "x.png"], UsageError.exit_code, "x.png: the plan is written as .html"),
        (["blind.xml", "--out", "no/x.html"], DataError.exit_code, "there is no folder no"),
        (["blind.xml", "-D", "size"], UsageError.exit_code, "-D 'size' is not of the form NAME=VALUE"),
        (["blind.xml", "-D", "size=3"], UsageError.exit_code, "size"),
    ],
)
def test_what_cannot_be_planned_is_one_line(
    arguments: list[str],
    code: int,
    what: str,
    broken: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(broken)
    assert main(["plan", *arguments]) == code
    out, err = capsys.readouterr()
    assert what in err
    assert (out, err.count("\n")) == ("", 1)
    assert sorted(p.name for p in broken.iterdir()) == ["blind.xml", "fog.xml"]


def test_nothing_in_it_calls_for_nothing(broken: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(broken / "blind.xml"), "--json"]) == 0
    assert not any(cell["called_for"] for cell in json.loads(said(capsys))["cells"].values())


@pytest.mark.parametrize(
    ("integrator", "depth"),
    [
        ({"type": "path"}, -1),
        ({"type": "path", "max_depth": 5}, 5),
        ({"type": "direct"}, 2),
        ({"type": "prb", "max_depth": 4}, 4),
        ({"type": "aov", "aovs": "far:depth", "inside": {"type": "path", "max_depth": 7}}, 7),
        ({"type": "volpath", "max_depth": 3}, 3),
    ],
)
def test_the_depth_is_the_integrators(integrator: dict[str, Any], depth: int) -> None:
    mi.set_variant("llvm_ad_rgb")
    assert depth_of(mi.load_dict(integrator)) == (depth if depth >= 0 else None)  # type: ignore[arg-type]


def test_no_integrator_no_end(tmp_path: Path) -> None:
    mi.set_variant("llvm_ad_rgb")
    path = tmp_path / "scene.xml"
    text = (SCENES / "glass.xml").read_text()
    path.write_text(re.sub(r"<integrator.*?</integrator>", "", text, flags=re.DOTALL))
    assert planning.static(load(path))["max_depth"] == -1
    assert planning.static(load(SCENES / "glass.xml"))["max_depth"] == 8
