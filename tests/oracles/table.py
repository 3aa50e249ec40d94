"""Make the tables of exact answers that come with the package: ``python -m tests.oracles.table [FORMULA ...]``.

Without a name: all of them, in some 20 minutes on two cores. Names are those of `brdf.hard.FORMULAS`, or their beginnings.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import brdf.hard
from brdf.hard import FORMULAS, Exact, Formula, table
from tests.oracles.exact import exact

SEED, POINTS = 1, 2000
#: An answer beyond this has no float32 to stand for it: the point is left out, and another drawn.
LARGEST = 1e36
#: Drawn for a thousand that are kept.
SPARE = 1.2


def answers(formula: Formula, seed: int = SEED, points: int = POINTS) -> Exact:
    """The exact answers at the first points drawn with a seed whose answers are numbers in float32."""
    found = exact(formula, formula.draw(seed, int(points * SPARE)))
    fits = (np.abs(found.value) < LARGEST) & np.all(np.abs(found.slope) < LARGEST, axis=0)
    return found.some(np.flatnonzero(fits)[:points])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="FORMULA")
    names = parser.parse_args().names
    folder = Path(brdf.hard.__file__).parent / table.FOLDER
    folder.mkdir(exist_ok=True)
    for formula in FORMULAS.values():
        if names and not any(formula.name.startswith(name) for name in names):
            continue
        start = time.monotonic()
        found = answers(formula)
        path = folder / f"{table.file_name(formula.name)}.npz"
        found.write(path)
        print(
            f"{formula.name}: {len(found)} points, {time.monotonic() - start:.0f} s, {path.stat().st_size / 1e3:.0f} kB"
        )


if __name__ == "__main__":
    main()
