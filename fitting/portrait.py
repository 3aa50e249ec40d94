"""What a BSDF looks like, for its plots: lobes in the plane of incidence, albedo, and where it is not reciprocal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from brdf.checks import Subject
from brdf.checks.directions import at_angle, row
from brdf.checks.energy import brightest
from brdf.checks.values import channels

Array = npt.NDArray[np.float64]

#: Angles of incidence of the lobes, and those of the albedo [deg].
INCIDENT = (10.0, 45.0, 75.0)
ANGLES = (*range(0, 80, 5), *range(80, 90, 2), 89.0, 89.9)
#: Steps of the outgoing angle [deg].
STEP = 0.25
#: Angles from the normal of either direction in the map of reciprocity, and azimuths between the two [deg]. Away from
#: the mirror direction and the plane of incidence, where all is symmetric.
THETA = np.arange(1.0, 90.0, 2.0)
AZIMUTHS = np.arange(0.0, 181.0, 15.0)
#: Azimuths of the first direction, on an anisotropic surface [deg].
TURNS = (0.0, 35.0, 70.0, 110.0, 145.0)
#: (float32, float64) A difference below this share of the largest value is rounding.
FLOOR = (1e-6, 1e-12)


class Ray(NamedTuple):
    """What an ideal lobe does with the light from an angle of incidence: where it sends what fraction of it."""

    incident: float
    angle: float
    weight: float


@dataclass(frozen=True)
class Portrait:
    """Angles are from the normal, signed in the plane of incidence, beyond pi / 2 below the surface [rad].

    Attributes
    ----------
    incident : array, shape (k,)
        Where light comes from, on the side of negative angles; the mirror direction is at the same angle, positive.
    outgoing : array, shape (n,)
        Where it is seen from.
    f : array, shape (k, n)
        The smooth lobes, mean of the channels [1/sr].
    rays : tuple of Ray
        The ideal lobes.
    angles : array, shape (a,)
    albedo : dict of arrays, shape (a,)
        Directional albedo of each lobe, of the channel that reflects most.
    total : array, shape (a,)
        Of all lobes together.
    theta : array, shape (t,)
    difference : array, shape (t, t), or None
        Largest ``|f(wi, wo) - f(wo, wi)| / the larger`` over the azimuth between them; None if no lobe is smooth.
    """

    incident: Array
    outgoing: Array
    f: Array
    rays: tuple[Ray, ...]
    angles: Array
    albedo: dict[str, Array]
    total: Array
    theta: Array
    difference: Array | None


def portrait(subject: Subject, seed: int = 0) -> Portrait:
    """Ask a BSDF for everything that is drawn of it."""
    reach = 180.0 if subject.transmits else 90.0
    outgoing = np.arange(STEP / 2 - reach, reach, STEP)
    f = np.array([lobe_values(subject, angle, outgoing) for angle in INCIDENT])
    rays = tuple(
        ray
        for number, part in enumerate(subject.lobes)
        if part.ideal
        for angle in INCIDENT
        for ray in ideal_rays(subject, number, angle, seed)
    )
    curves = {part.name: albedo_curve(subject, number, seed) for number, part in enumerate(subject.lobes)}
    total = albedo_curve(subject, None, seed) if len(curves) > 1 else next(iter(curves.values()))
    difference = reciprocity_map(subject) if subject.smooth else None
    incident, angles = np.radians(INCIDENT), np.radians(ANGLES)
    return Portrait(incident, np.radians(outgoing), f, rays, angles, curves, total, np.radians(THETA), difference)


def lobe_values(subject: Subject, incident: float, outgoing: Array) -> Array:
    """The smooth lobes as seen from the angles `outgoing` when light comes from `incident` [deg]; 0 if not finite."""
    if not subject.smooth:
        return np.zeros(outgoing.size)
    light = subject.vector(np.tile(at_angle(incident, 180.0)[:, None], outgoing.size))
    viewer = subject.vector(np.array([at_angle(abs(a), 0.0 if a >= 0 else 180.0) for a in outgoing]).T)
    f = np.nan_to_num(channels(subject.f(viewer, light)).mean(axis=0), nan=0, posinf=0, neginf=0)
    return np.broadcast_to(f, outgoing.shape)


def ideal_rays(subject: Subject, lobe: int, incident: float, seed: int) -> list[Ray]:
    """The directions into which one lobe sends the light from an angle of incidence [deg]."""
    u = np.random.default_rng(seed).random((3, 64))
    light = subject.vector(np.tile(at_angle(incident, 180.0)[:, None], u.shape[1]))
    drawn = subject.sample(light, subject.vector(u), lobe)
    share = channels(drawn.weight).mean(axis=0) * np.ravel(drawn.pdf)
    sent = np.ravel(drawn.ideal).astype(bool) & (share > 0) & np.isfinite(share)
    found = {}
    for index in np.flatnonzero(np.broadcast_to(sent, u.shape[1])):
        x, _, z = row(drawn.wo, int(index))
        angle = float(np.arctan2(x, z))
        found.setdefault(round(angle, 3), Ray(float(np.radians(incident)), angle, float(share[index % share.size])))
    return list(found.values())


def albedo_curve(subject: Subject, lobe: int | None, seed: int) -> Array:
    """The directional albedo of one lobe, or of all."""
    return np.array([brightest(subject, [at_angle(angle)], lobe, seed).value for angle in ANGLES])


def reciprocity_map(subject: Subject) -> Array:
    """Largest relative difference with the two directions exchanged, for each pair of angles from the normal."""
    count = THETA.size
    turns = np.array(TURNS if subject.anisotropic else (0.0,))
    ti, to, turn, between = np.meshgrid(THETA, THETA, turns, AZIMUTHS, indexing="ij")
    wi, wo = (subject.vector(spherical(t, phi)) for t, phi in ((ti, turn), (to, turn + between)))
    there, back = channels(subject.f(wi, wo)), channels(subject.adjoint(wo, wi))
    larger = np.maximum(np.abs(there), np.abs(back))
    floor = FLOOR[subject.double] * np.max(larger, initial=0.0, where=np.isfinite(larger))
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.where(larger > floor, np.abs(there - back) / larger, 0)
    relative = np.where(np.isfinite(there) & np.isfinite(back), relative, np.inf)
    return np.broadcast_to(relative.max(axis=0), ti.size).reshape(count, count, -1).max(axis=-1)


def spherical(theta: Array, phi: Array) -> Array:
    """Directions at angles in degrees, shape (3, n)."""
    t, a = np.radians(theta).ravel(), np.radians(phi).ravel()
    return np.array([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)])
