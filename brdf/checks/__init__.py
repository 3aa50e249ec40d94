"""Questions asked of a reflection model: one file, one question. What needs Mitsuba is in ``plugins.checks``."""

from .gather import QUESTIONS, check_model
from .result import CHECKS, Finding, Result, judge
from .subject import ModelSubject, Part, Quantity, Sample, Subject

__all__ = [
    "CHECKS",
    "QUESTIONS",
    "Finding",
    "ModelSubject",
    "Part",
    "Quantity",
    "Result",
    "Sample",
    "Subject",
    "check_model",
    "judge",
]
