"""The computer, the interfaces and the versions of a run."""

import os
import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from hil_bench.identity import hash_bench
from hil_bench.places import CHECKOUT

LIBRARIES = ("cantools", "msgspec", "numpy", "rich", "jinja2")


def environment(channels: Sequence[str], described: str) -> dict[str, str]:
    """The computer, the interfaces and the versions of a run."""
    found = {
        "host": platform.node(),
        "kernel": platform.release(),
        "processors": str(os.cpu_count()),
        "interface": described,
        "adapter": ", ".join(dict.fromkeys(map(_adapter, channels))),
        "python": platform.python_version(),
        "revision": _revision(),
        "bench (SHA-256)": hash_bench(),
    }
    for name in LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def _adapter(channel: str) -> str:
    try:
        driver = Path(f"/sys/class/net/{channel}/device/driver").resolve(strict=True)
    except OSError:
        return "none: a virtual interface"
    return driver.name


def _revision() -> str:
    if CHECKOUT is None:
        return metadata.version("vehicle-iface")
    git = CHECKOUT / ".git"
    try:
        text = (git / "HEAD").read_text().strip()
        return (git / text[5:]).read_text().strip()[:12] if text.startswith("ref: ") else text[:12]
    except OSError:
        return "unknown"
