"""Reflection models in Mitsuba: `register` them, then use them from scene XML, from a dictionary, or from Python."""

import brdf  # noqa: F401  (chooses libLLVM before Mitsuba starts Dr.Jit)

from .registry import register, registered

__all__ = ["register", "registered"]
