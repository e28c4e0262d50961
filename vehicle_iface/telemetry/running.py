"""The loops of this user that are running on this machine, found by their telemetry."""

from dataclasses import dataclass

from vehicle_iface import clock
from vehicle_iface.telemetry.address import known_addresses
from vehicle_iface.telemetry.reader import TelemetryReader
from vehicle_iface.telemetry.snapshot import SessionInfo, Snapshot, WriterState
from vehicle_iface.units import s_from_ns


@dataclass(frozen=True, slots=True, kw_only=True)
class RunningLoop:
    """A loop that publishes telemetry under a name."""

    address: str
    info: SessionInfo
    newest: Snapshot | None
    """What it published last; None: nothing yet."""
    age_s: float
    """Time since then; 0 without a snapshot."""


def find_running_loops() -> list[RunningLoop]:
    """Return the running loops by address. One whose telemetry is a path (`--telemetry ./x`) cannot be found."""
    found = (_read(address) for address in known_addresses())
    return [loop for loop in found if loop is not None]


def _read(address: str) -> RunningLoop | None:
    with TelemetryReader(address) as reader:
        if reader.poll() is not WriterState.LIVE or reader.info is None:
            return None
        newest = reader.newest()
        age_s = s_from_ns(max(clock.monotonic_ns() - newest.published_ns, 0)) if newest is not None else 0.0
        return RunningLoop(address=address, info=reader.info, newest=newest, age_s=age_s)
