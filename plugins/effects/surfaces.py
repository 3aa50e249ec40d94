"""What a surface does with light: asked once for each, so that what it computes for one question serves the others."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from .lights import moved
from .state import Branch, Settings
from .undivided import Undivided


class Together:
    """The surfaces of all lanes under the interface of one, which has the lobes of all."""

    def __init__(self, lanes: Any, flags: int) -> None:
        self.lanes, self.all = lanes, flags

    def flags(self) -> int:
        return self.all

    def __getattr__(self, name: str) -> Any:
        return getattr(self.lanes, name)


def of_each(w: Settings, bsdf: Any, function: Any, *arguments: Any) -> Any:
    """Call ``function(bsdf, *arguments)`` for each surface; where derivatives are taken, for all of them as one.

    Forward derivatives through ``dr.dispatch`` raise where the scene has a single BSDF (Dr.Jit 1.5.0).
    """
    whole = w.contents.undivided

    def wrapped(bsdf: Any, here: Any) -> Any:
        return Undivided(bsdf, here, w.every, w.row.get("diffuse"), w.row["glossy"])

    if w.attached:
        if whole:
            bsdf = wrapped(bsdf, among(bsdf, whole))
        return function(Together(bsdf, w.contents.flags), *arguments)

    def call(bsdf: Any, *arguments: Any) -> Any:
        return function(wrapped(bsdf, True) if bsdf in whole else bsdf, *arguments)

    return dr.dispatch(bsdf, call if whole else function, *arguments)


def among(lanes: Any, some: tuple[Any, ...]) -> Any:
    """In which lanes the surface is one of these."""
    here = mi.Bool(False)
    for one in some:
        here |= lanes == mi.BSDFPtr(one)
    return here


def drawn(w: Settings, bsdf: Any, bs: Any, weight: Any) -> Any:
    """The weight of a sample of one direction, with the derivative of the chance at which it was drawn.

    A `blendbsdf` draws one of its two BSDFs, and tells the chance in ``bs.pdf`` alone. A `mask` has the derivative of
    its own in the weight already, so that it must not be taken again.
    """
    if not (w.attached and w.contents.blends):
        return weight
    lanes = bsdf.lanes.of if isinstance(bsdf.lanes, Undivided) else bsdf.lanes
    here = among(lanes, w.contents.blends) & (bs.pdf > 0)
    return dr.select(here, weight * dr.replace_grad(1, bs.pdf / dr.select(here, dr.detach(bs.pdf), 1)), weight)


def answers(
    w: Settings,
    bsdf: Any,
    si: Any,
    lamps: Any,
    asked: Any,
    branches: set[str],
    u: tuple[Any, ...],
    young: Any,
    fresh: Any,
    active: Any,
) -> Any:
    """All that one surface is asked: see `step`. `lamps` are pairs of direction and mask, with static kinds beside."""
    has = bsdf.flags()
    lit = []
    number, point = u or (0, 0)
    for columns, (wo, on) in zip(asked, lamps, strict=True):
        every, rows, pdf = mi.Spectrum(0), {}, mi.Float(0)
        if has & w.smooth:
            if columns == ("point",):
                every = bsdf.eval(w.every, si, wo, on)
            else:
                every, pdf = bsdf.eval_pdf(w.every, si, wo, on)
                if w.restricted and fresh is not False:
                    pdf = dr.select(young, bsdf.pdf(w.first, si, wo, on), pdf)
        if not w.together(columns) and fresh is not False:
            rows = in_rows(w, bsdf, si, wo, on)
        lit.append((every, rows, pdf))
    out: dict[str, Any] = {}
    if "spread" in branches:
        out["spread"] = (nowhere(), mi.Spectrum(1))
        if has & w.smooth:
            out["spread"] = scatter(w, bsdf, si, number, point, young, fresh, active)
    for name, kind, types in (
        ("mirrored", w.mirror, int(mi.BSDFFlags.DeltaReflection)),
        ("through", w.through, int(mi.BSDFFlags.DeltaTransmission | mi.BSDFFlags.Null)),
    ):
        if name in branches:
            out[name] = ideal(w, bsdf, si, kind, number, point, active) if has & types else nowhere()
    return lit, out


def in_rows(w: Settings, bsdf: Any, si: Any, wo: Any, on: Any) -> dict[str, Any]:
    """``f cos`` of the diffuse and of the glossy lobes."""
    has, out = bsdf.flags(), {}
    for row in w.contents.rows:
        if not has & w.types[row]:
            out[row] = mi.Spectrum(0)
        elif has & w.smooth & ~w.types[row]:
            out[row] = bsdf.eval(w.row[row], si, wo, on)
        else:
            out[row] = bsdf.eval(w.every, si, wo, on)
    return out


def scatter(
    w: Settings, bsdf: Any, si: Any, number: Any, point: Any, young: Any, fresh: Any, at: Any
) -> tuple[Branch, Any]:
    """A branch into the diffuse and glossy lobes, or past the surface where it lets light pass; its `share`."""
    if w.restricted and fresh is not False:
        bs, weight = bsdf.sample(w.first, si, number, point, at & young)
        if fresh is not True and w.switches.indirect:
            later, weight_later = bsdf.sample(w.every, si, number, point, at & ~young)
            bs, weight = dr.select(young, bs, later), dr.select(young, weight, weight_later)
    else:
        bs, weight = bsdf.sample(w.every, si, number, point, at)
    weight = dr.select(at & (bs.pdf > 0), weight, 0)
    null = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
    weight = dr.select(null, drawn(w, bsdf, bs, weight), weight)
    share = mi.Spectrum(1)
    if w.apart and not w.restricted and fresh is not False:
        share = part(in_rows(w, bsdf, si, bs.wo, at & ~null))
    return Branch(weight, mi.Vector3f(bs.wo), mi.Float(bs.pdf), dr.detach(bs.eta), null, mi.Spectrum(0)), share


def ideal(w: Settings, bsdf: Any, si: Any, kind: Any, number: Any, point: Any, at: Any) -> Branch:
    """The branch of a mirror, or of light that goes through, with its whole weight."""
    bs, weight = bsdf.sample(kind, si, number, point, at)
    right = at & (bs.pdf > 0) & mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)  # there are some that do not listen
    null = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
    if kind is w.mirror:
        right &= ~null
    else:  # what a surface with other lobes lets pass, `scatter` has
        flags = bsdf.lanes.flags() if isinstance(bsdf, Together) else bsdf.flags()
        right &= ~(null & mi.has_flag(flags, mi.BSDFFlags.Smooth))
    weight = dr.select(right, drawn(w, bsdf, bs, weight), 0)
    return Branch(weight, mi.Vector3f(bs.wo), mi.Float(0), dr.detach(bs.eta), null, mi.Spectrum(0))


def attach(w: Settings, spread: Branch, share: Any, bsdf: Any, si: Any, young: Any, fresh: Any, at: Any) -> Any:
    """Give the branch of `scatter` its derivative: density and the point that is met are held, the rest follows.

    Where nothing is met, the direction is held instead.
    """
    wo = dr.detach(spread.direction)
    spread.pdf = dr.detach(spread.pdf)
    world = dr.detach(si.to_world(wo))
    on = at & (spread.pdf > 0) & ~spread.null
    still = dr.detach(si)
    met = dr.detach(w.scene.ray_intersect(still.spawn_ray(world), mi.RayFlags.Minimal, coherent=False, active=on))
    hit = on & met.is_valid()
    to = dr.select(hit, met.p - si.p, world)
    world = dr.replace_grad(world, dr.normalize(to))

    def again(bsdf: Any, si: Any, wo: Any, young: Any, active: Any) -> Any:
        if not bsdf.flags() & w.smooth:
            return mi.Spectrum(0), mi.Spectrum(1)
        f = bsdf.eval(w.every, si, wo, active)
        if w.restricted and fresh is not False:
            f = dr.select(young, bsdf.eval(w.first, si, wo, active), f)
        if w.apart and not w.restricted and fresh is not False:
            return f, part(in_rows(w, bsdf, si, wo, active))
        return f, mi.Spectrum(1)

    f, share = of_each(w, bsdf, again, si, si.to_local(world), young, on)
    f = f / dr.select(on, spread.pdf, 1) * dr.select(hit, moved(to, met.n), 1)
    spread.weight = dr.select(on, f, spread.weight)
    spread.direction = dr.select(spread.null, si.to_world(spread.direction), world)
    return share


def nowhere() -> Branch:
    """A branch that does not exist."""
    return Branch(mi.Spectrum(0), mi.Vector3f(0, 0, 1), mi.Float(0), mi.Float(1), mi.Bool(False), mi.Spectrum(0))


def part(rows: dict[str, Any]) -> Any:
    """The part of what is reflected that the diffuse lobes reflect."""
    total = rows["diffuse"] + rows["glossy"]
    return dr.select(total > 0, rows["diffuse"] / dr.select(total > 0, total, 1), 0)
