"""Which libLLVM Dr.Jit compiles with.

Dr.Jit loads libLLVM the moment it is imported, and one older than 17 ends the process in the middle of a render
(``LLVM ERROR: Cannot select: fminimum``). `choose` therefore runs first thing in ``import brdf`` and tells Dr.Jit by
``DRJIT_LIBLLVM_PATH``. A library is never loaded here: its version is asked of a child process.

Finding nothing is not yet an error, since Mitsuba's scalar variants do without libLLVM. Dr.Jit is then kept from its
own search, which would take an old one, and `require` raises in whatever compiles.
"""

from __future__ import annotations

import os
import platform
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from glob import escape, glob

from .errors import NoBackend

#: LLVM 16 lacks ``fminimum`` on x86-64; 19, 22 and 23 are known to work.
MINIMUM = 17

#: Dr.Jit's own variable.
PATH_VARIABLE = "DRJIT_LIBLLVM_PATH"

#: What `choose` found, for child processes: source, version, problem, path, separated by tabs.
CHOICE_VARIABLE = "BRDF_LIBLLVM"

#: What Dr.Jit is given to load when no library is fit. It shows it in its message.
BLOCKED = "none is fit, see: brdf doctor"

#: The distribution that brings libLLVM on Linux x86-64.
WHEEL = "karellen-llvm-core"

#: Seconds after which a library that does not finish loading is given up.
LOAD_TIMEOUT = 60

SOURCES = {
    "user": f"{PATH_VARIABLE} names it",
    "wheel": f"it comes with the package {WHEEL}",
    "system": "it is the newest on this system",
    "loaded": "Dr.Jit had loaded it before brdf was imported",
    "drjit": "Dr.Jit searches for it",
    "none": "none is fit",
}
"""Why a library was chosen, by `Llvm.source`."""

_WHY = "an older one ends the process in the middle of a render"

_ASK = """
import ctypes, sys
try:
    lib = ctypes.CDLL(sys.argv[1])
except OSError as error:
    sys.exit("cannot be loaded (%s)" % error)
if not hasattr(lib, "LLVMGetVersion"):
    sys.exit("is no libLLVM, or one older than 16 (it has no LLVMGetVersion)")
version = [ctypes.c_uint() for _ in range(3)]
lib.LLVMGetVersion(*map(ctypes.byref, version))
print(".".join(str(v.value) for v in version))
"""


@dataclass(frozen=True)
class Llvm:
    """The libLLVM of this process.

    Attributes
    ----------
    path : str
        What Dr.Jit loads; empty when that is left to Dr.Jit.
    version : str
        ``"23.1"``; empty if not known.
    source : str
        A key of `SOURCES`.
    problem : str
        One sentence why nothing can be compiled; empty if all is well.
    """

    path: str
    version: str
    source: str
    problem: str = ""


_chosen: Llvm | None = None


def choose() -> Llvm:
    """Choose libLLVM and set ``DRJIT_LIBLLVM_PATH``: the user's, else the wheel's, else the system's newest.

    Done once in a process; a child process keeps its parent's choice. Never raises, see `require`.
    """
    global _chosen
    if _chosen is None:
        inherited = _inherited()
        if inherited is None and "drjit" in sys.modules:
            _chosen = _already_loaded()
        else:
            _chosen = inherited or _search()
            _announce(_chosen)
        if _chosen.problem:
            _start_quietly()
    return _chosen


def require() -> Llvm:
    """The libLLVM of this process, for code that is about to compile a kernel.

    Raises
    ------
    NoBackend
        None is fit, or Dr.Jit could not load the one chosen.
    """
    llvm = choose()
    if llvm.problem:
        raise NoBackend(llvm.problem)
    import drjit as dr

    if not dr.has_backend(dr.JitBackend.LLVM):
        raise NoBackend(f"Dr.Jit could not load libLLVM ({llvm.path or 'its own search found none'}). {_remedy()}")
    return llvm


def fault(path: str) -> tuple[str, str]:
    """What is wrong with the library `path`, asked of a child process.

    Returns
    -------
    (str, str)
        The version, empty if not known, and what is wrong as the end of a sentence, empty if nothing is.
    """
    import subprocess

    if os.sep in path and not os.path.isfile(path):
        return "", "is not a file" if os.path.exists(path) else "does not exist"
    named = _version_in_name(os.path.realpath(path))
    if named and _major(named) < MINIMUM:
        return named, _too_old(named)
    command = [sys.executable, "-I", "-S", "-c", _ASK, path]
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=LOAD_TIMEOUT, check=False)
    except subprocess.TimeoutExpired:
        return "", f"does not load within {LOAD_TIMEOUT} s"
    except OSError:  # no Python of our own to ask, as inside another program: the name has to do
        return named, ""
    version, trouble = child.stdout.strip(), " ".join(child.stderr.split())
    if child.returncode != 0 or not version:
        return "", trouble or f"ends the process that loads it (exit code {child.returncode})"
    return version, _too_old(version) if _major(version) < MINIMUM else ""


def _inherited() -> Llvm | None:
    """The choice of the parent process, unless the user set another path since."""
    fields = os.environ.get(CHOICE_VARIABLE, "").split("\t", 3)
    if len(fields) != 4 or os.environ.get(PATH_VARIABLE) != (fields[3] or BLOCKED):
        return None
    source, version, problem, path = fields
    return Llvm(path, version, source, problem)


def _announce(llvm: Llvm) -> None:
    """Tell Dr.Jit, and child processes, what was chosen."""
    if llvm.path or llvm.problem:
        os.environ[PATH_VARIABLE] = llvm.path or BLOCKED
        os.environ[CHOICE_VARIABLE] = "\t".join((llvm.source, llvm.version, llvm.problem, llvm.path))


