"""What is sent besides the fields of commands: enabling and disabling messages, values with a phase, counts, echoes."""

from itertools import pairwise
from pathlib import Path

import pytest

from tests.harness import ms
from tests.plain_vehicle import COMMAND, load_vehicle
from tests.scripted_vehicle import Received, ScriptedDrive, ScriptedVehicle
from vehicle_iface.errors import ConfigError
from vehicle_iface.safety.modes import Mode
from vehicle_iface.status import VehicleMode

PLAIN = {"accel_mps2": "CMD.ACC", "front_wheel_angle_rad": "CMD.STEER"}
ENABLED_BY_MESSAGE = """\
BO_ 128 CMD: 8 PC
 SG_ ACC : 16|16@1- (0.001,0) [-10|10] "m/s^2" CAR
 SG_ STEER : 32|16@1- (0.0001,0) [-1|1] "rad" CAR

BO_ 112 ENABLE_MSG: 2 PC
 SG_ MAGIC : 0|16@1+ (1,0) [0|65535] "" CAR

BO_ 113 DISABLE_MSG: 2 PC
 SG_ MAGIC : 0|16@1+ (1,0) [0|65535] "" CAR
"""
ENABLE_AND_DISABLE = """
[[send]]
message = "ENABLE_MSG"
when = "engaging"
once = true
values = { MAGIC = 52229 }
[[send]]
message = "DISABLE_MSG"
when = "released"
once = true
values = { MAGIC = 52230 }
"""
HEARTBEAT = """
BO_ 114 HEARTBEAT: 4 PC
 SG_ COUNT : 0|4@1+ (1,0) [0|15] "" CAR
 SG_ INVERSE : 4|4@1+ (1,0) [0|15] "" CAR
 SG_ ARMED : 8|1@1+ (1,0) [0|1] "" CAR
 SG_ ENABLED : 9|1@1+ (1,0) [0|1] "" CAR
 SG_ ECHO : 16|8@1+ (1,0) [0|255] "" CAR
"""


def obeys_magic(_vehicle: ScriptedVehicle, got: Received) -> VehicleMode | None:
    """Driven from the message that enables until the one that disables."""
    if got.name == "ENABLE_MSG" and got["MAGIC"] == 52229:
        return VehicleMode.AUTONOMOUS
    return VehicleMode.READY if got.name == "DISABLE_MSG" else None


def obeys_enable(_vehicle: ScriptedVehicle, got: Received) -> VehicleMode | None:
    return VehicleMode.AUTONOMOUS if got.signals.get("EN") else None


def drive_by_magic(folder: Path, *, armed: bool = True) -> ScriptedDrive:
    database = load_vehicle(folder, ENABLE_AND_DISABLE, command=ENABLED_BY_MESSAGE, signals=PLAIN)
    return ScriptedDrive(database, obeys_magic, armed=armed)


def with_heartbeat(folder: Path, when: str, values: str) -> ScriptedDrive:
    send = f'[[send]]\nmessage = "HEARTBEAT"\nwhen = "{when}"\nperiod_s = 0.1\nvalues = {{ {values} }}\n'
    return ScriptedDrive(load_vehicle(folder, send, command=COMMAND + HEARTBEAT), obeys_enable)


def test_a_vehicle_that_one_message_enables_and_another_one_disables_is_driven(tmp_path: Path) -> None:
    drive = drive_by_magic(tmp_path)
    drive.run_until(Mode.ENGAGED)
    drive.run_s(3.0)
    assert drive.vehicle.speed_mps > 1.0
    assert len(drive.named("ENABLE_MSG")) == 1
    assert drive.named("DISABLE_MSG") == []
    assert drive.named("CMD")[0].at_ns <= drive.named("ENABLE_MSG")[0].at_ns


def test_commands_without_an_enable_are_sent_only_while_the_vehicle_is_driven(tmp_path: Path) -> None:
    drive = drive_by_magic(tmp_path)
    drive.run_until(Mode.STANDBY)
    assert drive.vehicle.received == []
    drive.run_until(Mode.ENGAGED)
    drive.vehicle.brake = True
    drive.run_until(Mode.OVERRIDDEN)
    since_ns = drive.clock.t_ns
    drive.run_s(1.0)
    assert {one.name for one in drive.vehicle.received if one.at_ns > since_ns} <= {"DISABLE_MSG"}


