"""Pictures from and to files: linear RGB in arrays, whatever the file holds."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio  # noqa: N813 - as its own documentation calls it

from brdf.errors import DataError, UsageError

from .files import replacing

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
StrPath = str | os.PathLike[str]

# IEC 61966-2-1: below these the curve is a straight line of slope 12.92.
SRGB_ENCODED_KNEE = 0.04045
SRGB_LINEAR_KNEE = 0.0031308

# These hold light itself: whatever they say of a colour space, their numbers are taken as they are.
LINEAR_FORMATS = ("openexr", "hdr")

CHANNELS = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}


@dataclass(frozen=True)
class Image:
    """A picture.

    Attributes
    ----------
    rgb : float32 array, shape (height, width, 3)
        Linear red, green, blue; row 0 is the uppermost.
    alpha : float32 array, shape (height, width), or None
        Coverage, 0 to 1, where the file has it.
    decoded : str
        How `rgb` follows from the numbers in the file: ``decoded from sRGB``, ``linear as stored`` ...
    """

    rgb: Floats
    alpha: Floats | None
    decoded: str

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        return self.rgb.shape[1], self.rgb.shape[0]


def read(path: StrPath) -> Image:
    """The picture in a file, as linear RGB.

    Which curve is undone: none for EXR and HDR. Of the other formats, the one that the file names (``oiio:ColorSpace``
    linear, sRGB or a plain gamma; most files name none); else sRGB for whole numbers (8 and 16 bit) and none for
    floating point. Primaries are not converted. The colours are not multiplied by alpha nor divided by it: PNG stores
    them apart, EXR multiplied, and both arrive as stored. A camera's note that the picture lies on its side is obeyed.

    Parameters
    ----------
    path : path
        Any file that OpenImageIO reads. An EXR of several layers must have channels R, G, B, or one layer alone with
        ``<layer>.R``, ``<layer>.G``, ``<layer>.B``; of several parts with R, G, B the first is taken.

    Raises
    ------
    DataError
        The file is missing, cannot be read, or has no three channels R, G, B.
    """
    path = Path(path)
    with _Reader(path) as reader:
        part, indices, alpha = _choose(path, reader.specs)
        spec = reader.specs[part]
        pixels = reader.pixels(part)
    rgb, decoded = _decode(pixels[..., indices], spec, reader.format)
    return Image(
        np.ascontiguousarray(rgb), None if alpha is None else np.ascontiguousarray(pixels[..., alpha]), decoded
    )


def read_mask(path: StrPath, size: tuple[int, int]) -> Bools:
    """Pixels to use, shape (height, width): those where the first channel, as stored on 0 to 1, is above one half.

    Parameters
    ----------
    path : path
        Any picture; black leaves a pixel out, white keeps it.
    size : (int, int)
        Width and height that it must have [pixels].

    Raises
    ------
    DataError
        The file is missing, cannot be read, or is of another size.
    """
    path = Path(path)
    with _Reader(path) as reader:
        first = reader.pixels(0)[..., 0]
    _check_size(path, (first.shape[1], first.shape[0]), size)
    return first > 0.5


def check(image: Image, path: StrPath, size: tuple[int, int], used: Bools | None = None) -> None:
    """Raise if a target cannot be fitted. Positions are (x, y) in pixels, (0, 0) the upper left one.

    Parameters
    ----------
    image : Image
    path : path
        For the message.
    size : (int, int)
        Width and height of the camera's film [pixels].
    used : bool array, shape (height, width), optional
        Pixels that take part in the fit; the others may hold anything.

    Raises
    ------
    DataError
        Of another size, or among the pixels used: NaN, Inf, negative values, or nothing but black.
    """
    _check_size(path, image.size, size)
    rgb = image.rgb
    kept = np.ones(rgb.shape[:2], dtype=bool) if used is None else used
    for what, test in (("NaN", np.isnan), ("Inf", np.isinf), ("negative", lambda x: x < 0)):
        bad = test(rgb).any(axis=-1) & kept
        if bad.any():
            y, x = np.unravel_index(np.argmax(bad), bad.shape)
            count = int(bad.sum())
            raise DataError(
                f"{path}: {count} {'pixel is' if count == 1 else 'pixels are'} {what}, the first at x = {x}, y = {y} "
                "(from the upper left, counted from 0); expected finite values >= 0. "
                "Mend the picture or leave them out with a mask."
            )
    if kept.any() and not (rgb[kept] > 0).any():
        raise DataError(f"{path}: every pixel{'' if kept.all() else ' used'} is black; there is nothing to fit.")


def write(path: StrPath, array: npt.NDArray[Any], channels: Sequence[str] | None = None) -> None:
    """Write a picture: ``.exr`` as 32-bit floating point, losslessly packed; ``.png`` as 8 bit, encoded as sRGB.

    Parameters
    ----------
    path : path
    array : array, shape (height, width, n)
        Linear; n = 1 (Y), 3 (R, G, B) or 4 (R, G, B, A).
    channels : sequence of str, optional
        Names of the n channels, for EXR; then n may be any number.

    Raises
    ------
    UsageError
        Another ending than ``.exr`` and ``.png``.
    DataError
        The folder is missing or cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in (".exr", ".png"):
        raise UsageError(
            f"{path}: a picture is written as .exr or .png, got {kind or 'no ending'}. Name it with one of them."
        )
    height, width, n = array.shape
    pixels = np.ascontiguousarray(array, dtype=np.float32)
    if kind == ".png":
        pixels = np.concatenate([to_srgb(pixels[..., :3]), np.clip(pixels[..., 3:], 0, 1)], axis=-1)
        pixels = np.round(255 * pixels).astype(np.uint8)
    spec = oiio.ImageSpec(width, height, n, "uint8" if kind == ".png" else "float")
    spec.channelnames = tuple(channels or CHANNELS[n])
    spec.attribute("compression", "zip")
    if kind == ".png":
        spec.attribute("oiio:ColorSpace", "sRGB")
        spec.attribute("oiio:UnassociatedAlpha", 1)
    with replacing(path) as temporary:
        output = oiio.ImageOutput.create(str(temporary))
        if not (output and output.open(str(temporary), spec) and output.write_image(pixels) and output.close()):
            reason = output.geterror() if output else oiio.geterror()
            raise DataError(f"{path}: cannot be written: {_one_line(reason)}.")


