"""BSDFs that answer with all their lobes, whichever are asked for: none of them counts as diffuse, all as glossy."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from .convex import nested

#: Those of Mitsuba 3.9.1, told by name as well, since one that is black now may be given a colour later.
KNOWN = ("Principled", "PrincipledThin")
#: Pairs of directions that a BSDF is asked about.
PAIRS = 64
#: Of the largest value: far above the rounding of a sum in float32, far below a lobe that counts twice.
TOLERANCE = 1e-3


def undivided(bsdf: Any) -> bool:
    """Whether a BSDF with diffuse and glossy lobes does not tell them apart: their sum is not the whole.

    What is inside it is asked as well: a texture may show it elsewhere than here. Also true of one that cannot be
    asked without a shape: the picture is right either way.
    """
    has, flags = int(bsdf.flags()), mi.BSDFFlags
    if not (has & int(flags.Diffuse) and has & int(flags.Glossy)):
        return False
    return any(b.class_name() in KNOWN or not adds_up(b) for b in nested(bsdf))


def adds_up(bsdf: Any) -> bool:
    """Whether the values by diffuse and by glossy lobes sum to that by both."""
    rng = np.random.default_rng(0)
    wi, wo = (v / np.linalg.norm(v, axis=0) for v in rng.normal(size=(2, 3, PAIRS)))
    si = dr.zeros(mi.SurfaceInteraction3f, PAIRS)
    si.t, si.wi, si.n = mi.Float(1), mi.Vector3f(wi), mi.Normal3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(si.n)
    si.dp_du, si.dp_dv, si.uv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0), mi.Point2f(rng.random((2, PAIRS)))
    if mi.is_spectral:
        si.wavelengths = dr.full(type(si.wavelengths), 550, PAIRS)  # visible light

    def f(types: Any) -> Any:
        ctx = mi.BSDFContext()
        ctx.type_mask = int(types)
        return np.array(bsdf.eval(ctx, si, mi.Vector3f(wo)), dtype=np.float64)

    flags = mi.BSDFFlags
    try:
        whole, parts = f(flags.Smooth), f(flags.Diffuse) + f(flags.Glossy)
    except (
        RuntimeError,
        NotImplementedError,
    ):
        # It asks for more than a point, as vertices of a mesh: as a whole it is right, if in one row.
        return False
    return bool(np.abs(parts - whole).max() <= TOLERANCE * np.abs(whole).max())


class Undivided:
    """Such a surface, or lanes of which some are, under the interface of one that tells its lobes apart.

    Parameters
    ----------
    of : mi.BSDF or mi.BSDFPtr
    here : True or mask
        Where it is one.
    every, diffuse, glossy : mi.BSDFContext
        How all smooth lobes are asked for, and each row. Any other question is passed on.
    """

    def __init__(self, of: Any, here: Any, every: Any, diffuse: Any, glossy: Any) -> None:
        self.of, self.here, self.every, self.diffuse, self.glossy = of, here, every, diffuse, glossy

    def __getattr__(self, name: str) -> Any:
        return getattr(self.of, name)

    def flags(self) -> Any:
        flags = self.of.flags()
        return flags & ~int(mi.BSDFFlags.Diffuse) if self.here is True else flags

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any) -> Any:
        return self.whole(ctx, lambda ctx: self.of.eval(ctx, si, wo, active))

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any) -> Any:
        return self.whole(ctx, lambda ctx: self.of.pdf(ctx, si, wo, active))

    def whole(self, ctx: Any, ask: Any) -> Any:
        """The answer to a question: where it is for the glossy lobes all, for the diffuse ones 0."""
        if ctx is not self.diffuse and ctx is not self.glossy:
            return ask(ctx)
        every = ask(self.every)
        value = every if ctx is self.glossy else dr.zeros(type(every))
        return value if self.here is True else dr.select(self.here, value, ask(ctx))

    def sample(self, ctx: Any, si: Any, number: Any, point: Any, active: Any) -> Any:
        if ctx is not self.diffuse and ctx is not self.glossy:
            return self.of.sample(ctx, si, number, point, active)
        bs, weight = self.of.sample(self.every, si, number, point, active)
        if ctx is self.diffuse:  # but what lets light pass still does
            weight = dr.select(mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null), weight, 0)
        if self.here is True:
            return bs, weight
        other, weight_other = self.of.sample(ctx, si, number, point, active)
        return dr.select(self.here, bs, other), dr.select(self.here, weight, weight_other)
