"""Loss of the bus and its return: counted once, reported once, reopened on a timer."""

import pytest

from tests.harness import Clock, ms
from tests.inbox_bus import InboxBus
from vehicle_iface.bus.base import Bus
from vehicle_iface.bus.controller_events import ControllerEvent
from vehicle_iface.bus.traffic_monitor import TrafficSample
from vehicle_iface.errors import BusError, BusGoneError
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.link import MAX_TRANSITIONS, REOPEN_NS, Link

FRAME = CanFrame(0x80, b"12345678")


class Socket:
    """A bus that can be cut, and that remembers how it was treated."""

    def __init__(self, cable: "Cable") -> None:
        self.description = f"socket {len(cable.sockets)}"
        self.cable = cable
        self.closed = 0
        self.received = 0

    def wait(self, until_ns: int) -> bool:
        self._check()
        self.cable.clock.sleep_until(until_ns)
        return bool(self.cable.frames)

    def drain(self) -> list[CanFrame]:
        self._check()
        frames, self.cable.frames = self.cable.frames, []
        self.received += len(frames)
        return frames

    def has_room(self) -> bool:
        self._check()
        return not self.cable.waiting

    def send(self, *frames: CanFrame) -> int:
        self._check()
        return 0 if self.cable.full else len(frames)

    def counters(self) -> dict[str, int]:
        overflow = {"receive_overflow": self.cable.overflow} if self.cable.overflow else {}
        return {"received": self.received} | overflow

    def close(self) -> None:
        self.closed += 1

    def events(self) -> list[ControllerEvent]:
        self.cable.asked_ns.append(self.cable.clock.t_ns)
        self._check()
        events, self.cable.events = self.cable.events, []
        return events

    def _check(self) -> None:
        if self.cable.down:
            raise BusGoneError("no such interface") if self.cable.gone else BusError("cut")


class TrafficSocket(Socket):
    """One that sees all traffic as well."""

    def poll_traffic(self, now_ns: int) -> TrafficSample:
        self.cable.looked_ns.append(now_ns)
        self._check()
        return TrafficSample(span_ns=ms(500), frames=50, busy_ns=ms(100), frames_by_key={})


class Cable:
    """Everything that a link is opened on."""

    def __init__(self, kind: type[Socket] = Socket) -> None:
        self.kind = kind
        self.asked_ns: list[int] = []
        self.looked_ns: list[int] = []
        self.clock = Clock()
        self.down = self.gone = self.full = self.waiting = False
        self.events: list[ControllerEvent] = []
        self.overflow = 0
        self.frames: list[CanFrame] = []
        self.sockets: list[Socket] = []
        self.tries_ns: list[int] = []
        self.lost = 0
        self.counts = Counters()
        self.link = Link(
            self.open,
            self.counts,
            now_ns=self.clock.now_ns,
            sleep_until=self.clock.sleep_until,
        )

    def open(self) -> Socket:
        self.tries_ns.append(self.clock.t_ns)
        if self.down:
            raise BusGoneError("no such interface") if self.gone else BusError("still down")
        self.sockets.append(self.kind(self))
        return self.sockets[-1]

    def receive(self) -> list[CanFrame]:
        frames = self.link.receive(self.clock.t_ns + ms(10))
        self.lost += self.link.take_loss()
        return frames

    def pass_for(self, duration_ns: int) -> list[CanFrame]:
        received: list[CanFrame] = []
        end_ns = self.clock.t_ns + duration_ns
        while self.clock.t_ns < end_ns:
            received += self.receive()
        return received

    def watch_for(self, duration_ns: int) -> None:
        """Hear and watch at 100 Hz."""
        end_ns = self.clock.t_ns + duration_ns
        while self.clock.t_ns < end_ns:
            self.receive()
            self.link.watch(self.clock.t_ns)


def test_a_bus_that_cannot_be_opened_at_the_start_is_an_error() -> None:
    def refuse() -> Bus:
        raise BusError("vcan0: no such interface")

    clock = Clock()
    with pytest.raises(BusError, match="vcan0"):
        Link(refuse, Counters(), now_ns=clock.now_ns, sleep_until=clock.sleep_until)


