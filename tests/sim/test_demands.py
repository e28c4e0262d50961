"""What the simulated vehicle demands besides commands: a handshake, and what enables it where no command does."""

from itertools import pairwise
from pathlib import Path

import pytest

from tests import harness
from tests.harness import Drive, Sent, ms
from tests.plain_vehicle import COMMAND, SIGNALS, load_vehicle
from vehicle_iface.frame import CanFrame
from vehicle_iface.safety.modes import Mode
from vehicle_iface.sim.demands import Handshake
from vehicle_iface.status import VehicleMode

PLAIN = {field: name for field, name in SIGNALS.items() if field != "enable"}
MORE = """
BO_ 114 BEAT: 2 PC
 SG_ ECHO : 0|1@1+ (1,0) [0|1] "" CAR
 SG_ MAGIC : 8|8@1+ (1,0) [0|255] "" CAR

BO_ 115 DISABLE: 1 PC
 SG_ MAGIC : 0|8@1+ (1,0) [0|255] "" CAR
"""
BEAT, DISABLE, STATUS = 114, 115, 256
ECHO = """
[[send]]
message = "BEAT"
when = "always"
period_s = 0.02
values = { ECHO = { echo = "STATUS.HANDSHAKE" } }
"""
VALUE = """
[[send]]
message = "BEAT"
when = "always"
period_s = 0.02
values = { MAGIC = { value = 17, when = "enabled" } }
"""
MESSAGES = """
[[send]]
message = "BEAT"
when = "engaging"
once = true
values = { MAGIC = 17 }
[[send]]
message = "DISABLE"
when = "released"
once = true
"""


@pytest.fixture(autouse=True)
def _keep_frames_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """The harness takes the reference vehicle's commands apart, and these are none."""
    monkeypatch.setattr(harness, "decode_sent", lambda frame, at_ns, step: Sent(at_ns, step, "", 0, {}, frame))


class Receiver:
    """Between the line and the vehicle: frames with these identifiers get lost."""

    def __init__(self, drive: Drive, monkeypatch: pytest.MonkeyPatch) -> None:
        self.lost: set[int] = set()
        self._receive = drive.vehicle.receive
        monkeypatch.setattr(drive.vehicle, "receive", self.receive)

    def receive(self, frame: CanFrame, now_ns: int) -> None:
        if frame.can_id not in self.lost:
            self._receive(frame, now_ns)


def drive_of(folder: Path, sends: str, *, has_enable: bool = False) -> Drive:
    """A vehicle that demands what `sends` says; `has_enable`: its commands have an enable as well."""
    return Drive(database=load_vehicle(folder, sends, command=COMMAND + MORE, signals=SIGNALS if has_enable else PLAIN))


def test_a_handshake_alternates_with_each_echo_in_time() -> None:
    shake = Handshake("BEAT", "ECHO", (0.0, 1.0), patience_ns=ms(100))
    assert (shake.value, shake.expires_ns) == (0.0, None)
    shake.note(1.0, ms(1))
    assert shake.turns == 0
    shake.note(0.0, ms(2))
    assert (shake.value, shake.turns, shake.expires_ns) == (1.0, 1, ms(102))
    shake.note(0.0, ms(3))
    assert (shake.value, shake.expires_ns) == (1.0, ms(102))
    shake.note(None, ms(4))
    shake.note(1.0, ms(5))
    assert (shake.value, shake.turns) == (0.0, 2)
    shake.note(0.0, ms(105))
    assert (shake.value, shake.turns) == (1.0, 1)


def test_a_vehicle_with_a_handshake_alternates_it_and_is_driven(tmp_path: Path) -> None:
    drive = drive_of(tmp_path, ECHO, has_enable=True).engage(1.0)
    begin = len(drive.sent)
    drive.run_s(1.0)
    echoes = [one.frame.data[0] & 1 for one in drive.sent[begin:] if one.frame.can_id == BEAT]
    assert sum(a != b for a, b in pairwise(echoes)) > 20
    assert drive.mode() is Mode.ENGAGED


