"""``brdf doctor``: what the machine offers, and whether a kernel runs."""

from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from brdf import llvm
from brdf.errors import NoBackend

from .output import Json, print_json

PACKAGES = ("brdf-fitting", "mitsuba", "drjit", "numpy", "scipy", "OpenImageIO")

#: Seconds after which a kernel that does not finish is given up.
KERNEL_TIMEOUT = 300

KERNEL = """
import json, time
import drjit as dr
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
start = time.perf_counter()
x = dr.arange(mi.Float, 1000) - 500
least = dr.sum(dr.minimum(dr.maximum(x, -2), 3))
value = float(least[0])
print(json.dumps({"value": value, "seconds": time.perf_counter() - start, "threads": dr.thread_count()}))
"""
"""Minimum and maximum are what an old LLVM cannot compile."""

#: Of -500 ... 499, 499 numbers are raised to -2 and 497 lowered to 3.
KERNEL_VALUE = 499 * -2 + (-1 + 0 + 1 + 2) + 497 * 3


def command(as_json: Json = False) -> int:
    """Report Python, Mitsuba, Dr.Jit, libLLVM and the kernel cache, and run one kernel in a child process."""
    report = examine()
    if as_json:
        print_json(report)
    else:
        print("\n".join(lines(report)))
    return 0 if report["ok"] else NoBackend.exit_code


def examine() -> dict[str, Any]:
    """Everything that ``brdf doctor`` says, as plain values."""
    chosen = llvm.choose()
    kernel = {"ok": False, "problem": chosen.problem} if chosen.problem else run_kernel()
    return {
        "ok": kernel["ok"],
        "python": {"version": platform.python_version(), "executable": sys.executable},
        "system": f"{platform.system()} {platform.machine()}",
        "packages": {name: installed(name) for name in PACKAGES},
        "llvm": {
            "path": chosen.path or None,
            "version": chosen.version or None,
            "source": chosen.source,
            "why": llvm.SOURCES[chosen.source],
        },
        "kernel_cache": kernel_cache(),
        "kernel": kernel,
    }


def run_kernel(code: str = KERNEL) -> dict[str, Any]:
    """Compile and run one kernel in a child process, so that an abort is reported rather than suffered."""
    with tempfile.TemporaryDirectory(prefix="brdf-doctor-") as empty:
        # With an empty cache, or an earlier process's kernel would run and nothing be compiled.
        environment = {**os.environ, "DRJIT_CACHE_DIR": empty}
        try:
            child = subprocess.run(
                [sys.executable, "-c", code],
                capture_output=True,
                text=True,
                env=environment,
                cwd=empty,
                timeout=KERNEL_TIMEOUT,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return {"ok": False, "problem": f"the kernel did not end within {KERNEL_TIMEOUT} s"}
    said = next((line for line in child.stderr.splitlines() if "LLVM ERROR" in line), "")
    said = said or (child.stderr.strip().splitlines() or [""])[-1]
    if child.returncode != 0:
        how = f"was ended by {signal.Signals(-child.returncode).name}" if child.returncode < 0 else "failed"
        return {"ok": False, "problem": f"the kernel {how}: {said}" if said else f"the kernel {how}"}
    try:
        result = json.loads(child.stdout)
    except ValueError:
        return {"ok": False, "problem": f"the kernel printed {child.stdout[:80]!r}"}
    if result["value"] != KERNEL_VALUE:
        return {"ok": False, "problem": f"the kernel computed {result['value']}, expected {KERNEL_VALUE}"}
    return {"ok": True, "problem": "", "seconds": result["seconds"], "threads": result["threads"]}


def kernel_cache() -> dict[str, Any]:
    """Where Dr.Jit keeps compiled kernels, how many, and how large [bytes]."""
    home = os.environ.get("HOME")
    given = os.environ.get("DRJIT_CACHE_DIR") or (os.path.join(home, ".drjit") if home else "")
    folder = Path(given)
    if not given or not folder.is_dir():
        return {"folder": given or None, "files": 0, "bytes": 0}
    sizes = [entry.stat().st_size for entry in os.scandir(folder) if entry.is_file()]
    return {"folder": given, "files": len(sizes), "bytes": sum(sizes)}


def installed(name: str) -> str | None:
    """The version of an installed distribution."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def lines(report: dict[str, Any]) -> list[str]:
    """The report for people."""
    library, cache, kernel = report["llvm"], report["kernel_cache"], report["kernel"]
    rows = [("Python", f"{report['python']['version']} ({report['python']['executable']}), {report['system']}")]
    rows += [(name, number or "not installed") for name, number in report["packages"].items()]
    found = f"{library['version'] or 'version unknown'}, {library['path']}: " if library["path"] else ""
    rows.append(("libLLVM", found + library["why"]))
    rows.append(("kernel cache", f"{cache['folder'] or 'none'}, {cache['files']} files, {cache['bytes'] / 1e6:.1f} MB"))
    if kernel["ok"]:
        rows.append(("threads", str(kernel["threads"])))
        rows.append(("kernel", f"compiled and ran in {kernel['seconds']:.2f} s"))
    else:
        rows.append(("kernel", f"FAILED: {kernel['problem']}"))
    return [f"{name:<14}{value}" for name, value in rows]
