"""Several buses as one: merged by stamps, each frame sent on its own, and the loss of one is reported with its name."""

import re
import socket
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from tests.buses.two_buses import load_vehicle
from tests.harness import Clock, Drive, ms
from vehicle_iface import clock
from vehicle_iface.bus.base import add_bus_name
from vehicle_iface.bus.controller_events import ControllerEvent
from vehicle_iface.bus.several import SeveralBuses, buses_by_name
from vehicle_iface.bus.traffic_monitor import TrafficSample
from vehicle_iface.errors import BusError, BusGoneError
from vehicle_iface.frame import CanFrame, FrameKey
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.link import Link
from vehicle_iface.runtime.summary import table
from vehicle_iface.telemetry.details import LinkChange, LinkDetails, LinkSummary


class Part:
    """One bus; its description and its errors are those of a SocketCAN interface."""

    def __init__(self, name: str, number: int) -> None:
        self.name, self.number = name, number
        self.description = f"SocketCAN can{number}"
        self.near, self.far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.queued: list[CanFrame] = []
        self.sent: list[CanFrame] = []
        self.takes = 99
        """Frames that there is room for."""
        self.is_waiting = False
        self.error: BusError | None = None
        self.reported: list[ControllerEvent] = []
        self.overflow = 0
        self.closed = 0

    def carry(self, can_id: int, stamp_ns: int) -> CanFrame:
        """Another node's frame."""
        frame = CanFrame(can_id, b"", stamp_ns, bus=self.number)
        self.queued.append(frame)
        self.far.send(b"frame")
        return frame

    def fileno(self) -> int:
        return self.near.fileno()

    def wait(self, until_ns: int) -> bool:
        raise AssertionError(f"{until_ns}: one poll waits for all of them")

    def drain(self) -> list[CanFrame]:
        self._check()
        for _ in self.queued:
            self.near.recv(9)
        frames, self.queued = self.queued, []
        return frames

    def has_room(self) -> bool:
        self._check()
        return not self.is_waiting

    def send(self, *frames: CanFrame) -> int:
        self._check()
        taken = frames[: self.takes]
        self.sent += taken
        return len(taken)

    def counters(self) -> dict[str, int]:
        return {"sent": len(self.sent), "receive_overflow": self.overflow}

    def events(self) -> list[ControllerEvent]:
        events, self.reported = self.reported, []
        return events

    def poll_traffic(self, now_ns: int) -> TrafficSample:  # noqa: ARG002
        count = 10 * (self.number + 1)
        return TrafficSample(ms(500), count, ms(50) * (self.number + 1), {FrameKey(0x100, bus=self.number): count})

    def close(self) -> None:
        self.closed += 1
        self.near.close()
        self.far.close()

    def _check(self) -> None:
        if self.error is not None:
            raise add_bus_name(self.name, self.error)


@pytest.fixture
def parts() -> Iterator[dict[str, Part]]:
    made = {name: Part(name, number) for number, name in enumerate(("vehicle", "ins"))}
    yield made
    for part in made.values():
        part.close()


@pytest.fixture
def bus(parts: dict[str, Part]) -> SeveralBuses:
    return SeveralBuses(parts, "SocketCAN vehicle=can0, ins=can1")


COMMANDS = (CanFrame(0x80, b"a"), CanFrame(0x81, b"b"), CanFrame(0x80, b"c", bus=1), CanFrame(0x82, b"d"))


def test_a_frame_on_any_bus_ends_the_wait(bus: SeveralBuses, parts: dict[str, Part]) -> None:
    assert not bus.wait(clock.monotonic_ns())
    parts["ins"].carry(0x100, 1)
    assert bus.wait(clock.monotonic_ns() + ms(60_000))


def test_frames_come_in_the_order_of_their_stamps_and_those_of_one_bus_in_their_own(
    bus: SeveralBuses, parts: dict[str, Part]
) -> None:
    vehicle, ins = parts["vehicle"], parts["ins"]
    first, fourth, fifth = (vehicle.carry(0x100, stamp_ns) for stamp_ns in (10, 30, 20))  # its clock was stepped
    second, third = (ins.carry(0x100, stamp_ns) for stamp_ns in (11, 29))
    assert bus.drain() == [first, second, third, fourth, fifth]
    assert bus.drain() == []