def test_the_disabling_message_is_sent_once_when_the_driver_takes_over_and_the_enabling_one_not_again(
    tmp_path: Path,
) -> None:
    drive = drive_by_magic(tmp_path)
    drive.run_until(Mode.ENGAGED)
    drive.vehicle.brake = True
    drive.run_s(1.0)
    assert drive.mode() is Mode.OVERRIDDEN
    assert [len(drive.named(name)) for name in ("ENABLE_MSG", "DISABLE_MSG")] == [1, 1]
    assert drive.named("DISABLE_MSG")[0]["MAGIC"] == 52230
    drive.vehicle.brake, drive.vehicle.mode = False, VehicleMode.READY
    drive.loop.arming.request()
    drive.run_until(Mode.ENGAGED)
    assert [len(drive.named(name)) for name in ("ENABLE_MSG", "DISABLE_MSG")] == [2, 1]


def test_the_disabling_message_is_sent_at_the_end_of_a_run(tmp_path: Path) -> None:
    drive = drive_by_magic(tmp_path)
    drive.run_until(Mode.ENGAGED)
    drive.loop.shutdown.request()
    drive.run_s(10.0)
    assert drive.loop.shutdown.is_done
    assert len(drive.named("DISABLE_MSG")) == 1
    assert drive.vehicle.mode is VehicleMode.READY


@pytest.mark.parametrize("end", ["override", "second signal"])
def test_a_value_that_releases_the_vehicle_does_not_wait_for_its_messages_period(tmp_path: Path, end: str) -> None:
    enabled = 'ENABLED = { value = 1, when = "enabled" }'
    drive = with_heartbeat(tmp_path, "always", enabled)
    drive.run_until(Mode.ENGAGED)
    drive.run_s(0.5)
    while drive.named("HEARTBEAT")[-1].at_ns < drive.clock.t_ns - ms(15):  # the next one is due in 85 ms or more
        drive.run_s(0.01)
    since_ns = drive.clock.t_ns
    if end == "override":
        drive.vehicle.brake = True
        drive.run_s(0.05)
    else:
        drive.loop.shutdown.request()
        drive.loop.shutdown.request()
        drive.run_s(0.02)
        assert drive.loop.shutdown.is_done
    sent = drive.named("HEARTBEAT", since_ns + 1)
    assert [one["ENABLED"] for one in sent] == [0]


def test_a_periodic_message_is_sent_once_more_for_each_change_and_then_in_its_period(tmp_path: Path) -> None:
    drive = with_heartbeat(tmp_path, "always", 'ENABLED = { value = 1, when = "enabled" }')
    drive.run_until(Mode.ENGAGED)
    drive.run_s(1.0)
    apart_ms = [(b.at_ns - a.at_ns) / ms(1) for a, b in pairwise(drive.named("HEARTBEAT"))]
    assert len([apart for apart in apart_ms if apart < 90.0]) == 1
    assert all(apart == pytest.approx(100.0, abs=10.0) for apart in apart_ms if apart >= 90.0)


@pytest.mark.parametrize("fault", ["brake", "status lost", "vehicle fault"])
def test_enabling_messages_are_not_sent_while_the_driver_brakes_or_the_vehicle_is_not_fit(
    tmp_path: Path, fault: str
) -> None:
    send = ENABLE_AND_DISABLE.replace("once = true", "period_s = 0.02", 1)
    database = load_vehicle(tmp_path, send, command=ENABLED_BY_MESSAGE, signals=PLAIN)
    drive = ScriptedDrive(database, lambda _vehicle, _got: None)
    drive.run_until(Mode.ENGAGING)
    drive.run_s(0.2)
    assert len(drive.named("ENABLE_MSG")) in (10, 11)
    if fault == "brake":
        drive.vehicle.brake = True
    elif fault == "status lost":
        drive.vehicle.sends_status = False
    else:
        drive.vehicle.mode = VehicleMode.FAULT
    drive.run_s(0.12)  # a status in 20 ms, or none for 100 ms
    since_ns = drive.clock.t_ns
    drive.run_s(1.0)
    assert drive.named("ENABLE_MSG", since_ns) == []


def test_a_run_that_is_not_armed_sends_nothing(tmp_path: Path) -> None:
    send = '[[send]]\nmessage = "HEARTBEAT"\nwhen = "always"\nperiod_s = 0.1\n'
    database = load_vehicle(tmp_path, send, command=COMMAND + HEARTBEAT)
    drive = ScriptedDrive(database, obeys_enable, armed=False)
    drive.run_s(3.0)
    assert drive.vehicle.received == []


