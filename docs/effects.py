"""Print what simulating only what a scene calls for is worth: ``.venv/bin/python docs/effects.py --price``."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent.parent)]

from tests.bench import effects  # noqa: E402  (the path first)

if __name__ == "__main__":
    if sys.argv[1:] != ["--price"]:
        raise SystemExit(__doc__)
    print(effects.table())
