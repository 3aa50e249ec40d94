"""All formulas that are held against exact answers."""

from __future__ import annotations

from .bricks import BRICKS
from .formulas import Formula
from .lobes import LOBES
from .smooth import SMOOTH

FORMULAS = {f.name: f for f in [*BRICKS, *LOBES, *SMOOTH]}


def formulas_of(owner: str) -> list[Formula]:
    """Those of one model, or of ``"bricks"``."""
    return [f for f in FORMULAS.values() if f.owner == owner]
