"""Models with smooth surfaces, layers and grooves, under their choices."""

from __future__ import annotations

from .formulas import Formula

SMOOTH: list[Formula] = []
