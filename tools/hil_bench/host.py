"""What a case changes on the bench's computer: a cable of two ends, a small disk."""

import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from hil_bench.errors import RigError

BENCH_END, DEVICE_END = "hil0", "hil1"


def make_cable() -> None:
    """Create a vxcan pair: the vehicle on one end, the device on the other. Raises `RigError`."""
    remove_cable()
    _run(["ip", "link", "add", BENCH_END, "type", "vxcan", "peer", "name", DEVICE_END])
    _run(["ip", "link", "set", BENCH_END, "mtu", "72", "up"])
    _run(["ip", "link", "set", DEVICE_END, "mtu", "72", "up"])


def remove_cable() -> None:
    """Delete it, if it exists."""
    with suppress(OSError):
        subprocess.run(["ip", "link", "del", BENCH_END], capture_output=True, check=False, start_new_session=True)


def make_disk(place: Path, size_mib: int) -> None:
    """Mount a small disk in memory. Raises `RigError`."""
    place.mkdir(parents=True, exist_ok=True)
    _run(["mount", "-t", "tmpfs", "-o", f"size={size_mib}m", "tmpfs", str(place)])


def remove_disk(place: Path) -> None:
    """Unmount it with its content, if it exists."""
    subprocess.run(["umount", "-l", str(place)], capture_output=True, check=False, start_new_session=True)
    with suppress(OSError):
        place.rmdir()


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, check=False, text=True)
    if done.returncode:
        raise RigError(f"{' '.join(command)}: {done.stderr.strip()}")
