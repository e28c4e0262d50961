"""Which code handles frames on their way between socket and loop: C (`_wire.c`) where it is built, or Python.

Both do the same. The environment variable `VEHICLE_IFACE_WIRE` chooses: `c`, an error where it is not built, or
`python`. Without it, C is used where it is built.
"""

import functools
import os
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
        import hashlib  # a wheel needs none: it takes a while

        if hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest() != _wire.SOURCE_SHA256:
            return "vehicle_iface/_wire.c has changed since it was built"
    return ""
