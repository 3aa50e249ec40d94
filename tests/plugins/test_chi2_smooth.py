"""Of models with a smooth surface, the diffuse part: directions as the pdf says, weights with the albedo as their mean."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import drjit.llvm.ad as wide
import mitsuba as mi
import numpy as np
import pytest

import plugins
from brdf import builtin, defaults
from tests.oracles import directions
from tests.plugins.hits import array

#: Tests in this file: the level of each is chosen so that all pass with 99 % probability if all is right.
COUNT = 4
#: Component number of the diffuse lobe.
DIFFUSE = {"glazed": 1, "diffusion": 0}

settings = pytest.mark.parametrize(("name", "cos"), [(name, cos) for name in DIFFUSE for cos in (0.7, 0.05)])


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


def asked(name: str, cos: float) -> tuple[mi.BSDF, mi.BSDFContext, Any]:
    context = mi.BSDFContext()
    context.component = DIFFUSE[name]

    def interaction(n: int) -> mi.SurfaceInteraction3f:
        si = dr.zeros(mi.SurfaceInteraction3f, n)
        si.wi = mi.Vector3f(*directions.unit(cos, 0.4).tolist())
        return si

    return mi.load_dict({"type": name}), context, interaction


@settings
def test_directions(name: str, cos: float, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)  # a failing test leaves its tables in the working directory
    bsdf, context, interaction = asked(name, cos)

    def sample(u: mi.Vector3f) -> tuple[mi.Vector3f, mi.Float]:
        bs, weight = bsdf.sample(context, interaction(dr.width(u)), u.x, mi.Point2f(u.y, u.z))
        return bs.wo, dr.select(dr.any(weight != 0), 1.0, 0.0)

    def density(wo: mi.Vector3f) -> mi.Float:
        return bsdf.pdf(context, interaction(dr.width(wo)), wo)

    test = mi.chi2.ChiSquareTest(mi.chi2.SphericalDomain(), sample, density, sample_dim=3, res=101, ires=8)
    assert test.run(test_count=COUNT, quiet=True), test.messages


@settings
def test_mean_weight(name: str, cos: float) -> None:
    """Against the albedo by quadrature of the model in float64; 256^2 strata leave an error far below 1e-3."""
    bsdf, context, interaction = asked(name, cos)
    k = (np.arange(256) + 0.5) / 256
    u = mi.Point2f(np.array(np.meshgrid(k, k)).reshape(2, -1))
    _, weight = bsdf.sample(context, interaction(len(k) ** 2), mi.Float(0.5), u)

    model, vector = builtin()[name](), wide.Array3f64
    z = np.sqrt((np.arange(4000) + 0.5) / 4000)  # equal steps of cos^2
    wo = vector(np.sqrt(1 - z * z), 0 * z, z)
    f = array(model.f(defaults(model, vector), vector(*directions.unit(cos, 0.4).tolist()), wo)[DIFFUSE[name]])
    np.testing.assert_allclose(array(weight).mean(axis=1), np.pi * f.mean(axis=1), rtol=1e-3)
