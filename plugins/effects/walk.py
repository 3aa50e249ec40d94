"""Whole paths, and the tree of their mirror images: one loop, one surface a step."""

from __future__ import annotations

from typing import Any, ClassVar

import drjit as dr
import mitsuba as mi

from .collect import emission, reflect, sample_lamps
from .stack import Stack
from .state import EYE, IMAGE, INDIRECT, SCATTERED, Branch, Lamp, Settings, State, is_fresh
from .surfaces import answers, attach, nowhere, of_each

#: Branches that wait at once in a lane. Where no more fit, one branch is chosen at random, which is unbiased.
WAITING = 12
#: The same where derivatives are taken: there each is a set of variables.
WAITING_ATTACHED = 3
#: Surfaces a lane meets at most: a mistake ends as a wrong picture, not as a computer that hangs.
LONGEST = 1 << 14
#: The chance to go on, at most, under Russian roulette, as in Mitsuba.
SURVIVAL = 0.95


def run(w: Settings, sampler: Any, ray: Any, active: Any) -> State:
    """All paths of the rays from the eye."""
    names = w.names or ("",)
    ray, active = mi.Ray3f(ray), mi.Bool(active)
    if w.hide:
        ray = past_lamps(w, ray, active)
    s = State(
        ray=ray,
        hit=w.scene.ray_intersect_preliminary(dr.detach(ray), coherent=True, active=active),
        beta=mi.Spectrum(1),
        eta=mi.Float(1),
        depth=mi.UInt32(0),
        stage=mi.UInt32(EYE),
        pdf=mi.Float(0),
        share=mi.Spectrum(float(not w.restricted or w.switches.continued == ("diffuse",))),
        mirrored=mi.Bool(False),
        active=active,
        valid=mi.Bool(not w.hide and "environment" in w.contents.columns),
        count=mi.UInt32(0),
        light={name: mi.Spectrum(0) for name in names},
    )
    if w.max_depth == 0:
        return s
    if not w.contents.flags:  # no surface, or none that answers
        emission(w, s, s.hit.compute_surface_interaction(s.ray, mi.RayFlags.All, s.active), True)
        s.valid |= s.active & s.hit.is_valid()
        return s
    if w.switches.tree or w.contents.null:
        return loop(w, s, sampler, None)
    s = step(w, s, None, sampler, True)
    if w.switches.indirect:
        return loop(w, s, sampler, False)
    if w.switches.continued:
        emission(w, s, s.hit.compute_surface_interaction(s.ray, mi.RayFlags.All, s.active), False)
    return s


def loop(w: Settings, s: State, sampler: Any, fresh: Any) -> State:
    """Steps until all lanes are done; symbolic for a picture, evaluated one by one where derivatives are taken."""
    stack = None
    if w.switches.tree and w.max_depth != 1:
        most = WAITING_ATTACHED if w.attached else WAITING
        size = most if w.max_depth < 0 else min(most, w.max_depth - 1)
        zero = mi.Vector3f(0)
        blank = entry_class()(mi.Point3f(0), zero, mi.Spectrum(0), mi.Float(0), mi.UInt32(0))
        stack = Stack(blank, size, mi.UInt32, registers=w.attached)

    def body(s: State, sampler: Any, held: Any) -> tuple[State, Any, Any]:
        if stack is not None:
            stack.state = held
        s = step(w, s, stack, sampler, fresh)
        return s, sampler, stack.state if stack is not None else held

    held = stack.state if stack is not None else ()
    mode = "evaluated" if w.attached else None
    s, _, _ = dr.while_loop((s, sampler, held), lambda s, sampler, held: s.active, body, mode=mode, label="effects")
    return s


def past_lamps(w: Settings, ray: Any, active: Any) -> Any:
    """Rays that begin behind all area emitters that they would meet first."""

    def body(ray: Any, active: Any, count: Any) -> tuple[Any, Any, Any]:
        si = w.scene.ray_intersect(ray, mi.RayFlags.Minimal, coherent=True, active=active)
        active &= si.is_valid() & (si.shape.emitter() != None) & (count < LONGEST)  # noqa: E711  (by lane)
        return dr.select(active, si.spawn_ray(ray.d), ray), active, count + 1

    state = (mi.Ray3f(ray), mi.Bool(active), mi.UInt32(0))
    return dr.while_loop(state, lambda ray, active, count: active, body)[0]


