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
    hit: Any
    """What the ray meets first."""
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
    beta: Any
    """Throughput along it."""


@dataclass
class Lamp:
    """A direction to a lamp, and what comes from there if it is reflected."""

    ds: Any
    weight: Any
    lit: Any
    wo: Any
    """In the local frame."""
    columns: tuple[str, ...]
    """The kinds that the lamp can be of."""


class Together:
    """The surfaces of all lanes under the interface of one, which has the lobes of all."""

    def __init__(self, lanes: Any, flags: int) -> None:
        self.lanes, self.all = lanes, flags

    def flags(self) -> int:
        return self.all

    def __getattr__(self, name: str) -> Any:
        return getattr(self.lanes, name)


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
        self.types = of_row
        self.row = {row: context(of_row[row] | null) for row in contents.rows}
        going_on = switches.continued
        self.restricted = bool(going_on) and going_on != contents.rows
        self.first = self.row[going_on[0]] if self.restricted else self.every
        self.mirror = context(int(flags.DeltaReflection) | (null if contents.masks else 0))
        self.through = context(int(flags.DeltaTransmission) | null)
        self.entry = entry_class()
        self.sky = "environment" in contents.columns
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
        if fresh is not True and self.others.emitters:
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

    def lamps(self, s: State, si: Any, sampler: Any, fresh: Any, at: Any) -> list[Lamp]:
        """Directions to lamps from the surfaces `at`, and what would come from there."""
        switches, out = self.switches, []
        later = switches.indirect and fresh is not True
        none = mi.Point2f(0)
        if "point" in self.contents.columns and (later or (switches.wants("point") and fresh is not False)):
            emitters = self.points.emitters
            for emitter in emitters if len(emitters) <= SUMMED else (None,):
                if emitter is None:
                    ds, weight, _ = self.points.sample(si, sampler.next_1d(), none, at)
                else:
                    ds, weight = emitter.sample_direction(si, none, at)
                lit = at & (ds.pdf != 0) & dr.any(weight != 0)
                lit &= ~self.scene.ray_test(dr.detach(si.spawn_ray_to(ds.p)), lit)
                out.append(Lamp(ds, weight, lit, si.to_local(ds.d), ("point",)))
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
            out.append(Lamp(ds, weight, lit, si.to_local(ds.d), columns))
        return out

    def reflect(self, s: State, lamp: Lamp, answer: Any, fresh: Any) -> None:
        """Add the light of one lamp."""
        switches, columns = self.switches, lamp.columns
        every, rows, pdf = answer
        incoming = s.beta * lamp.weight
        if columns != ("point",):
            incoming *= dr.detach(mis(lamp.ds.pdf, pdf))
        young = self.is_fresh(s, fresh)
        together = self.together(columns)
        if together or (switches.indirect and fresh is not True):
            on = lamp.lit if together or fresh is False else lamp.lit & ~young
            self.add_indirect(s, dr.select(on, incoming * every, 0))
        if together or fresh is False:
            return
        for row, f in rows.items():
            value = dr.select(lamp.lit & young, incoming * f, 0)
            for column in columns:
                if row not in switches.wants(column):
                    continue
                mine = value
                if len(columns) > 1:
                    infinite = mi.has_flag(lamp.ds.emitter.flags(), mi.EmitterFlags.Infinite)
                    mine = dr.select(infinite == mi.Bool(column == "environment"), value, 0)
                self.add_shaded(s, row, column, mine)

    def together(self, columns: tuple[str, ...]) -> bool:
        """Whether one value of the reflectance does for the first surface and for those after it."""
        return not self.layers and all(self.switches.wants(c) == self.contents.rows for c in columns)

    # -- what a surface does; asked once for each, so that what it computes for one question serves the others

    def of_each(self, bsdf: Any, function: Any, *arguments: Any) -> Any:
        """Call ``function(bsdf, *arguments)`` for each surface; where derivatives are taken, for all of them as one.

        Forward derivatives through ``dr.dispatch`` raise where the scene has a single BSDF (Dr.Jit 1.5.0).
        """
        if self.attached:
            return function(Together(bsdf, self.contents.flags), *arguments)
        return dr.dispatch(bsdf, function, *arguments)

    def in_rows(self, bsdf: Any, si: Any, wo: Any, on: Any) -> dict[str, Any]:
        """``f cos`` of the diffuse and of the glossy lobes."""
        has, out = bsdf.flags(), {}
        for row in self.contents.rows:
            if not has & self.types[row]:
                out[row] = mi.Spectrum(0)
            elif has & self.smooth & ~self.types[row]:
                out[row] = bsdf.eval(self.row[row], si, wo, on)
            else:
                out[row] = bsdf.eval(self.every, si, wo, on)
        return out

    def answers(
        self, bsdf: Any, si: Any, lamps: Any, branches: set[str], u: Any, young: Any, fresh: Any, active: Any
    ) -> Any:
        """All that one surface is asked: see `step`. `lamps` are pairs of direction and mask, with static kinds beside."""
        has = bsdf.flags()
        lit = []
        for columns, (wo, on) in zip(self.asked, lamps, strict=True):
            every, rows, pdf = mi.Spectrum(0), {}, mi.Float(0)
            if has & self.smooth:
                if columns == ("point",):
                    every = bsdf.eval(self.every, si, wo, on)
                else:
                    every, pdf = bsdf.eval_pdf(self.every, si, wo, on)
                    if self.restricted and fresh is not False:
                        pdf = dr.select(young, bsdf.pdf(self.first, si, wo, on), pdf)
            if not self.together(columns) and fresh is not False:
                rows = self.in_rows(bsdf, si, wo, on)
            lit.append((every, rows, pdf))
        out: dict[str, Any] = {}
        if "spread" in branches:
            out["spread"] = (self.nowhere(), mi.Spectrum(1))
            if has & self.smooth:
                out["spread"] = self.scatter(bsdf, si, *u, young, fresh, active)
        for name, kind, types in (
            ("mirrored", self.mirror, int(mi.BSDFFlags.DeltaReflection)),
            ("through", self.through, int(mi.BSDFFlags.DeltaTransmission | mi.BSDFFlags.Null)),
        ):
            if name in branches:
                out[name] = self.ideal(bsdf, si, kind, *u, active) if has & types else self.nowhere()
        return lit, out

    def scatter(
        self, bsdf: Any, si: Any, number: Any, point: Any, young: Any, fresh: Any, at: Any
    ) -> tuple[Branch, Any]:
        """A branch into the diffuse and glossy lobes, or past the surface where it lets light pass; its `share`."""
        if self.restricted and fresh is not False:
            bs, weight = bsdf.sample(self.first, si, number, point, at & young)
            if fresh is not True and self.switches.indirect:
                later, weight_later = bsdf.sample(self.every, si, number, point, at & ~young)
                bs, weight = dr.select(young, bs, later), dr.select(young, weight, weight_later)
        else:
            bs, weight = bsdf.sample(self.every, si, number, point, at)
        weight = dr.select(at & (bs.pdf > 0), weight, 0)
        null = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
        share = mi.Spectrum(1)
        if self.apart and not self.restricted and fresh is not False:
            share = part(self.in_rows(bsdf, si, bs.wo, at & ~null))
        return Branch(weight, mi.Vector3f(bs.wo), mi.Float(bs.pdf), dr.detach(bs.eta), null, mi.Spectrum(0)), share

    def ideal(self, bsdf: Any, si: Any, kind: Any, number: Any, point: Any, at: Any) -> Branch:
        """The branch of a mirror, or of light that goes through, with its whole weight."""
        bs, weight = bsdf.sample(kind, si, number, point, at)
        right = at & (bs.pdf > 0)
        null = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
        if kind is self.mirror:
            right &= ~null
        else:  # what a surface with other lobes lets pass, `scatter` has
            flags = bsdf.lanes.flags() if isinstance(bsdf, Together) else bsdf.flags()
            right &= ~(null & mi.has_flag(flags, mi.BSDFFlags.Smooth))
        weight = dr.select(right, weight, 0)
        return Branch(weight, mi.Vector3f(bs.wo), mi.Float(0), dr.detach(bs.eta), null, mi.Spectrum(0))

    def attach(self, spread: Branch, share: Any, bsdf: Any, si: Any, young: Any, fresh: Any, at: Any) -> Any:
        """Give the branch of `scatter` its derivative: density and the point that is met are held, the rest follows.

        Where nothing is met, the direction is held instead.
        """
        wo = dr.detach(spread.direction)
        spread.pdf = dr.detach(spread.pdf)
        world = dr.detach(si.to_world(wo))
        on = at & (spread.pdf > 0) & ~spread.null
        still = dr.detach(si)
        met = dr.detach(
            self.scene.ray_intersect(still.spawn_ray(world), mi.RayFlags.Minimal, coherent=False, active=on)
        )
        hit = on & met.is_valid()
        world = dr.replace_grad(world, dr.select(hit, dr.normalize(met.p - si.p), world))

        def again(bsdf: Any, si: Any, wo: Any, young: Any, active: Any) -> Any:
            if not bsdf.flags() & self.smooth:
                return mi.Spectrum(0), mi.Spectrum(1)
            f = bsdf.eval(self.every, si, wo, active)
            if self.restricted and fresh is not False:
                f = dr.select(young, bsdf.eval(self.first, si, wo, active), f)
            if self.apart and not self.restricted and fresh is not False:
                return f, part(self.in_rows(bsdf, si, wo, active))
            return f, mi.Spectrum(1)

        f, share = self.of_each(bsdf, again, si, si.to_local(world), young, on)
        f = f / dr.select(on, spread.pdf, 1) * dr.select(hit, moved(si.p, met.p, met.n), 1)
        spread.weight = dr.select(on, f, spread.weight)
        spread.direction = dr.select(spread.null, si.to_world(spread.direction), world)
        return share

    def nowhere(self) -> Branch:
        return Branch(mi.Spectrum(0), mi.Vector3f(0, 0, 1), mi.Float(0), mi.Float(1), mi.Bool(False), mi.Spectrum(0))

    # -- a step

    def step(self, s: State, stack: Stack | None, sampler: Any, fresh: Any) -> State:
        """Collect light at the surface that was met, choose where to go on, and see what is met there.

        `fresh` tells whether it is the first that is not mirror or glass: True or False where all lanes are alike, else
        None.
        """
        contents, switches = self.contents, self.switches
        si = s.hit.compute_surface_interaction(s.ray, mi.RayFlags.All, s.active)
        self.emission(s, si, fresh)
        going = s.active & si.is_valid() & (s.count < LONGEST)
        if self.max_depth >= 0:
            going &= s.depth + 1 < self.max_depth
        bsdf = si.bsdf(s.ray)
        young = self.is_fresh(s, fresh)
        if not switches.indirect and fresh is not True:
            going &= young | mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)
        if self.rr_depth < self.max_depth or self.max_depth < 0:
            chance = dr.minimum(dr.detach(dr.max(mi.unpolarized_spectrum(s.beta)) * dr.square(s.eta)), SURVIVAL)
            old = going & (s.depth >= self.rr_depth)
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
            lamps = self.lamps(s, si, sampler, fresh, at)
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
        self.asked = [lamp.columns for lamp in lamps]

        def ask(bsdf: Any, si: Any, lamps: Any, u: Any, young: Any, active: Any) -> Any:
            return self.answers(bsdf, si, lamps, branches, u, young, fresh, active)

        lit, answers = self.of_each(bsdf, ask, si, [(lamp.wo, lamp.lit) for lamp in lamps], u, young, going)

        beta, share = self.called_indirect(s, fresh)
        at = State(**{**vars(s), "beta": beta, "share": share})
        for lamp, answer in zip(lamps, lit, strict=True):
            self.reflect(at, lamp, answer, fresh)

        spread = mirrored = through = None
        if "spread" in branches:
            spread, part_diffuse = answers["spread"]
            if self.attached:
                part_diffuse = self.attach(spread, part_diffuse, bsdf, si, young, fresh, going)
            else:
                spread.direction = si.to_world(spread.direction)
            goes_on = mi.Bool(bool(switches.continued)) if fresh is True else ~young | bool(switches.continued)
            spread.weight = dr.select(spread.null | (shown & goes_on), spread.weight, 0)
            if self.apart and not self.restricted and fresh is not False:
                share = dr.select(young, part_diffuse, share)
            share = dr.select(spread.null, s.share, share)
        allowed = dr.select(young, mi.Bool(switches.tree), mi.Bool(switches.indirect))
        if "mirrored" in branches:
            mirrored = answers["mirrored"]
            mirrored.weight = dr.select(allowed, mirrored.weight, 0)
            mirrored.direction = si.to_world(mirrored.direction)
        if "through" in branches:
            through = answers["through"]
            through.weight = dr.select(through.null | allowed, through.weight, 0)
            through.direction = si.to_world(through.direction)
        return self.go_on(s, stack, sampler, si, (spread, mirrored, through), beta, share, young)

    def is_fresh(self, s: State, fresh: Any) -> Any:
        return mi.Bool(fresh) if isinstance(fresh, bool) else s.stage <= IMAGE

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
        for b in branches:
            if b is not None:
                b.beta = dr.select(b.null, s.beta, beta) * b.weight
        spread, mirrored, through = branches
        room = young & ~stack.full() if stack is not None else mi.Bool(False)
        nothing = mi.Bool(False)
        strong = self.strength(s, spread) if spread is not None else mi.Float(0)

        split, waiting = nothing, None
        chosen = through if mirrored is None else mirrored
        strong_chosen = self.tree_strength(s, chosen, young) if chosen is not None else mi.Float(0)
        if mirrored is not None and through is not None:
            strong_mirrored, strong_through = strong_chosen, self.tree_strength(s, through, young)
            both = (strong_mirrored > 0) & (strong_through > 0)
            split = both & room & (strong <= 0) & (dr.minimum(strong_mirrored, strong_through) >= self.threshold)
            one = both & ~split
            chance = strong_mirrored / dr.select(one, strong_mirrored + strong_through, 1)
            left = dr.select(one, sampler.next_1d() < chance, ~split & (strong_through <= 0))
            chosen = dr.select(left, mirrored, through)
            strong_chosen = dr.select(left, strong_mirrored, strong_through)
            chosen.beta = chosen.beta / dr.select(one, dr.select(left, chance, 1 - chance), 1)
            waiting = mirrored

        apart, spreads = nothing, strong > 0
        taken = spread if chosen is None else chosen
        if spread is not None and chosen is not None:
            pair = (strong > 0) & (strong_chosen > 0)
            apart = pair & room & (strong_chosen >= self.threshold)
            one = pair & ~apart
            chance = strong / dr.select(one, strong + strong_chosen, 1)
            spreads = dr.select(one, sampler.next_1d() < chance, spreads)
            taken = dr.select(spreads, spread, chosen)
            taken.beta = taken.beta / dr.select(one, dr.select(spreads, chance, 1 - chance), 1)
            waiting = chosen if waiting is None else dr.select(split, waiting, chosen)
        if taken is None:
            taken = self.nowhere()

        goes = dr.select(spreads, strong, strong_chosen) > 0
        if self.max_depth >= 0 and not self.contents.others:  # nothing shines on whoever hits it
            goes &= s.depth + 2 < self.max_depth
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
        out.valid = s.valid | (s.active & si.is_valid() & ~(goes & taken.null))
        out.count = s.count + 1
        if stack is not None and waiting is not None:
            ray = si.spawn_ray(waiting.direction)
            code = (s.depth + 1) * 2 + dr.select(waiting.null, s.stage, mi.UInt32(IMAGE))
            stack.push(self.entry(ray.o, ray.d, waiting.beta, s.eta * waiting.eta, code), split | apart)
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
        self.trace(out, out.active, stack.state[0] > 0 if stack is not None else False)
        return out

    def trace(self, s: State, at: Any, more: Any = False) -> None:
        """Find what the rays of the lanes `at` meet. Where that is nothing, and there is no sky, the path is over.

        But it stays where `more` branches wait.
        """
        hit = self.scene.ray_intersect_preliminary(dr.detach(s.ray), coherent=False, active=at)
        s.hit = dr.select(at, hit, s.hit)
        s.active = (s.active & ~at) | (at & (mi.Bool(self.sky) | hit.is_valid() | more))

    def strength(self, s: State, branch: Branch) -> Any:
        """How much of the light at the eye comes along a branch, at most: without the compression of radiance."""
        return dr.detach(dr.max(mi.unpolarized_spectrum(branch.beta)) * dr.square(s.eta * branch.eta))

    def tree_strength(self, s: State, branch: Branch, young: Any) -> Any:
        """The same of a branch of the tree; 0 if it is cut."""
        strong = self.strength(s, branch)
        return dr.select(young & (strong < self.threshold), 0, strong) if self.cut else strong

    # -- whole paths

    def run(self, sampler: Any, ray: Any, active: Any) -> State:
        """All paths of the rays from the eye."""
        names = CELLS if self.layers else ("",)
        ray, active = mi.Ray3f(ray), mi.Bool(active)
        if self.hide:
            ray = self.past_lamps(ray, active)
        s = State(
            ray=ray,
            hit=self.scene.ray_intersect_preliminary(dr.detach(ray), coherent=True, active=active),
            beta=mi.Spectrum(1),
            eta=mi.Float(1),
            depth=mi.UInt32(0),
            stage=mi.UInt32(EYE),
            pdf=mi.Float(0),
            share=mi.Spectrum(float(not self.restricted or self.switches.continued == ("diffuse",))),
            mirrored=mi.Bool(False),
            active=active,
            valid=mi.Bool(not self.hide and "environment" in self.contents.columns),
            count=mi.UInt32(0),
            light={name: mi.Spectrum(0) for name in names},
        )
        if self.max_depth == 0:
            return s
        if self.switches.tree or self.contents.null:
            return self.loop(s, sampler, None)
        s = self.step(s, None, sampler, True)
        if self.switches.indirect:
            return self.loop(s, sampler, False)
        if self.switches.continued:
            self.emission(s, s.hit.compute_surface_interaction(s.ray, mi.RayFlags.All, s.active), False)
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


def part(rows: dict[str, Any]) -> Any:
    """The part of what is reflected that the diffuse lobes reflect."""
    total = rows["diffuse"] + rows["glossy"]
    return dr.select(total > 0, rows["diffuse"] / dr.select(total > 0, total, 1), 0)


def moved(p: Any, fixed: Any, n: Any) -> Any:
    """The solid angle of a fixed piece of surface, seen from `p`, over what it is now: 1, with its derivative."""
    to = fixed - p
    distance2 = dr.squared_norm(to)
    solid = dr.abs(dr.dot(to, n)) / (distance2 * dr.sqrt(distance2))
    now = dr.detach(solid)
    return dr.select(now > 0, solid / dr.select(now > 0, now, 1), 1)
