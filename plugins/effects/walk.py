"""One step of a path, and of the tree of its mirror images: emission, light from lamps, where to go on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import drjit as dr
import mitsuba as mi

from .cells import Switches
from .contents import Contents
from .lights import Lights
from .stack import Stack
from .table import CELLS

#: Point lights up to here are all summed, at every surface; of more, one is chosen at random.
SUMMED = 64
#: Branches that wait at once in a lane. Where no more fit, one branch is chosen at random, which is unbiased.
WAITING = 12
#: The same where derivatives are taken: there each is a set of variables.
WAITING_ATTACHED = 3
#: Surfaces a lane meets at most: a mistake ends as a wrong picture, not as a computer that hangs.
LONGEST = 1 << 14
#: The chance to go on, at most, under Russian roulette, as in Mitsuba.
SURVIVAL = 0.95

#: What has happened to a path: nothing yet; ideal reflection or refraction alone; one scattering at a surface, the last
#: thing; more than that. Only what comes after the first scattering at a diffuse or glossy surface is indirect light.
EYE, IMAGE, SCATTERED, INDIRECT = range(4)  # the first two fit into a bit


@dataclass
class State:
    """A path under way."""

    ray: Any
    beta: Any
    """Throughput [radiance by radiance], with the factor by which refraction compresses radiance."""
    eta: Any
    """Index of refraction where the path is, over that at the eye: ``beta eta^2`` is without that factor."""
    depth: Any
    stage: Any
    pdf: Any
    """Of the direction, by solid angle; 0 for one of an ideal lobe."""
    share: Any
    """The part of `beta` from diffuse scattering at the first surface; where it need not be known, 1."""
    mirrored: Any
    """Whether that surface was seen in a mirror or through glass."""
    active: Any
    valid: Any
    count: Any
    light: Any
    """Sums: radiance under the name of each layer, or under ''."""


@dataclass
class Branch:
    """One way to go on from a surface."""

    weight: Any
    direction: Any
    """In the world."""
    pdf: Any
    eta: Any
    null: Any
    """Whether the surface is passed as if it were not there."""
    beta: Any = None


class Walk:
    """The steps of `effects` in one scene."""

    def __init__(
        self,
        scene: mi.Scene,
        contents: Contents,
        switches: Switches,
        lights: tuple[Lights, Lights],
        *,
        max_depth: int,
        rr_depth: int,
        threshold: float,
        cut: bool,
        layers: bool,
        hide: bool,
        attached: bool,
    ) -> None:
        self.scene, self.contents, self.switches = scene, contents, switches
        self.points, self.others = lights
        self.max_depth, self.rr_depth = max_depth, rr_depth
        self.threshold, self.cut = threshold, cut
        self.layers, self.hide, self.attached = layers, hide, attached
        flags = mi.BSDFFlags
        self.smooth = int(flags.Smooth)
        null = int(flags.Null) if contents.null else 0
        of_row = {"diffuse": int(flags.Diffuse), "glossy": int(flags.Glossy)}
        self.every = context(self.smooth | null)
        self.row = {row: context(of_row[row] | null) for row in contents.rows}
        going_on = switches.continued
        self.restricted = bool(going_on) and going_on != contents.rows
        self.first = self.row[going_on[0]] if self.restricted else self.every
        self.mirror = context(int(flags.DeltaReflection) | (null if contents.masks else 0))
        self.through = context(int(flags.DeltaTransmission) | null)
        self.entry = entry_class()
        columns = ("area", "environment", "indirect")
        #: Whether diffuse and glossy scattering must be told apart on the way.
        self.apart = len(contents.rows) == 2 and (
            layers or (not self.restricted and len({switches.wants(c) for c in columns if self.exists(c)}) > 1)
        )

    def exists(self, column: str) -> bool:
        return column in self.contents.columns or (column == "indirect" and bool(self.contents.columns))

    # -- what a path collects

    def add(self, s: State, cell: str, value: Any) -> None:
        name = cell if self.layers else ""
        s.light[name] = s.light[name] + value

    def add_indirect(self, s: State, value: Any) -> None:
        """Light at a surface after the first."""
        if not self.layers:
            return self.add(s, "", value)
        self.add(s, "mirror.indirect", dr.select(s.mirrored, value, 0))
        rest = dr.select(s.mirrored, 0, value)
        rows = self.contents.rows
        if len(rows) == 1:
            return self.add(s, f"{rows[0]}.indirect", rest)
        self.add(s, "diffuse.indirect", rest * s.share)
        return self.add(s, "glossy.indirect", rest * (1 - s.share))

    def add_shaded(self, s: State, row: str, column: str, value: Any) -> None:
        """Light from a lamp at the first surface that is neither mirror nor glass."""
        if not self.layers:
            return self.add(s, "", value)
        image = s.stage == IMAGE
        self.add(s, "mirror.indirect", dr.select(image, value, 0))
        return self.add(s, f"{row}.{column}", dr.select(image, 0, value))

    # -- emission

    def emission(self, s: State, si: Any, fresh: Any) -> None:
        """Add what the emitter sends that the ray has met."""
        if not self.contents.others:
            return
        emitter = si.emitter(self.scene, s.active)
        here = s.active & (emitter != None)  # noqa: E711
        if self.hide:
            here &= (s.depth > 0) | si.is_valid()
        value = s.beta * emitter.eval(si, here)
        if fresh is not True:
            sampled = here & (s.pdf > 0)
            with dr.suspend_grad():
                reference = dr.zeros(mi.Interaction3f)
                reference.p = s.ray.o
                ds = mi.DirectionSample3f(self.scene, si, reference)
                other = self.others.pdf(reference, ds, sampled)
                weight = dr.select(sampled, mis(s.pdf, other), 1)
            value = value * weight
        value = dr.select(here, value, 0)
        area = si.is_valid()
        for column, met in (("area", area), ("environment", ~area)):
            if column in self.contents.columns:
                this = value if len(self.contents.columns - {"point"}) == 1 else dr.select(met, value, 0)
                self.emitted(s, column, this, fresh)

    def emitted(self, s: State, column: str, value: Any, fresh: Any) -> None:
        """Sort emission by what happened to the path before."""
        switches, total = self.switches, mi.Spectrum(0)
        for stage, cell in ((EYE, "emitter"), (IMAGE, f"mirror.{column}")):
            if cell in switches.cells and fresh is not False:
                part = dr.select(s.stage == stage, value, 0)
                if self.layers:
                    self.add(s, cell, part)
                total += part
        if fresh is not True:
            last = dr.select(s.stage == SCATTERED, value, 0)
            wanted = switches.wants(column)
            if not self.apart:
                if wanted:
                    total += last
                    if self.layers:
                        self.seen_from_surface(s, wanted[0], column, last)
            else:
                for row in wanted:
                    part = last * (s.share if row == "diffuse" else 1 - s.share)
                    total += part
                    if self.layers:
                        self.seen_from_surface(s, row, column, part)
            if switches.indirect:
                part = dr.select(s.stage == INDIRECT, value, 0)
                if self.layers:
                    self.add_indirect(s, part)
                total += part
        if not self.layers:
            self.add(s, "", total)

    def seen_from_surface(self, s: State, row: str, column: str, value: Any) -> None:
        self.add(s, "mirror.indirect", dr.select(s.mirrored, value, 0))
        self.add(s, f"{row}.{column}", dr.select(s.mirrored, 0, value))

    # -- light from lamps

    def direct(self, s: State, si: Any, bsdf: Any, sampler: Any, fresh: Any, at: Any) -> None:
        """Add light that comes straight from lamps to the surfaces `at`."""
        switches = self.switches
        later = switches.indirect and fresh is not True
        none = mi.Point2f(0)
        if "point" in self.contents.columns and (later or (switches.wants("point") and fresh is not False)):
            lamps = self.points.emitters
            for lamp in lamps if len(lamps) <= SUMMED else (None,):
                if lamp is None:
                    ds, weight, _ = self.points.sample(si, sampler.next_1d(), none, at)
                else:
                    ds, weight = lamp.sample_direction(si, none, at)
                lit = at & (ds.pdf != 0) & dr.any(weight != 0)
                lit &= ~self.scene.ray_test(dr.detach(si.spawn_ray_to(ds.p)), lit)
                self.reflect(s, si, bsdf, ds, weight, fresh, lit, ("point",))
        columns = tuple(c for c in ("area", "environment") if c in self.contents.columns)
        if columns and (later or (fresh is not False and any(switches.wants(c) for c in columns))):
            still = dr.detach(si)
            with dr.suspend_grad():
                number = sampler.next_1d() if len(self.others.emitters) > 1 else 0
                ds, weight, emitter = self.others.sample(still, number, sampler.next_2d(), at)
                lit = at & (ds.pdf > 0) & dr.any(weight != 0)
                lit &= ~self.scene.ray_test(still.spawn_ray_to(ds.p), lit)
            if self.attached:
                infinite = mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite)
                to = ds.p - si.p
                ds.d = dr.replace_grad(ds.d, dr.select(infinite, ds.d, dr.normalize(to)))
                again = emitter.eval_direction(si, ds, lit) / dr.select(ds.pdf > 0, ds.pdf, 1)
                weight = again * dr.select(infinite | ~lit, 1, moved(si.p, ds.p, ds.n))
            self.reflect(s, si, bsdf, ds, weight, fresh, lit, columns)

    def reflect(
        self, s: State, si: Any, bsdf: Any, ds: Any, weight: Any, fresh: Any, lit: Any, columns: tuple[str, ...]
    ) -> None:
        """Add the light of one lamp, of which `columns` are the kinds that it can be."""
        switches, rows = self.switches, self.contents.rows
        wo = si.to_local(ds.d)
        sampled = columns != ("point",)
        incoming = s.beta * weight
        young = self.is_fresh(s, fresh)
        #: Whether one value of the reflectance does for the first surface and for those after it.
        together = not self.layers and all(switches.wants(c) == rows for c in columns)
        if together or (switches.indirect and fresh is not True):
            on = lit if together or fresh is False else lit & ~young
            if sampled:
                f, pdf = bsdf.eval_pdf(self.every, si, wo, on)
                if self.restricted and fresh is not False:
                    pdf = dr.select(young, bsdf.pdf(self.first, si, wo, on & young), pdf)
                f = f * dr.detach(mis(ds.pdf, pdf))
            else:
                f = bsdf.eval(self.every, si, wo, on)
            self.add_indirect(s, dr.select(on, incoming * f, 0))
        if together or fresh is False:
            return
        on = lit & young
        if sampled:
            incoming = incoming * dr.detach(mis(ds.pdf, bsdf.pdf(self.first, si, wo, on)))
        for row in rows:
            asked = tuple(c for c in columns if row in switches.wants(c))
            if not asked:
                continue
            value = dr.select(on, incoming * bsdf.eval(self.row[row], si, wo, on), 0)
            for column in asked:
                mine = value
                if len(columns) > 1:
                    infinite = mi.has_flag(ds.emitter.flags(), mi.EmitterFlags.Infinite)
                    mine = dr.select(infinite == mi.Bool(column == "environment"), value, 0)
                self.add_shaded(s, row, column, mine)

    # -- where to go on

    def is_fresh(self, s: State, fresh: Any) -> Any:
        return mi.Bool(fresh) if isinstance(fresh, bool) else s.stage <= IMAGE

    def scatter(self, s: State, si: Any, bsdf: Any, sampler: Any, fresh: Any, at: Any) -> tuple[Branch, Any]:
        """A branch into the diffuse and glossy lobes, and past the surface where it lets light pass; its `share`."""
        number, point = sampler.next_1d(), sampler.next_2d()
        young = self.is_fresh(s, fresh)
        if self.restricted and fresh is not False:
            bs, weight = bsdf.sample(self.first, si, number, point, at & young)
            if fresh is not True and self.switches.indirect:
                later, weight_later = bsdf.sample(self.every, si, number, point, at & ~young)
                bs, weight = dr.select(young, bs, later), dr.select(young, weight, weight_later)
        else:
            bs, weight = bsdf.sample(self.every, si, number, point, at)
        weight = dr.select(at & (bs.pdf > 0), weight, 0)
        direction = si.to_world(bs.wo)
        null = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
        if self.attached:
            bs.wo, bs.pdf, direction = dr.detach(bs.wo), dr.detach(bs.pdf), dr.detach(direction)
            on = at & (bs.pdf > 0) & ~null
            met = self.scene.ray_intersect(
                dr.detach(si).spawn_ray(direction), mi.RayFlags.Minimal, coherent=False, active=on
            )
            met = dr.detach(met)
            hit = on & met.is_valid()
            direction = dr.replace_grad(direction, dr.select(hit, dr.normalize(met.p - si.p), direction))
            wo = si.to_local(direction)
            f = bsdf.eval(self.every, si, wo, on)
            if self.restricted and fresh is not False:
                f = dr.select(young, bsdf.eval(self.first, si, wo, on & young), f)
            f = f / dr.select(bs.pdf > 0, bs.pdf, 1)
            weight = dr.select(on, f * dr.select(hit, moved(si.p, met.p, met.n), 1), weight)
        share = s.share
        if self.apart and not self.restricted and fresh is not False:
            first = at & young & ~null
            wo = si.to_local(direction)
            diffuse = bsdf.eval(self.row["diffuse"], si, wo, first)
            both = diffuse + bsdf.eval(self.row["glossy"], si, wo, first)
            share = dr.select(first, dr.select(both > 0, diffuse / dr.select(both > 0, both, 1), 0), share)
        return Branch(weight, direction, bs.pdf, bs.eta, null), share

    def ideal(self, si: Any, bsdf: Any, kind: Any, sampler: Any, at: Any) -> Branch:
        """The branch of a mirror, or of light that goes through, with its whole weight."""
        number, point = sampler.next_1d(), sampler.next_2d()
        bs, weight = bsdf.sample(kind, si, number, point, at)
        right = at & (bs.pdf > 0)
        null = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
        if kind is self.mirror:
            right &= ~null
        else:  # what a surface with other lobes lets pass, `scatter` has
            right &= ~(null & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth))
        return Branch(dr.select(right, weight, 0), si.to_world(bs.wo), mi.Float(0), dr.detach(bs.eta), null)

    # -- whole paths

    def run(self, sampler: Any, ray: Any, active: Any) -> State:
        """All paths of the rays from the eye."""
        names = CELLS if self.layers else ("",)
        s = State(
            ray=mi.Ray3f(ray),
            beta=mi.Spectrum(1),
            eta=mi.Float(1),
            depth=mi.UInt32(0),
            stage=mi.UInt32(EYE),
            pdf=mi.Float(0),
            share=mi.Spectrum(float(not self.restricted or self.switches.continued == ("diffuse",))),
            mirrored=mi.Bool(False),
            active=mi.Bool(active),
            valid=mi.Bool(not self.hide and "environment" in self.contents.columns),
            count=mi.UInt32(0),
            light={name: mi.Spectrum(0) for name in names},
        )
        if self.max_depth == 0:
            return s
        if self.hide:
            s.ray = self.past_lamps(s.ray, s.active)
        if self.switches.tree or self.contents.null:
            return self.loop(s, sampler, None)
        s = self.step(s, None, sampler, True)
        if self.switches.indirect:
            return self.loop(s, sampler, False)
        if self.switches.continued:
            self.emission(s, self.scene.ray_intersect(s.ray, mi.RayFlags.All, coherent=False, active=s.active), False)
        return s

    def loop(self, s: State, sampler: Any, fresh: Any) -> State:
        stack = None
        if self.switches.tree and self.max_depth != 1:
            most = WAITING_ATTACHED if self.attached else WAITING
            size = most if self.max_depth < 0 else min(most, self.max_depth - 1)
            zero = mi.Vector3f(0)
            blank = self.entry(mi.Point3f(0), zero, mi.Spectrum(0), mi.Float(0), mi.UInt32(0))
            stack = Stack(blank, size, mi.UInt32, registers=self.attached)

        def body(s: State, sampler: Any, held: Any) -> tuple[State, Any, Any]:
            if stack is not None:
                stack.state = held
            s = self.step(s, stack, sampler, fresh)
            return s, sampler, stack.state if stack is not None else held

        held = stack.state if stack is not None else ()
        mode = "evaluated" if self.attached else None
        s, _, _ = dr.while_loop((s, sampler, held), lambda s, sampler, held: s.active, body, mode=mode, label="effects")
        return s

    def past_lamps(self, ray: Any, active: Any) -> Any:
        """Rays that begin behind all area emitters that they would meet first."""

        def body(ray: Any, active: Any, count: Any) -> tuple[Any, Any, Any]:
            si = self.scene.ray_intersect(ray, mi.RayFlags.Minimal, coherent=True, active=active)
            active &= si.is_valid() & (si.shape.emitter() != None) & (count < LONGEST)  # noqa: E711
            return dr.select(active, si.spawn_ray(ray.d), ray), active, count + 1

        state = (mi.Ray3f(ray), mi.Bool(active), mi.UInt32(0))
        return dr.while_loop(state, lambda ray, active, count: active, body)[0]

    def nowhere(self) -> Branch:
        return Branch(mi.Spectrum(0), mi.Vector3f(0, 0, 1), mi.Float(0), mi.Float(1), mi.Bool(False))

    def step(self, s: State, stack: Stack | None, sampler: Any, fresh: Any) -> State:
        """Go to the next surface, collect light there, and choose where to go on.

        `fresh` tells whether it is the first that is not mirror or glass: True or False where all lanes are alike, else
        None.
        """
        contents, switches = self.contents, self.switches
        si = self.scene.ray_intersect(s.ray, mi.RayFlags.All, coherent=fresh is True, active=s.active)
        self.emission(s, si, fresh)
        going = s.active & si.is_valid() & (s.count < LONGEST)
        if self.max_depth >= 0:
            going &= s.depth + 1 < self.max_depth
        bsdf = si.bsdf(s.ray)
        flags = bsdf.flags()
        young = self.is_fresh(s, fresh)
        if not switches.indirect and fresh is not True:
            going &= young | mi.has_flag(flags, mi.BSDFFlags.Null)
        if self.rr_depth < self.max_depth or self.max_depth < 0:
            chance = dr.minimum(self.strength(s, s.beta), SURVIVAL)
            old = going & (s.depth >= self.rr_depth)
            going &= ~old | (sampler.next_1d() < chance)
            s.beta = dr.select(old & going, s.beta / dr.select(chance > 0, chance, 1), s.beta)

        smooth = going if contents.smooth else going & mi.has_flag(flags, mi.BSDFFlags.Smooth)
        shown = mi.Bool(switches.indirect)
        if fresh is not False:
            first = mi.Bool(switches.eye)
            if switches.eye != switches.image and fresh is not True:
                first = (s.stage == EYE) == first
            shown = dr.select(young, first, shown)
        beta, share = self.called_indirect(s, fresh)
        if switches.shades:
            at = State(**{**vars(s), "beta": beta, "share": share})
            self.direct(at, si, bsdf, sampler, fresh, smooth & shown)

        spread, mirrored, through = self.nowhere(), self.nowhere(), self.nowhere()
        if contents.rows and (switches.indirect or (switches.continued and fresh is not False) or contents.null):
            goes_on = mi.Bool(bool(switches.continued)) if fresh is True else ~young | bool(switches.continued)
            spread, part = self.scatter(s, si, bsdf, sampler, fresh, smooth)
            spread.weight = dr.select(spread.null | (shown & goes_on), spread.weight, 0)
            share = dr.select(spread.null, s.share, part if fresh is True else dr.select(young, part, share))
        follows = (switches.tree and fresh is not False) or (switches.indirect and fresh is not True)
        ideal = going & mi.has_flag(flags, mi.BSDFFlags.Delta)
        allowed = dr.select(young, mi.Bool(switches.tree), mi.Bool(switches.indirect))
        if contents.reflects and follows:
            mirrored = self.ideal(si, bsdf, self.mirror, sampler, ideal & allowed)
        if (contents.transmits and follows) or contents.thin:
            through = self.ideal(si, bsdf, self.through, sampler, ideal)
            through.weight = dr.select(through.null | allowed, through.weight, 0)
        return self.go_on(s, stack, sampler, si, (spread, mirrored, through), beta, share, young)

    def called_indirect(self, s: State, fresh: Any) -> tuple[Any, Any]:
        """Throughput and `share` at a surface where light becomes indirect: of the rows for which that is called for."""
        wanted = self.switches.wants("indirect")
        if not self.apart or self.restricted or fresh is True or len(wanted) == 2:
            return s.beta, s.share
        diffuse = wanted == ("diffuse",)
        part = s.share if diffuse else 1 - s.share
        now = s.stage == SCATTERED
        return dr.select(now, s.beta * part, s.beta), dr.select(now, mi.Spectrum(float(diffuse)), s.share)

    def go_on(
        self, s: State, stack: Stack | None, sampler: Any, si: Any, branches: Any, beta: Any, share: Any, young: Any
    ) -> State:
        """Choose among the branches; where mirror images are followed in full, the other one waits on the stack."""
        spread, mirrored, through = branches
        for b in branches:
            b.beta = dr.select(b.null, s.beta, beta) * b.weight
        strong, strong_mirrored, strong_through = (self.strength(s, b.beta, b.eta) for b in branches)
        if self.cut:
            strong_mirrored, strong_through = (
                dr.select(young & (x < self.threshold), 0, x) for x in (strong_mirrored, strong_through)
            )
        room = young & ~stack.full() if stack is not None else mi.Bool(False)

        both = (strong_mirrored > 0) & (strong_through > 0)
        split = both & room & (strong <= 0) & (dr.minimum(strong_mirrored, strong_through) >= self.threshold)
        chance = strong_mirrored / dr.select(both, strong_mirrored + strong_through, 1)
        left = dr.select(both & ~split, sampler.next_1d() < chance, strong_through <= 0)
        chosen = dr.select(left, mirrored, through)
        strong_chosen = dr.select(left, strong_mirrored, strong_through)
        scale = dr.select(both & ~split, dr.select(left, chance, 1 - chance), 1)
        chosen.beta /= dr.select(scale > 0, scale, 1)

        pair = (strong > 0) & (strong_chosen > 0)
        apart = pair & room & (strong_chosen >= self.threshold)
        chance = strong / dr.select(pair, strong + strong_chosen, 1)
        spreads = dr.select(pair & ~apart, sampler.next_1d() < chance, strong > 0)
        scale = dr.select(pair & ~apart, dr.select(spreads, chance, 1 - chance), 1)
        waiting = dr.select(split, mirrored, chosen)
        taken = dr.select(spreads, spread, chosen)
        taken.beta /= dr.select(scale > 0, scale, 1)

        goes = dr.select(spreads, strong, strong_chosen) > 0
        out = State(**vars(s))
        out.ray = si.spawn_ray(taken.direction)
        out.beta = taken.beta
        out.eta = s.eta * taken.eta
        out.depth = s.depth + 1
        onward = dr.select(young, dr.select(spreads, mi.UInt32(SCATTERED), mi.UInt32(IMAGE)), mi.UInt32(INDIRECT))
        out.stage = dr.select(taken.null, s.stage, onward)
        out.pdf = dr.select(spreads & ~taken.null, spread.pdf, 0)
        out.share = share
        out.mirrored = s.mirrored | (s.stage == IMAGE)
        out.active = goes
        out.valid = s.valid | (s.active & si.is_valid() & ~(goes & taken.null))
        out.count = s.count + 1
        if stack is not None:
            ray = si.spawn_ray(waiting.direction)
            code = (s.depth + 1) * 2 + dr.select(waiting.null, s.stage, mi.UInt32(IMAGE))
            stack.push(self.entry(ray.o, ray.d, waiting.beta, s.eta * waiting.eta, code), split | apart)
            entry, popped = stack.pop(~goes)
            out.ray.o, out.ray.d = dr.select(popped, entry.o, out.ray.o), dr.select(popped, entry.d, out.ray.d)
            out.beta = dr.select(popped, entry.beta, out.beta)
            out.eta = dr.select(popped, entry.eta, out.eta)
            out.depth = dr.select(popped, entry.code >> 1, out.depth)
            out.stage = dr.select(popped, entry.code & 1, out.stage)
            out.pdf = dr.select(popped, 0, out.pdf)
            out.mirrored &= ~popped
            out.active |= popped
        return out

    def strength(self, s: State, beta: Any, eta: Any = 1.0) -> Any:
        """How much of the light at the eye comes along a branch, at most: without the compression of radiance."""
        return dr.detach(dr.max(mi.unpolarized_spectrum(beta)) * dr.square(s.eta * eta))


def entry_class() -> type:
    """A branch that waits, in the types of the variant now set."""

    class Entry:
        DRJIT_STRUCT: ClassVar = {
            "o": mi.Point3f, "d": mi.Vector3f, "beta": mi.Spectrum, "eta": mi.Float, "code": mi.UInt32
        }  # fmt: skip

        def __init__(self, o: Any = None, d: Any = None, beta: Any = None, eta: Any = None, code: Any = None) -> None:
            self.o, self.d, self.beta, self.eta, self.code = o, d, beta, eta, code

    return Entry


def context(types: int) -> Any:
    out = mi.BSDFContext()
    out.type_mask = types
    return out


def mis(mine: Any, other: Any) -> Any:
    """The power heuristic: the weight of a sample of density `mine` that another technique also takes."""
    weight = dr.square(mine) / (dr.square(mine) + dr.square(other))
    return dr.select(mine > 0, dr.select(dr.isfinite(weight), weight, 1), 0)


def moved(p: Any, fixed: Any, n: Any) -> Any:
    """The solid angle of a fixed piece of surface, seen from `p`, over what it is now: 1, with its derivative."""
    to = fixed - p
    distance2 = dr.squared_norm(to)
    solid = dr.abs(dr.dot(to, n)) / (distance2 * dr.sqrt(distance2))
    now = dr.detach(solid)
    return dr.select(now > 0, solid / dr.select(now > 0, now, 1), 1)