def step(w: Settings, s: State, stack: Stack | None, sampler: Any, fresh: Any) -> State:
    """Collect light at the surface that was met, choose where to go on, and see what is met there.

    `fresh` tells whether it is the first that is not mirror or glass: True or False where all lanes are alike, else
    None.
    """
    contents, switches = w.contents, w.switches
    si = s.hit.compute_surface_interaction(s.ray, mi.RayFlags.All, s.active)
    emission(w, s, si, fresh)
    going = s.active & si.is_valid() & (s.count < LONGEST)
    if w.max_depth >= 0:
        going &= s.depth + 1 < w.max_depth
    bsdf = si.bsdf(s.ray)
    young = is_fresh(w, s, fresh)
    if not switches.indirect and fresh is not True:
        going &= young | mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)
    if w.rr_depth < w.max_depth or w.max_depth < 0:
        chance = dr.minimum(dr.detach(dr.max(mi.unpolarized_spectrum(s.beta)) * dr.square(s.eta)), SURVIVAL)
        old = going & (s.depth >= w.rr_depth)
        going &= ~old | (sampler.next_1d() < chance)
        s.beta = dr.select(old & going, s.beta / dr.select(chance > 0, chance, 1), s.beta)

    shown = mi.Bool(switches.indirect)
    if fresh is not False:
        first = mi.Bool(switches.eye)
        if switches.eye != switches.image and fresh is not True:
            first = (s.stage == EYE) == first
        shown = dr.select(young, first, shown)
    lamps: list[Lamp] = []
    if switches.shades:
        at = going & shown
        if not contents.smooth:
            at &= mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        lamps = sample_lamps(w, s, si, sampler, fresh, at)
    branches = set()
    if contents.rows and (switches.indirect or (switches.continued and fresh is not False) or contents.null):
        branches.add("spread")
    follows = (switches.tree and fresh is not False) or (switches.indirect and fresh is not True)
    if contents.reflects and follows:
        branches.add("mirrored")
    if (contents.transmits and follows) or contents.thin:
        branches.add("through")
    # one set of numbers for all branches: each is right by itself
    u = (sampler.next_1d(), sampler.next_2d()) if branches else ()

    kinds = [lamp.columns for lamp in lamps]

    def ask(bsdf: Any, si: Any, directions: Any, u: Any, young: Any, active: Any) -> Any:
        return answers(w, bsdf, si, directions, kinds, branches, u, young, fresh, active)

    lit, ways = of_each(w, bsdf, ask, si, [(lamp.wo, lamp.lit) for lamp in lamps], u, young, going)

    beta, share = called_indirect(w, s, fresh)
    at = State(**{**vars(s), "beta": beta, "share": share})
    for lamp, answer in zip(lamps, lit, strict=True):
        reflect(w, at, lamp, answer, fresh)

    spread = mirrored = through = None
    if "spread" in branches:
        spread, part_diffuse = ways["spread"]
        if w.attached:
            part_diffuse = attach(w, spread, part_diffuse, bsdf, si, young, fresh, going)
        else:
            spread.direction = si.to_world(spread.direction)
        goes_on = mi.Bool(bool(switches.continued)) if fresh is True else ~young | bool(switches.continued)
        spread.weight = dr.select(spread.null | (shown & goes_on), spread.weight, 0)
        if w.apart and not w.restricted and fresh is not False:
            share = dr.select(young, part_diffuse, share)
        share = dr.select(spread.null, s.share, share)
    allowed = dr.select(young, mi.Bool(switches.tree), mi.Bool(switches.indirect))
    if "mirrored" in branches:
        mirrored = ways["mirrored"]
        mirrored.weight = dr.select(allowed, mirrored.weight, 0)
        mirrored.direction = si.to_world(mirrored.direction)
    if "through" in branches:
        through = ways["through"]
        through.weight = dr.select(through.null | allowed, through.weight, 0)
        through.direction = si.to_world(through.direction)
    return go_on(w, s, stack, sampler, si, (spread, mirrored, through), beta, share, young)


def called_indirect(w: Settings, s: State, fresh: Any) -> tuple[Any, Any]:
    """Throughput and `share` at a surface where light becomes indirect: of the rows for which that is called for."""
    wanted = w.switches.wants("indirect")
    if not w.apart or w.restricted or fresh is True or len(wanted) == 2:
        return s.beta, s.share
    diffuse = wanted == ("diffuse",)
    part = s.share if diffuse else 1 - s.share
    now = s.stage == SCATTERED
    return dr.select(now, s.beta * part, s.beta), dr.select(now, mi.Spectrum(float(diffuse)), s.share)


