"""What a scene holds, as far as the integrators must know before their kernel is traced."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi

from .convex import nested
from .inventory import refuse_media, solid
from .table import CELLS
from .undivided import undivided

#: Depths from which on a cell can have light: its shortest path, counted as `max_depth` counts.
SHORTEST = {"emitter": 1, "mirror.area": 2, "mirror.environment": 2, "mirror.indirect": 3}


@dataclass(frozen=True)
class Contents:
    """The kinds of emitters and lobes of a scene."""

    points: tuple[Any, ...]
    """Emitters at a point or from one direction: no ray hits them."""
    others: tuple[Any, ...]
    """Area emitters and the environment."""
    columns: frozenset[str]
    """Which of point, area and environment there are."""
    flags: int
    """All lobes of all surfaces, as Mitsuba's flags; of those that are `undivided`, without the diffuse ones."""
    undivided: tuple[Any, ...]
    """The BSDFs that do not tell diffuse and glossy lobes apart."""
    blends: tuple[Any, ...]
    """The BSDFs with a `blendbsdf` in them, but no `mask`: see `surfaces.drawn`."""
    thin: bool
    """Whether a surface without diffuse and glossy lobes lets light pass straight: thin glass, a border."""
    masks: bool
    """Whether a `mask` is among the surfaces: it samples wrongly if its `Null` lobe is switched off."""
    smooth: bool
    """Whether every surface has a diffuse or glossy lobe."""

    @property
    def reflects(self) -> bool:
        """Whether a surface reflects like a mirror."""
        return self.has(mi.BSDFFlags.DeltaReflection)

    @property
    def transmits(self) -> bool:
        """Whether a surface refracts."""
        return self.has(mi.BSDFFlags.DeltaTransmission)

    @property
    def null(self) -> bool:
        """Whether a surface lets a part of the light pass as if it were not there."""
        return self.has(mi.BSDFFlags.Null)

    def has(self, lobe: Any) -> bool:
        return bool(self.flags & int(lobe))

    @property
    def rows(self) -> tuple[str, ...]:
        """The rows of the table whose lobes are not ideal."""
        return ("diffuse",) * self.has(mi.BSDFFlags.Diffuse) + ("glossy",) * self.has(mi.BSDFFlags.Glossy)

    def possible(self, max_depth: int) -> frozenset[str]:
        """Cells that may have light in this scene at this depth."""
        delta = self.reflects or self.transmits
        out = set()
        for cell in CELLS:
            if cell == "emitter":
                there = bool(self.others)
            else:
                row, column = cell.split(".")
                there = bool(self.columns) if column == "indirect" else column in self.columns
                there &= delta and cell != "mirror.point" if row == "mirror" else row in self.rows
                if cell == "mirror.indirect":
                    there &= bool(self.rows)
            shortest = SHORTEST.get(cell, 3 if cell.endswith("indirect") else 2)
            if there and (max_depth < 0 or max_depth >= shortest):
                out.add(cell)
        return frozenset(out)


def contents(scene: mi.Scene) -> Contents:
    """Look through the shapes and emitters of a scene.

    Raises
    ------
    DataError
        There is a participating medium.
    """
    flags = mi.BSDFFlags
    shapes = [shape for shape, _ in solid(scene)]
    refuse_media(scene, shapes)
    bsdfs = {}
    for shape in shapes:
        bsdf = shape.bsdf()
        if bsdf is not None:
            bsdfs[bsdf.ptr] = bsdf
    whole = tuple(bsdf for bsdf in bsdfs.values() if undivided(bsdf))
    inside = {key: [b.class_name() for b in nested(bsdf)] for key, bsdf in bsdfs.items()}
    found = 0
    for bsdf in bsdfs.values():
        found |= int(bsdf.flags()) & ~(int(flags.Diffuse) if bsdf in whole else 0)
    points, others, columns = [], [], set()
    for emitter in scene.emitters():
        kind = emitter.flags()
        if kind & int(mi.EmitterFlags.Delta):
            if not kind & int(mi.EmitterFlags.Surface):  # neither found by a ray nor by sampling
                points.append(emitter)
                columns.add("point")
        else:
            others.append(emitter)
            columns.add("environment" if kind & int(mi.EmitterFlags.Infinite) else "area")
    lobes = [int(bsdf.flags()) for bsdf in bsdfs.values()]
    return Contents(
        points=tuple(points),
        others=tuple(others),
        columns=frozenset(columns),
        flags=found,
        undivided=whole,
        blends=tuple(b for key, b in bsdfs.items() if "BlendBSDF" in inside[key] and "MaskBSDF" not in inside[key]),
        thin=any(f & int(flags.Null) and not f & int(flags.Smooth) for f in lobes),
        masks=any("Mask[" in str(bsdf) for bsdf in bsdfs.values()),
        smooth=all(f & int(flags.Smooth) for f in lobes),
    )
