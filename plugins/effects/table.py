"""The lecture's table: how light arrives at a surface (columns) against how the surface answers it (rows).

On the way from the eye, let y be the first point that sends light into many directions. The row is the lobe with which
y answers, the column how light arrives at y: straight from a point or directional light, from an area light, from the
environment, or from another surface, through glass and mirrors too (a caustic is indirect). If the eye sees y in a
mirror or through glass, that is ``mirror.indirect``, whatever lights y; a mirrored lamp is ``mirror.area``, a mirrored
sky ``mirror.environment``. A point light in a mirror has measure zero: the cell ``mirror.point`` is always empty. Lamp
and sky seen directly are ``emitter``. Surfaces that light only passes (`null`, `mask`) do not count. A BSDF
that answers with all its lobes whichever are asked for, as `principled` and `principledthin` do, is glossy as a whole.
The cells add up to the picture.
"""

from __future__ import annotations

import difflib
import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import mitsuba as mi

from brdf.errors import UsageError

from .inventory import Inventory, Kind, take

ROWS = ("diffuse", "glossy", "mirror")
COLUMNS = ("point", "area", "environment", "indirect")
EMITTER = "emitter"
#: Always empty: no ray meets a point.
EMPTY = "mirror.point"
#: All cells: the table row by row, and lamps seen directly.
CELLS = (*(f"{row}.{column}" for row in ROWS for column in COLUMNS), EMITTER)
#: What is easy to include in a classic ray tracer: point lights, and the mirror image of everything else by recursion.
CLASSIC = frozenset(("diffuse.point", "glossy.point", "mirror.area", "mirror.environment", "mirror.indirect", EMITTER))
#: So many point lights are summed; of more, one is drawn at random for each point seen.
SUMMED = 64
ABOUT = {
    "diffuse.point": "hard shadows",
    "diffuse.area": "soft shadows",
    "diffuse.environment": "soft shadows",
    "diffuse.indirect": "soft indirect illumination",
    "glossy.point": "simple specular highlight",
    "glossy.area": "shaped specular highlight",
    "glossy.environment": "blurry reflection of environment",
    "glossy.indirect": "blurry reflections of other objects",
    "mirror.point": "point reflections",
    "mirror.area": "reflected image of source",
    "mirror.environment": "reflected image of environment",
    "mirror.indirect": "reflected images of other objects",
    EMITTER: "lamp or sky seen directly",
}


@dataclass(frozen=True)
class Cell:
    """One cell of the table, for one scene.

    Attributes
    ----------
    name : str
    called_for : bool
        False: it is exactly zero.
    why : str
        One line: what in the scene calls for it, or what is missing.
    technique : str
        What will estimate it; empty if nothing has to.
    easy : bool
        Whether a classic ray tracer includes it easily.
    """

    name: str
    called_for: bool
    why: str
    technique: str
    easy: bool


def parse(text: str) -> frozenset[str]:
    """The cells that a user asks for.

    Parameters
    ----------
    text : str
        Names with commas or spaces between: cells, or ``all``, ``auto`` (all that the scene calls for: as `all`, since
        what it does not call for is zero), ``classic`` (`CLASSIC`). With ``-`` before it a name is left out; if the
        first one is, then of all.

    Raises
    ------
    UsageError
        An unknown name, or nothing is left.
    """
    groups = {"all": frozenset(CELLS), "auto": frozenset(CELLS), "classic": CLASSIC}
    names = text.replace(",", " ").split()
    chosen = set(CELLS) if names and names[0].startswith("-") else set()
    for name in names:
        bare = name.removeprefix("-")
        if bare not in groups and bare not in CELLS:
            near = difflib.get_close_matches(bare, (*CELLS, *groups), 1, cutoff=0.4)
            guess = f"Did you mean {near[0]}? " if near else ""
            raise UsageError(f"effects: there is no {bare!r}. {guess}There are: {', '.join((*groups, *CELLS))}.")
        meant = groups.get(bare, frozenset((bare,)))
        chosen = chosen - meant if name.startswith("-") else chosen | meant
    if not chosen:
        raise UsageError(f"effects: {text!r} leaves no cell. Name one of: {', '.join((*groups, *CELLS))}.")
    return frozenset(chosen)