def _start_quietly() -> None:
    """Import Dr.Jit without what it prints when it has no libLLVM: `require` says more, and only where it matters."""
    try:
        kept = os.dup(2)
    except OSError:  # no standard error at all
        return
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        import drjit  # noqa: F401
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _search() -> Llvm:
    given = os.environ.get(PATH_VARIABLE, "")
    if given and given != BLOCKED:
        path = os.path.abspath(given) if os.sep in given else given
        version, wrong = fault(path)
        if wrong:
            todo = f"Unset {PATH_VARIABLE}, or set it to a libLLVM that is {MINIMUM} or newer; {_WHY}."
            return Llvm("", "", "none", f"{PATH_VARIABLE} = {given} {wrong}. {todo}")
        return Llvm(path, version, "user")
    for path in _in_wheel():
        version = _version_in_name(path)
        if os.path.isfile(path) and _major(version) >= MINIMUM:
            return Llvm(path, version, "wheel")
    if not sys.platform.startswith("linux"):
        return Llvm("", "", "drjit")
    seen = []
    for path in sorted(_on_system(), key=lambda p: _numbers(_version_in_name(p)), reverse=True):
        version, wrong = fault(path)
        if not wrong:
            return Llvm(path, version, "system")
        seen.append(f"{path} {wrong}")
    found = f"none of those found is fit: {'; '.join(seen)}" if seen else "none was found"
    return Llvm("", "", "none", f"Dr.Jit needs libLLVM {MINIMUM} or newer ({_WHY}), and {found}. {_remedy()}")


def _already_loaded() -> Llvm:
    """The library Dr.Jit took by itself, when it was imported before brdf."""
    first = f"Import brdf before drjit and mitsuba, or set {PATH_VARIABLE}."
    if not sys.platform.startswith("linux"):
        return Llvm("", "", "drjit")
    mapped = _mapped()
    if not mapped:
        return Llvm("", "", "none", f"Dr.Jit was imported before brdf and found no libLLVM. {first}")
    version, wrong = fault(mapped)
    if wrong:
        problem = f"Dr.Jit was imported before brdf and took {mapped}, which {wrong}: {_WHY}. {first}"
        return Llvm(mapped, version, "none", problem)
    return Llvm(mapped, version, "loaded")


def _in_wheel() -> Iterator[str]:
    """The libLLVM files that the installed wheel lists, by hand: importlib.metadata takes longer than all of this."""
    prefix = WHEEL.replace("-", "_") + "-"
    for folder in sys.path:
        try:
            names = os.listdir(folder or os.curdir)
        except OSError:
            continue
        for name in names:
            if not (name.startswith(prefix) and name.endswith(".dist-info")):
                continue
            try:
                with open(os.path.join(folder, name, "RECORD"), encoding="utf-8") as record:
                    files = [line.split(",", 1)[0] for line in record]
            except OSError:
                continue
            for file in files:
                if os.path.basename(file).startswith("libLLVM.so."):
                    yield os.path.normpath(os.path.join(os.path.abspath(folder), file))


def _on_system() -> set[str]:
    """Every libLLVM of this environment and system whose name tells its version."""
    folders = [os.path.join(sys.prefix, "lib"), *os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep)]
    folders += [
        "/usr/local/lib",
        *glob("/usr/lib/llvm*/lib*"),
        "/usr/lib64",
        "/usr/lib",
        *glob("/usr/lib/*-linux-gnu*"),
    ]
    paths = {path for folder in folders if folder for path in glob(os.path.join(escape(folder), "libLLVM*.so*"))}
    paths.update(_ldconfig())
    return {real for real in map(os.path.realpath, paths) if os.path.isfile(real) and _version_in_name(real)}


def _ldconfig() -> list[str]:
    import subprocess

    for command in ("ldconfig", "/sbin/ldconfig"):
        try:
            cache = subprocess.run([command, "-p"], capture_output=True, text=True, timeout=LOAD_TIMEOUT, check=False)
        except (OSError, subprocess.TimeoutExpired):
            continue
        return re.findall(r"=> (\S*/libLLVM[^/\n]*)$", cache.stdout, re.MULTILINE)
    return []


def _mapped() -> str:
    """The libLLVM in this process's memory; empty if there is none."""
    try:
        with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
            found = re.search(r"(/.*/libLLVM[^/\n]*)$", maps.read(), re.MULTILINE)
    except OSError:
        return ""
    return found.group(1) if found else ""


def _version_in_name(path: str) -> str:
    """``23.1`` of libLLVM.so.23.1, ``14`` of libLLVM-14.so.1, ``14.0.6`` of libLLVM-14.0.6.so; else empty."""
    found = re.match(r"libLLVM(?:-(\d+(?:\.\d+)*)\.so|\.so\.(\d+(?:\.\d+)*))", os.path.basename(path))
    return (found.group(1) or found.group(2)) if found else ""


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(n) for n in version.split(".") if n)


def _major(version: str) -> int:
    return (_numbers(version) or (0,))[0]


def _too_old(version: str) -> str:
    return f"is LLVM {version}, too old"


def _remedy() -> str:
    if sys.platform == "darwin":
        how = "brew install llvm"
    elif sys.platform.startswith("linux") and platform.machine() == "x86_64":
        how = f"pip install {WHEEL}"
    else:
        how = "on Debian and Ubuntu, apt install libllvm19"
    return f"Install one ({how}), or set {PATH_VARIABLE} to one."