def to_srgb(rgb: npt.NDArray[Any]) -> Floats:
    """Linear values to sRGB's, clipped to 0 to 1 (IEC 61966-2-1); NaN becomes 0."""
    x = np.clip(np.nan_to_num(np.asarray(rgb, dtype=np.float32), nan=0.0, posinf=1.0, neginf=0.0), 0, 1)
    curve = 1.055 * np.maximum(x, SRGB_LINEAR_KNEE) ** (1 / 2.4) - 0.055
    return np.where(x <= SRGB_LINEAR_KNEE, 12.92 * x, curve).astype(np.float32)


def from_srgb(rgb: npt.NDArray[Any]) -> Floats:
    """sRGB's values, 0 to 1, to linear (IEC 61966-2-1)."""
    x = np.asarray(rgb, dtype=np.float32)
    curve = ((np.maximum(x, SRGB_ENCODED_KNEE) + 0.055) / 1.055) ** 2.4
    return np.where(x <= SRGB_ENCODED_KNEE, x / 12.92, curve).astype(np.float32)


class _Reader:
    """One open picture file: the header of each part, and pixels on demand."""

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise DataError(
                f"{path}: there is no such picture. Check the name; a relative one starts from the folder you are in."
            )
        if path.is_dir():
            raise DataError(f"{path}: is a folder, expected a picture.")
        self.path = path
        as_stored = oiio.ImageSpec()
        as_stored.attribute("oiio:UnassociatedAlpha", 1)
        opened = oiio.ImageInput.open(str(path), as_stored)
        if opened is None:
            raise self.unreadable(oiio.geterror())
        self.input = opened
        self.format: str = self.input.format_name()
        self.specs: list[Any] = []
        while self.input.seek_subimage(len(self.specs), 0):
            self.specs.append(self.input.spec())
        self.input.geterror()  # running past the last part is not an error

    def __enter__(self) -> _Reader:
        return self

    def __exit__(self, *_: object) -> None:
        self.input.close()

    def pixels(self, part: int) -> Floats:
        """Shape (height, width, channels); whole numbers on 0 to 1; upright."""
        spec = self.specs[part]
        if spec.deep or spec.depth > 1:
            raise self.unreadable("it is deep or a volume, not a flat picture")
        pixels = self.input.read_image(part, 0, 0, spec.nchannels, "float")
        if pixels is None or self.input.has_error:
            raise self.unreadable(self.input.geterror())
        turn = spec.get_int_attribute("Orientation", 1)  # as in TIFF and EXIF
        if turn >= 5:
            pixels = pixels.swapaxes(0, 1)
        if turn in (2, 3, 6, 7):
            pixels = pixels[:, ::-1]
        if turn in (3, 4, 7, 8):
            pixels = pixels[::-1]
        return pixels

    def unreadable(self, reason: str) -> DataError:
        return DataError(
            f"{self.path}: cannot be read as a picture: {_one_line(reason) or 'unknown reason'}. "
            "Give a whole file in a format that OpenImageIO reads (EXR, HDR, PNG, JPEG, TIFF ...)."
        )