@pytest.mark.parametrize("by", ["receiving", "sending"])
def test_a_loss_closes_the_bus_and_is_counted_and_logged_once(by: str) -> None:
    cable = Cable()
    cable.down = True
    if by == "receiving":
        assert cable.receive() == []
    else:
        assert not cable.link.send(FRAME)
    for _ in range(3):
        assert not cable.link.send(FRAME)
    cable.pass_for(ms(1000))
    assert (cable.lost, cable.counts.link_losses, cable.sockets[0].closed) == (1, 1, 1)
    assert cable.counts.frames_sent == 0


def test_a_frame_that_met_a_lost_link_is_not_sent_later() -> None:
    cable = Cable()
    cable.down = True
    cable.link.send(FRAME)
    cable.down = False
    cable.pass_for(ms(300))
    assert len(cable.sockets) == 2
    assert cable.counts.frames_sent == 0


def test_a_lost_link_is_tried_ten_times_a_second_on_its_grid() -> None:
    cable = Cable()
    began_ns = cable.clock.t_ns
    cable.down = True
    cable.pass_for(ms(1005))
    tries_ns = cable.tries_ns[1:]
    assert len(tries_ns) == 10
    assert [(t_ns - began_ns) % REOPEN_NS for t_ns in tries_ns] == [0] * 10


def test_a_restored_link_receives_and_sends_again() -> None:
    cable = Cable()
    cable.down = True
    cable.pass_for(ms(250))
    cable.down = False
    cable.pass_for(ms(100))
    cable.frames = [FRAME]
    assert cable.pass_for(ms(10)) == [FRAME]
    assert cable.link.send(FRAME)
    cable.down = True
    cable.pass_for(ms(20))
    assert (cable.lost, cable.counts.link_losses) == (2, 2)


def test_a_full_bus_is_no_lost_link() -> None:
    cable = Cable()
    cable.full = True
    assert not cable.link.send(FRAME)
    assert (cable.counts.frames_sent, cable.counts.frames_not_sent, cable.lost) == (0, 1, 0)
    cable.full = False
    assert cable.link.send(FRAME)
    assert (cable.counts.frames_sent, cable.counts.frames_not_sent) == (1, 1)


def test_the_counters_survive_every_loss() -> None:
    cable = Cable()
    for received in range(1, 4):
        cable.frames = [FRAME] * received
        cable.pass_for(ms(10))
        cable.down = True
        cable.pass_for(ms(10))
        cable.down = False
        cable.pass_for(ms(200))
    assert cable.link.counters() == {"received": 1 + 2 + 3}


def test_closing_twice_closes_the_bus_once() -> None:
    cable = Cable()
    cable.link.close()
    cable.link.close()
    assert cable.sockets[0].closed == 1
    assert cable.lost == 0


def states(cable: Cable) -> list[str]:
    return [change.state.name for change in cable.link.transitions]


def test_a_link_goes_down_and_comes_back_by_recovering() -> None:
    cable = Cable()
    cable.down = True
    cable.pass_for(ms(250))
    cable.down = False
    cable.pass_for(ms(150))
    assert states(cable) == ["DOWN", "RECOVERING"]
    cable.watch_for(ms(600))
    assert states(cable) == ["DOWN", "RECOVERING"]  # nothing was received yet
    cable.frames = [FRAME]
    cable.watch_for(ms(100))
    assert states(cable) == ["DOWN", "RECOVERING", "UP"]


def test_an_interface_that_is_deleted_is_gone_and_one_that_is_back_but_down_is_down() -> None:
    cable = Cable()
    cable.down = cable.gone = True
    cable.pass_for(ms(250))
    cable.gone = False
    cable.pass_for(ms(250))
    cable.down = False
    cable.pass_for(ms(250))
    assert states(cable) == ["GONE", "DOWN", "RECOVERING"]


def test_a_refused_command_degrades_the_link_until_it_was_clean_for_a_while() -> None:
    cable = Cable()
    cable.frames = [FRAME]
    cable.pass_for(ms(10))
    cable.waiting = True
    assert not cable.link.has_room()
    cable.waiting = False
    assert cable.link.has_room()
    assert cable.link.send(FRAME)
    assert (states(cable), cable.link.is_stalled) == (["DEGRADED"], False)
    cable.watch_for(ms(400))
    assert states(cable) == ["DEGRADED"]
    cable.watch_for(ms(200))
    assert states(cable) == ["DEGRADED", "UP"]
    assert cable.counts.commands_refused == 1


