"""Scenes and pictures to try a fit on. ``python -m fitting.examples.make`` makes the pictures."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

FOLDER = Path(str(files(__name__)))


def truth() -> dict[str, dict[str, Any]]:
    """What the pictures were made with: ``{"sphere": {"ball.m": 0.3, ...}, ...}``."""
    return json.loads((FOLDER / "truth.json").read_text())
