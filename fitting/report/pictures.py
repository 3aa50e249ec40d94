"""The pictures of a report: target and render at one exposure, and the error between them, as PNG data URIs."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.image import imsave

from ..images import to_srgb
from ..solution import View

Floats = npt.NDArray[np.float64]
Bytes = npt.NDArray[np.uint8]

#: Luminance of linear RGB with the primaries of Rec. 709.
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
#: Percentile of the target that is shown white. The maximum would leave all but the highlight black.
WHITE_PERCENTILE = 99.0
#: The error is relative to the target, but to no less than this fraction of white: in the dark there is mostly noise.
ERROR_FLOOR = 0.05
#: Percentile of the absolute error at which the colours of the error end.
ERROR_PERCENTILE = 99.0
#: Blue: the render is darker; red: it is brighter. Told apart also without red and green cones.
ERROR_COLOURS = matplotlib.colormaps["RdBu_r"]
#: Two greys of the hatching of pixels left out.
HATCH = (np.uint8(150), np.uint8(182))


@dataclass(frozen=True)
class Shown:
    """A view as it appears: three PNG data URIs and what is said about them.

    Attributes
    ----------
    target, render, error : str
    white : float
        Linear value that is shown white in target and render.
    shrink : int
        Side of the blocks of pixels that one pixel shown is the mean of.
    """

    view: View
    target: str
    render: str
    error: str
    white: float
    shrink: int

    @property
    def width(self) -> int:
        return self.view.target.shape[1]

    @property
    def height(self) -> int:
        return self.view.target.shape[0]

    @property
    def pixels(self) -> int:
        return int(self.view.used.sum())


def show(views: Sequence[View], largest: int) -> tuple[list[Shown], float]:
    """All views, at most `largest` pixels wide and high, and the relative error at which the colours end."""
    whites = [white_of(view) for view in views]
    errors = [relative_error(view, white) for view, white in zip(views, whites, strict=True)]
    limit = error_limit(errors, [view.used for view in views])
    shown = []
    for view, white, error in zip(views, whites, errors, strict=True):
        shrink = max(1, -(-max(view.used.shape) // largest))
        target, render = (
            png(eight_bit(to_srgb(shrunk(np.nan_to_num(p, nan=0, posinf=0, neginf=0), shrink) / white)))
            for p in (view.target, view.render)
        )
        colours = error_colours(shrunk(error, shrink), shrunk(view.used, shrink) > 0.5, limit)
        shown.append(Shown(view, target, render, png(colours), white, shrink))
    return shown, limit


def white_of(view: View) -> float:
    """The target's `WHITE_PERCENTILE`, of the largest channel, over the pixels used."""
    kept = view.used if view.used.any() else np.ones_like(view.used)
    brightest = np.nan_to_num(view.target, nan=0, posinf=0, neginf=0).max(axis=-1)[kept]
    return next((float(x) for x in (np.percentile(brightest, WHITE_PERCENTILE), brightest.max()) if x > 0), 1.0)


def relative_error(view: View, white: float) -> Floats:
    """``(Y_render - Y_target) / max(Y_target, ERROR_FLOOR white)``, with the luminance Y; 0 where it is not finite."""
    with np.errstate(invalid="ignore"):
        target, render = view.target @ LUMINANCE, view.render @ LUMINANCE
        error = (render - target) / np.maximum(target, ERROR_FLOOR * white)
    return np.nan_to_num(error, nan=0, posinf=0, neginf=0)


def error_limit(errors: Sequence[Floats], used: Sequence[npt.NDArray[np.bool_]]) -> float:
    """A round number that `ERROR_PERCENTILE` of the pixels used stay below."""
    sizes = np.concatenate([np.abs(error)[kept] for error, kept in zip(errors, used, strict=True)] or [np.zeros(0)])
    return round_up(float(np.percentile(sizes, ERROR_PERCENTILE))) if sizes.size else 1.0


def round_up(x: float) -> float:
    """The next of ..., 0.1, 0.2, 0.5, 1, 2, 5, ...; 1e-6 for anything less."""
    decade = 10.0 ** np.floor(np.log10(max(x, 1e-6)))
    return float(f"{next(k * decade for k in (1, 2, 5, 10) if k * decade * (1 + 1e-9) >= x):.0e}")


def error_colours(error: Floats, used: npt.NDArray[np.bool_], limit: float) -> Bytes:
    """Colours of a signed error, those of pixels left out hatched in grey."""
    height, width = used.shape
    colours = eight_bit(ERROR_COLOURS(0.5 + 0.5 * np.clip(error / limit, -1, 1))[..., :3])
    stripe = max(1, round(max(height, width) / 80))
    dark = np.add.outer(np.arange(height), np.arange(width)) // stripe % 4 == 0
    hatch = np.where(dark, *HATCH)[..., None]
    return np.where(used[..., None], colours, hatch)


def colour_bar() -> str:
    """The colours of the error from left to right, a PNG data URI."""
    return png(eight_bit(ERROR_COLOURS(np.linspace(0, 1, 256))[None, :, :3]))


def shrunk(array: npt.NDArray[Any], by: int) -> Floats:
    """Means of blocks of `by` times `by` pixels; what is left over at the right and below is cut off."""
    if by == 1:
        return np.asarray(array, dtype=np.float64)
    height, width = (n // by * by for n in array.shape[:2])
    blocks = array[:height, :width].reshape(height // by, by, width // by, by, *array.shape[2:])
    return blocks.mean(axis=(1, 3), dtype=np.float64)


def eight_bit(x: npt.NDArray[Any]) -> Bytes:
    """0 to 1 as 0 to 255."""
    return np.round(255 * x).astype(np.uint8)


def png(pixels: Bytes) -> str:
    """A data URI."""
    buffer = io.BytesIO()
    imsave(buffer, np.ascontiguousarray(pixels), format="png")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
