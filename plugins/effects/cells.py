"""Which cells of the table are simulated: what was asked for, against what a scene holds."""

from __future__ import annotations

from dataclasses import dataclass

from .table import CELLS


def layer_names(parts: bool) -> tuple[str, ...]:
    """The layers of a picture; with `parts`, what is seen in mirrors is split by the cell that is seen."""
    shown = [image_of(c) for c in CELLS if c.startswith(("diffuse", "glossy"))] if parts else ["mirror.indirect"]
    return tuple(name for c in CELLS for name in (shown if c == "mirror.indirect" else [c]))


def image_of(cell: str) -> str:
    """The name of the part of ``mirror.indirect`` that goes with this cell."""
    return f"mirror.indirect/{cell}"


@dataclass(frozen=True)
class Switches:
    """What the kernel simulates. A mirror shows what the other cells called for show; everything, if it is alone."""

    cells: frozenset[str]
    rows: tuple[str, ...]
    """Those of diffuse and glossy that the scene has."""
    eye: bool
    """Whether a surface that is not a mirror is shaded where it is seen directly."""
    image: bool
    """Whether it is where it is seen in a mirror or through glass."""

    @classmethod
    def of(cls, wanted: frozenset[str], possible: frozenset[str], rows: tuple[str, ...]) -> Switches:
        """`wanted` is asked for, `possible` is what may have light, `rows` as below."""
        smooth = {c for c in CELLS if c.startswith(("diffuse", "glossy"))}
        cells = wanted & possible
        alone = not wanted & smooth and "mirror.indirect" in cells
        return cls(
            cells=cells | (possible & smooth if alone else frozenset()),
            rows=rows,
            eye=not alone and bool(cells & smooth),
            image="mirror.indirect" in cells,
        )

    def wants(self, column: str) -> tuple[str, ...]:
        """The rows, diffuse or glossy, in which light of this kind is called for."""
        return tuple(row for row in self.rows if f"{row}.{column}" in self.cells)

    @property
    def shades(self) -> bool:
        return self.eye or self.image

    @property
    def indirect(self) -> bool:
        return self.shades and bool(self.wants("indirect"))

    @property
    def tree(self) -> bool:
        """Whether mirrors and glass are followed from the eye."""
        return any(c.startswith("mirror") for c in self.cells)

    @property
    def continued(self) -> tuple[str, ...]:
        """Rows from which a path goes on, be it only to see where a sampled direction meets a lamp."""
        wanted = {row for c in ("area", "environment", "indirect") for row in self.wants(c)}
        return tuple(row for row in self.rows if row in wanted) if self.shades else ()
