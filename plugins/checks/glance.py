"""Reciprocity and energy of any BSDF in Mitsuba: ours, Mitsuba's own, and what is nested in `twosided` or a blend."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from brdf import UsageError
from brdf.checks.directions import ANGLES, hemisphere, near_mirror
from brdf.checks.energy import BATCHES, stratified, summarise
from brdf.checks.reciprocity import reciprocity
from brdf.checks.values import channels

#: Pairs of directions whose exchange is tried.
PAIRS = 100_000
#: Values below this share of the largest are noise of float32 beside a sharp lobe, and are left out of reciprocity.
FLOOR = 1e-6
#: Each of 16 batches of directions has this many, squared.
SIDE = 32


class Glance(NamedTuple):
    """What was found.

    ``reciprocity_max`` is the largest ``|f(wi,wo) - f(wo,wi)| / max`` of the two; ``albedo_max`` the largest
    directional albedo of any channel, ``albedo_sd`` its standard error, and ``albedo_angle`` [rad] the angle from the
    normal where it is found.
    """

    reciprocity_max: float
    albedo_max: float
    albedo_sd: float
    albedo_angle: float


def glance(bsdf: mi.BSDF, seed: int = 0) -> Glance:
    """Try a BSDF on its reflecting side, at the middle of its textures.

    Reciprocity: ``eval / cos`` of random pairs and of the same pairs exchanged. Energy: the mean of what `sample`
    weighs, over reflected and transmitted directions.

    Parameters
    ----------
    bsdf : mi.BSDF
    seed : int
        Of the random directions.

    Raises
    ------
    UsageError
        In a scalar variant.
    """
    if not dr.is_jit_v(mi.Float):
        raise UsageError(
            f"check: the variant {mi.variant()} has no arrays. Set llvm_ad_rgb, or another llvm or cuda variant."
        )
    rng = np.random.default_rng(seed)
    wi = hemisphere(PAIRS, rng)
    wo = np.where(np.arange(PAIRS) % 2 == 0, hemisphere(PAIRS, rng), near_mirror(wi, rng))
    up = wo[2] > 0
    # Not radiance, which is compressed on the way into a denser medium.
    context = mi.BSDFContext(mi.TransportMode.Importance)

    def f(i: mi.Vector3f, o: mi.Vector3f) -> Any:
        return bsdf.eval(context, interaction(i), o) / o.z

    difference, _ = reciprocity(f, mi.Vector3f(wi[:, up]), mi.Vector3f(wo[:, up]), FLOOR)

    angles = np.radians(ANGLES)
    n = BATCHES * SIDE * SIDE
    u = [mi.Float(row) for row in np.tile(stratified(SIDE, BATCHES, seed), len(angles))]
    across, along = (mi.Float(np.repeat(a, n)) for a in (np.sin(angles), np.cos(angles)))
    _, weight = bsdf.sample(context, interaction(mi.Vector3f(across, 0, along)), u[2], mi.Point2f(u[0], u[1]))
    weights = np.broadcast_to(channels(weight), (dr.size_v(weight), n * len(angles)))
    found = [summarise(w.reshape(len(w), BATCHES, -1)) for w in np.split(weights, len(angles), axis=1)]
    worst = max(range(len(found)), key=lambda i: found[i][0] if math.isfinite(found[i][0]) else math.inf)
    return Glance(difference, *found[worst], float(angles[worst]))


def interaction(wi: mi.Vector3f) -> mi.SurfaceInteraction3f:
    """A hit seen from `wi`, at the middle of the texture."""
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(wi))
    si.wi = wi
    si.uv = mi.Point2f(0.5)
    si.n = mi.Normal3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(si.n)
    if mi.is_spectral:
        si.wavelengths = mi.Spectrum(450, 520, 590, 660)
    return si