def test_a_single_bus_that_has_frames_is_read_as_it_is(bus: SeveralBuses, parts: dict[str, Part]) -> None:
    frames = [parts["ins"].carry(0x100, stamp_ns) for stamp_ns in (3, 1)]
    assert bus.drain() == frames


def test_each_frame_leaves_on_its_own_bus(bus: SeveralBuses, parts: dict[str, Part]) -> None:
    assert bus.send(*COMMANDS) == 4
    assert [frame.data for frame in parts["vehicle"].sent] == [b"a", b"b", b"d"]
    assert [frame.data for frame in parts["ins"].sent] == [b"c"]


@pytest.mark.parametrize(("takes", "sent"), [({"vehicle": 1}, 1), ({"ins": 0}, 2), ({"vehicle": 2, "ins": 0}, 2)])
def test_nothing_leaves_behind_the_first_frame_that_is_not_taken(
    bus: SeveralBuses, parts: dict[str, Part], takes: dict[str, int], sent: int
) -> None:
    for name, count in takes.items():
        parts[name].takes = count
    assert bus.send(*COMMANDS) == sent
    assert sum(len(part.sent) for part in parts.values()) == sent
    assert bus.refusing == ("vehicle" if takes.get("vehicle") == 1 else "ins")


def test_there_is_room_only_where_all_of_them_have_room(bus: SeveralBuses, parts: dict[str, Part]) -> None:
    assert bus.has_room()
    parts["ins"].is_waiting = True
    assert not bus.has_room()
    assert bus.refusing == "ins"


def test_frames_sent_before_another_bus_was_lost_are_counted_and_the_loss_is_reported_next(
    bus: SeveralBuses, parts: dict[str, Part]
) -> None:
    parts["ins"].error = BusGoneError("can1: no such device")
    assert bus.send(*COMMANDS) == 2
    parts["ins"].error = None  # the kernel tells it once
    for ask in (bus.drain, bus.has_room, bus.send, lambda: bus.wait(0)):
        with pytest.raises(BusGoneError, match=r"^bus ins: can1: no such device$"):
            ask()


def test_a_loss_before_any_frame_was_sent_is_reported_at_once(bus: SeveralBuses, parts: dict[str, Part]) -> None:
    parts["vehicle"].error = BusError("can0: down")
    with pytest.raises(BusError, match=r"^bus vehicle: can0: down$"):
        bus.send(*COMMANDS)
    assert not parts["ins"].sent


def test_counts_are_those_of_all_and_of_each(bus: SeveralBuses) -> None:
    bus.send(*COMMANDS)
    counts = bus.counters()
    assert (counts["sent"], counts["sent vehicle"], counts["sent ins"]) == (4, 3, 1)