@pytest.mark.parametrize("by", ["waiting", "full"])
def test_three_refusals_in_a_row_stall_the_link(by: str) -> None:
    cable = Cable()
    cable.frames = [FRAME]
    cable.pass_for(ms(10))
    setattr(cable, by, True)
    stalled = []
    for _ in range(3):
        assert not (cable.link.has_room() and cable.link.send(FRAME))
        stalled.append(cable.link.is_stalled)
    assert stalled == [False, False, True]
    setattr(cable, by, False)
    assert cable.link.has_room()
    assert cable.link.send(FRAME)
    assert cable.link.is_stalled  # one that leaves is no clean link yet
    cable.watch_for(ms(600))
    assert not cable.link.is_stalled


def test_a_sent_command_between_rejections_restarts_the_count() -> None:
    cable = Cable()
    for _ in range(4):
        for _ in range(2):
            cable.waiting = True
            assert not cable.link.has_room()
        cable.waiting = False
        assert cable.link.send(FRAME)
    assert not cable.link.is_stalled


def test_a_bus_that_refuses_for_longer_than_a_tenth_of_a_second_is_lost() -> None:
    cable = Cable()
    cable.waiting = True
    for _ in range(12):
        cable.link.has_room()
        cable.watch_for(ms(10))
    assert (states(cable)[:2], cable.lost) == (["DEGRADED", "DOWN"], 1)


def test_the_controllers_errors_degrade_the_link_until_it_is_active_again() -> None:
    cable = Cable()
    cable.frames = [FRAME]
    cable.events = [ControllerEvent.ARBITRATION_LOST]
    cable.watch_for(ms(100))
    assert states(cable) == []
    cable.events = [ControllerEvent.PASSIVE]
    cable.watch_for(ms(2000))
    assert states(cable) == ["DEGRADED"]
    cable.events = [ControllerEvent.ACTIVE]
    cable.watch_for(ms(600))
    assert states(cable) == ["DEGRADED", "UP"]
    cable.events = [ControllerEvent.BUS_OFF]
    cable.watch_for(ms(60))
    assert states(cable)[:3] == ["DEGRADED", "UP", "DOWN"]


def test_frames_that_the_kernel_had_no_room_for_degrade_the_link() -> None:
    cable = Cable()
    cable.frames = [FRAME]
    cable.overflow = 7
    cable.watch_for(ms(60))
    assert states(cable) == ["DEGRADED"]
    cable.watch_for(ms(600))
    assert states(cable) == ["DEGRADED", "UP"]


def test_a_bus_that_was_stuck_is_used_again_only_when_what_waits_in_it_has_left() -> None:
    cable = Cable()
    cable.frames = [FRAME]
    cable.pass_for(ms(10))
    cable.waiting = True
    for _ in range(12):
        cable.link.has_room()
        cable.watch_for(ms(10))
    cable.watch_for(ms(1000))
    assert (states(cable), len(cable.sockets), cable.sockets[0].closed) == (["DEGRADED", "DOWN"], 1, 0)
    cable.waiting = False
    cable.frames = [FRAME] * 5
    assert cable.pass_for(ms(200)) == []  # what came meanwhile is old
    assert states(cable) == ["DEGRADED", "DOWN", "RECOVERING"]
    assert (len(cable.sockets), cable.sockets[0].closed) == (1, 0)


def test_a_stuck_bus_whose_interface_goes_down_is_closed_and_reopened() -> None:
    cable = Cable()
    cable.waiting = True
    for _ in range(12):
        cable.link.has_room()
        cable.watch_for(ms(10))
    cable.down = True
    cable.watch_for(ms(300))
    assert (len(cable.sockets), cable.sockets[0].closed) == (1, 1)
    cable.down = cable.waiting = False
    cable.watch_for(ms(200))
    assert len(cable.sockets) == 2


@pytest.mark.parametrize(("later_ns", "lost"), [(ms(100), 0), (ms(100) + 1, 1)])
def test_a_tenth_of_a_second_of_refusals_ends_to_the_nanosecond(later_ns: int, lost: int) -> None:
    cable = Cable()
    cable.waiting = True
    assert not cable.link.has_room()
    cable.link.watch(cable.clock.t_ns + later_ns)
    cable.receive()
    assert cable.lost == lost


