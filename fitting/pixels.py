"""Which pixels of a picture a fit may use: those that see one fitted material and nothing else."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt
from scipy import ndimage

#: Rays along each side of a pixel with which its content is found.
PROBES = 4
#: Points of the lens, as a sensor takes them in the unit square, through which each is sent: the middle, and the rim.
LENS = ((0.5, 0.5), (0.0, 0.5), (1.0, 0.5), (0.5, 0.0), (0.5, 1.0))


def film_size(sensor: mi.Sensor) -> tuple[int, int]:
    """(width, height) of the picture a sensor makes [pixels]."""
    width, height = sensor.film().crop_size()
    return int(width), int(height)


def rays(sensor: mi.Sensor, position: mi.Point2f, aperture: mi.Point2f | None = None) -> Any:
    """Camera rays through film positions in pixels (of the cropped film)."""
    width, height = film_size(sensor)
    at = mi.Point2f(position.x / width, position.y / height)
    middle = mi.Point2f(0.5, 0.5) if aperture is None else aperture
    return sensor.sample_ray(sensor.shutter_open(), 0.5, at, middle)


def content(scene: mi.Scene, sensor: mi.Sensor) -> npt.NDArray[np.int64]:
    """The index of the one BSDF that all probe rays of a pixel meet, shape (height, width); -1: several, or none.

    Indices are Dr.Jit's instance ids of ``shape.bsdf()``: see `index_of`.
    """
    width, height = film_size(sensor)
    n = width * height * PROBES**2
    i = dr.arange(mi.UInt32, n)
    probe, pixel = i % PROBES**2, i // PROBES**2
    # Probes on the borders of the pixel as well: an edge that only touches it counts.
    dx = mi.Float(probe % PROBES) / (PROBES - 1)
    dy = mi.Float(probe // PROBES) / (PROBES - 1)
    position = mi.Point2f(mi.Float(pixel % width) + dx, mi.Float(pixel // width) + dy)
    seen = []
    for point in LENS if sensor.needs_aperture_sample() else LENS[:1]:
        ray, _ = rays(sensor, position, mi.Point2f(*point))
        si = scene.ray_intersect(ray)
        met = dr.reinterpret_array(mi.UInt32, si.bsdf())
        seen.append(np.array(dr.select(si.is_valid(), met, 0)).reshape(height, width, PROBES**2).astype(np.int64))
    ids = np.concatenate(seen, axis=2)
    same = (ids == ids[..., :1]).all(axis=-1) & (ids[..., 0] > 0)
    return np.where(same, ids[..., 0], -1)


def index_of(bsdf: mi.BSDF) -> int:
    """Dr.Jit's instance id of a BSDF."""
    number: Any = dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(bsdf))
    return int(number[0])


def interior(ids: npt.NDArray[np.int64], sensor: mi.Sensor) -> npt.NDArray[np.int64]:
    """`content` eroded by the film's reconstruction filter: -1 where its support reaches other pixels' content.

    A pixel at an edge is a mixture that no reflection model explains; one such ring biases m by its whole error bar.
    """
    reach = 2 * max(1, math.ceil(sensor.film().rfilter().radius())) + 1
    low = ndimage.minimum_filter(ids, reach, mode="nearest")
    high = ndimage.maximum_filter(ids, reach, mode="nearest")
    return np.where(low == high, ids, -1)
