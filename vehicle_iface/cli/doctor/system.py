"""Checks the machine: scheduling, memory, clock and software."""

import importlib.metadata
import os
import platform
import shlex
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from vehicle_iface import wire
from vehicle_iface.cli.doctor.findings import Diagnostic, missing, ok, read_text, warn
from vehicle_iface.runtime import realtime

TESTED = {
    "python-can": "4.6.1",
    "cantools": "45.1.0",
    "msgspec": "0.22.0",
    "autosar-e2e": "1.0.0",
    "viser": "1.1.1",
}
"""The package versions with which the tests run, as in requirements.txt."""
TELEMETRY_BYTES = 4 << 20
FIX_WIRE = "sudo apt-get install -y gcc python3-dev; python3 -m pip install --force-reinstall --no-deps SOURCE-FOLDER"
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies", "pit")
FAST_CLOCKS = ("tsc", "arch_sys_counter", "kvm-clock")


def check_realtime() -> Iterator[Diagnostic]:
    """Check whether the loop would get real-time priority and locked memory, by trying both."""
    if realtime.may_fifo():
        yield ok("SCHED_FIFO", f"granted, priority {realtime.FIFO_PRIORITY}")
    else:
        yield warn(
            "SCHED_FIFO",
            "no permission for it: other programs delay the loop by 10 ms and more (log in again after the change)",
            realtime.FIX_FIFO,
        )
    if realtime.may_lock():
        yield ok("memory lock", "granted")
    else:
        yield warn(
            "memory lock",
            "no permission for it: a pass can wait for the disk when memory runs short (log in again after the change)",
            realtime.FIX_LOCK,
        )


def check_throttling(runtime_us: int | None, period_us: int | None) -> Iterator[Diagnostic]:
    """Check what share of each period the kernel allows real-time threads."""
    subject, fix = "throttling", "sudo sysctl -w kernel.sched_rt_runtime_us=950000 kernel.sched_rt_period_us=1000000"
    if runtime_us is None or not period_us:
        yield ok(subject, "this kernel has no setting for it")
    elif runtime_us < 0:
        yield warn(subject, "off: a real-time thread that hangs takes the machine with it", fix)
    elif runtime_us < 0.5 * period_us:
        yield warn(subject, f"real-time threads get {runtime_us} of each {period_us} µs, and then wait", fix)
    else:
        yield ok(subject, f"real-time threads get {runtime_us / period_us:.0%}, the loop needs a few")


def check_governor(governors: Iterable[str]) -> Iterator[Diagnostic]:
    """Check whether CPUs may slow down between two samples."""
    names = sorted({name for governor in governors if (name := governor.strip())})
    if not names:
        yield ok("CPU frequency", "cannot be seen here (fixed, or a virtual machine)")
    elif names == ["performance"]:
        yield ok("CPU frequency", "governor performance")
    else:
        fix = "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"
        yield warn("CPU frequency", f"governor {', '.join(names)}: the CPU may wake up slowly from idle", fix)


def check_clock(current: list[str], available: list[str]) -> Iterator[Diagnostic]:
    """Check whether reading the clock is fast."""
    name = current[0] if current else ""
    better = next((clock for clock in FAST_CLOCKS if clock in available), None)
    if not name:
        yield ok("clock source", "cannot be seen here")
    elif name not in SLOW_CLOCKS:
        yield ok("clock source", name)
    elif better is None:
        yield warn(
            "clock source", f"{name}, each reading takes about 1 µs, and there is no better one", "dmesg | grep -i tsc"
        )
    else:
        fix = f"echo {better} | sudo tee /sys/devices/system/clocksource/clocksource0/current_clocksource"
        yield warn("clock source", f"{name}: each reading takes about 1 µs", fix)


def check_memory_files(folder: Path) -> Iterator[Diagnostic]:
    """Check the folder of the telemetry file, which connects loop and viewer."""
    subject = "/dev/shm"
    if str(folder) != subject:
        yield warn(
            subject,
            f"missing or not writable: the viewer's file goes to {folder}, where a slow disk delays the loop",
            f"sudo mkdir -p {subject} && sudo mount -t tmpfs -o mode=1777 tmpfs {subject}",
        )
        return
    space = os.statvfs(folder)
    free_bytes = space.f_bavail * space.f_frsize
    if free_bytes < TELEMETRY_BYTES:
        yield missing(subject, f"{free_bytes} bytes free of {TELEMETRY_BYTES} needed", f"ls -lS {subject}")
    else:
        yield ok(subject, f"writable, {free_bytes >> 20} MiB free")


def check_wire() -> Iterator[Diagnostic]:
    """Check which code handles the frames."""
    if wire.uses_c():
        yield ok("wire", "C")
    elif problem := wire.find_problem():
        yield warn("wire", f"Python, slower than C: {problem}", FIX_WIRE)
    else:
        yield ok("wire", f"Python, by {wire.VARIABLE}")


def check_software() -> Iterator[Diagnostic]:
    """Check the versions of Python and of the packages against the tested ones."""
    yield ok("Python", f"{platform.python_version()} ({platform.python_implementation()})")
    for name, tested in TESTED.items():
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            version = ""
        yield check_package(name, version, tested)


def check_package(name: str, version: str, tested: str) -> Diagnostic:
    """Check one package; `version` is empty if it is not installed."""
    fix = f"{shlex.quote(sys.executable)} -m pip install {name}=={tested}"
    if not version:
        return missing(name, "not installed", fix)
    if version != tested:
        return warn(name, f"{version}, tested with {tested}", fix)
    return ok(name, f"{version}, as tested")


def describe_other_system(system: str) -> Iterator[Diagnostic]:
    """Describe what this program can do on systems other than Linux."""
    yield warn(
        "SocketCAN",
        f"does not apply to {system}: a python-can adapter, or the simulated vehicle in the loop's process",
        "vehicle-iface demo",
    )
    yield warn(
        "real time",
        f"does not apply to {system}: no SCHED_FIFO, no /dev/shm; other programs delay the loop (use Linux)",
        "vehicle-iface demo",
    )


def read_number(path: str) -> int | None:
    """Return the whole number in a file; None if there is none."""
    text = read_text(path).strip()
    return int(text) if text.lstrip("-").isdigit() else None