@pytest.mark.parametrize(("later_ns", "state"), [(ms(500) - 1, "DEGRADED"), (ms(500), "UP")])
def test_half_a_second_without_trouble_ends_to_the_nanosecond(later_ns: int, state: str) -> None:
    cable = Cable()
    cable.frames = [FRAME]
    cable.pass_for(ms(10))
    cable.full = True
    assert not cable.link.send(FRAME)
    cable.full = False
    assert cable.link.send(FRAME)
    cable.link.watch(cable.clock.t_ns + later_ns)
    assert cable.link.state.name == state


def test_a_link_without_any_received_frame_does_not_become_up() -> None:
    cable = Cable()
    cable.waiting = True
    assert not cable.link.has_room()
    cable.waiting = False
    assert cable.link.send(FRAME)
    cable.watch_for(ms(2000))
    assert states(cable) == ["DEGRADED"]


def test_the_controller_is_asked_twenty_times_a_second_on_its_grid() -> None:
    cable = Cable()
    began_ns = cable.clock.t_ns
    cable.watch_for(ms(500))
    assert [t_ns - began_ns for t_ns in cable.asked_ns] == [ms(50) * count for count in range(1, 11)]


def test_all_traffic_is_looked_at_twice_a_second_and_added_up() -> None:
    cable = Cable(TrafficSocket)
    began_ns = cable.clock.t_ns
    cable.watch_for(ms(2000))
    assert [t_ns - began_ns for t_ns in cable.looked_ns] == [ms(500), ms(1000), ms(1500), ms(2000)]
    link = cable.link.load.whole("UP", [], {}, {})
    assert (link.load_percent, link.highest_load_percent, link.frames_per_s) == (20.0, 20.0, 100.0)


class PlainBus(InboxBus):
    """The least that a bus can be: nobody can ask its controller, and it sees no traffic but its own."""

    def wait(self, until_ns: int) -> bool:  # noqa: ARG002
        return False

    def send(self, *frames: CanFrame) -> int:
        return len(frames)


def test_a_bus_without_error_events_is_monitored_too() -> None:
    clock, losses = Clock(), Counters()
    link = Link(PlainBus, losses, now_ns=clock.now_ns, sleep_until=clock.sleep_until)
    link.watch(clock.t_ns + ms(500))
    assert losses.link_losses == 0


@pytest.mark.parametrize("by", ["asking for room", "asking the controller"])
def test_a_question_that_finds_no_bus_is_a_loss(by: str) -> None:
    cable = Cable()
    cable.down = True
    if by == "asking for room":
        assert cable.link.has_room() is False
    else:
        cable.link.watch(cable.clock.t_ns + ms(50))
    assert cable.link.take_loss()
    assert states(cable) == ["DOWN"]


def test_without_a_bus_there_is_no_room_and_no_command_counts_as_rejected() -> None:
    cable = Cable()
    cable.link.close()
    assert cable.link.has_room() is False
    assert cable.counts.commands_refused == 0


def test_each_event_is_counted_and_each_kind_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    cable = Cable()
    cable.events = [ControllerEvent.ARBITRATION_LOST, ControllerEvent.ARBITRATION_LOST, ControllerEvent.PASSIVE]
    cable.watch_for(ms(50))
    cable.events = [ControllerEvent.PASSIVE]
    cable.watch_for(ms(50))
    assert cable.link.events == {ControllerEvent.ARBITRATION_LOST.value: 2, ControllerEvent.PASSIVE.value: 2}
    said = [record.getMessage() for record in caplog.records if "further ones are counted" in record.getMessage()]
    assert len(said) == 2


@pytest.mark.parametrize("well", [ControllerEvent.ACTIVE, ControllerEvent.RESTARTED])
@pytest.mark.parametrize("ill", [ControllerEvent.WARNING, ControllerEvent.PASSIVE])
def test_degraded_lasts_until_the_controller_reports_recovery(ill: ControllerEvent, well: ControllerEvent) -> None:
    cable = Cable()
    cable.frames = [FRAME]
    cable.events = [ill]
    cable.watch_for(ms(1000))
    assert states(cable) == ["DEGRADED"]
    cable.events = [well]
    cable.watch_for(ms(100))
    assert states(cable) == ["DEGRADED", "UP"]


