"""Does the maximum of a glossy lobe leave the mirror direction at grazing incidence?

That of a rough surface does (Torrance and Sparrow 1967); a lobe that stays in the mirror direction is not that of a
surface.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .result import Finding, at_least, not_asked, worst
from .subject import Subject
from .values import channels

Array = npt.NDArray[np.float64]

#: The light comes at this angle from the normal [deg].
INCIDENCE = 75.0
#: The viewer moves in the plane of incidence, in steps of this all over, and about the mirror direction [deg].
COARSE, FINE = 0.1, 0.002
#: How far the fine steps reach [deg].
NEAR = 1.0
#: The viewer comes no nearer to the surface than this [deg].
GRAZING = 89.0
#: A lobe narrower than this, at half its height, is too sharp to tell [deg].
SHARP = 2.0
#: The maximum is in the mirror direction if it is nearer than this, or than this share of the width of the lobe.
APART, SHARE = 0.02, 2e-3
#: A lobe that changes by less than this is no lobe, but looks equally bright from everywhere.
FLAT = 0.01


def ask(subject: Subject, seed: int = 0) -> Finding:
    """Degrees between mirror direction and maximum, of what a viewer sees who moves while the light stands still.

    `seed` is not used: the directions are always the same.
    """
    glossy = [i for i, part in enumerate(subject.lobes) if part.glossy and part.reflects and part.smooth]
    if not glossy:
        return not_asked("There is no glossy reflection.")
    return worst([off_specular(subject, lobe) for lobe in glossy])


def off_specular(subject: Subject, lobe: int) -> Finding:
    """Where one lobe has its maximum."""
    angles = np.union1d(
        np.arange(-GRAZING, GRAZING + COARSE / 2, COARSE),
        INCIDENCE + np.arange(-NEAR, NEAR + FINE / 2, FINE),
    )
    seen = profile(subject, lobe, angles)
    if not np.isfinite(seen).all():
        return not_asked("The lobe is not finite.")
    name = subject.lobes[lobe].name
    top = float(seen.max())
    if top <= 0:
        return not_asked(f"The lobe {name} is black.")
    if seen.min() >= (1 - FLAT) * top:
        return not_asked(f"The lobe {name} looks the same from everywhere.")
    width = float(np.trapezoid(seen >= 0.5 * top, angles))
    around = float(angles[int(np.argmax(seen))])
    if width < SHARP and abs(around - INCIDENCE) < SHARP:
        return not_asked(f"The lobe {name} is too sharp to tell, {width:.2g} deg wide.")
    finer = np.clip(around + np.arange(-COARSE, COARSE + FINE / 2, FINE), -GRAZING, GRAZING)
    again = profile(subject, lobe, finer)
    if abs(around - INCIDENCE) > NEAR and again.max() > top:
        around = float(finer[int(np.argmax(again))])
    figure = abs(around - INCIDENCE)
    case = subject.case(
        figure="degrees between the maximum and the mirror direction; fails below the limit",
        lobe=name,
        wo=direction(-INCIDENCE).ravel().tolist(),
        wi=direction(around).ravel().tolist(),
        maximum_at=around,
        mirror_at=INCIDENCE,
        width=width,
    )
    said = f"With light at {INCIDENCE:g} deg the lobe {name} has its maximum in the mirror direction."
    return at_least(figure, max(APART, SHARE * width), said, case)


def profile(subject: Subject, lobe: int, angles: Array) -> Array:
    """What is seen from these angles, in the channel that is brightest."""
    wi = subject.vector(direction(angles))
    light = subject.vector(direction(np.full_like(angles, -INCIDENCE)))
    return channels(subject.f(wi, light, lobe)).max(axis=0)


def direction(angle: npt.ArrayLike) -> Array:
    """In the plane of incidence, at this angle from the normal [deg], shape (3, n)."""
    a = np.radians(np.atleast_1d(np.asarray(angle, dtype=float)))
    return np.array([np.sin(a), np.zeros_like(a), np.cos(a)])
