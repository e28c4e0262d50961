"""Commands with longer periods than the samples: computed on each sample, sent on every n-th, never in bursts."""

from itertools import pairwise
from pathlib import Path

import pytest

from tests import harness
from tests.harness import Drive, Sent, ms
from tests.plain_vehicle import load_vehicle
from tests.scripted_vehicle import Received, ScriptedDrive, ScriptedVehicle
from vehicle_iface.errors import ConfigError
from vehicle_iface.frame import CanFrame
from vehicle_iface.safety.modes import Mode
from vehicle_iface.status import VehicleMode

BRAKE_AND_STEER = """\
BO_ 129 BRAKE_CMD: 2 PC
 SG_ ACC : 0|16@1- (0.001,0) [-10|10] "m/s^2" CAR

BO_ 130 STEER_CMD: 4 PC
 SG_ EN : 0|1@1+ (1,0) [0|1] "" CAR
 SG_ STEER : 16|16@1- (0.0001,0) [-1|1] "rad" CAR
"""
TWO = {"enable": "STEER_CMD.EN", "accel_mps2": "BRAKE_CMD.ACC", "front_wheel_angle_rad": "STEER_CMD.STEER"}
CYCLES = 'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;\nBA_ "GenMsgCycleTime" BO_ 129 20;\n'
NAMES = {128: "CMD", 129: "BRAKE_CMD", 130: "STEER_CMD"}
SLOW = {"command_period_s = 0.01": "command_period_s = 0.02"}


@pytest.fixture(autouse=True)
def _keep_frames_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """The harness takes the reference vehicle's commands apart, and these are none."""

    def keep(frame: CanFrame, at_ns: int = 0, step: int = 0) -> Sent:
        return Sent(at_ns, step, NAMES[frame.can_id], 0, {}, frame)

    monkeypatch.setattr(harness, "decode_sent", keep)


def gaps_ms(frames: list[Sent]) -> list[float]:
    return [(later.at_ns - earlier.at_ns) / ms(1) for earlier, later in pairwise(frames)]


@pytest.mark.parametrize(("period_s", "gap_ms"), [(0.02, 20), (0.03, 30), (0.05, 50)])
def test_a_slow_command_is_sent_on_every_nth_sample_and_the_vehicle_is_driven(
    tmp_path: Path, period_s: float, gap_ms: float
) -> None:
    edits = {"command_period_s = 0.01": f"command_period_s = {period_s}"}
    drive = Drive(database=load_vehicle(tmp_path, edits=edits)).engage(speed_mps=3.0)
    since = len(drive.sent)
    drive.run_s(10.0)
    assert drive.mode() is Mode.ENGAGED
    assert set(gaps_ms(drive.named("CMD", since))) == {gap_ms}
    assert drive.loop._transmitter._transmit_filter.refused == {"not on the list": 0, "too often": 0}
    assert drive.vehicle.state.speed_mps == pytest.approx(5.0, abs=0.1)


def test_each_message_has_its_own_period_and_both_carry_the_same_answer_when_both_are_due(tmp_path: Path) -> None:
    more = "[command.periods]\nBRAKE_CMD = 0.02\n"
    drive = Drive(database=load_vehicle(tmp_path, more, command=BRAKE_AND_STEER + CYCLES, signals=TWO))
    drive.engage(speed_mps=1.0)
    drive.run_s(8.0)
    brakes, steers = drive.named("BRAKE_CMD"), drive.named("STEER_CMD")
    assert set(gaps_ms(steers)) == {10}
    assert set(gaps_ms(brakes)) <= {10, 20}
    assert gaps_ms(brakes).count(10) <= 1  # the first enabled command does not wait
    assert {sent.step for sent in brakes} < {sent.step for sent in steers}
    assert sum(drive.loop._transmitter._transmit_filter.refused.values()) == 0


