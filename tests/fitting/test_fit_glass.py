"""A fit through glass: `effects` takes the place of `path`, and differences that of derivatives."""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

import fitting
from fitting.method import kind_of, rendering
from plugins.scenes import FOLDER
from tests.fitting import studio

SKY = f'<emitter type="envmap"><string name="filename" value="{FOLDER / "sky.exr"}"/></emitter>'
GLASS = '<bsdf type="glass" id="ball"><float name="eta" value="1.2"/></bsdf>'
#: Mitsuba's own, for the target.
DIELECTRIC = (
    '<bsdf type="dielectric" id="ball"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>'
)
PATH = '<integrator type="path"><integer name="max_depth" value="8"/></integrator>'


def scene(folder: Path, bsdf: str, name: str, light: str = SKY, integrator: str = PATH) -> Path:
    return studio.write(folder, bsdf, studio.SPHERE, studio.camera(48), light, integrator=integrator, name=name)


@pytest.mark.slow
def test_the_index_of_a_glass_ball(tmp_path: Path) -> None:
    """From 1.2, where the picture has a valley of its own, to the truth, 1.5, of a picture by Mitsuba's `path`."""
    studio.use()
    target = np.array(mi.render(mi.load_file(str(scene(tmp_path, DIELECTRIC, "target.xml"))), spp=1024, seed=5))
    solution = fitting.fit(scene(tmp_path, GLASS, "glass.xml"), {"camera": target[..., :3]}, {"ball.eta": [1.2]})
    assert solution.settings["integrator"] == "effects"
    assert solution.parameters["ball.eta"].value[0] == pytest.approx(1.5, rel=0.01)
    for said in ("Another start", "seen through glass"):
        assert [remark for remark in solution.remarks if said in remark]


@pytest.mark.parametrize(
    ("integrator", "expected"),
    [
        (PATH, ("effects", 8, False)),
        ('<integrator type="direct"><boolean name="hide_emitters" value="true"/></integrator>', ("effects", 2, True)),
        ('<integrator type="prb"><integer name="max_depth" value="4"/></integrator>', ("effects", 4, False)),
        ('<integrator type="path"/>', ("effects", -1, False)),
    ],
    ids=["path", "direct", "prb", "no limit"],
)
def test_effects_in_the_place_of_another(integrator: str, expected: tuple[str, int, bool], tmp_path: Path) -> None:
    studio.use()
    made = rendering(mi.load_file(str(scene(tmp_path, GLASS, "scene.xml", integrator=integrator))))
    assert (kind_of(made), made.max_depth, made.hide_emitters) == expected  # type: ignore[attr-defined]


def test_others_are_left(tmp_path: Path) -> None:
    studio.use()
    own = '<integrator type="volpath"><integer name="max_depth" value="3"/></integrator>'
    assert (
        kind_of(rendering(mi.load_file(str(scene(tmp_path, GLASS, "v.xml", integrator=own))))) == "volumetricsimplepath"
    )
    fog = SKY + '<shape type="cube"><bsdf type="null"/><medium name="interior" type="homogeneous"/></shape>'
    assert kind_of(rendering(mi.load_file(str(scene(tmp_path, GLASS, "fog.xml", fog))))) == "path"