class Linked:
    """A link to two buses that can be opened again."""

    def __init__(self) -> None:
        self.clock, self.counts = Clock(), Counters()
        self.opened: list[dict[str, Part]] = []
        self.link = Link(self.open, self.counts, now_ns=self.clock.now_ns, sleep_until=self.clock.sleep_until)

    def open(self) -> SeveralBuses:
        self.opened.append({name: Part(name, number) for number, name in enumerate(("vehicle", "ins"))})
        return SeveralBuses(self.opened[-1], "SocketCAN vehicle=can0, ins=can1")

    @property
    def parts(self) -> dict[str, Part]:
        return self.opened[-1]

    @property
    def states(self) -> list[tuple[str, str]]:
        return [(state.name, why) for _, state, why in self.link.transitions]

    def watch_for(self, duration_ns: int) -> None:
        for _ in range(duration_ns // ms(10)):
            self.clock.sleep_until(self.clock.t_ns + ms(10))
            self.link.receive(0)
            self.link.watch(self.clock.t_ns)


@pytest.fixture
def linked() -> Iterator[Linked]:
    made = Linked()
    yield made
    made.link.close()


def test_a_lost_bus_is_a_lost_link_that_names_the_bus_and_all_are_reopened(linked: Linked) -> None:
    linked.parts["ins"].error = BusError("can1: Network is down")
    linked.watch_for(ms(10))
    assert linked.link.take_loss()
    assert linked.states == [("DOWN", "bus ins: can1: Network is down")]
    assert linked.link.why == "bus ins: can1: Network is down"
    assert [part.closed for part in linked.opened[0].values()] == [1, 1]
    linked.watch_for(ms(200))
    assert linked.states[1:] == [("RECOVERING", "SocketCAN vehicle=can0, ins=can1 is open again")]
    assert linked.counts.link_losses == 1


def test_a_bus_off_controller_is_reported_with_its_bus(linked: Linked) -> None:
    linked.parts["ins"].reported = [ControllerEvent.BUS_OFF]
    linked.watch_for(ms(50))
    ((state, why),) = linked.states
    assert (state, why.startswith("bus ins: SocketCAN can1: bus off")) == ("DOWN", True)
    assert linked.link.events == {"bus ins: bus off": 1}


def test_errors_of_one_controller_are_not_over_when_another_one_is_well(linked: Linked) -> None:
    linked.parts["ins"].reported = [ControllerEvent.PASSIVE]
    linked.watch_for(ms(100))
    linked.parts["vehicle"].reported = [ControllerEvent.ACTIVE]
    linked.parts["vehicle"].carry(0x100, 1)
    linked.watch_for(ms(1000))
    assert linked.states == [("DEGRADED", "bus ins: error passive")]
    linked.parts["ins"].reported = [ControllerEvent.ACTIVE]
    linked.watch_for(ms(100))
    assert [state for state, _ in linked.states] == ["DEGRADED", "UP"]


def test_a_bus_that_takes_nothing_and_one_that_lost_frames_are_named(linked: Linked) -> None:
    linked.parts["ins"].overflow = 3
    linked.watch_for(ms(50))
    assert linked.states == [("DEGRADED", "bus ins: receive overflow")]
    linked.parts["vehicle"].is_waiting = True
    for _ in range(12):
        linked.link.has_room()
        linked.watch_for(ms(10))
    state, why = linked.states[-1]
    assert (state, why.startswith("bus vehicle: ")) == ("DOWN", True)


def test_the_load_of_each_bus_is_known_and_the_greatest_is_the_link_s(linked: Linked) -> None:
    linked.watch_for(ms(500))
    names = {FrameKey(0x100): "STATUS", FrameKey(0x100, bus=1): "STATUS"}
    counted = {FrameKey(0x100): 7, FrameKey(0x100, bus=1): 20}
    assert linked.link.load.now("UP", names, counted) == LinkDetails(
        state="UP",
        load_percent=20.0,
        loads_percent={"vehicle": 10.0, "ins": 20.0},
        frames_per_s=60.0,
        rates_hz={"vehicle 0x100 STATUS": 14.0, "ins 0x100 STATUS": 40.0},
    )
    assert linked.link.load.whole("UP", [], names, counted).highest_load_percent == 20.0


def test_a_lost_bus_and_the_load_of_each_are_in_the_summary(tmp_path: Path) -> None:
    summary = Drive(database=load_vehicle(tmp_path)).loop.summary()
    changes = [LinkChange(at_s=1.0, state="DOWN", why="bus ins: can1: down")]
    loads = {"vehicle": 10.0, "ins": 20.0}
    link = LinkSummary(
        state="UP",
        transitions=changes,
        load_percent=20.0,
        loads_percent=loads,
        highest_load_percent=25.0,
        frames_per_s=60.0,
        rates_hz={},
    )
    shown = table(msgspec.structs.replace(summary, link=link))
    assert re.search(r"^  link lost +bus ins: can1: down$", shown, re.MULTILINE)
    assert "bus load vehicle 10.0 %, ins 20.0 % (at most 25.0 %)" in shown


def test_a_bus_that_is_one_has_itself_as_its_only_part(parts: dict[str, Part]) -> None:
    assert buses_by_name(parts["ins"]) == {"": parts["ins"]}