def plan(
    scene: mi.Scene, max_depth: int, *, hide_emitters: bool = False, sensors: Sequence[Any] | None = None
) -> dict[str, Cell]:
    """Which cells a scene calls for, from what is in it alone: exact, and free.

    What is not called for is exactly zero, for every one of the sensors. What is called for may be zero as well: a
    lamp may be hidden. Call it again after a change of the scene.

    Parameters
    ----------
    max_depth : int
        The longest paths, in edges from eye to lamp: 1 ends at lamps seen directly, 2 at direct light; -1: no end.
    hide_emitters : bool
        Whether lamps and sky are not to be seen directly. Behind masks, thin glass and the like, lamps still are.
    sensors : sequence of mi.Sensor
        All that look at the scene, None among them for one that is not known. If not given, the scene's own.

    Returns
    -------
    dict of Cell
        By name, in the order of `CELLS`.

    Raises
    ------
    DataError
        The scene has a participating medium.
    """
    return from_inventory(take(scene, sensors), max_depth, hide_emitters)


def called_for(cells: dict[str, Cell]) -> frozenset[str]:
    """The names of those that are."""
    return frozenset(name for name, cell in cells.items() if cell.called_for)


def from_inventory(found: Inventory, max_depth: int, hide_emitters: bool) -> dict[str, Cell]:
    """`plan`, once it is known what is in the scene."""
    paths = Paths(found)
    # Longer ones pass through the same kinds of surface again.
    depth = max_depth if max_depth >= 0 else 2 * len(found.kinds) + 4
    indirect = bool(paths.with_indirect("smooth", depth))
    cells = {}
    for name in CELLS:
        row, _, column = name.partition(".")
        users: list[Kind] = []
        if name == EMITTER:
            there = depth >= 1 and bool(found.lamps or found.sky)
            if hide_emitters:  # a lamp is seen all the same if light passes straight through what is before it
                there = depth >= 2 and found.lamps > 0 and found.passes
        elif name == EMPTY:
            there = False
        elif column == "indirect":
            users = paths.with_indirect(row, depth)
            there = bool(users)
        else:
            users = [kind for kind in found.kinds if getattr(kind, row) and depth >= 2 and paths.direct(kind, column)]
            there = bool(users)
        why = reason(name, found, users) if there else lack(name, found, depth)
        technique = how(name, found, indirect) if there else ""
        cells[name] = Cell(name, there, why, technique, name in CLASSIC)
    return cells


class Paths:
    """Which ways light can take between the kinds of surfaces of a scene. Edges count from the surface to the lamp."""

    def __init__(self, found: Inventory) -> None:
        self.found = found
        self.sends = functools.cache(self.sends)

    def direct(self, kind: Kind, column: str) -> bool:
        """Whether light of this column arrives straight from its source."""
        own = kind.lamp and not kind.again
        return {"point": self.found.points > 0, "area": self.found.lamps > own, "environment": self.found.sky}[column]

    def reached(self, kind: Kind) -> Iterable[Kind]:
        """The kinds that can be seen from a surface of this one."""
        return (other for other in self.found.kinds if other is not kind or kind.again)

    def sends(self, kind: Kind, edges: int) -> bool:
        """Whether a surface sends light on to another, over at most so many edges."""
        columns = COLUMNS[:3] if kind.smooth else COLUMNS[1:3]
        return (edges >= 1 and any(self.direct(kind, column) for column in columns)) or self.receives(kind, edges)

    def receives(self, kind: Kind, edges: int) -> bool:
        """Whether light arrives from other surfaces."""
        return edges >= 2 and any(self.sends(other, edges - 1) for other in self.reached(kind))

    def image(self, kind: Kind, edges: int) -> bool:
        """Whether a lit surface is seen in this mirror. In one that shows another mirror there is no more to see."""
        return any(other.smooth and self.sends(other, edges - 1) for other in self.reached(kind))

    def with_indirect(self, row: str, depth: int) -> list[Kind]:
        """The kinds that call for the last column of a row."""
        way = self.image if row == "mirror" else self.receives
        return [kind for kind in self.found.kinds if getattr(kind, row) and way(kind, depth - 1)]