@pytest.mark.parametrize("pause_s", [0.025, 0.045, 0.08, 0.3])
def test_after_a_standstill_of_the_loop_commands_are_as_far_apart_as_before(tmp_path: Path, pause_s: float) -> None:
    drive = Drive(database=load_vehicle(tmp_path, edits=SLOW)).engage(speed_mps=3.0)
    since = len(drive.sent)
    drive.stall(pause_s)
    drive.run_s(1.0)
    gaps = gaps_ms(drive.named("CMD", since))
    assert min(gaps) >= 10  # a stop after the pause does not wait
    assert gaps.count(20) >= len(gaps) - 3
    assert drive.mode() is (Mode.ENGAGED if pause_s < 0.1 else Mode.FAULT)  # the vehicle's watchdog acts after 100 ms


def test_an_override_and_a_stop_are_answered_with_the_next_sample_and_the_pace_goes_on_from_there(
    tmp_path: Path,
) -> None:
    drive = Drive(database=load_vehicle(tmp_path, edits=SLOW)).engage(speed_mps=3.0)
    since = len(drive.sent)
    drive.run_until(lambda: len(drive.sent) > since, 0.1)
    drive.send_line("brake on")
    begin_ns, since = drive.clock.t_ns, len(drive.sent)
    drive.run_until(lambda: drive.mode() is Mode.OVERRIDDEN, 0.05)
    drive.run_s(0.2)
    released = next(sent for sent in drive.sent[since:] if not sent.frame.data[0] & 1)
    assert released.at_ns - begin_ns <= ms(31)  # status 20 ms, sample 10 ms
    assert set(gaps_ms(drive.sent[drive.sent.index(released) :])) == {20}


def obeys_enable(_vehicle: ScriptedVehicle, got: Received) -> VehicleMode | None:
    return VehicleMode.AUTONOMOUS if got.signals.get("EN") else None


def test_the_rates_of_a_slow_message_are_those_of_its_limits_though_another_one_is_fast(tmp_path: Path) -> None:
    more = "[command.periods]\nBRAKE_CMD = 0.05\n"
    edits = {"accel_rate_mps3 = 30.0": "accel_rate_mps3 = 2.0"}
    database = load_vehicle(tmp_path, more, command=BRAKE_AND_STEER, signals=TWO, edits=edits)
    drive = ScriptedDrive(database, obeys_enable)
    drive.run_until(Mode.ENGAGED)
    drive.run_s(0.3)
    accels = [sent["ACC"] for sent in drive.named("BRAKE_CMD")]
    rises = {round(later - earlier, 6) for earlier, later in pairwise(accels) if earlier > 0.0}
    assert rises == {0.1}  # 2 m/s³ for 50 ms


@pytest.mark.parametrize(
    ("edits", "more", "text"),
    [
        (
            {"sample_period_s = 0.01": "sample_period_s = 0.04"},
            "",
            r"\$\.timing\.command_period_s: 0\.01: must be a whole multiple of \$\.timing\.sample_period_s = 0\.04, "
            r"such as 0\.04 or 0\.08; .* \$\.state\.trigger",
        ),
        (
            {"command_period_s = 0.01": "command_period_s = 0.015"},
            "",
            r"\$\.timing\.command_period_s: 0\.015: .* such as 0\.01 or 0\.02$",
        ),
        ({}, "[command.periods]\nCMD = 0.025\n", r"\$\.command\.periods\.CMD: 0\.025: .* such as 0\.02 or 0\.03$"),
        ({}, "[command.periods]\nPOSE = 0.02\n", r"\$\.command\.periods\.POSE: must be of a command message: CMD"),
        ({}, "[command.periods]\nCMB = 0.02\n", r"\$\.command\.periods\.CMB: no message 'CMB' in v\.dbc; nearest: CMD"),
    ],
)
def test_periods_that_do_not_go_together_are_refused_with_what_is_possible(
    tmp_path: Path, edits: dict[str, str], more: str, text: str
) -> None:
    with pytest.raises(ConfigError, match=text):
        load_vehicle(tmp_path, more, edits=edits)


def test_a_period_other_than_the_cycle_of_its_message_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"\$\.timing\.command_period_s: 0\.01 s, but BRAKE_CMD has a cycle of 20 ms"):
        load_vehicle(tmp_path, command=BRAKE_AND_STEER + CYCLES, signals=TWO)
