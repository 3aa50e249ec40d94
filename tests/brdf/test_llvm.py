"""Which libLLVM is chosen. Each choice is made in a process of its own, as it is in life."""

import json
import os
import subprocess
import sys
import sysconfig
from glob import glob
from pathlib import Path

import pytest

from brdf import llvm

REPOSITORY = Path(__file__).parents[2]

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the search is Linux's")

#: Debian 12 has 14, 15 and 16.
OLD = sorted(path for v in (14, 15, 16) for path in glob(f"/usr/lib/*-linux-gnu/libLLVM-{v}.so.1"))

REPORT = """
import json, os
{before}
from brdf import llvm
from brdf.errors import NoBackend
chosen = llvm.choose()
try:
    llvm.require()
    refused = ""
except NoBackend as error:
    refused = str(error)
import drjit as dr
in_memory = {{line[line.index("/") :].rstrip() for line in open("/proc/self/maps") if "libLLVM" in line}}
print(json.dumps(dict(vars(chosen), refused=refused, in_memory=sorted(in_memory), environment=dict(os.environ))))
"""


def report(before: str = "", **variables: str | None) -> dict:
    """What a new process chooses with these environment variables."""
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    for name, value in {llvm.PATH_VARIABLE: None, llvm.CHOICE_VARIABLE: None, **variables}.items():
        environment.pop(name, None)
        if value is not None:
            environment[name] = value
    code = REPORT.format(before=before)
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert child.returncode == 0, child.stderr
    return {**json.loads(child.stdout), "stderr": child.stderr}


def chosen_by_user(path: object, **variables: str | None) -> dict:
    return report("", **{llvm.PATH_VARIABLE: str(path)}, **variables)


def the_wheels() -> str:
    found = list(llvm._in_wheel())
    if not found:
        pytest.skip(f"{llvm.WHEEL} is not installed")
    return found[0]


@linux
def test_the_wheels_is_chosen_and_is_the_only_one_in_memory() -> None:
    path = the_wheels()
    got = report()
    assert (got["source"], got["path"], got["refused"]) == ("wheel", path, "")
    assert got["in_memory"] == [os.path.realpath(path)]


def test_the_wheels_version_is_what_the_library_says() -> None:
    path = the_wheels()
    version, wrong = llvm.fault(path)
    assert not wrong
    assert version.startswith(llvm._version_in_name(path))


def test_choosing_the_wheels_starts_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    path = the_wheels()
    monkeypatch.delenv(llvm.PATH_VARIABLE, raising=False)
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: pytest.fail("a process was started"))
    assert llvm._search().path == path


def test_the_users_comes_first() -> None:
    got = chosen_by_user(the_wheels())
    assert (got["source"], got["refused"]) == ("user", "")


def test_an_empty_variable_is_no_choice() -> None:
    assert chosen_by_user("")["source"] == report()["source"]


@pytest.mark.parametrize("path", OLD or [pytest.param("", marks=pytest.mark.skip(reason="no libLLVM 14 to 16 here"))])
def test_one_too_old_is_refused_by_its_version_and_never_loaded(path: str) -> None:
    got = chosen_by_user(path)
    assert got["in_memory"] == []
    for part in (path, f"LLVM {llvm._version_in_name(path)}", "17 or newer", "Unset DRJIT_LIBLLVM_PATH"):
        assert part in got["refused"]
    assert "\n" not in got["refused"]
    assert got["stderr"] == ""


@pytest.mark.skipif(not OLD, reason="no libLLVM 14 to 16 here")
def test_one_too_old_is_refused_under_another_name(tmp_path: Path) -> None:
    """A hard link where that can be had, else a copy: nothing about the file's name tells its age."""
    disguised = tmp_path / "libLLVM.so.23.1"
    try:
        os.link(os.path.realpath(OLD[0]), disguised)
    except OSError:
        disguised.write_bytes(Path(OLD[0]).read_bytes())
    got = chosen_by_user(disguised)
    assert str(disguised) in got["refused"]
    assert got["in_memory"] == []


@linux
@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda p: None, "does not exist"),
        (lambda p: p.mkdir(), "is not a file"),
        (lambda p: p.write_text("not a library"), "cannot be loaded"),
        (lambda p: p.write_bytes(b""), "cannot be loaded"),
        (lambda p: p.symlink_to(an_extension_module()), "is no libLLVM"),
        (lambda p: p.write_bytes(Path(the_wheels()).read_bytes()[: 2**20]), "ends the process that loads it"),
    ],
    ids=["nothing", "folder", "text", "empty", "another library", "cut short"],
)
def test_a_path_to_no_library_is_refused(make, what: str, tmp_path: Path) -> None:
    path = tmp_path / "libLLVM.so.23.1"
    make(path)
    got = chosen_by_user(path)
    assert got["refused"].startswith(f"DRJIT_LIBLLVM_PATH = {path} {what}")
    assert "\n" not in got["refused"]
    assert got["stderr"] == ""