@pytest.mark.parametrize(
    ("when", "driven", "overridden"),
    [("always", 10, 10), ("armed", 10, 0), ("enabled", 10, 0), ("engaging", 0, 0), ("released", 0, 10)],
)
def test_a_periodic_message_is_sent_evenly_while_its_phase_lasts(
    tmp_path: Path, when: str, driven: int, overridden: int
) -> None:
    drive = with_heartbeat(tmp_path, when, 'COUNT = "count"')
    drive.run_until(Mode.ENGAGED)
    drive.run_s(0.1)
    since_ns = drive.clock.t_ns
    drive.run_s(1.0)
    assert len(drive.named("HEARTBEAT", since_ns)) in (driven, driven + bool(driven))
    drive.vehicle.brake = True
    drive.run_until(Mode.OVERRIDDEN)
    drive.run_s(0.1)
    since_ns = drive.clock.t_ns
    drive.run_s(1.0)
    beats = drive.named("HEARTBEAT", since_ns)
    assert len(beats) in (overridden, overridden + bool(overridden))
    assert {later.at_ns - earlier.at_ns for earlier, later in pairwise(beats)} <= {ms(100)}


def test_a_count_steps_with_each_frame_that_is_sent_and_its_complement_is_its_inverse(tmp_path: Path) -> None:
    drive = with_heartbeat(tmp_path, "always", 'COUNT = "count", INVERSE = { complement = "COUNT" }')
    drive.run_s(4.0)
    beats = drive.named("HEARTBEAT")
    assert [one["COUNT"] for one in beats] == [number % 16 for number in range(len(beats))]
    assert len(beats) > 30
    assert all(one["INVERSE"] == 15 - one["COUNT"] for one in beats)


def test_a_protected_message_has_the_complement_of_its_own_counter_below_its_checksum(tmp_path: Path) -> None:
    beat = """
BO_ 114 HEARTBEAT: 2 PC
 SG_ COUNT : 0|4@1+ (1,0) [0|15] "" CAR
 SG_ INVERSE : 4|4@1+ (1,0) [0|15] "" CAR
 SG_ SUM : 8|8@1+ (1,0) [0|255] "" CAR
"""
    more = """
[protection.rule]
checksum = { signal = "SUM", kind = "sum" }
counter = { signal = "COUNT" }
[protection.messages]
HEARTBEAT = "rule"
[[send]]
message = "HEARTBEAT"
when = "always"
period_s = 0.05
values = { INVERSE = { complement = "COUNT" } }
"""
    drive = ScriptedDrive(load_vehicle(tmp_path, more, command=COMMAND + beat), obeys_enable)
    drive.run_s(2.0)
    beats = [(one["COUNT"], one["INVERSE"], one["SUM"]) for one in drive.named("HEARTBEAT")]
    numbers = [number % 16 for number in range(len(beats))]
    assert beats == [(number, 15 - number, number + 16 * (15 - number)) for number in numbers]
    assert len(beats) > 30


def test_values_with_a_phase_follow_it(tmp_path: Path) -> None:
    values = 'ARMED = { value = 1, when = "armed" }, ENABLED = { value = 1, when = "enabled" }'
    drive = with_heartbeat(tmp_path, "always", values)
    drive.run_until(Mode.STANDBY)
    drive.run_until(Mode.ENGAGED)
    drive.run_s(0.2)
    drive.vehicle.brake = True
    drive.run_s(0.5)
    shown = [(one["ARMED"], one["ENABLED"]) for one in drive.named("HEARTBEAT")]
    assert list(dict.fromkeys(shown)) == [(1, 0), (1, 1), (0, 0)]


def test_a_message_that_echoes_is_not_sent_before_there_is_a_value_and_sends_the_newest(tmp_path: Path) -> None:
    drive = with_heartbeat(tmp_path, "always", 'ECHO = { echo = "STATUS.ALIVE" }')
    drive.vehicle.sends_status = False
    drive.run_s(1.0)
    assert drive.named("HEARTBEAT") == []
    assert drive.loop.details().loop["messages_not_encoded"] == 0  # it waits, and nothing has failed
    drive.vehicle.sends_status = True
    drive.run_s(2.0)
    beats = drive.named("HEARTBEAT")
    steps = [later["ECHO"] - earlier["ECHO"] for earlier, later in pairwise(beats)]
    assert set(steps[1:]) == {5}  # the first one may be sent between two samples
    assert len(beats) > 15


