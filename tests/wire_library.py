"""The C code of `_wire.c`, compiled for the tests from the source as it is now, whatever is installed."""

import importlib.util
import os
import subprocess
import sys
from collections.abc import Sequence
from importlib.machinery import ExtensionFileLoader
from pathlib import Path
from types import ModuleType

import pytest

import hatch_build
from vehicle_iface import wire

ROOT = Path(__file__).resolve().parents[1]
LIBRARY = "TEST_WIRE_LIBRARY"
"""The environment variable with the path of the library that `load_wire` loads."""
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-fno-omit-frame-pointer", "-g")


def build_wire(folder: Path, *flags: str) -> Path:
    """Compile the library; fails where there is no C compiler, because the C code is then not tested."""
    library = folder / "_wire.abi3.so"
    sources = ROOT / hatch_build.FOLDER
    problem = hatch_build.find_problem() or hatch_build.compile_library(sources, library, "-Werror", *flags)
    assert not problem, f"the C code is not tested: {problem} (tools/test installs what is missing)"
    return library


def load_wire(library: str = "") -> ModuleType:
    """Load a library as `vehicle_iface._wire`; without one that of the environment."""
    path = library or os.environ[LIBRARY]
    spec = importlib.util.spec_from_loader("vehicle_iface._wire", ExtensionFileLoader("vehicle_iface._wire", path))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def find_runtime(name: str) -> str:
    """Path of a runtime library of the compiler, like libasan.so."""
    found = subprocess.run(["cc", f"-print-file-name={name}"], check=True, capture_output=True, text=True)
    return found.stdout.strip()


def install_wire(library: str, patch: pytest.MonkeyPatch) -> ModuleType:
    """Load a library as `load_wire` does, and let the program use it."""
    module = load_wire(library)
    wire.find_problem.cache_clear()
    patch.setitem(sys.modules, "vehicle_iface._wire", module)
    patch.setattr("vehicle_iface._wire", module, raising=False)
    patch.setenv(wire.VARIABLE, "c")
    return module


def run_tests(files: Sequence[Path], library: Path, *preload: str, without: str = "nothing") -> None:
    """Run the tests of files in a process of their own with these libraries preloaded, except for those named so."""
    environment = os.environ | {
        LIBRARY: str(library),
        "LD_PRELOAD": " ".join(preload),
        "PYTHONMALLOC": "malloc",  # so that the address sanitizer sees every object
        "ASAN_OPTIONS": "detect_leaks=0",  # the interpreter never frees everything
        "PYTHONPATH": str(ROOT),
    }
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--hypothesis-seed=0"]
    command += [*map(str, files), "-k", f"not {without}"]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