def test_an_event_that_is_no_state_of_the_controller_is_over_by_itself() -> None:
    cable = Cable()
    assert cable.link.why == ""
    cable.frames = [FRAME]
    cable.events = [ControllerEvent.PROTOCOL]
    cable.watch_for(ms(1000))
    assert states(cable) == ["DEGRADED", "UP"]


def test_one_lost_frame_is_trouble_and_its_count_outlives_the_bus() -> None:
    cable = Cable()
    cable.overflow = 1
    cable.watch_for(ms(50))
    assert states(cable) == ["DEGRADED"]
    cable.down = True
    cable.pass_for(ms(10))
    cable.down, cable.overflow = False, 0
    cable.pass_for(ms(200))
    assert cable.link.counters()["receive_overflow"] == 1


def test_the_first_thousand_transitions_of_an_unstable_link_are_kept() -> None:
    cable = Cable()
    for _ in range(MAX_TRANSITIONS // 2 + 1):
        cable.down = True
        cable.pass_for(ms(10))
        cable.down = False
        cable.pass_for(ms(100))
    assert len(cable.link.transitions) == 1000
    assert cable.counts.link_losses == MAX_TRANSITIONS // 2 + 1


def lost_and_open_again(cable: Cable) -> None:
    cable.down = True
    cable.pass_for(ms(10))
    cable.down = False
    while cable.link.state.name != "RECOVERING":
        cable.pass_for(ms(10))


def test_the_first_event_of_a_kind_is_logged_when_it_comes(caplog: pytest.LogCaptureFixture) -> None:
    cable = Cable()
    cable.events = [ControllerEvent.ARBITRATION_LOST]
    cable.watch_for(ms(50))
    assert [record.getMessage() for record in caplog.records] == [
        f"socket 0: {ControllerEvent.ARBITRATION_LOST.value} (further ones are counted)"
    ]


class BlindSocket(TrafficSocket):
    """One that carries frames, and breaks when it is asked for all traffic."""

    def poll_traffic(self, now_ns: int) -> TrafficSample:  # noqa: ARG002
        raise BusError("no tap")


def test_a_look_at_the_traffic_that_finds_no_bus_is_a_loss() -> None:
    cable = Cable(BlindSocket)
    cable.watch_for(ms(490))
    assert cable.lost == 0
    cable.watch_for(ms(10))
    cable.lost += cable.link.take_loss()
    assert (cable.lost, cable.sockets[0].closed, states(cable)) == (1, 1, ["DOWN"])


def test_refusals_before_a_loss_do_not_count_after_it() -> None:
    cable = Cable()
    stalled = []
    for _ in range(2):
        cable.waiting = True
        for _ in range(3):
            cable.link.has_room()
            stalled.append(cable.link.is_stalled)
        cable.waiting = False
        lost_and_open_again(cable)
        assert not cable.link.is_stalled
    assert stalled == [False, False, True] * 2


def test_an_illness_ends_with_the_bus_that_had_it() -> None:
    cable = Cable()
    cable.events = [ControllerEvent.PASSIVE]
    cable.watch_for(ms(50))
    lost_and_open_again(cable)
    cable.frames = [FRAME]
    cable.watch_for(ms(600))
    assert states(cable) == ["DEGRADED", "DOWN", "RECOVERING", "UP"]


def test_frames_received_before_a_loss_do_not_make_the_link_up_after_it() -> None:
    cable = Cable()
    cable.frames = [FRAME]
    cable.pass_for(ms(10))
    lost_and_open_again(cable)
    cable.watch_for(ms(2000))
    assert states(cable) == ["DOWN", "RECOVERING"]


def test_a_link_that_is_back_counts_as_up_half_a_second_later_and_not_with_its_first_frame() -> None:
    cable = Cable()
    lost_and_open_again(cable)
    cable.frames = [FRAME]
    cable.watch_for(ms(400))
    assert states(cable) == ["DOWN", "RECOVERING"]
    cable.watch_for(ms(150))
    assert states(cable) == ["DOWN", "RECOVERING", "UP"]


def test_a_stuck_bus_whose_interface_goes_down_is_not_taken_for_one_that_is_back() -> None:
    cable = Cable()
    cable.waiting = True
    for _ in range(12):
        cable.link.has_room()
        cable.watch_for(ms(10))
    cable.down = True
    cable.watch_for(ms(1000))
    assert (states(cable), cable.lost, cable.sockets[0].closed) == (["DEGRADED", "DOWN"], 1, 1)
