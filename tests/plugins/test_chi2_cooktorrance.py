"""Sampling of the choices of cooktorrance that are not the first, by Pearson's chi-square test."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import pytest

import plugins
from tests.oracles import directions
from tests.plugins.test_chi2 import ALL, GLOSSY, AroundMirror, run


@pytest.fixture(autouse=True)
def variant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()
    monkeypatch.chdir(tmp_path)  # a failing test leaves its tables in the working directory


GGX, BLINN, TWO = {"distribution": "ggx"}, {"distribution": "blinn"}, {"m_u": 0.6, "m_v": 0.2}


@pytest.mark.parametrize(
    ("xml", "cos", "component"),
    [
        ({**GGX, "m": 0.5}, 0.7, GLOSSY),
        ({**GGX, "m": 0.5}, 0.05, ALL),
        ({**GGX, "m": 0.5, "masking": "smith"}, 1.0, GLOSSY),
        ({**GGX, "m": 0.5, "masking": "smith"}, 0.05, ALL),
        ({**GGX, **TWO, "masking": "smith"}, 0.7, GLOSSY),
        ({**GGX, **TWO, "masking": "smith"}, 0.05, GLOSSY),
        ({**GGX, **TWO}, 0.3, GLOSSY),
        ({**BLINN, "m": 0.5}, 0.7, ALL),
        ({**BLINN, "m": 1.0}, 0.05, GLOSSY),
        ({**BLINN, **TWO, "masking": "smith"}, 0.3, GLOSSY),
        (TWO, 1.0, GLOSSY),
        ({**TWO, "material": "Al"}, 0.05, ALL),
    ],
    ids=str,
)
def test_on_the_sphere(xml: dict[str, Any], cos: float, component: int) -> None:
    xml = {"type": "cooktorrance", "diffuse_reflectance": 0.2, **xml}
    run(xml, cos, component, lambda wi: mi.chi2.SphericalDomain(), lambda wi, wo: 1, res=101, ires=16)


@pytest.mark.parametrize(
    ("xml", "cos"),
    [
        ({**GGX, "m": 0.02, "masking": "smith"}, 0.7),
        ({**GGX, "m": 0.02, "masking": "smith"}, 0.02),
        ({**GGX, "m": 0.02}, 0.1),
        ({**GGX, "m_u": 0.02, "m_v": 0.05, "masking": "smith"}, 0.1),
        ({**BLINN, "m": 0.02}, 0.1),
        ({"m_u": 0.02, "m_v": 0.05}, 0.7),
    ],
    ids=str,
)
def test_around_the_mirror_direction(xml: dict[str, Any], cos: float) -> None:
    xml = {"type": "cooktorrance", "diffuse_reflectance": 0.2, **xml}
    domain = AroundMirror(xml.get("m", 0.03), mi.Vector3f(*directions.unit(cos, 0.4).tolist()))
    run(xml, cos, GLOSSY, lambda wi: domain, domain.jacobian, res=101, ires=16)