def _choose(path: Path, specs: list[Any]) -> tuple[int, list[int], int | None]:
    """Part, places of R, G, B and place of A, or None."""
    found: dict[tuple[str, int], dict[str, int]] = {}
    for part, spec in enumerate(specs):
        for place, channel in enumerate(spec.channelnames):
            layer, _, name = channel.rpartition(".")
            found.setdefault((layer, part), {})[name.upper()] = place
    coloured = {key: places for key, places in found.items() if places.keys() >= set("RGB")}
    plain = [key for key in coloured if key[0] == ""]
    if not plain and len(coloured) != 1:
        names = [channel for spec in specs for channel in spec.channelnames]
        listed = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
        raise DataError(
            f"{path}: got {len(names)} channel{'' if len(names) == 1 else 's'} ({listed}), expected 3: R, G, B, "
            "or one layer with .R, .G, .B. Convert the picture to RGB."
        )
    key = plain[0] if plain else next(iter(coloured))
    places = coloured[key]
    return key[1], [places[c] for c in "RGB"], places.get("A")


def _decode(rgb: Floats, spec: Any, file_format: str) -> tuple[Floats, str]:
    """Linear values, and the words for what was done."""
    space = spec.get_string_attribute("oiio:ColorSpace").lower()
    gamma = re.match(r"g(\d)(\d)_", space)
    whole = spec.format.basetype not in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)
    if file_format in LINEAR_FORMATS or space.startswith("lin") or not (whole or gamma or space.startswith("srgb")):
        return rgb, "linear as stored"
    if gamma:
        exponent = float(f"{gamma[1]}.{gamma[2]}")
        return rgb**exponent, f"decoded from a gamma of {exponent}"
    return from_srgb(rgb), "decoded from sRGB"


def _check_size(path: StrPath, got: tuple[int, int], expected: tuple[int, int]) -> None:
    if got != tuple(expected):
        raise DataError(
            f"{path}: got {got[0]} x {got[1]} pixels (width x height), expected {expected[0]} x {expected[1]}, "
            "the size of the camera's film. Resize the picture or change the film."
        )


def _one_line(text: str) -> str:
    return "; ".join(line.strip() for line in text.splitlines() if line.strip()).rstrip(".")
