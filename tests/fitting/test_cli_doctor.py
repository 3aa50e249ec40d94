"""``brdf doctor``: what it says of a machine that works, of a library that is no good, and of a kernel that dies."""

import json
import os
import subprocess
import sys
from glob import glob
from pathlib import Path

import pytest

from brdf import llvm
from brdf.errors import NoBackend
from fitting.cli import doctor

REPOSITORY = Path(__file__).parents[2]

#: Loads, but cannot compile a minimum: Debian 12's.
LLVM_15 = next(iter(glob("/usr/lib/*-linux-gnu/libLLVM-15.so.1")), "")


def run(*options: str, **variables: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "fitting.cli.app", "doctor", *options]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), **variables}
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


def test_a_machine_that_works() -> None:
    ran = run("--json")
    assert ran.returncode == 0
    report = json.loads(ran.stdout)
    assert report["ok"]
    assert report["kernel"]["ok"]
    assert report["python"]["version"] == ".".join(map(str, sys.version_info[:3]))
    import mitsuba

    assert report["packages"]["mitsuba"] == mitsuba.__version__
    assert report["llvm"]["path"] == llvm.choose().path
    assert llvm._major(report["llvm"]["version"]) >= llvm.MINIMUM
    assert report["kernel"]["threads"] >= 1


def test_the_text_says_the_same() -> None:
    ran = run()
    assert ran.returncode == 0
    assert ran.stderr == ""
    for part in ("Python", "mitsuba", "drjit", "numpy", "scipy", "OpenImageIO", "libLLVM", "kernel cache", "threads"):
        assert f"\n{part} " in f"\n{ran.stdout}"
    assert "compiled and ran" in ran.stdout


def test_a_path_to_nothing_is_4_and_said() -> None:
    ran = run("--json", DRJIT_LIBLLVM_PATH="/does/not/exist.so")
    assert ran.returncode == NoBackend.exit_code
    report = json.loads(ran.stdout)
    assert not report["ok"]
    assert "/does/not/exist.so does not exist" in report["kernel"]["problem"]


@pytest.mark.skipif(not LLVM_15, reason="no libLLVM 15 here")
def test_one_too_old_is_4_and_its_version_said() -> None:
    ran = run(DRJIT_LIBLLVM_PATH=LLVM_15)
    assert ran.returncode == NoBackend.exit_code
    assert "is LLVM 15, too old" in ran.stdout
    assert ran.stderr == ""


@pytest.mark.skipif(not LLVM_15, reason="no libLLVM 15 here")
def test_a_kernel_that_aborts_is_reported() -> None:
    """LLVM 15, passed off as a choice already made: it loads, and aborts when it compiles."""
    made = "\t".join(("user", "17", "", LLVM_15))
    ran = run(**{llvm.PATH_VARIABLE: LLVM_15, llvm.CHOICE_VARIABLE: made})
    assert ran.returncode == NoBackend.exit_code
    assert "the kernel was ended by SIGABRT: LLVM ERROR: Cannot select" in ran.stdout
    assert "fminimum" in ran.stdout


@pytest.mark.parametrize(
    ("code", "problem"),
    [
        ("import os; os.abort()", "the kernel was ended by SIGABRT"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "the kernel was ended by SIGSEGV"),
        ("raise ImportError('no drjit')", "the kernel failed: ImportError: no drjit"),
        ("print('what')", "the kernel printed 'what\\n'"),
        (doctor.KERNEL.replace("(x, -2)", "(x, -3)"), f"the kernel computed -3.0, expected {doctor.KERNEL_VALUE}"),
    ],
)
def test_whatever_happens_to_the_kernel_is_reported(code: str, problem: str) -> None:
    got = doctor.run_kernel(code)
    assert not got["ok"]
    assert got["problem"] == problem


def test_a_kernel_without_end_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "KERNEL_TIMEOUT", 1)
    assert "did not end within 1 s" in doctor.run_kernel("import time; time.sleep(60)")["problem"]


def test_the_kernel_is_compiled_not_found() -> None:
    """A cached kernel would run without LLVM compiling anything."""
    listing = "import json, os; from pathlib import Path; import drjit as dr\n"
    kernel = listing + doctor.KERNEL + "\nassert os.listdir(os.environ['DRJIT_CACHE_DIR']), 'nothing was compiled'"
    assert doctor.run_kernel(kernel)["ok"]


def test_the_kernel_cache_is_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DRJIT_CACHE_DIR", str(tmp_path))
    (tmp_path / "a.bin").write_bytes(b"12345")
    (tmp_path / "b.bin").write_bytes(b"123")
    assert doctor.kernel_cache() == {"folder": str(tmp_path), "files": 2, "bytes": 8}
    monkeypatch.delenv("DRJIT_CACHE_DIR")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert doctor.kernel_cache() == {"folder": str(tmp_path / "home" / ".drjit"), "files": 0, "bytes": 0}
    monkeypatch.delenv("HOME")
    assert doctor.kernel_cache() == {"folder": None, "files": 0, "bytes": 0}