def test_a_command_echoes_the_handshake_of_the_vehicle_and_is_not_sent_before_it(tmp_path: Path) -> None:
    """FS-AI-like: the vehicle toggles a bit, and drives only while it comes back."""
    command = f'{COMMAND} SG_ HANDSHAKE : 1|1@1+ (1,0) [0|1] "" CAR\n'
    more = '[command.values]\n"CMD.HANDSHAKE" = { echo = "STATUS.HANDSHAKE" }\n'
    drive = ScriptedDrive(load_vehicle(tmp_path, more, command=command), obeys_enable)
    drive.vehicle.sends_status = False
    drive.run_s(1.0)
    assert drive.vehicle.received == []
    drive.vehicle.sends_status = True
    drive.run_until(Mode.ENGAGED)
    for handshake in (1, 0, 1):
        drive.vehicle.handshake = handshake
        drive.run_s(0.03)  # a status, and the sample after it
        since_ns = drive.clock.t_ns
        drive.run_s(0.1)
        assert {one["HANDSHAKE"] for one in drive.named("CMD", since_ns)} == {handshake}


def test_a_multiplexed_command_is_sent_in_the_branch_that_the_value_chooses(tmp_path: Path) -> None:
    command = """\
BO_ 258 CMD: 8 PC
 SG_ TYPE M : 0|3@1+ (1,0) [0|7] "" CAR
 SG_ PEDAL m0 : 8|10@1+ (0.1,0) [0|100] "%" CAR
 SG_ ACC m2 : 16|16@1- (0.001,0) [-10|10] "m/s^2" CAR
 SG_ LIMIT m2 : 48|8@1+ (0.1,0) [0|25] "m/s^2" CAR
 SG_ EN : 4|1@1+ (1,0) [0|1] "" CAR
 SG_ STEER : 32|16@1- (0.0001,0) [-1|1] "rad" CAR
"""
    more = '[command.values]\n"CMD.TYPE" = 2\n"CMD.LIMIT" = 5\n"CMD.PEDAL" = 0\n'
    drive = ScriptedDrive(load_vehicle(tmp_path, more, command=command), obeys_enable)
    drive.run_until(Mode.ENGAGED)
    drive.run_s(2.0)
    assert drive.vehicle.speed_mps > 1.0
    assert {(one["TYPE"], one["LIMIT"]) for one in drive.named("CMD")} == {(2.0, 5.0)}


def test_a_value_of_the_command_is_sent_while_engaging_only(tmp_path: Path) -> None:
    command = f'{COMMAND} SG_ CLEAR_FAULTS : 1|1@1+ (1,0) [0|1] "" CAR\n SG_ RATE : 48|8@1+ (0.1,0) [0|25] "" CAR\n'
    more = '[command.values]\n"CMD.CLEAR_FAULTS" = { value = 1, when = "engaging" }\n"CMD.RATE" = 3.3\n'
    drive = ScriptedDrive(load_vehicle(tmp_path, more, command=command), lambda _vehicle, _got: None)
    drive.run_until(Mode.ENGAGING)
    drive.run_s(0.1)
    drive.vehicle.mode = VehicleMode.AUTONOMOUS
    drive.run_s(0.3)
    shown = [(one["EN"], one["CLEAR_FAULTS"]) for one in drive.named("CMD")]
    assert list(dict.fromkeys(shown)) == [(0, 0), (1, 1), (1, 0)]
    assert all(one["RATE"] == pytest.approx(3.3) for one in drive.named("CMD"))


def test_the_filter_lets_nothing_else_out_and_each_message_at_its_rate(tmp_path: Path) -> None:
    drive = drive_by_magic(tmp_path)
    drive.run_until(Mode.ENGAGED)
    drive.run_s(5.0)
    transmit_filter = drive.loop._transmitter._transmit_filter
    assert {can_id for can_id, *_ in transmit_filter._sent_ns} == {128, 112, 113}
    assert transmit_filter.refused == {"not on the list": 0, "too often": 0}


def test_a_counter_of_the_protection_cannot_be_sent_back(tmp_path: Path) -> None:
    rule = '[protection.alive]\ncounter = { signal = "ALIVE" }\n[protection.messages]\nSTATUS = "alive"\n'
    send = '[[send]]\nmessage = "HEARTBEAT"\nwhen = "always"\nperiod_s = 0.1\n'
    values = 'values = { ECHO = { echo = "STATUS.ALIVE" } }\n'
    with pytest.raises(ConfigError, match=r"STATUS\.ALIVE is bound to an echo$"):
        load_vehicle(tmp_path, send + values + rule, command=COMMAND + HEARTBEAT)
