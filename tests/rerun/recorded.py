"""Recorded drives in virtual time: the loop, a simulated vehicle, a bus that can fail, a clock that never rests."""

import random
from pathlib import Path

from vehicle_iface import compose, drivable
from vehicle_iface.cli.frames import check_frame
from vehicle_iface.codec.database import load_database
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame
from vehicle_iface.motion_sources import cap_unconfirmed_speed
from vehicle_iface.profile import load_profile
from vehicle_iface.recorder import files
from vehicle_iface.recorder.folder import RecordingRequest, create_folder
from vehicle_iface.recorder.inputs import format_block, split_passes
from vehicle_iface.rerun.tap import InputTap
from vehicle_iface.sim.driver_commands import execute
from vehicle_iface.sim.embedded import EmbeddedBus
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.telemetry import SessionInfo
from vehicle_iface.trajectories.mailbox import Mailbox
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.units import ns_from_s

START_NS = 1_000_000_000


class RestlessClock:
    """Each reading is some microseconds later than the one before."""

    def __init__(self) -> None:
        self._now_ns, self._random = START_NS, random.Random(1)

    def now_ns(self) -> int:
        self._now_ns += self._random.randrange(200, 20_000)
        return self._now_ns

    def peek_ns(self) -> int:
        return self._now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        self._now_ns = max(self._now_ns, deadline_ns)


class FailingBus:
    """The embedded bus: it can be cut, take only some frames, have no room, and receive frames of others."""

    description = "embedded bus that can fail"

    def __init__(self, inner: EmbeddedBus) -> None:
        self._inner = inner
        self.is_down = self.is_waiting = False
        self.takes: int | None = None
        self.extra: list[CanFrame] = []
        self.log: list[CanFrame] = []
        """Frames that were seen on the bus."""

    def open(self) -> "FailingBus":
        self._check()
        return self

    def wait(self, until_ns: int) -> bool:
        self._check()
        return self._inner.wait(until_ns)

    def drain(self) -> list[CanFrame]:
        self._check()
        frames, self.extra = self._inner.drain() + self.extra, []
        return frames

    def has_room(self) -> bool:
        self._check()
        return not self.is_waiting

    def send(self, *frames: CanFrame) -> int:
        self._check()
        taken = frames[: self.takes]
        self.log += taken
        return self._inner.send(*taken)

    def counters(self) -> dict[str, int]:
        return self._inner.counters()

    def close(self) -> None:
        self._inner.drain()

    def _check(self) -> None:
        if self.is_down:
            raise BusError("cut")


class RecordedDrive:
    """A drive of which the inputs are recorded, as `run --record` does."""

    def __init__(
        self,
        profile: str = "reference",
        *,
        route: str | None = "figure8",
        controller: str = "pure_pursuit",
        scheduled_s: float | None = None,
    ) -> None:
        """Without a route, trajectories come from `mailbox`."""
        database = load_database(cap_unconfirmed_speed(load_profile(profile)))
        self._profile = database.profile
        frame_id = check_frame(None, database)
        self.options = files.RunOptions(
            armed=True,
            profile=Path(self._profile.file).name,
            controller=controller,
            frame_id=frame_id,
            route=route,
            channels=["vcan0"],
        )
        self.clock, self.mailbox, self._raw = RestlessClock(), Mailbox(), bytearray()
        self.vehicle = simulated_vehicle(database, start_ns=START_NS)
        self.bus = FailingBus(EmbeddedBus(self.vehicle, self.clock.now_ns, self.clock.sleep_until))
        self._tap = InputTap(self._write, self.clock.now_ns)
        self.loop = compose.build_loop(
            database=database,
            open_bus=self._tap.wrap_bus(self.bus.open),
            controller=compose.build_controller(controller, database.profile),
            source=(
                RecedingRoute(drivable.build_route(route, self._profile), frame_id=frame_id)
                if route is not None
                else self._tap.wrap_source(self.mailbox)
            ),
            telemetry=None,
            armed=True,
            now_ns=self._tap.now_ns,
            sleep_until=self.clock.sleep_until,
        )
        self._tap.end_pass(self.loop)
        self.loop.begin()
        self._tap.end_pass(self.loop)
        self._scheduled_ns = None if scheduled_s is None else START_NS + ns_from_s(scheduled_s)
        if self._scheduled_ns is not None:
            self.loop.shutdown.schedule(self._scheduled_ns)
            self._tap.schedule(self._scheduled_ns)

    @property
    def reasons(self) -> list[str]:
        """Of the stops so far."""
        return [stop.reason for stop in self.loop.events.stops(START_NS, self.clock.peek_ns())]

    def run_s(self, seconds: float) -> "RecordedDrive":
        end_ns = self.clock.peek_ns() + ns_from_s(seconds)
        while self.clock.peek_ns() < end_ns and not self.loop.shutdown.is_done:
            if self._scheduled_ns is not None and self.clock.peek_ns() >= self._scheduled_ns:
                self._scheduled_ns = None
                self.loop.shutdown.begin_on_schedule()
                self._tap.begin_on_schedule()
            self.loop.step()
            self._tap.end_pass(self.loop)
        return self

    def tell(self, line: str) -> None:
        assert execute(self.vehicle, line) == "ok"

    def save(self, folder: Path, *, with_log: bool = False, input_files: tuple[str, ...] = ()) -> Path:
        """Write the recording."""
        profile = self._profile
        request = RecordingRequest(
            folder=str(folder),
            telemetry="",
            channels=[],
            profile=profile.file,
            named_files=[str(file) for file in (*profile.dbc_files, *profile.checksum_files)],
            command_line=[],
            run=self.options,
            input_files=list(input_files),
        )
        create_folder(request, SessionInfo(channel="embedded", bus="embedded"))
        self._tap.close(self._raw.extend)
        passes = split_passes(self._raw)
        blocks = [format_block(passes[at : at + 700]) for at in range(0, len(passes), 700)]
        (folder / files.INPUTS).write_bytes(b"".join(blocks))
        if with_log:
            lines = (f"({k // 100}.{k % 100:02}0000) vcan0 {_hex(frame)}\n" for k, frame in enumerate(self.bus.log))
            (folder / files.FRAMES).write_text("".join(lines))
        return folder

    def _write(self, data: bytes | bytearray) -> int:
        self._raw += data
        return len(data)


def _hex(frame: CanFrame) -> str:
    separator = "##1" if frame.is_fd else "#"
    return f"{frame.can_id:03X}{separator}{frame.data.hex().upper()}"
