"""Faults of the device's process and of what it runs on: signals, memory, disk, recorder, wall clock."""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hil_bench.faults.base import Injection, NotApplicableError
from hil_bench.faults.frames import change_frames, drop
from hil_bench.rig import Rig

UNREAD_PERIODS = 2.5
"""A paused device has samples before it that it has not answered."""


def send_signals(*numbers: signal.Signals, apart_s: float = 0.0) -> Injection:
    """Send signals to the device, one after the other."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        for number in numbers:
            rig.device.send(number)
            rig.run_for(apart_s)
        yield

    return inject


def pause() -> Injection:
    """Stop the device by SIGSTOP, and continue it at the end."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        rig.device.send(signal.SIGSTOP)
        try:
            yield
        finally:
            rig.device.send(signal.SIGCONT)

    return inject


def pause_and_mute(age_s: float) -> Injection:
    """Stop the device, then the vehicle's samples; continue the device when the newest sample is so old."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        rig.device.send(signal.SIGSTOP)
        try:
            rig.run_for(UNREAD_PERIODS * rig.wire.period_s)
            with change_frames(drop)(rig):
                rig.run_for(age_s)
                rig.device.send(signal.SIGCONT)
                yield
        finally:
            rig.device.send(signal.SIGCONT)

    return inject


def send_to_recorder(number: signal.Signals) -> Injection:
    """Send a signal to the process that records the drive, and SIGCONT at the end."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        writers = rig.device.writers(Path(rig.placeholders["record"]).parent)
        if not writers:
            raise NotApplicableError("no process that the device started records the drive")
        try:
            for writer in writers:
                writer.send(number)
            yield
        finally:
            for writer in writers:
                writer.send(signal.SIGCONT)
                writer.close()

    return inject


@contextmanager
def fill_disk(rig: Rig) -> Iterator[None]:
    """Fill the disk that the drive is recorded on, and free some room at the end."""
    filler = Path(rig.placeholders["record"]).parent / "filler"
    with open(filler, "wb", buffering=0) as file, suppress(OSError):
        while file.write(bytes(1 << 12)):
            pass
    rig.mark_injection()
    try:
        yield
        if filler.stat().st_size == 0:
            raise NotApplicableError("there was no room to take away")
    finally:
        filler.unlink()


@contextmanager
def limit_memory(rig: Rig) -> Iterator[None]:
    """Allow the device no more memory than it has."""
    with rig.device.without_memory():
        yield


def step_wall_clock(by_s: float) -> Injection:
    """Step the wall clock, and back at the end, each time when no frame with an older stamp is pending."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        rig.receive_commands()
        time.clock_settime(time.CLOCK_REALTIME, time.time() + by_s)
        try:
            yield
            rig.receive_commands()
        finally:
            time.clock_settime(time.CLOCK_REALTIME, time.time() - by_s)

    return inject
