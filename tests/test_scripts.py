"""The scripts that make pictures and tables: `--help` and a slip of the keys are answered, and no job starts."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
SCRIPTS = sorted(f"docs/{path.name}" for path in (REPOSITORY / "docs").glob("*.py"))
MODULES = ["fitting.examples.make", "plugins.scenes.stress", "tests.bench.price", "tests.oracles.table"]


@pytest.mark.parametrize("script", [*SCRIPTS, *MODULES])
def test_help_and_an_unknown_option(script: str, tmp_path: Path) -> None:
    command = [sys.executable, str(REPOSITORY / script)] if script in SCRIPTS else [sys.executable, "-m", script]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "COLUMNS": "200"}
    for option, code in (("--help", 0), ("--hlep", 2)):
        run = subprocess.run(
            [*command, option], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert run.returncode == code, run.stderr
        assert (run.stdout if code == 0 else run.stderr).startswith("usage: ")
        assert code == 0 or (run.stdout == "" and f"unrecognized arguments: {option}" in run.stderr)
    assert not any(tmp_path.iterdir())
