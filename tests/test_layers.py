"""What import-linter cannot say: the lowest layer imports Dr.Jit, NumPy and the standard library, and nothing else."""

import ast
import os
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]


def imported(path: Path) -> set[str]:
    """Top-level names of the absolute imports in a file, wherever in it they stand."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.add(node.module.split(".")[0])
    return found


def test_brdf_imports_drjit_numpy_and_the_standard_library() -> None:
    """And mpmath, if it is installed: for an exact answer that somebody has written in it."""
    allowed = {"drjit", "numpy", "brdf"} | sys.stdlib_module_names
    files = sorted((REPOSITORY / "brdf").rglob("*.py"))
    assert files
    found = {path.name: imported(path) - allowed for path in files if imported(path) - allowed}
    assert found == {"jet.py": {"mpmath"}, "outsider.py": {"mpmath"}}


def test_importing_brdf_loads_no_renderer() -> None:
    code = "import sys, brdf; sys.exit('mitsuba' in sys.modules or 'scipy' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    assert subprocess.run([sys.executable, "-c", code], env=environment, check=False).returncode == 0