def test_without_the_echo_a_vehicle_does_not_become_autonomous(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = drive_of(tmp_path, ECHO, has_enable=True)
    Receiver(drive, monkeypatch).lost.add(BEAT)
    drive.run_until(lambda: drive.mode() is Mode.FAULT, 10.0)
    assert drive.loop.reason.name == "VEHICLE_NOT_AUTONOMOUS"
    assert drive.vehicle.counters["to_autonomous"] == 0


def test_an_echo_that_ends_is_a_lost_commander_after_ten_periods(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = drive_of(tmp_path, ECHO, has_enable=True)
    receiver = Receiver(drive, monkeypatch)
    drive.engage(1.0)
    receiver.lost.add(BEAT)
    drive.run_s(0.15)
    assert drive.vehicle.mode is VehicleMode.AUTONOMOUS
    drive.run_s(0.1)
    assert (drive.vehicle.mode, drive.vehicle.counters["commands_lost"]) == (VehicleMode.FAULT, 1)
    drive.run_s(0.1)
    assert drive.mode() is Mode.FAULT


@pytest.mark.parametrize("sends", [VALUE, MESSAGES])
def test_a_vehicle_without_an_enable_signal_is_enabled_by_the_messages_of_engaging(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sends: str
) -> None:
    drive = drive_of(tmp_path, sends)
    receiver = Receiver(drive, monkeypatch)
    receiver.lost.add(BEAT)
    drive.run_until(lambda: drive.mode() is Mode.FAULT, 10.0)
    assert drive.vehicle.counters["to_autonomous"] == 0
    receiver.lost.clear()
    drive.loop.arming.request()
    drive.engage(1.0)
    assert drive.vehicle.mode is VehicleMode.AUTONOMOUS


@pytest.mark.parametrize("sends", [VALUE, MESSAGES])
def test_it_is_released_by_the_messages_of_a_release(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sends: str
) -> None:
    drive = drive_of(tmp_path, sends)
    receiver = Receiver(drive, monkeypatch)
    drive.engage(1.0)
    drive.loop.shutdown.request()
    receiver.lost |= {BEAT, DISABLE}
    drive.run_until(lambda: drive.mode() is Mode.RELEASED, 10.0)
    assert drive.vehicle.mode is VehicleMode.AUTONOMOUS
    receiver.lost.clear()
    drive.vehicle.receive(next(one.frame for one in reversed(drive.sent) if one.frame.can_id in (BEAT, DISABLE)), 0)
    assert drive.vehicle.mode.name == "READY"


def test_after_an_override_the_earlier_messages_do_not_enable_it_again(tmp_path: Path) -> None:
    drive = drive_of(tmp_path, MESSAGES).engage(1.0)
    drive.send_line("brake 1")
    drive.run_s(0.1)
    drive.send_line("brake 0")
    drive.send_line("ready")
    assert not drive.vehicle._wire.demands.are_met(drive.clock.t_ns)


def test_an_echo_of_what_has_a_meaning_of_its_own_is_no_handshake(tmp_path: Path) -> None:
    drive = drive_of(tmp_path, ECHO.replace("STATUS.HANDSHAKE", "STATUS.BRAKE"), has_enable=True)
    assert drive.vehicle._wire.demands.handshakes == {}
    assert drive.engage(1.0).vehicle.mode is VehicleMode.AUTONOMOUS


def test_a_pause_of_the_simulation_gives_an_echo_as_much_more_time(tmp_path: Path) -> None:
    demands = drive_of(tmp_path, ECHO, has_enable=True).vehicle._wire.demands
    demands.extend(ms(50))
    before = demands.expires_ns
    demands.note("BEAT", {"ECHO": 0.0}, ms(10))
    answered = demands.expires_ns
    demands.extend(ms(50))
    assert (before, answered, demands.expires_ns) == (None, ms(210), ms(260))


def test_values_are_compared_within_half_a_count(tmp_path: Path) -> None:
    more = MORE.replace("SG_ MAGIC : 8|8@1+ (1,0) [0|255]", "SG_ MAGIC : 8|8@1+ (0.1,0) [0|25.5]", 1)
    sends = VALUE.replace("value = 17", "value = 0.33")
    database = load_vehicle(tmp_path, sends, command=COMMAND + more, signals=PLAIN)
    assert Drive(database=database).engage(1.0).vehicle.mode is VehicleMode.AUTONOMOUS
