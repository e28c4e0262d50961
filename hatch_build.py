"""Builds `vehicle_iface/_wire*.c` into the wheel where there is a C compiler; without one the wheel is pure Python.

An editable installation gets the library beside its source. The environment: `CC`, `CFLAGS` and `LDFLAGS` as usual;
`VEHICLE_IFACE_WIRE=python` builds none, and `VEHICLE_IFACE_WIRE=c` makes it an error that it cannot be built.
"""

import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import zlib
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDER, LIBRARY = "vehicle_iface", "vehicle_iface/_wire.abi3.so"
SOURCES = ("_wire.c", "_wire.h", "_wire_pack.c", "_wire_payload.c", "_wire_unpack.c")


class WireBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """The hook that hatchling calls for a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the library, if it can be done, and add it to the wheel."""
        choice = os.environ.get("VEHICLE_IFACE_WIRE", "")
        is_editable = version == "editable"
        self._folder = tempfile.TemporaryDirectory()
        library = Path(self.root, LIBRARY) if is_editable else Path(self._folder.name, "_wire.abi3.so")
        library.unlink(missing_ok=True)
        if choice == "python":
            return
        if problem := find_problem() or compile_library(Path(self.root, FOLDER), library):
            if choice == "c":
                raise RuntimeError(f"VEHICLE_IFACE_WIRE=c: vehicle_iface/_wire.c cannot be built: {problem}")
            self.app.display_warning(f"vehicle_iface/_wire.c is not built, its Python twin is used: {problem}")
        elif not is_editable:
            build_data["force_include"][str(library)] = LIBRARY
            build_data["pure_python"] = False
            build_data["tag"] = f"cp311-abi3-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove the compiled library, which is in the wheel."""
        self._folder.cleanup()


def find_problem() -> str:
    """Return why this machine can build no library; empty if it can."""
    if sys.platform != "linux":
        return "SocketCAN is on Linux only"
    if platform.python_implementation() != "CPython" or sysconfig.get_config_var("Py_GIL_DISABLED"):
        return "this Python does not have CPython's stable ABI"
    return "" if shutil.which(_compiler()[0]) else f"no C compiler ({_compiler()[0]})"


def _compiler() -> list[str]:
    return shlex.split(os.environ.get("CC", "")) or ["cc"]


def compile_library(folder: Path, library: Path, *flags: str) -> str:
    """Compile the sources in `folder` to `library`; return the compiler's output if it fails."""
    sources = [folder / name for name in SOURCES]
    crc32 = zlib.crc32(b"".join(source.read_bytes() for source in sources))
    # Without contraction: a product and a sum are rounded one after the other, as Python does.
    command = [
        *_compiler(),
        "-O2",
        "-std=c11",
        "-ffp-contract=off",
        "-Wall",
        "-Wextra",
        "-fPIC",
        "-shared",
        "-fvisibility=hidden",
    ]
    command += [f'-DSOURCE_CRC32="{crc32:08x}"', f"-I{sysconfig.get_path('include')}"]
    command += [
        *flags,
        *shlex.split(os.environ.get("CFLAGS", "")),
        *(str(source) for source in sources if source.suffix == ".c"),
    ]
    command += ["-o", str(library), *shlex.split(os.environ.get("LDFLAGS", "")), "-lm"]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    return "" if done.returncode == 0 else done.stderr.strip() or f"{command[0]} ended with {done.returncode}"
