"""Scenes of Mitsuba with our models in them: ``brdf render`` draws them."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

FOLDER = Path(str(files(__name__)))
