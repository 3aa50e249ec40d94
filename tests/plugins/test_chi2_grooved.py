"""What `grooved` draws is distributed as its density says: Pearson's chi-square test, a million samples each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import pytest

import plugins
from tests.oracles import directions

ALL, GLOSSY = 0xFFFFFFFF, 1
#: Tests in this file: the level of each is chosen so that all pass with 99 % probability if all is right.
COUNT = 14


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


@pytest.mark.parametrize("azimuth", [0.4, 1.5])
@pytest.mark.parametrize(
    ("cos", "exponent", "spacing", "height", "component"),
    [
        (1.0, 30.0, 2.0, 0.0, GLOSSY),
        (0.7, 5.0, 2.5, 0.3, GLOSSY),
        (0.3, 100.0, 4.0, 0.8, GLOSSY),
        (0.3, 1.0, 2.2, 0.5, GLOSSY),
        (0.1, 20.0, 2.5, 0.3, GLOSSY),
        (0.02, 20.0, 6.0, 0.9, GLOSSY),
        (0.5, 30.0, 3.0, 0.2, ALL),
    ],
)
def test_on_the_sphere(
    cos: float,
    exponent: float,
    spacing: float,
    height: float,
    component: int,
    azimuth: float,
    tmp_path: Path,
    monkeypatch: Any,
) -> None:
    monkeypatch.chdir(tmp_path)  # a failing test leaves its tables in the working directory
    bsdf = mi.load_dict({"type": "grooved", "exponent": exponent, "spacing": spacing, "height": height})
    wi = mi.Vector3f(*directions.unit(cos, azimuth).tolist())
    context = mi.BSDFContext()
    context.component = component

    def interaction(n: int) -> mi.SurfaceInteraction3f:
        si = dr.zeros(mi.SurfaceInteraction3f, n)
        si.wi = wi
        return si

    def sample(u: mi.Vector3f) -> tuple[mi.Vector3f, mi.Float]:
        bs, weight = bsdf.sample(context, interaction(dr.width(u)), u.x, mi.Point2f(u.y, u.z))
        return bs.wo, dr.select(dr.any(weight != 0), 1.0, 0.0)

    def density(wo: mi.Vector3f) -> mi.Float:
        return bsdf.pdf(context, interaction(dr.width(wo)), wo)

    test = mi.chi2.ChiSquareTest(mi.chi2.SphericalDomain(), sample, density, sample_dim=3, res=101, ires=8)
    assert test.run(test_count=COUNT, quiet=True), test.messages