def reason(name: str, found: Inventory, users: list[Kind]) -> str:
    """What calls for a cell."""
    row, _, column = name.partition(".")
    light = {
        "point": counted(found.points, "point light"),
        "area": counted(found.lamps, "area light"),
        "environment": "an environment",
    }
    if name == EMITTER:
        seen = [light["area"]] * (found.lamps > 0) + [light["environment"]] * found.sky
        return f"{' and '.join(seen)} may be in view"
    surfaces = those(row, users)
    if name == "mirror.indirect":
        return f"{surfaces} may show other surfaces"
    if column != "indirect":
        return f"{surfaces}, {light[column]}"
    said = f"{surfaces}, lit by other surfaces"
    if found.caustics:
        said += ", with caustics"
    if any(kind.mirror for kind in found.kinds) and found.points:
        said += "; point lights thrown by mirror or glass are not: no path finds them"
    return said


def lack(name: str, found: Inventory, depth: int) -> str:
    """What is missing for a cell."""
    row, _, column = name.partition(".")
    if name == EMPTY:
        return "no ray meets a point: measure zero"
    if name == EMITTER:
        if not (found.lamps or found.sky):
            return "no area light, no environment"
        return "hidden by hide_emitters" if depth else "paths end at depth 0"
    if not any(getattr(kind, row) for kind in found.kinds):
        return {"mirror": "no mirror, glass or glaze"}.get(row, f"no {row} surface")
    unseen = found.unreachable > 0
    if column == "point" and not found.points:
        return "no point or directional light"
    if column == "area" and not found.lamps:
        return "no area light that a path finds (directionalarea is not found)" if unseen else "no area light"
    if column == "environment" and not found.sky:
        return "no environment"
    if not (found.points or found.lamps or found.sky):
        return "no light that a path finds" if unseen else "no light"
    if depth < (3 if column == "indirect" else 2):
        return f"paths end at depth {depth}"
    if column == "area":
        return "the only area light is the surface itself, which does not see itself"
    kinds = found.kinds
    if len(kinds) == 1 and not kinds[0].again:
        return "one convex or flat body, which does not see itself"
    if name == "mirror.indirect" and not any(kind.smooth for kind in kinds):
        return "nothing to be seen in it but mirrors and lamps"
    if not (found.lamps or found.sky) and any(kind.mirror for kind in kinds):
        return f"point lights thrown by mirror or glass are not found, and other paths are longer than {depth}"
    return f"such paths are longer than {depth}"


def how(name: str, found: Inventory, indirect: bool) -> str:
    """What estimates a cell."""
    row, _, column = name.partition(".")
    if name == EMITTER:
        return "camera rays"
    if row == "mirror":
        return "ray tree"
    if column == "point":
        return "all lights summed" if found.points <= SUMMED else "one light drawn by power"
    if column == "indirect":
        return "paths continued by BSDF sampling"
    if name == "diffuse.area" and not indirect:
        return "light sampling"
    return "light and BSDF sampling (MIS)"


def those(row: str, users: list[Kind]) -> str:
    """``3 glossy surfaces``, ``1 glossy surface (floor)``."""
    count = sum(kind.count for kind in users)
    return counted(count, f"{row} surface") + (f" ({users[0].example})" if count == 1 else "")


def counted(number: int, what: str) -> str:
    """``1 point light``, ``2 point lights``."""
    return f"{number} {what}{'' if number == 1 else 's'}"
