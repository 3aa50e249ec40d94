"""Measured materials: pictures of them through Mitsuba's `measured`, fitted with Cook-Torrance.

The data are the EPFL RGL database's (Dupuy and Jakob 2018), in the folder that ``BRDF_DATA`` names. A real surface is not a
Cook-Torrance surface; what is asked is that the fit comes out, beats a Lambertian, and says how far it is.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from fitting import fit
from tests.fitting import studio

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("BRDF_DATA", ROOT.parent / "shared" / "data")) / "measured"
MATERIALS = ("paper_white_rgb", "colodur_napoli_4f_rgb", "vch_golden_yellow_rgb", "cc_ibiza_sunset_rgb")
SIZE = 64
PAINT = ("diffuse_reflectance", "specular_reflectance", "m", "eta")


@pytest.fixture
def data() -> Path:
    """The folder; skips without it, but not where `CI` is set."""
    if not DATA.is_dir():
        message = f"{DATA} is missing: set BRDF_DATA to the folder of measured materials"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)
    return DATA


def scene(folder: Path, bsdf: str, name: str) -> Path:
    """A sphere of this BSDF under three lamps, one of them grazing."""
    grazing = studio.RIM.replace('z="-0.5"', 'z="-2"')
    side = studio.KEY.replace('x="3" y="3" z="4"', 'x="-1" y="4" z="1"').replace('id="key"', 'id="side"')
    shape = f'<shape type="sphere">{bsdf}</shape>'
    return studio.write(folder, shape, studio.camera(SIZE), studio.KEY, side, grazing, name=name)


@pytest.mark.parametrize("material", MATERIALS)
def test_a_measured_material(material: str, data: Path, tmp_path: Path) -> None:
    """Cook-Torrance comes out, finite and converged or with the reason why not; nearer than the best Lambertian."""
    measured = f'<bsdf type="measured"><string name="filename" value="{data / (material + ".bsdf")}"/></bsdf>'
    target = studio.picture(scene(tmp_path, measured, "target.xml"), 1024, 2).clip(0)
    ours = scene(tmp_path, '<bsdf type="cooktorrance" id="paint"/>', "paint.xml")
    matte = scene(tmp_path, '<bsdf type="lambertian" id="paint"/>', "matte.xml")
    solution = fit(ours, {"camera": target}, [f"paint.{p}" for p in PAINT])
    flat = fit(matte, {"camera": target}, ["paint.reflectance"])
    values = {name.split(".")[1]: np.round(e.value, 4).tolist() for name, e in solution.parameters.items()}
    print(f"\n{material}: residual {100 * solution.rms:.1f} % (lambertian {100 * flat.rms:.1f} %) {values}")
    print(f"  {solution.status}\n  " + "\n  ".join(solution.remarks))
    assert all(np.isfinite(e.value).all() for e in solution.parameters.values())
    assert np.isfinite(solution.rms)
    assert solution.rms < 0.9 * flat.rms
    assert any("is not noise" in r for r in solution.remarks), "the misfit has to be said"
    assert solution.converged or "determined" in solution.status or "Not converged" in solution.status
