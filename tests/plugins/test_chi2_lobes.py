"""Phong, Blinn-Phong, Ward, Kajiya and Kay: what `sample` draws is distributed as `pdf` says, and weighs the albedo."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import plugins
from tests.oracles import directions
from tests.plugins.test_chi2 import ALL, DIFFUSE, GLOSSY, AroundMirror, run

COSINES = (1.0, 0.7, 0.1)


@pytest.fixture(autouse=True)
def variant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()
    monkeypatch.chdir(tmp_path)  # a failing test leaves its tables in the working directory


class AroundThread:
    """Directions above the surface by their angles to the local x axis and about it: there the density is smooth."""

    def bounds(self) -> Any:
        return mi.ScalarBoundingBox2f([0, 0], [np.pi, np.pi])

    def aspect(self) -> float:
        return 1.0

    def map_forward(self, p: mi.Point2f) -> mi.Vector3f:
        s, c = dr.sincos(p.x)
        sin, cos = dr.sincos(p.y)
        return mi.Vector3f(c, s * cos, s * sin)

    def map_backward(self, wo: mi.Vector3f) -> mi.Point2f:
        turn = dr.atan2(dr.maximum(wo.z, 0), wo.y)  # what falls below the surface weighs nothing
        return mi.Point2f(dr.atan2(dr.sqrt(wo.y * wo.y + wo.z * wo.z), wo.x), turn)

    def jacobian(self, wi: mi.Vector3f, wo: mi.Vector3f) -> mi.Float:
        return dr.sqrt(wo.y * wo.y + wo.z * wo.z)


def sphere(xml: dict[str, Any], cos: float, component: int) -> None:
    run(xml, cos, component, lambda wi: mi.chi2.SphericalDomain(), lambda wi, wo: 1, res=101, ires=16)


def mirror(xml: dict[str, Any], cos: float, m: float) -> None:
    domain = AroundMirror(m, mi.Vector3f(*directions.unit(cos, 0.4).tolist()))
    run(xml, cos, GLOSSY, lambda wi: domain, domain.jacobian, res=101, ires=16)


@pytest.mark.parametrize("cos", COSINES)
@pytest.mark.parametrize(("exponent", "component"), [(1.0, ALL), (30.0, GLOSSY)])
@pytest.mark.parametrize("name", ["phong", "blinnphong"])
def test_wide_powers(name: str, exponent: float, component: int, cos: float) -> None:
    sphere({"type": name, "exponent": exponent}, cos, component)


@pytest.mark.parametrize("cos", [0.7, 0.1])
@pytest.mark.parametrize("name", ["phong", "blinnphong"])
def test_sharp_powers(name: str, cos: float) -> None:
    """Of the half vector's slopes, a lobe of 1e4 about the mirror direction is about sqrt(1 / (2 n)) wide."""
    mirror({"type": name, "exponent": 1e4}, cos, 0.02)


@pytest.mark.parametrize("cos", COSINES)
@pytest.mark.parametrize("alphas", [(0.5, 0.5), (0.2, 0.6)])
def test_wide_ward(alphas: tuple[float, float], cos: float) -> None:
    sphere({"type": "ward", "alpha_u": alphas[0], "alpha_v": alphas[1]}, cos, GLOSSY)


@pytest.mark.parametrize("cos", COSINES)
def test_sharp_ward(cos: float) -> None:
    mirror({"type": "ward", "alpha_u": 0.01, "alpha_v": 0.03}, cos, 0.02)


@pytest.mark.parametrize("cos", COSINES)
@pytest.mark.parametrize(("exponent", "component"), [(1.0, DIFFUSE), (1.0, GLOSSY), (30.0, ALL), (300.0, GLOSSY)])
def test_kajiyakay(exponent: float, component: int, cos: float) -> None:
    domain = AroundThread()
    xml = {"type": "kajiyakay", "exponent": exponent}
    run(xml, cos, component, lambda wi: domain, domain.jacobian, res=101, ires=16)


def test_around_the_thread() -> None:
    """Forward and backward are inverse, and the Jacobian integrates to the hemisphere's solid angle."""
    domain = AroundThread()
    t = (dr.arange(mi.Float, 500) + 0.5) * np.pi / 500
    p = mi.Point2f(*dr.meshgrid(t, t))
    wo = domain.map_forward(p)
    assert dr.all(dr.max(dr.abs(domain.map_backward(wo) - p)) < 1e-3)
    assert dr.sum(domain.jacobian(wo, wo))[0] * (np.pi / 500) ** 2 == pytest.approx(2 * np.pi, rel=1e-3)
