"""What `sample` draws is distributed as `pdf` says: Pearson's chi-square test, a million samples each."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import pytest

import plugins
from tests.oracles import directions

#: Component numbers of cooktorrance; -1 is all of them.
ALL, DIFFUSE, GLOSSY = 0xFFFFFFFF, 0, 1
COSINES = (1.0, 0.7, 0.1, 0.02)
#: Tests in this file: the level of each is chosen so that all pass with 99 % probability if all is right.
COUNT = 40


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def run(xml: dict[str, Any], cos: float, component: int, domain: Any, jacobian: Any, **settings: Any) -> None:
    bsdf = mi.load_dict(xml)
    wi = mi.Vector3f(*directions.unit(cos, 0.4).tolist())
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
        return bsdf.pdf(context, interaction(dr.width(wo)), wo) * jacobian(wi, wo)

    test = mi.chi2.ChiSquareTest(domain(wi), sample, density, sample_dim=3, **settings)
    assert test.run(test_count=COUNT, quiet=True), test.messages


class AroundMirror:
    """Directions by the slopes of the half vector, ``x / (1 - x^2)`` times `m` each, so that a sharp lobe fills the
    domain, at normal incidence and at grazing. Mitsuba's own domain, the sphere, cannot resolve it."""

    def __init__(self, m: float, wi: mi.Vector3f) -> None:
        self.m, self.wi = m, wi

    def bounds(self) -> Any:
        return mi.ScalarBoundingBox2f([-1, -1], [1, 1])

    def aspect(self) -> float:
        return 1.0

    def map_forward(self, p: mi.Point2f) -> mi.Vector3f:
        slope = self.m * p / dr.maximum(1 - p * p, 1e-6)
        h = dr.normalize(mi.Vector3f(slope.x, slope.y, 1))
        seen = dr.dot(self.wi, h)
        return dr.select(seen > 0, 2 * seen * h - self.wi, -self.wi)

    def map_backward(self, wo: mi.Vector3f) -> mi.Point2f:
        s = self.slopes(wo) / self.m
        return 2 * s / (1 + dr.sqrt(1 + 4 * s * s))

    def slopes(self, wo: mi.Vector3f) -> mi.Point2f:
        h = self.wi + wo
        safe = dr.select(h.z > 0, h.z, 1)
        return dr.select(h.z > 0, mi.Point2f(h.x, h.y) / safe, 0)

    def jacobian(self, wi: mi.Vector3f, wo: mi.Vector3f) -> mi.Float:
        """Solid angle of wo by area of the domain."""
        p = self.map_backward(wo)
        by_slope = self.m * (1 + p * p) / dr.square(dr.maximum(1 - p * p, 1e-6))
        h = wi + wo
        length = dr.select(wo.z > 0, dr.norm(h), 1)
        cos = h.z / length
        return dr.select(wo.z > 0, 4 * (length / 2) * cos**3 * by_slope.x * by_slope.y, 0)


@pytest.mark.parametrize("component", [ALL, GLOSSY], ids=["both", "glossy"])
@pytest.mark.parametrize("cos", COSINES)
@pytest.mark.parametrize("m", [0.5, 1.0])
def test_on_the_sphere(m: float, cos: float, component: int, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)  # a failing test leaves its tables in the working directory
    xml = {"type": "cooktorrance", "m": m, "diffuse_reflectance": 0.2}
    run(xml, cos, component, lambda wi: mi.chi2.SphericalDomain(), lambda wi, wo: 1, res=101, ires=16)


@pytest.mark.parametrize(("m", "component"), [(0.001, GLOSSY), (0.02, GLOSSY), (0.02, ALL), (0.1, GLOSSY), (0.1, ALL)])
@pytest.mark.parametrize("cos", COSINES)
def test_around_the_mirror_direction(cos: float, m: float, component: int, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    xml = {"type": "cooktorrance", "m": m, "diffuse_reflectance": 0.2}
    domain = AroundMirror(m, mi.Vector3f(*directions.unit(cos, 0.4).tolist()))
    run(xml, cos, component, lambda wi: domain, domain.jacobian, res=101, ires=16)


@pytest.mark.parametrize("cos", [0.7, 0.02])
def test_smith(cos: float, tmp_path: Path, monkeypatch: Any) -> None:
    """The same sampling serves the other choices of masking."""
    monkeypatch.chdir(tmp_path)
    xml = {"type": "cooktorrance", "m": 0.5, "masking": "smith", "fresnel": "schlick"}
    run(xml, cos, ALL, lambda wi: mi.chi2.SphericalDomain(), lambda wi, wo: 1, res=101, ires=16)


@pytest.mark.parametrize("xml", [{"type": "lambertian"}, {"type": "cooktorrance"}], ids=lambda x: x["type"])
def test_diffuse(xml: dict[str, Any], tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    run(xml, 0.3, DIFFUSE, lambda wi: mi.chi2.SphericalDomain(), lambda wi, wo: 1, res=101, ires=8)


def test_the_domain() -> None:
    """Forward and backward are inverse, and the Jacobian integrates to the hemisphere's solid angle."""
    wi = mi.Vector3f(*directions.unit(0.7, 0.4).tolist())
    domain = AroundMirror(0.3, wi)
    t = (dr.arange(mi.Float, 1000) + 0.5) / 500 - 1
    p = mi.Point2f(*dr.meshgrid(t, t))
    wo = domain.map_forward(p)
    seen = wo.z > 0
    assert dr.all(~seen | (dr.max(dr.abs(domain.map_backward(wo) - p)) < 1e-3))
    total = dr.sum(domain.jacobian(wi, wo))[0] * (2 / 1000) ** 2
    assert total == pytest.approx(2 * math.pi, rel=3e-3)
