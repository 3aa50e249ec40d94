"""cooktorrance against Mitsuba's own roughconductor: a bare evaluation, and a path-traced frame."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import pytest

import plugins
from tests.bench.timing import interleaved

DIRECTIONS = 1 << 22
#: Evaluations a round, so that a round is well above the resolution of the clock and of the scheduler.
REPEATS = 8
OURS = {"type": "cooktorrance", "m": 0.2}
METAL = {"type": "roughconductor", "distribution": "beckmann", "alpha": 0.2, "material": "Al"}
DIELECTRIC = {"type": "roughconductor", "distribution": "beckmann", "alpha": 0.2, "eta": 1.5, "k": 0.0}


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")
    plugins.register()


@pytest.mark.parametrize("masking", ["vcavity", "smith"])
@pytest.mark.parametrize("theirs", [METAL, DIELECTRIC], ids=["metal", "dielectric"])
def test_eval(benchmark: Any, theirs: dict[str, Any], masking: str) -> None:
    """4 M directions: with V-cavities at least as fast (for Smith's masking we evaluate erf, Mitsuba a rational fit)."""
    rng = mi.PCG32(DIRECTIONS)
    wi, wo = (mi.warp.square_to_cosine_hemisphere(mi.Point2f(rng.next_float32(), rng.next_float32())) for _ in range(2))
    si = dr.zeros(mi.SurfaceInteraction3f, DIRECTIONS)
    si.wi = wi
    dr.eval(si, wo)
    context = mi.BSDFContext()

    def run(bsdf: mi.BSDF) -> None:
        for _ in range(REPEATS):
            dr.eval(bsdf.eval(context, si, wo))
        dr.sync_thread()

    pair = [mi.load_dict(xml) for xml in ({**OURS, "masking": masking}, theirs)]
    ratio = interleaved(benchmark, lambda: run(pair[0]), lambda: run(pair[1]), rounds=15)
    if masking == "vcavity":
        assert ratio <= 1.0


def test_frame(benchmark: Any) -> None:
    """A path-traced frame, 256 x 256 with 64 samples: at most 1.1 times as long, both with one glossy lobe."""

    def scene(bsdf: dict[str, Any]) -> Any:
        to = mi.ScalarTransform4f
        return mi.load_dict({
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 4},
            "sky": {"type": "constant"},
            "lamp": {"type": "point", "position": [2, 3, 4], "intensity": 10.0},
            "ball": {"type": "sphere", "bsdf": bsdf},
            "floor": {
                "type": "rectangle",
                "to_world": to().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(5),
                "bsdf": bsdf,
            },
            "camera": {
                "type": "perspective",
                "to_world": to().look_at([0, 1, 5], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 256, "height": 256},
            },
        })  # fmt: skip

    def run(of: Any) -> None:
        dr.eval(mi.render(of, spp=64))
        dr.sync_thread()

    pair = [scene(xml) for xml in ({**OURS, "diffuse_reflectance": 0.0}, METAL)]
    assert interleaved(benchmark, lambda: run(pair[0]), lambda: run(pair[1]), rounds=9) <= 1.1
