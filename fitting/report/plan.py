"""The page of ``brdf plan``: the lecture's table for a scene, a small picture in each cell, all on one scale."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from plugins.effects.pilot import white_of
from plugins.effects.table import ABOUT, CELLS, COLUMNS, EMITTER, ROWS

from ..files import replacing
from ..images import to_srgb
from .page import ENVIRONMENT, minus
from .pictures import eight_bit, png


@dataclass(frozen=True)
class Shown:
    """A cell as the page shows it; `picture` is a PNG data URI, empty if the cell is not called for."""

    name: str
    about: str
    picture: str
    called_for: bool
    easy: bool
    why: str
    technique: str
    share: str
    time: str
    error: str


def write(plan: Mapping[str, Any], layers: Mapping[str, npt.NDArray[Any]], path: str | os.PathLike[str]) -> None:
    """Write the page to `path`, one HTML file that needs no other.

    Parameters
    ----------
    plan : dict
        What ``brdf plan --json`` prints, with or without a pilot.
    layers : dict of array, shape (height, width, 3)
        The light of each cell, linear RGB; they add up to the picture.

    Raises
    ------
    DataError
        The folder is missing or cannot be written.
    """
    text = html(plan, layers)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def html(plan: Mapping[str, Any], layers: Mapping[str, npt.NDArray[Any]]) -> str:
    """The whole page."""
    white = white_of(layers)
    cells = {name: shown(name, plan["cells"][name], layers.get(name), white) for name in CELLS}
    return ENVIRONMENT.get_template("plan.html").render(
        title=Path(plan["scene"]).name,
        depth=plan["max_depth"],
        rows=ROWS,
        columns=COLUMNS,
        cells=cells,
        emitter=EMITTER,
        whole=picture(np.sum(list(layers.values()), axis=0), white),
        size=next(iter(layers.values())).shape[:2],
        white=f"{white:.3g}",
        pilot=plan["pilot"],
        called=sum(cell.called_for for cell in cells.values()),
        classic=all(cell.easy for cell in cells.values() if cell.called_for),
    )


def shown(name: str, cell: Mapping[str, Any], layer: npt.NDArray[Any] | None, white: float) -> Shown:
    """A cell as text and picture."""
    return Shown(
        name=name,
        about=ABOUT[name],
        picture=picture(layer, white) if cell["called_for"] and layer is not None else "",
        called_for=cell["called_for"],
        easy=cell["easy"],
        why=cell["why"],
        technique=cell["technique"] or "",
        share=percent(cell["share"], cell["share_se"]),
        time=percent(cell["time"]),
        error=percent(cell["drop_error"], cell["drop_error_se"]),
    )


def picture(light: npt.NDArray[Any], white: float) -> str:
    """A PNG data URI, with `white` as white."""
    return png(eight_bit(to_srgb(np.asarray(light) / white)))


def percent(value: float | None, se: float | None = None) -> str:
    """``12.3 ± 0.4 %``; nothing for what is not known."""
    if value is None:
        return ""
    return minus(f"{100 * value:.1f}") + (f" ± {100 * se:.1f}" if se is not None else "") + " %"