def an_extension_module() -> str:
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    import numpy

    return glob(f"{Path(numpy.__file__).parent}/**/*{suffix}", recursive=True)[0]


@linux
def test_mitsubas_scalar_variants_do_without() -> None:
    got = report(
        "import brdf, mitsuba as mi; mi.set_variant('scalar_rgb'); assert mi.Float(2) == 2",
        **{llvm.PATH_VARIABLE: "/does/not/exist.so"},
    )
    assert got["refused"]


def test_a_child_process_keeps_the_choice_and_the_reason() -> None:
    parent = report()
    inherited = {k: parent["environment"].get(k) for k in (llvm.PATH_VARIABLE, llvm.CHOICE_VARIABLE)}
    child = report("", **inherited)
    for key in ("source", "path", "version", "problem"):
        assert child[key] == parent[key]


@linux
def test_a_child_process_keeps_the_refusal() -> None:
    parent = chosen_by_user("/does/not/exist.so")
    child = report("", **{k: parent["environment"][k] for k in (llvm.PATH_VARIABLE, llvm.CHOICE_VARIABLE)})
    assert child["refused"] == parent["refused"]


def test_a_path_set_after_the_parents_choice_is_the_users() -> None:
    parent = report()
    got = chosen_by_user(
        "/does/not/exist.so", **{llvm.CHOICE_VARIABLE: parent["environment"].get(llvm.CHOICE_VARIABLE)}
    )
    assert "/does/not/exist.so does not exist" in got["refused"]


@linux
def test_drjit_imported_first_is_found_out() -> None:
    """What Dr.Jit then takes depends on the machine: it must be fit, or be refused."""
    got = report("import drjit")
    if got["in_memory"] and llvm._major(llvm._version_in_name(got["in_memory"][0])) >= llvm.MINIMUM:
        assert (got["source"], got["refused"]) == ("loaded", "")
    else:
        assert "imported before brdf" in got["refused"]
        assert "Import brdf before drjit" in got["refused"]


@linux
def test_without_a_wheel_the_systems_newest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, older = the_wheels(), tmp_path / "libLLVM.so.18.1"
    older.symlink_to(path)
    monkeypatch.delenv(llvm.PATH_VARIABLE, raising=False)
    monkeypatch.setattr(llvm, "_in_wheel", lambda: iter(()))
    monkeypatch.setattr(llvm, "_on_system", lambda: {"/lib/libLLVM-9.so.1", str(older), path, "/lib/libLLVM.so.99.1"})
    got = llvm._search()
    assert (got.source, got.path) == ("system", path)


@linux
def test_the_system_is_searched_where_the_loader_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    path = the_wheels()
    monkeypatch.setenv("LD_LIBRARY_PATH", os.path.dirname(path))
    assert os.path.realpath(path) in llvm._on_system()
    assert {os.path.realpath(p) for p in OLD} <= llvm._on_system()


@linux
def test_nothing_fit_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(llvm.PATH_VARIABLE, raising=False)
    monkeypatch.setattr(llvm, "_in_wheel", lambda: iter(()))
    monkeypatch.setattr(llvm, "_on_system", set)
    assert "Install one" in llvm._search().problem
    assert "none was found" in llvm._search().problem
    monkeypatch.setattr(llvm, "_on_system", lambda: {"/old/libLLVM-9.so.1"})
    monkeypatch.setattr(llvm, "fault", lambda path: ("9", llvm._too_old("9")))
    assert "/old/libLLVM-9.so.1 is LLVM 9, too old" in llvm._search().problem


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("libLLVM-14.so.1", "14"),
        ("libLLVM-14.0.6.so", "14.0.6"),
        ("libLLVM-17.so", "17"),
        ("libLLVM.so.18.1", "18.1"),
        ("libLLVM.so.19.1-rust-1.85.0-stable", "19.1"),
        ("libLLVM.so.23.1", "23.1"),
        ("libLLVM.so", ""),
        ("libLLVM-C.so.19", ""),
        ("libz.so.1", ""),
    ],
)
def test_versions_in_names(name: str, version: str) -> None:
    """Names as Debian, Fedora, conda and Rust give them."""
    assert llvm._version_in_name(f"/usr/lib/{name}") == version
