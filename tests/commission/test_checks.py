"""One sample with an error is no movement, and noise and slow hands end in no verdict that is wrong."""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from vehicle_iface.commission.checks import PREPARED, Check
from vehicle_iface.commission.frame_log import FrameLog
from vehicle_iface.commission.motion_checks import BendCheck, Field, RollCheck, TurnCheck
from vehicle_iface.commission.readings import Moment
from vehicle_iface.commission.status_checks import ChoiceCheck, PressCheck, RestCheck
from vehicle_iface.errors import ConfigError
from vehicle_iface.frame import CanFrame
from vehicle_iface.review.findings import Judgement
from vehicle_iface.status import Gear, VehicleMode, VehicleStatus

WHEEL = Field(name="wheel", label="EPS.ANGLE", unit="rad")
SPEED = Field(name="speed_mps", label="ABS.V", unit="m/s", signs="forward positive")


def watch(check: Check, moments: Iterable[Moment]) -> list[str]:
    """The texts of its results."""
    for number, moment in enumerate(moments):
        if number < PREPARED:
            check.prepare(moment)
        elif not check.results:
            check.take(moment)
    return [one.text for one in check.results]


def numbers(name: str, values: Iterable[float]) -> list[Moment]:
    return [Moment(time_s=0.05 * number, numbers={name: value}) for number, value in enumerate(values)]


def flags(values: Iterable[int]) -> list[Moment]:
    return [
        Moment(
            time_s=0.0,
            numbers={},
            status=VehicleStatus(stamp_ns=0, mode=VehicleMode.MANUAL, gear=None, driver_brake=bool(value)),
        )
        for value in values
    ]


def gears(values: Iterable[Gear | None]) -> list[Moment]:
    return [
        Moment(time_s=0.0, numbers={}, status=VehicleStatus(stamp_ns=0, mode=VehicleMode.MANUAL, gear=gear))
        for gear in values
    ]


def turn(sign: float = 1.0) -> TurnCheck:
    return TurnCheck(WHEEL, sign=sign, least=0.05, most=1.2, action="the wheel is turned left", wrong="too far")


def test_a_single_outlier_is_no_movement() -> None:
    values = [0.0] * 20
    values[8], values[12], values[16] = 0.4, -0.5, 9.0
    assert watch(turn(), numbers("wheel", values)) == []


def test_a_noisy_wheel_that_stands_off_zero_is_judged_by_its_movement_alone() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.01, 200)
    still = turn()
    assert watch(still, numbers("wheel", 0.3 + noise)) == []
    assert still.give_up().judgement is Judgement.UNKNOWN
    falls = numbers("wheel", 0.3 + noise - np.linspace(0.0, 0.2, 200))
    (text,) = watch(turn(), falls)
    assert text == "EPS.ANGLE falls when the wheel is turned left: its sign is reversed"


def test_a_heading_is_followed_across_its_end() -> None:
    rising = [(3.0 + 0.02 * tick + math.pi) % (2 * math.pi) - math.pi for tick in range(80)]
    heading = Field(name="h", label="INS.YAW", unit="rad")
    assert watch(BendCheck(heading, is_rate=False), numbers("h", rising)) == [
        "INS.YAW turns left in a bend to the left"
    ]


def test_a_roll_that_does_not_end_is_no_result_and_one_in_two_pushes_is() -> None:
    endless = RollCheck(SPEED, place=None, heading=None)
    assert watch(endless, numbers("speed_mps", [0.5] * 200)) == []
    assert endless.explain() == "the vehicle did not stand still for 1 s by ABS.V"
    pushes = [0.0] * 5 + [0.5] * 30 + [0.0] * 40 + [0.5] * 30 + [0.0] * 40
    (text,) = watch(RollCheck(SPEED, place=None, heading=None), numbers("speed_mps", pushes))
    assert text == "ABS.V is positive and adds up to 1.5 m"


def brake_rest(was_clear: bool) -> RestCheck:
    rest = RestCheck("VCU.BRAKE", lambda status: status.driver_brake, "driver_brake")
    rest.was_clear = was_clear
    return rest


@pytest.mark.parametrize(
    ("was_clear", "values", "texts"),
    [
        (True, [0] * 6 + [1] * 6, ["VCU.BRAKE is set when the brake is pressed"]),
        (True, [1] * 10 + [0] * 10 + [1] * 10, ["VCU.BRAKE is set when the brake is pressed"]),
        (True, [1] * 10 + [0] * 10, []),
        (False, [1] * 10 + [0] * 10, ["VCU.BRAKE is cleared when the brake is pressed: it is inverted"]),
        (True, [0] * 9 + [1] + [0] * 9, []),
    ],
)
def test_a_flag_is_judged_by_its_change(was_clear: bool, values: list[int], texts: list[str]) -> None:
    assert watch(PressCheck(brake_rest(was_clear), "the brake is pressed"), flags(values)) == texts


def test_a_lever_may_pass_other_gears_but_not_stay_there() -> None:
    def check() -> ChoiceCheck:
        return ChoiceCheck("TCU.GEAR", lambda status: status.gear, "gear", Gear.DRIVE, "it is in drive")

    passing = [Gear.PARK] * 10 + [Gear.REVERSE] * 20 + [None] * 3 + [Gear.NEUTRAL] * 20 + [Gear.DRIVE] * 10
    assert watch(check(), gears(passing)) == ["TCU.GEAR is DRIVE when it is in drive"]
    staying = [Gear.PARK] * 10 + [Gear.REVERSE] * 70
    (text,) = watch(check(), gears(staying))
    assert text == "TCU.GEAR is REVERSE when it is in drive: a name of its table means another one"
    assert watch(check(), gears([Gear.PARK] * 100)) == []


def test_frames_of_every_kind_are_recorded_as_candump_does(tmp_path: Path) -> None:
    frames = (
        CanFrame(0x110, b"\x01\x02", 1_500_000_000),
        CanFrame(0x18FF1234, b"", 1_600_000_000, is_extended=True),
        CanFrame(0x111, bytes(12), 1_700_000_000, is_fd=True),
        CanFrame(0x112, b"", 1_800_000_000, is_remote=True),
    )
    path = tmp_path / "walk.log"
    with FrameLog(path, ["can 0"], wall_offset_ns=10 * 10**9) as log:
        log.write(frames[:2])
        log.write(frames[2:])
    assert path.read_text().splitlines() == [
        "(0000000011.500000) can_0 110#0102",
        "(0000000011.600000) can_0 18FF1234#",
        "(0000000011.700000) can_0 111##1" + 24 * "0",
        "(0000000011.800000) can_0 112#R",
    ]


def test_an_older_record_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "walk.log"
    path.write_text("old")
    with pytest.raises(ConfigError, match=r"--record .*walk.log: cannot be written: File exists"):
        FrameLog(path, ["can0"], wall_offset_ns=0)
    assert path.read_text() == "old"
