"""Questions asked of a reflection model: one file, one question. What needs Mitsuba is in ``plugins.checks``."""

from .result import CHECKS, Finding, Result, judge
from .subject import ModelSubject, Part, Quantity, Sample, Subject

__all__ = ["CHECKS", "Finding", "ModelSubject", "Part", "Quantity", "Result", "Sample", "Subject", "judge"]
