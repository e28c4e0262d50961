"""The vehicle of the `rate` benchmark: sends samples at even times, and takes the commands out."""

import os
import socket
import time
from dataclasses import dataclass

from benchmarks.parts.reaction_vehicle import RailVehicle
from vehicle_iface.runtime import realtime

DRIVE_COMMAND = 0x080
STATUS_EVERY = 10
"""Samples for each status; at 1 kHz one in 30 ms."""
CPU = min(os.sched_getaffinity(0))
"""Not the loop's where there is another."""
AHEAD_S = 0.2
"""Between the order to begin and the first frame."""
GREATEST_GAP_S = 200e-6
"""Between two frames of a sample: the state assembler waits no longer for the next one."""
NAP_S = 100e-6
"""The sender sleeps, in halves of this, while more than this is left."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of the frames."""

    samples: int
    frames: int
    lost: int
    """Frames that found no room."""
    commands: int
    """Pairs that were received."""
    late_ms: float
    """How late the sender itself was at most."""


def send(far: socket.socket, vehicle: RailVehicle, rate_hz: int, seconds: int) -> Outcome:
    """Send samples of three frames, and the status, evenly but for the greatest gap within a sample."""
    realtime.apply_settings(cpu=CPU)
    samples = frames = lost = commands = 0
    late_s, begin_s = 0.0, time.monotonic() + AHEAD_S
    while frames < rate_hz * seconds:
        due_s = begin_s + frames / rate_hz
        batch = vehicle.sample(due_s)
        if samples % STATUS_EVERY == 0:
            batch.append(vehicle.status())
        samples += 1
        for place, frame in enumerate(batch):
            due_s = begin_s + (frames - place) / rate_hz + place * min(1.0 / rate_hz, GREATEST_GAP_S)
            while (now_s := time.monotonic()) < due_s:
                commands += bool(_take_command(far))
                if due_s - now_s > NAP_S:
                    time.sleep(NAP_S / 2.0)
            late_s = max(late_s, now_s - due_s)
            frames += 1
            try:
                far.send(frame, socket.MSG_DONTWAIT)
            except BlockingIOError:
                lost += 1
    time.sleep(AHEAD_S)
    while (taken := _take_command(far)) is not None:
        commands += taken
    return Outcome(samples=samples, frames=frames, lost=lost, commands=commands, late_ms=late_s * 1e3)


def _take_command(far: socket.socket) -> bool | None:
    """Whether the frame that was there was the first of a pair; None where there was none."""
    try:
        return int.from_bytes(far.recv(72, socket.MSG_DONTWAIT)[:4], "little") == DRIVE_COMMAND
    except BlockingIOError:
        return None