def go_on(
    w: Settings, s: State, stack: Stack | None, sampler: Any, si: Any, branches: Any, beta: Any, share: Any, young: Any
) -> State:
    """Choose among the branches; where mirror images are followed in full, the other one waits on the stack."""
    for b in branches:
        if b is not None:
            b.beta = dr.select(b.null, s.beta, beta) * b.weight
    spread, mirrored, through = branches
    room = young & ~stack.full() if stack is not None else mi.Bool(False)
    nothing = mi.Bool(False)
    strong = strength(w, s, spread) if spread is not None else mi.Float(0)

    split, waiting, solid = nothing, None, nothing
    chosen = through if mirrored is None else mirrored
    strong_chosen = tree_strength(w, s, chosen, young) if chosen is not None else mi.Float(0)
    if mirrored is not None and through is not None:
        strong_mirrored, strong_through = strong_chosen, tree_strength(w, s, through, young)
        both = (strong_mirrored > 0) & (strong_through > 0)
        split = both & room & (strong <= 0) & (dr.minimum(strong_mirrored, strong_through) >= w.threshold)
        one = both & ~split
        chance = strong_mirrored / dr.select(one, strong_mirrored + strong_through, 1)
        left = dr.select(one, sampler.next_1d() < chance, ~split & (strong_through <= 0))
        chosen = dr.select(left, mirrored, through)
        strong_chosen = dr.select(left, strong_mirrored, strong_through)
        chosen.beta = chosen.beta / dr.select(one, dr.select(left, chance, 1 - chance), 1)
        waiting = mirrored
        if w.contents.thin:  # a pane followed both ways covers what is behind it by the part that it reflects
            covers = strong_mirrored / dr.select(split, strong_mirrored + strong_through, 1)
            solid = split & through.null & (sampler.next_1d() < covers)

    apart, spreads = nothing, strong > 0
    taken = spread if chosen is None else chosen
    if spread is not None and chosen is not None:
        pair = (strong > 0) & (strong_chosen > 0)
        apart = pair & room & (strong_chosen >= w.threshold)
        one = pair & ~apart
        chance = strong / dr.select(one, strong + strong_chosen, 1)
        spreads = dr.select(one, sampler.next_1d() < chance, spreads)
        taken = dr.select(spreads, spread, chosen)
        taken.beta = taken.beta / dr.select(one, dr.select(spreads, chance, 1 - chance), 1)
        waiting = chosen if waiting is None else dr.select(split, waiting, chosen)
    if taken is None:
        taken = nowhere()

    goes = dr.select(spreads, strong, strong_chosen) > 0
    if w.max_depth >= 0 and not w.contents.others:  # nothing shines on whoever hits it
        goes &= s.depth + 2 < w.max_depth
    out = State(**vars(s))
    out.ray = si.spawn_ray(taken.direction)
    out.beta = taken.beta
    out.eta = s.eta * taken.eta
    out.depth = s.depth + 1
    onward = dr.select(young, dr.select(spreads, mi.UInt32(SCATTERED), mi.UInt32(IMAGE)), mi.UInt32(INDIRECT))
    out.stage = dr.select(taken.null, s.stage, onward)
    out.pdf = dr.select(taken.null, 0, taken.pdf)
    out.share = share
    out.mirrored = s.mirrored | (s.stage == IMAGE)
    out.active = goes
    out.valid = s.valid | solid | ((s.stage == EYE) & s.active & si.is_valid() & ~(goes & taken.null))
    out.count = s.count + 1
    if stack is not None and waiting is not None:
        ray = si.spawn_ray(waiting.direction)
        code = (s.depth + 1) * 2 + dr.select(waiting.null, s.stage, mi.UInt32(IMAGE))
        stack.push(type(stack.blank)(ray.o, ray.d, waiting.beta, s.eta * waiting.eta, code), split | apart)
    if stack is not None:
        entry, popped = stack.pop(~goes)
        out.ray.o, out.ray.d = dr.select(popped, entry.o, out.ray.o), dr.select(popped, entry.d, out.ray.d)
        out.beta = dr.select(popped, entry.beta, out.beta)
        out.eta = dr.select(popped, entry.eta, out.eta)
        out.depth = dr.select(popped, entry.code >> 1, out.depth)
        out.stage = dr.select(popped, entry.code & 1, out.stage)
        out.pdf = dr.select(popped, 0, out.pdf)
        out.mirrored &= ~popped
        out.active |= popped
    trace(w, out, out.active, stack.state[0] > 0 if stack is not None else False)
    return out


def trace(w: Settings, s: State, at: Any, more: Any = False) -> None:
    """Find what the rays of the lanes `at` meet. Where that is nothing, and there is no sky, the path is over.

    But it stays where `more` branches wait.
    """
    hit = w.scene.ray_intersect_preliminary(dr.detach(s.ray), coherent=False, active=at)
    s.hit = dr.select(at, hit, s.hit)
    s.active = (s.active & ~at) | (at & (mi.Bool(w.sky) | hit.is_valid() | more))


def strength(w: Settings, s: State, branch: Branch) -> Any:
    """How much of the light at the eye comes along a branch, at most: without the compression of radiance."""
    return dr.detach(dr.max(mi.unpolarized_spectrum(branch.beta)) * dr.square(s.eta * branch.eta))


def tree_strength(w: Settings, s: State, branch: Branch, young: Any) -> Any:
    """The same of a branch of the tree; 0 if it is cut."""
    strong = strength(w, s, branch)
    return dr.select(young & (strong < w.threshold), 0, strong) if w.cut else strong


def entry_class() -> type:
    """A branch that waits, in the types of the variant now set."""

    class Entry:
        DRJIT_STRUCT: ClassVar = {
            "o": mi.Point3f, "d": mi.Vector3f, "beta": mi.Spectrum, "eta": mi.Float, "code": mi.UInt32
        }  # fmt: skip

        def __init__(self, o: Any = None, d: Any = None, beta: Any = None, eta: Any = None, code: Any = None) -> None:
            self.o, self.d, self.beta, self.eta, self.code = o, d, beta, eta, code

    return Entry
