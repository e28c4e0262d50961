"""One case's set-up while it runs: bus, vehicle and device, a hundred ticks a second, in one thread."""

import random
import re
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from vehicle_bus_contract.cable import set_link
from vehicle_bus_contract.candump import candump_line
from vehicle_bus_contract.reference import MS, Frame, S

from hil_bench.bus import RxFrame
from hil_bench.buses import open_bus
from hil_bench.device import Commands, Device, fill_template
from hil_bench.errors import RigError, UnexpectedNodeError
from hil_bench.lateness import Delay, DeviceWatch, Lateness, Witness, sum_up
from hil_bench.peer.build import build_vehicle
from hil_bench.process import Process
from hil_bench.result import Event, EventKind
from hil_bench.shell import Shell
from hil_bench.wire import Wire

ANSWER_S = 0.005
"""Within half a period a device has answered, or it has not."""
STUCK_S = 20.0
"""Longer than any trajectory of the catalogue lets it wait for a change of direction."""
LATE_NS = 30 * MS
"""A tick later than this invalidates the observation: plus one period it approaches the 50 ms stale-state limit."""
FULL_QUEUE = "the bench had no room in its transmit queue, and was"
COMMAND_S = 10.0
"""A system command that takes longer has failed."""


class Rig:
    """Raises `RigError` and `OSError` where the bench, not the device, is at fault."""

    def __init__(
        self,
        wire: Wire,
        channels: Sequence[str],
        device_channels: Sequence[str],
        commands: Commands,
        folder: Path,
        placeholders: Mapping[str, str],
        seed: int,
        name: str,
    ) -> None:
        """The channels are those of each bus. `name` is the case's; with `seed` it fixes all that is left to chance."""
        self.wire, self.folder, self.name = wire, folder, name
        self.random = random.Random(f"{seed} {name}")
        self.channels, self.device_channels = channels, device_channels
        self.bus = open_bus(channels, wire)
        self.vehicle = build_vehicle(wire)
        self.vehicle_transmits = True
        self.placeholders, self._commands = placeholders, commands
        self.device = Device(commands, folder / f"{name}.log", placeholders, self.run_command)
        self._shell = Shell()
        self.received: list[RxFrame] = []
        self.events: list[Event] = []
        self.every_tick: list[Callable[[], None]] = []
        self.delay_s: Callable[[], float] = lambda: 0.0
        self.late: list[Delay] = []
        """Ticks of the bench that came too late."""
        self.watch = DeviceWatch(self.device.find_processes)
        self._witness: Witness | None = None
        self._seen_by_witness: list[tuple[int, int, int]] = []
        self.commands_ns = 0
        """When the first command came: lateness before it does no harm, unless none comes at all."""
        self.begin_ns = self.inject_ns = self.end_ns = self.then_ns = self.healthy_ns = self.exit_ns = 0
        self.engaged_ns = self.closed_ns = 0
        self.is_not_engaged_in_time = False
        """The device runs, and the time in which it should have engaged is over."""
        self.touched_ns = 0
        """The bench began to act; the fault may begin a little later."""
        self.armed_ns: list[int] = []
        """When the device was armed again."""
        self.exit_status: int | None = None
        self._output_bytes: list[int] = []
        """Of the device's output, at each mark."""
        self._next_ns = 0
        self._of_device = frozenset(wire.of_device)

    @property
    def now_ns(self) -> int:
        """Of the clock that stamps the frames."""
        return time.monotonic_ns()

    def begin(self) -> None:
        """Start the case's clock; the vehicle transmits from the next tick."""
        self._witness = Witness()
        self.begin_ns = self._next_ns = self.now_ns

    @property
    def lateness(self) -> Lateness:
        """How late bench and host were; complete once the rig is closed."""
        from_ns = self.begin_ns if self.is_not_engaged_in_time else self.commands_ns or self.begin_ns
        return sum_up(self.late, self.watch.waits, self._seen_by_witness, self.begin_ns, from_ns)

    def tick(self) -> None:
        """Wait for the next period; receive, move the vehicle, transmit."""
        now_ns = time.monotonic_ns()
        if now_ns < self._next_ns:
            time.sleep((self._next_ns - now_ns) / S)
            now_ns = time.monotonic_ns()
        due_ns = self._next_ns
        self._next_ns = (now_ns if now_ns - due_ns > LATE_NS else due_ns) + self.vehicle.period_ns
        self._drain(now_ns)
        if not self.exit_ns and self.device.poll() is not None:
            self.exit_ns = now_ns
        self.vehicle.move(self.vehicle.period_ns / S, now_ns)
        frames = self.vehicle.next_frames()
        if self.vehicle_transmits:
            delay_s = self.delay_s()
            if delay_s > 0.0:
                time.sleep(delay_s)
            rejected = self.bus.rejected
            for frame in frames:
                self.bus.send(frame)
            if self.bus.rejected > rejected:
                self.late.append(Delay(at_s=self._now_s(), by_s=LATE_NS / S, what=FULL_QUEUE))
        self._note_lateness(time.monotonic_ns() - due_ns)
        for call in tuple(self.every_tick):
            call()

    def run_for(self, duration_s: float) -> None:
        """Tick for this long."""
        end_ns = self.now_ns + round(duration_s * S)
        while self.now_ns < end_ns:
            self.tick()

    def wait_for(self, is_true: Callable[[], bool], within_s: float, what: str) -> bool:
        """Tick until the condition holds. False after `within_s`, which is then noted on the time line."""
        end_ns = self.now_ns + round(within_s * S)
        while not is_true():
            if self.now_ns > end_ns:
                self.note(EventKind.CLEAN_UP, f"waited {within_s:.0f} s in vain for {what}")
                return False
            self.tick()
        return True

    def note(self, kind: EventKind, text: str, at_ns: int = 0) -> None:
        """Add an event to the time line (default: now)."""
        self.events.append(Event(at_s=((at_ns or self.now_ns) - self.begin_ns) / S, kind=kind, text=text))

    def mark_injection(self) -> None:
        """The fault begins now."""
        self.inject_ns = self.now_ns

    @property
    def is_engaged(self) -> bool:
        """True while the vehicle is autonomous and its last command is no stop."""
        return self.vehicle.is_driven

    @property
    def is_at_end(self) -> bool:
        """True once the device has ended its drive where the trajectory ends, and the vehicle is at rest."""
        return self.vehicle.has_arrived

    @property
    def is_stuck(self) -> bool:
        """True once the vehicle has been at rest for `STUCK_S`."""
        ticks = round(STUCK_S * S / self.vehicle.period_ns)
        return len(self.vehicle.history) > ticks and not any(
            instant.speed_mps for instant in self.vehicle.history[-ticks:]
        )

    def rearm(self) -> None:
        """Arm the device again, as the operator does."""
        self.armed_ns.append(self.now_ns)
        self.device.rearm()

    def run_command(self, command: Sequence[str]) -> None:
        """Run a system command while the vehicle continues. Raises `RigError` when it fails."""
        self._shell.start(command)
        if not self.wait_for(self._shell.is_done, COMMAND_S, command[0]):
            raise RigError(f"{' '.join(command)}: did not end")
        if self._shell.status:
            raise RigError(f"{' '.join(command)}: {self._shell.output or self._shell.status}")

    def start_process(self, command: Sequence[str]) -> Process:
        """Start a program that runs until `stop_process`; its output goes to a file. Raises `RigError`."""
        log = self.folder / f"{self.name}.process.log"
        self._shell.start(["exec", *command], background_log=str(log))
        if not self.wait_for(self._shell.is_done, COMMAND_S, command[0]):
            raise RigError(f"{' '.join(command)}: did not start")
        number = re.search(r"^process=(\d+)$", self._shell.output, re.MULTILINE)
        try:
            return Process(int(number[1]) if number else 0)
        except OSError as error:
            raise RigError(f"{' '.join(command)}: {error}; see {log}") from None

    def stop_process(self, process: Process) -> None:
        """End a program of `start_process`, if it still runs."""
        process.send(signal.SIGCONT)
        process.send(signal.SIGTERM)
        process.close()

    @property
    def viewer(self) -> list[str]:
        """The command that starts a viewer of the device."""
        return fill_template(self._commands.view, self.placeholders)

    @property
    def device_channel(self) -> str:
        """The device's interface on the first bus."""
        return self.device_channels[0]

    def set_link(self, *, up: bool, bus: int = 0) -> None:
        """Take the device's interface on a bus up or down at once. Raises `OSError`."""
        set_link(self.device_channels[bus], is_up=up)

    def mark_output(self) -> None:
        """Mark where the device's output ends now: once when the bench begins to act, and when the operator acts."""
        self._output_bytes.append(self.device.log.stat().st_size if self.device.log.exists() else 0)

    def said(self) -> str:
        """The device's output between the first mark and the last."""
        if len(self._output_bytes) < 2:
            return ""
        begin, end = self._output_bytes[0], self._output_bytes[-1]
        return self.device.log.read_bytes()[begin:end].decode(errors="replace") if self.device.log.exists() else ""

    def receive_commands(self) -> None:
        """Wait for the device's answer to the last sample, and receive it."""
        time.sleep(ANSWER_S)
        self._drain(time.monotonic_ns())

    def device_frames(self) -> list[Frame]:
        """All frames that the device sent, well-formed or not."""
        return [rx.frame for rx in self.received if self._is_from_device(rx)]

    def judged_frames(self) -> list[Frame]:
        """The frames that the device is judged by: the vehicle's as they were on the bus, and its own."""
        return [
            rx.frame
            for rx in self.received
            if not rx.frame.is_error and (self._is_from_device(rx) or (rx.is_ours and not self._has_device_id(rx)))
        ]

    def write_candump(self, path: Path) -> None:
        """Write all received frames as `candump -L` does."""
        offset_ns = time.time_ns() - time.monotonic_ns()
        with open(path, "w", encoding="ascii") as log:
            for rx in self.received:
                log.write(candump_line(rx.frame, self.channels[rx.frame.bus], offset_ns) + "\n")

    def close(self) -> None:
        """Close bus and shell, and end the witness. May be called twice."""
        self.watch.close()
        if self._witness is not None:
            self._seen_by_witness, self._witness = self._witness.close(), None
        self.bus.close()
        self._shell.close()

    def _note_lateness(self, late_ns: int) -> None:
        if self.vehicle.commands:
            self.commands_ns = self.commands_ns or self.now_ns
        if late_ns > LATE_NS:
            self.late.append(Delay(at_s=self._now_s(), by_s=late_ns / S, what="the bench was"))
        self.watch.look(time.monotonic_ns())

    def _now_s(self) -> float:
        return (self._next_ns - self.begin_ns) / S

    def _drain(self, now_ns: int) -> None:
        for rx in self.bus.drain():
            self.received.append(rx)
            if self._has_device_id(rx) and not rx.frame.is_error:
                self.vehicle.receive(rx.frame, now_ns)
            elif not rx.is_ours and self.vehicle_transmits:
                self._check_sender(rx.frame)

    def _check_sender(self, frame: Frame) -> None:
        """Stop transmitting and raise `UnexpectedNodeError` if a frame of the vehicle came from another node."""
        decoded = None if frame.is_error else self.wire.intact(frame)
        if decoded is not None:
            self.vehicle_transmits = False
            self.every_tick.clear()
            raise UnexpectedNodeError(f"another node sends {decoded.name} (0x{frame.can_id:03X}) on this bus")

    def _has_device_id(self, rx: RxFrame) -> bool:
        return self.wire.name_of(rx.frame) in self._of_device

    def _is_from_device(self, rx: RxFrame) -> bool:
        if rx.is_ours or rx.frame.is_error:
            return False
        return self._has_device_id(rx) or bool(self.wire.find_stray(rx.frame))
