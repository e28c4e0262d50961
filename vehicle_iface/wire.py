"""Which code handles frames on their way between socket and loop: C (`_wire.c`) where it is built, or Python.

Both do the same. The environment variable `VEHICLE_IFACE_WIRE` chooses: `c`, an error where it is not built, or
`python`. Without it, C is used where it is built.
"""

import functools
import os
import zlib
from pathlib import Path

from vehicle_iface.errors import ConfigError

VARIABLE = "VEHICLE_IFACE_WIRE"


def uses_c() -> bool:
    """Return whether the C code is used.

    Raises `ConfigError` for an unknown choice, and for C where it cannot be used.
    """
    choice = os.environ.get(VARIABLE, "")
    if choice not in ("", "c", "python"):
        raise ConfigError(f"{VARIABLE}={choice}: must be c or python, or unset")
    if choice == "python":
        return False
    problem = find_problem()
    if choice == "c" and problem:
        raise ConfigError(f"{VARIABLE}=c: {problem}; unset it to use the Python code")
    return not problem


def describe() -> str:
    """Return which code is used, as `doctor` and the summary show it."""
    return "C" if uses_c() else "Python"


@functools.cache
def find_problem() -> str:
    """Return why the C code cannot be used; empty if it can."""
    try:
        from vehicle_iface import _wire
    except ImportError as error:
        return f"vehicle_iface/_wire.c is not built ({error})"
    sources = sorted(Path(__file__).parent.glob("_wire*.[ch]"))  # only in a checkout
    if sources:
        crc32 = zlib.crc32(b"".join(path.read_bytes() for path in sources))  # hashlib would bring OpenSSL: 3.5 MB
        if getattr(_wire, "SOURCE_CRC32", "") != f"{crc32:08x}":  # that of another version may have none
            return "vehicle_iface/_wire.c has changed since it was built"
    return ""
