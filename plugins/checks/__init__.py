"""Questions asked of any BSDF in Mitsuba: ours, Mitsuba's own, anybody's. `check` asks them all.

What needs no renderer is in ``brdf.checks``.
"""

from .gather import alone_as_xml, check, check_scene
from .glance import Glance, glance
from .outsiders import CheckFailed, cases, parametrize
from .subject import BsdfSubject

__all__ = [
    "BsdfSubject",
    "CheckFailed",
    "Glance",
    "alone_as_xml",
    "cases",
    "check",
    "check_scene",
    "glance",
    "parametrize",
]
