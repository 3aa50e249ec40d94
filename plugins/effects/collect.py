"""What a path collects: emission of what it meets, and light straight from lamps, sorted into cells of the table."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from .cells import image_of
from .lights import mis, moved
from .state import EYE, IMAGE, INDIRECT, SCATTERED, Lamp, Settings, State, is_fresh
from .table import SUMMED


def emission(w: Settings, s: State, si: Any, fresh: Any) -> None:
    """Add what the emitter sends that the ray has met."""
    if not w.contents.others:
        return
    emitter = si.emitter(w.scene, s.active)
    here = s.active & (emitter != None)  # noqa: E711  (lane by lane, which `is not` cannot do)
    if w.hide:  # the sky, also behind what light passes straight; lamps are gone by `past_lamps`, not behind that
        here &= (s.stage != EYE) | si.is_valid()
    value = s.beta * emitter.eval(si, here)
    if fresh is not True and w.others.emitters:
        sampled = here & (s.pdf > 0)
        with dr.suspend_grad():
            reference = dr.zeros(mi.Interaction3f)
            reference.p = s.ray.o
            ds = mi.DirectionSample3f(w.scene, si, reference)
            other = w.others.pdf(reference, ds, sampled)
            weight = dr.select(sampled, mis(s.pdf, other), 1)
        value = value * weight
    value = dr.select(here, value, 0)
    area = si.is_valid()
    for column, met in (("area", area), ("environment", ~area)):
        if column in w.contents.columns:
            this = value if len(w.contents.columns - {"point"}) == 1 else dr.select(met, value, 0)
            emitted(w, s, column, this, fresh)


def emitted(w: Settings, s: State, column: str, value: Any, fresh: Any) -> None:
    """Sort emission by what happened to the path before."""
    switches, total = w.switches, mi.Spectrum(0)
    for stage, cell in ((EYE, "emitter"), (IMAGE, f"mirror.{column}")):
        if cell in switches.cells and fresh is not False:
            part = dr.select(s.stage == stage, value, 0)
            if w.names:
                add(w, s, cell, part)
            total += part
    if fresh is not True:
        last = dr.select(s.stage == SCATTERED, value, 0)
        wanted = switches.wants(column)
        if not w.apart:
            if wanted:
                total += last
                if w.names:
                    add_split(w, s, wanted[0], column, s.mirrored, last)
        else:
            for row in wanted:
                part = last * (s.share if row == "diffuse" else 1 - s.share)
                total += part
                if w.names:
                    add_split(w, s, row, column, s.mirrored, part)
        if switches.indirect:
            part = dr.select(s.stage == INDIRECT, value, 0)
            if w.names:
                add_indirect(w, s, part)
            total += part
    if not w.names:
        add(w, s, "", total)


def sample_lamps(w: Settings, s: State, si: Any, sampler: Any, fresh: Any, at: Any) -> list[Lamp]:
    """Directions to lamps from the surfaces `at`, and what would come from there."""
    switches, out = w.switches, []
    later = switches.indirect and fresh is not True
    none = mi.Point2f(0)
    if "point" in w.contents.columns and (later or (switches.wants("point") and fresh is not False)):
        emitters = w.points.emitters
        for emitter in emitters if len(emitters) <= SUMMED else (None,):
            if emitter is None:
                ds, weight, _ = w.points.sample(si, sampler.next_1d(), none, at)
            else:
                ds, weight = emitter.sample_direction(si, none, at)
            lit = at & (ds.pdf != 0) & dr.any(weight != 0)
            lit &= ~w.scene.ray_test(dr.detach(si.spawn_ray_to(ds.p)), lit)
            out.append(Lamp(ds, weight, lit, si.to_local(ds.d), ("point",)))
    columns = w.sampled
    if columns and (later or (fresh is not False and any(switches.wants(c) for c in columns))):
        still = dr.detach(si)
        with dr.suspend_grad():
            number = sampler.next_1d() if len(w.others.emitters) > 1 else 0
            ds, weight, emitter = w.others.sample(still, number, sampler.next_2d(), at)
            lit = at & (ds.pdf > 0) & dr.any(weight != 0)
            lit &= ~w.scene.ray_test(still.spawn_ray_to(ds.p), lit)
        if w.attached:
            near = lit & ~mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite)
            to = dr.select(near, ds.p - si.p, ds.d)
            ds.d = dr.replace_grad(ds.d, dr.normalize(to))
            again = emitter.eval_direction(si, ds, lit) / dr.select(ds.pdf > 0, ds.pdf, 1)
            weight = again * dr.select(near, moved(to, ds.n), 1)
        out.append(Lamp(ds, weight, lit, si.to_local(ds.d), columns))
    return out


def reflect(w: Settings, s: State, lamp: Lamp, answer: Any, fresh: Any) -> None:
    """Add the light of one lamp."""
    switches, columns = w.switches, lamp.columns
    every, rows, pdf = answer
    incoming = s.beta * lamp.weight
    if columns != ("point",):
        incoming *= dr.detach(mis(lamp.ds.pdf, pdf))
    young = is_fresh(w, s, fresh)
    together = w.together(columns)
    if together or (switches.indirect and fresh is not True):
        on = lamp.lit if together or fresh is False else lamp.lit & ~young
        add_indirect(w, s, dr.select(on, incoming * every, 0))
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
            add_shaded(w, s, row, column, mine)


def add(w: Settings, s: State, cell: str, value: Any) -> None:
    """Radiance into a layer, or into the picture if there are no layers."""
    name = cell if w.names else ""
    s.light[name] = s.light[name] + value


def add_indirect(w: Settings, s: State, value: Any) -> None:
    """Light at a surface after the first."""
    if not w.names:
        return add(w, s, "", value)
    rows = w.contents.rows
    if len(rows) == 1:
        return add_split(w, s, rows[0], "indirect", s.mirrored, value)
    add_split(w, s, "diffuse", "indirect", s.mirrored, value * s.share)
    return add_split(w, s, "glossy", "indirect", s.mirrored, value * (1 - s.share))


def add_shaded(w: Settings, s: State, row: str, column: str, value: Any) -> None:
    """Light from a lamp at the first surface that is neither mirror nor glass."""
    if not w.names:
        return add(w, s, "", value)
    return add_split(w, s, row, column, s.stage == IMAGE, value)


def add_split(w: Settings, s: State, row: str, column: str, image: Any, value: Any) -> None:
    """Radiance into the layer of a cell, or where that surface is seen in a mirror into that of its image."""
    shown = image_of(f"{row}.{column}")
    add(w, s, shown if shown in w.names else "mirror.indirect", dr.select(image, value, 0))
    add(w, s, f"{row}.{column}", dr.select(image, 0, value))
