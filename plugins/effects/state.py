"""The state of a path, and the settings under which paths are followed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi

from .cells import Switches
from .contents import Contents
from .lights import Lights

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


class Settings:
    """What is fixed while the kernel of one scene is traced."""

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
        names: tuple[str, ...],
        hide: bool,
        attached: bool,
    ) -> None:
        self.scene, self.contents, self.switches = scene, contents, switches
        self.points, self.others = lights
        self.max_depth, self.rr_depth = max_depth, rr_depth
        self.threshold, self.cut = threshold, cut
        self.names, self.hide, self.attached = names, hide, attached
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
        self.sky = "environment" in contents.columns
        #: Kinds of emitters of which one is sampled.
        self.sampled = tuple(dict.fromkeys(column_of(e) for e in self.others.emitters))
        columns = ("area", "environment", "indirect")
        #: Whether diffuse and glossy scattering must be told apart on the way.
        self.apart = len(contents.rows) == 2 and (
            bool(names) or (not self.restricted and any(len(switches.wants(c)) == 1 for c in columns))
        )

    def together(self, columns: tuple[str, ...]) -> bool:
        """Whether one value of the reflectance does for the first surface and for those after it."""
        return not self.names and all(self.switches.wants(c) == self.contents.rows for c in columns)


def column_of(emitter: mi.Emitter) -> str:
    """The column of an emitter that is no point."""
    return "environment" if emitter.is_environment() else "area"


def context(types: int) -> Any:
    """What is asked of a BSDF: the lobes of these types."""
    out = mi.BSDFContext()
    out.type_mask = types
    return out


def is_fresh(w: Settings, s: State, fresh: Any) -> Any:
    """The lanes of paths that have not been scattered by a diffuse or glossy lobe."""
    return mi.Bool(fresh) if isinstance(fresh, bool) else s.stage <= IMAGE
