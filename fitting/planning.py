"""What ``brdf plan`` finds: the lecture's table for a scene, and with a pilot what each cell is worth."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from brdf.errors import UsageError
from plugins.effects import inventory, pilot, table
from plugins.scene import Scene

from .method import depth_of

#: The pictures of the page: longer side [pixels], samples a pixel.
PICTURE_SIZE, PICTURE_SPP = 160, 64
#: Longer side of the pictures that are timed [pixels]. With those of the pilot most of the time goes into Python.
TIMED_SIZE = 128
#: Samples of a picture from which a pilot costs little beside it: it takes up to a second, most of it to compile.
PILOT_PAYS = 2**23
Layers = Mapping[str, npt.NDArray[Any]]


def static(loaded: Scene) -> dict[str, Any]:
    """The table from what is in the scene alone, as ``brdf plan --json`` prints it.

    Raises
    ------
    DataError
        The scene has a participating medium.
    """
    integrator: Any = loaded.scene.integrator()
    depth = None if integrator is None else depth_of(integrator)
    depth = -1 if depth is None else depth
    hide = bool(getattr(integrator, "hide_emitters", False))
    cells = table.plan(loaded.scene, depth, hide_emitters=hide)
    unknown = dict.fromkeys(("share", "share_se", "time", "drop_error", "drop_error_se"))
    return {
        "scene": str(loaded.path),
        "max_depth": depth,
        "cells": {
            name: {
                "called_for": cell.called_for,
                "why": cell.why,
                "technique": cell.technique or None,
                "easy": cell.easy,
                **unknown,
            }
            for name, cell in cells.items()
        },
        "pilot": None,
    }


def measured(
    plan: dict[str, Any],
    scene: mi.Scene,
    layers: Callable[[mi.Scene, int, int, int], Layers],
    seconds: Callable[[frozenset[str]], float],
    seed: int,
) -> dict[str, Any]:
    """The same with the shares, times and errors of a pilot.

    Parameters
    ----------
    layers : function
        As `pilot.run` takes it.
    seconds : function
        As `pilot.times` takes it.
    """
    start = time.perf_counter()
    found = pilot.run(layers, scene, seed=seed)
    light = pilot.shares(found)
    called = [name for name, cell in plan["cells"].items() if cell["called_for"]]
    spent = pilot.times(seconds, called) if called else {}
    cells = {}
    for name, cell in plan["cells"].items():
        share, error = light[name], pilot.drop_error(found, {name})
        cells[name] = {
            **cell,
            "share": share.value,
            "share_se": share.se,
            "time": spent.get(name, 0.0),
            "drop_error": error.value,
            "drop_error_se": error.se,
        }
    about = {
        "runs": found.runs,
        "size": pilot.SIZE,
        "spp": pilot.SPP,
        "seed": seed,
        "white": found.white,
        "seconds": time.perf_counter() - start,
    }
    return {**plan, "cells": cells, "pilot": about}


def calls(plan: dict[str, Any]) -> int:
    """How often `measured` calls one of its functions."""
    called = sum(cell["called_for"] for cell in plan["cells"].values())
    return pilot.RUNS + (pilot.REPEATS + 1) * (called + 1 if called > 1 else called)


def effects(loaded: Scene, max_depth: int) -> dict[str, Any]:
    """The integrator `effects` for `mi.load_dict`, that ends paths and hides lamps as the scene's own does."""
    settings = {"type": "effects", "max_depth": max_depth}
    if getattr(loaded.scene.integrator(), "hide_emitters", False):
        settings["hide_emitters"] = True
    return settings


def choose(
    loaded: Scene, sensor: mi.Sensor, asked: str, tolerance: float, samples: int, seed: int
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The cells that are to be rendered, and what leaving out the others costs.

    Cells that the scene does not call for are zero and switched off. Of the others, ``auto`` leaves out what a pilot
    finds to be worth less than the tolerance together, where the picture is so large that a pilot pays.

    Parameters
    ----------
    asked : str
        As `table.parse` takes it.
    tolerance : float
        Of `pilot.droppable`; 0: none.
    samples : int
        Pixels times samples of the picture.

    Returns
    -------
    dict, dict
        The integrator for `mi.load_dict`; and for the report: the cells ``rendered``, ``left_out`` by what was asked
        for, ``dropped`` by the pilot, and the predicted ``error`` of both with its standard error ``error_se``, None if
        nothing that is called for is missing; ``white`` is the radiance that counts as white in it.

    Raises
    ------
    UsageError
        Nothing that is asked for is called for.
    """
    plan = static(loaded)
    settings = effects(loaded, plan["max_depth"])
    called = frozenset(name for name, cell in plan["cells"].items() if cell["called_for"])
    kept = table.parse(asked) & called
    if called and not kept:
        raise UsageError(f"the scene calls for none of these cells. It calls for: {', '.join(in_order(called))}.")
    missing, dropped, error, white = called - kept, frozenset[str](), None, None
    optional = asked == "auto" and tolerance > 0 and samples >= PILOT_PAYS
    if missing or optional:
        layers, _ = with_effects(loaded, sensor, plan)
        found = pilot.run(layers, loaded.scene, seed=seed)
        white = found.white
        if optional:
            dropped = pilot.droppable(found, tolerance, inventory.take(loaded.scene).caustics).cells & kept
        if missing | dropped:
            error = pilot.drop_error(found, missing | dropped)
    settings["cells"] = ",".join(in_order(kept - dropped)) or "all"  # of a scene without light: a black picture
    about = {
        "rendered": in_order(kept - dropped),
        "left_out": in_order(missing),
        "dropped": in_order(dropped),
        "error": None if error is None else error.value,
        "error_se": None if error is None else error.se,
        "white": white,
    }
    return settings, about


def by_cell(layers: Layers) -> dict[str, npt.NDArray[Any]]:
    """The layers of the cells; the parts of what mirrors show are added up."""
    out: dict[str, npt.NDArray[Any]] = {}
    for name, y in layers.items():
        cell = name.split("/")[0]
        out[cell] = out[cell] + y if cell in out else y
    return out


def in_order(cells: frozenset[str]) -> list[str]:
    """Cells as a list, in the order of the table."""
    return [name for name in table.CELLS if name in cells]


def with_effects(
    loaded: Scene, sensor: mi.Sensor, plan: dict[str, Any]
) -> tuple[Callable[[mi.Scene, int, int, int], Layers], Callable[[frozenset[str]], float]]:
    """`layers` and `seconds` for `measured`, by the integrator `effects`."""
    settings = effects(loaded, plan["max_depth"])
    some: dict[frozenset[str], Any] = {}

    def seconds(cells: frozenset[str]) -> float:
        if cells not in some:
            some[cells] = mi.load_dict({**settings, "cells": ",".join(sorted(cells))})
        with pilot.shrunk(sensor, TIMED_SIZE):
            start = time.perf_counter()
            np.array(mi.render(loaded.scene, sensor=sensor, integrator=some[cells], spp=pilot.SPP))
            return time.perf_counter() - start

    return pilot.rendered(mi.load_dict({**settings, "layers": True, "parts": True}), sensor), seconds
