"""Targets and cameras, ready for a fit: pictures checked, pixels chosen."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from brdf.errors import DataError, UsageError
from plugins.scene import Scene

from . import images, pixels
from .parameters import Free

Target = str | os.PathLike[str] | npt.NDArray[np.floating]
Bools = npt.NDArray[np.bool_]

#: Alpha from which a pixel counts as covered.
OPAQUE = 0.999


@dataclass(frozen=True)
class Prepared:
    """One camera with its target.

    Attributes
    ----------
    name : str
        Id of the sensor.
    path : str
        The target's file, or "(array)".
    target : float32 array, shape (height, width, 3)
        Linear RGB; 0 in the pixels that are not used.
    used : bool array, shape (height, width)
    groups : list of (mi.BSDF, int array)
        What ``shape.bsdf()`` gives where a fitted material is, and the flat indices of the pixels that see it alone.
    remarks : tuple of str
        What was done to the picture, what was left out.
    """

    name: str
    sensor: mi.Sensor
    path: str
    target: npt.NDArray[np.float32]
    used: Bools
    groups: list[tuple[mi.BSDF, npt.NDArray[np.int64]]]
    remarks: tuple[str, ...]


def prepare(
    scene: Scene, targets: Mapping[str, Target], masks: Mapping[str, Target], free: list[Free]
) -> list[Prepared]:
    """Read the targets and choose the pixels.

    Raises
    ------
    UsageError
        No target, or no sensor of that name.
    DataError
        A picture that cannot be used (see `images.check`), or in which no pixel shows a fitted material.
    """
    if not targets:
        raise UsageError(
            f"no target: give a picture for a sensor, as in --target {next(iter(scene.sensors), 'camera')}=photo.exr."
        )
    for kind, names in (("target", targets), ("mask", masks)):
        for name in names:
            if name not in scene.sensors:
                raise UsageError(
                    f"{kind} {name}: the scene has no such sensor. It has: {', '.join(scene.sensors) or 'none'}."
                )
    for name in masks:
        if name not in targets:
            raise UsageError(f"mask {name}: there is no target for that sensor.")
    parents = {pixels.index_of(p): p for f in free for p in f.material.parents}
    return [one(scene, name, target, masks.get(name), parents) for name, target in targets.items()]


def one(scene: Scene, name: str, target: Target, mask: Target | None, parents: dict[int, mi.BSDF]) -> Prepared:
    """A single view."""
    sensor = scene.sensors[name]
    size = pixels.film_size(sensor)
    image, path = read(target)
    remarks = []
    allowed = np.ones(image.rgb.shape[:2], dtype=bool)
    if image.alpha is not None:
        allowed &= image.alpha >= OPAQUE
    if mask is not None and image.size == size:
        given = mask_of(mask, size)
        allowed &= given
    images.check(image, path, size, allowed)
    if "sRGB" in image.decoded or "gamma" in image.decoded:
        clipped = (image.rgb >= 1.0).any(axis=-1)
        if (clipped & allowed).any():
            remarks.append(
                f"{name}: {int((clipped & allowed).sum())} pixels at the top of the picture's range were left out."
            )
        allowed &= ~clipped
        remarks.append(f"{name}: {image.decoded}.")
    if not allowed.any():
        raise DataError(
            f"{path}: every pixel is masked. Leave at least the fitted material unmasked (white in the mask)."
        )
    inside = pixels.interior(pixels.content(scene.scene, sensor), sensor)
    flat = np.where(allowed, inside, -1).ravel()
    groups = [(bsdf, np.flatnonzero(flat == index)) for index, bsdf in parents.items()]
    groups = [(bsdf, where) for bsdf, where in groups if len(where)]
    if not groups:
        seen = np.isin(inside, list(parents)).any()
        why = (
            "they are all masked" if seen else "none is in view, or it is too small to have pixels away from its edges"
        )
        raise DataError(f"{path}: no pixel of sensor {name} shows a fitted material alone: {why}.")
    used = np.zeros(allowed.size, dtype=bool)
    used[np.concatenate([where for _, where in groups])] = True
    used = used.reshape(allowed.shape)
    if not (image.rgb[used] > 0).any():
        raise DataError(f"{path}: every pixel that shows a fitted material is black; there is nothing to fit.")
    rgb = np.where(np.isfinite(image.rgb), image.rgb, 0).astype(np.float32)
    return Prepared(name, sensor, path, rgb, used, groups, tuple(remarks))


def read(target: Target) -> tuple[images.Image, str]:
    """A target from a file or an array, and its name."""
    if isinstance(target, str | os.PathLike):
        return images.read(target), os.fspath(target)
    array = np.asarray(target, dtype=np.float32)
    if array.ndim != 3 or array.shape[2] not in (3, 4):
        raise DataError(f"the target has the shape {array.shape}, expected (height, width, 3), or 4 with alpha.")
    alpha = array[..., 3] if array.shape[2] == 4 else None
    return images.Image(array[..., :3], alpha, "linear as given"), "(array)"


def mask_of(mask: Target, size: tuple[int, int]) -> Bools:
    """A mask from a file or an array, shape (height, width)."""
    if isinstance(mask, str | os.PathLike):
        return images.read_mask(mask, size)
    array = np.asarray(mask)
    array = array[..., 0] if array.ndim == 3 else array
    if array.shape != (size[1], size[0]):
        raise DataError(f"the mask has the shape {array.shape}, expected {(size[1], size[0])}.")
    return array > 0.5
