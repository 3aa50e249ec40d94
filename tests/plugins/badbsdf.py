"""A BSDF written directly for Mitsuba, whose samples are not weighed by the cosine. Importing it registers it."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

ALBEDO = 0.5


class NoCosine(mi.BSDF):
    """Diffuse reflection from uniformly sampled directions."""

    def __init__(self, props: mi.Properties) -> None:
        mi.BSDF.__init__(self, props)
        self.m_flags = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
        self.m_components = [self.m_flags]

    def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = mi.warp.square_to_uniform_hemisphere(sample2)
        bs.pdf = mi.warp.square_to_uniform_hemisphere_pdf(bs.wo)
        bs.eta = 1
        bs.sampled_type = mi.UInt32(int(mi.BSDFFlags.DiffuseReflection))
        good = active & (si.wi.z > 0)
        return bs, mi.Spectrum(ALBEDO / dr.pi / bs.pdf) & good

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return mi.Spectrum(ALBEDO / dr.pi * wo.z) & (active & (si.wi.z > 0) & (wo.z > 0))

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        density = mi.warp.square_to_uniform_hemisphere_pdf(wo)
        return dr.select(active & (si.wi.z > 0) & (wo.z > 0), density, 0)

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def traverse(self, callback: Any) -> None:
        pass

    def to_string(self) -> str:
        return "NoCosine[]"


mi.register_bsdf("nocosine", NoCosine)
