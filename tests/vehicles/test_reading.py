"""What other makers' vehicles send, read through profiles: units, samples by time, forms, conditions, J1939."""

import math
import re
from pathlib import Path

import pytest

from tests.narrowing import at_present
from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.codec.decoder import Decoder, DropCause
from vehicle_iface.errors import ConfigError
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.assembly import build_state_assembler
from vehicle_iface.state_assembler import Sample, StateAssembler
from vehicle_iface.status import Gear, VehicleMode, VehicleStatus

from .profiles import load_vehicle

MS = 1_000_000


class Reader:
    """Decoder and assembler of one vehicle, fed with payloads."""

    def __init__(self, database: VehicleDatabase) -> None:
        self.decoder = Decoder(database.received)
        self.assembler: StateAssembler = build_state_assembler(database)

    def receive(self, can_id: int, data: bytes, at_ms: float = 0.0, *, is_extended: bool = False) -> Sample | None:
        frame = CanFrame(can_id, data, round(at_ms * MS), is_extended=is_extended)
        received = self.decoder.decode(frame)
        return self.assembler.take(received) if received is not None else None


def little(*words: int) -> bytes:
    return b"".join(word.to_bytes(2, "little", signed=word < 0) for word in words)


def pose(x: int = 0, y: int = 0, yaw: int = 0, speed: int = 0) -> bytes:
    return little(x, y, yaw, speed)


def test_units_of_the_dbc_are_converted(tmp_path: Path) -> None:
    dbc = (
        ('(0.01,0) [-327|327] "m"', '(1,0) [-32700|32700] "cm"'),
        ('(0.0001,0) [-3.2|3.2] "rad"', '(0.01,0) [-180|180] "Deg"'),
        ('V : 48|16@1- (0.01,0) [-50|50] "m/s"', 'V : 48|16@1- (0.01,0) [-180|180] " km / h"'),
    )
    sample = Reader(load_vehicle(tmp_path, dbc=dbc)).receive(272, pose(250, -100, 9000, 3600))
    assert sample is not None
    assert (sample.state.x_m, sample.state.y_m) == (2.5, -1.0)
    assert sample.state.heading_rad == pytest.approx(math.pi / 2)
    assert sample.state.speed_mps == pytest.approx(10.0)


def test_notes_turn_a_compass_heading_and_wheel_rpm_into_si(tmp_path: Path) -> None:
    dbc = (
        ('(0.0001,0) [-3.2|3.2] "rad"', '(0.01,0) [0|0] ""'),
        ('V : 48|16@1- (0.01,0) [-50|50] "m/s"', 'V : 48|16@1+ (1,0) [0|3000] "rpm"'),
    )
    more = """
[signals."POSE.YAW"]
unit = "deg"
scale = -1.0
offset = 1.5707963267948966
range = [-180, 180]
[signals."POSE.V"]
scale = 0.3
"""
    sample = Reader(load_vehicle(tmp_path, dbc=dbc, more=more)).receive(272, pose(yaw=9000, speed=600))
    assert sample is not None
    assert sample.state.heading_rad == pytest.approx(0.0, abs=1e-12)  # east
    assert sample.state.speed_mps == pytest.approx(600 * math.tau / 60.0 * 0.3)


def test_a_range_of_the_notes_goes_before_the_dbcs(tmp_path: Path) -> None:
    more = '\n[signals."POSE.V"]\nrange = [0, 20]\n'
    reader = Reader(load_vehicle(tmp_path, more=more))
    assert reader.receive(272, pose(speed=2000)) is not None
    assert reader.receive(272, pose(speed=2001)) is None
    assert reader.decoder.drops == {(DropCause.OUT_OF_RANGE, "POSE"): 1}


def test_a_value_that_is_not_available_makes_the_sample_incomplete_and_drops_no_frame(tmp_path: Path) -> None:
    reader = Reader(load_vehicle(tmp_path, more='\n[signals."POSE.V"]\nnot_available = [0xFFFF]\n'))
    assert reader.receive(272, pose(speed=-1)) is None
    assert reader.receive(272, pose(speed=-2)) is not None
    assert (reader.assembler.incomplete, reader.decoder.drops) == (1, {})


def test_a_signal_of_no_use_is_not_looked_at(tmp_path: Path) -> None:
    dbc = (("SG_ BRAKE : 3|1@1+", 'SG_ OTHER : 8|8@1+ (1,0) [0|3] "" PC\n SG_ BRAKE : 3|1@1+'),)
    reader = Reader(load_vehicle(tmp_path, dbc=dbc))
    reader.receive(256, bytes((1, 255)))
    assert reader.decoder.drops == {}
    assert reader.assembler.status is not None


TWO_PARTS = (("BO_ 256", 'BO_ 273 ATT: 8 CAR\n SG_ YAW : 0|16@1- (0.0001,0) [-3.2|3.2] "rad" PC\n\nBO_ 256'),)
BY_TIME = (('heading_rad = "POSE.YAW"', 'heading_rad = "ATT.YAW"'), ('sample = ["POSE"]', 'sample = ["POSE", "ATT"]'))


def test_a_sample_is_the_newest_of_its_messages_when_the_trigger_arrives(tmp_path: Path) -> None:
    reader = Reader(load_vehicle(tmp_path, dbc=TWO_PARTS, toml=BY_TIME))
    assert reader.receive(273, little(100, 0, 0, 0), 0) is None
    assert reader.receive(273, little(200, 0, 0, 0), 5) is None
    sample = reader.receive(272, pose(x=100), 10)
    assert sample is not None
    assert sample.state.x_m == 1.0
    assert sample.state.heading_rad == pytest.approx(0.02)
    assert (sample.state.stamp_ns, sample.counter) == (10 * MS, -1)
    assert reader.receive(272, pose(x=120), 30) is not None  # with the same heading, which is 25 ms old


@pytest.mark.parametrize(("age_ms", "completes"), [(50.0, True), (50.001, False)])
@pytest.mark.parametrize("limit", ["0.05", "{ ATT = 0.05 }"])
def test_a_part_that_is_too_old_makes_the_sample_incomplete(
    tmp_path: Path, age_ms: float, completes: bool, limit: str
) -> None:
    toml = (*BY_TIME, ("[state.signals]", f"max_age_s = {limit}\n[state.signals]"))
    reader = Reader(load_vehicle(tmp_path, dbc=TWO_PARTS, toml=toml))
    reader.receive(273, little(100, 0, 0, 0), 100)
    assert (reader.receive(272, pose(), 100 + age_ms) is not None) is completes
    assert reader.assembler.incomplete == (not completes)


def test_another_message_can_be_the_trigger(tmp_path: Path) -> None:
    toml = (*BY_TIME, ("[state.signals]", 'trigger = "ATT"\n[state.signals]'))
    reader = Reader(load_vehicle(tmp_path, dbc=TWO_PARTS, toml=toml))
    assert reader.receive(272, pose(), 10) is None
    assert reader.receive(273, little(1, 0, 0, 0), 11) is not None


WHEELS = (
    (
        "BO_ 256",
        "BO_ 273 WHEELS: 8 CAR\n"
        + "".join(f' SG_ W{i} : {16 * i}|16@1+ (0.01,0) [0|300] "km/h" PC\n' for i in range(4))
        + "\nBO_ 256",
    ),
)


def test_a_field_is_the_mean_of_several_signals(tmp_path: Path) -> None:
    toml = (
        ('speed_mps = "POSE.V"', 'speed_mps = { mean = ["WHEELS.W0", "WHEELS.W1", "WHEELS.W2", "WHEELS.W3"] }'),
        ('sample = ["POSE"]', 'sample = ["POSE", "WHEELS"]'),
    )
    reader = Reader(load_vehicle(tmp_path, dbc=WHEELS, toml=toml))
    reader.receive(273, little(3500, 3600, 3700, 3600))
    sample = reader.receive(272, pose())
    assert sample is not None
    assert sample.state.speed_mps == pytest.approx(10.0)


STEERING = (
    (
        "BO_ 256",
        "BO_ 273 EPS: 8 CAR\n"
        ' SG_ ANGLE : 0|16@1- (1.5,0) [-500|500] "deg" PC\n SG_ FRACTION : 16|8@1- (0.1,0) [-0.7|0.7] "deg" PC\n'
        ' SG_ YAW : 24|16@1+ (0.01,0) [0|100] "deg/s" PC\n SG_ RIGHT : 40|1@1+ (1,0) [0|1] "" PC\n\nBO_ 256',
    ),
)


@pytest.mark.parametrize(("right", "sign"), [(0, 1.0), (1, -1.0)])
def test_a_sum_and_a_sign_in_a_signal_of_its_own(tmp_path: Path, right: int, sign: float) -> None:
    toml = (
        (
            "[status.signals]",
            'front_wheel_angle_rad = { sum = ["EPS.ANGLE", "EPS.FRACTION"] }\n'
            'yaw_rate_radps = { value = "EPS.YAW", negative_if = "EPS.RIGHT" }\n[status.signals]',
        ),
    )
    more = "".join(f'\n[signals."EPS.{name}"]\nscale = 0.0625\n' for name in ("ANGLE", "FRACTION"))
    reader = Reader(load_vehicle(tmp_path, dbc=STEERING, toml=toml, more=more))
    reader.receive(273, little(100) + bytes((5,)) + little(1500) + bytes((right, 0, 0)))
    sample = reader.receive(272, pose())
    assert sample is not None
    assert sample.state.front_wheel_angle_rad == pytest.approx(math.radians(150.5) / 16.0)
    assert sample.state.yaw_rate_radps == pytest.approx(sign * math.radians(15.0))


FLAGS = (
    (
        "BO_ 256 STATUS",
        'BO_ 257 GAS: 2 CAR\n SG_ ENABLED : 0|1@1+ (1,0) [0|1] "" PC\n SG_ OVERRIDE : 1|1@1+ (1,0) [0|1] "" PC\n'
        ' SG_ STATE : 8|5@1+ (1,0) [0|31] "" PC\n SG_ TORQUE : 2|4@1- (1,0) [-8|7] "N*m" PC\n\nBO_ 256 STATUS',
    ),
)
CONDITIONS = (
    ('mode = "STATUS.MODE"\ndriver_brake = "STATUS.BRAKE"\n', ""),
    ("[status.signals]", """
[status.when]
fault = { any = [{ signal = "GAS.STATE", in = [3, 17] }, { not = { signal = "STATUS.MODE", below = 5 } }] }
manual = "GAS.OVERRIDE"
autonomous = { all = ["GAS.ENABLED", { signal = "STATUS.MODE", equals = "AUTONOMOUS" }] }
ready = { all = [] }
[status.driver]
brake = "STATUS.BRAKE"
steering = { signal = "GAS.TORQUE", above = 3.0, magnitude = true }
[status.signals]"""),
)  # fmt: skip


@pytest.mark.parametrize(
    ("gas", "status", "mode"),
    [
        ((0b00, 0), 0, VehicleMode.READY),
        ((0b01, 0), 0, VehicleMode.READY),
        ((0b01, 0), 2, VehicleMode.AUTONOMOUS),
        ((0b11, 0), 2, VehicleMode.MANUAL),
        ((0b11, 3), 2, VehicleMode.FAULT),
        ((0b01, 17), 2, VehicleMode.FAULT),
        ((0b01, 16), 2, VehicleMode.AUTONOMOUS),
        ((0b01, 0), 5, VehicleMode.FAULT),
    ],
)
def test_conditions_determine_the_mode(tmp_path: Path, gas: tuple[int, int], status: int, mode: VehicleMode) -> None:
    names = '4 "EMERGENCY_STOP" ;'
    dbc = (*FLAGS, (names, '4 "EMERGENCY_STOP" 5 "LIMP" ;'))
    reader = Reader(load_vehicle(tmp_path, dbc=dbc, toml=CONDITIONS))
    reader.receive(257, bytes(gas), 1)
    assert at_present(reader.assembler.status) is None  # until every message of the conditions has come
    reader.receive(256, bytes((status, 0)), 2)
    assert reader.assembler.status is not None
    assert (reader.assembler.status.mode, reader.assembler.status.stamp_ns) == (mode, 1 * MS)


@pytest.mark.parametrize(("torque", "steers"), [(3, False), (4, True), (-3, False), (-4, True)])
def test_the_driver_overrides_by_a_condition(tmp_path: Path, torque: int, steers: bool) -> None:
    reader = Reader(load_vehicle(tmp_path, dbc=FLAGS, toml=CONDITIONS))
    reader.receive(257, bytes(((torque & 15) << 2, 0)))
    reader.receive(256, bytes((0b1000, 0)))
    assert reader.assembler.status is not None
    assert (reader.assembler.status.driver_brake, reader.assembler.status.driver_steers) == (True, steers)


def test_many_names_mean_one_gear_and_names_left_out_mean_none_or_a_fault(tmp_path: Path) -> None:
    dbc = (
        ("SG_ BRAKE : 3|1@1+", 'SG_ GEAR : 8|6@1+ (1,0) [0|63] "" PC\n SG_ BRAKE : 3|1@1+'),
        ("VAL_ 256 MODE", 'VAL_ 256 GEAR 0 "P" 1 "R" 2 "D" 3 "S" 63 "SNA" ;\nVAL_ 256 MODE'),
        ('3 "FAULT"', '3 "LIMP"'),
    )
    toml = (("[status.signals]", '[status.signals]\ngear = "STATUS.GEAR"'),)
    more = '\n[status.gears]\nP = "PARK"\nR = "REVERSE"\nD = "DRIVE"\nS = "DRIVE"\n'
    reader = Reader(load_vehicle(tmp_path, dbc=dbc, toml=toml, more=more))
    found = []
    for number in (0, 1, 2, 3, 63):
        reader.receive(256, bytes((1, number)))
        assert reader.assembler.status is not None
        found.append(reader.assembler.status.gear)
    assert found == [Gear.PARK, Gear.REVERSE, Gear.DRIVE, Gear.DRIVE, None]
    reader.receive(256, bytes((3, 0)))
    assert reader.assembler.status is not None
    assert reader.assembler.status.mode is VehicleMode.FAULT


def test_a_fault_code_is_a_fault_in_every_mode(tmp_path: Path) -> None:
    dbc = (("SG_ BRAKE : 3|1@1+", 'SG_ CODE : 8|8@1+ (1,0) [0|255] "" PC\n SG_ BRAKE : 3|1@1+'),)
    reader = Reader(
        load_vehicle(tmp_path, dbc=dbc, toml=(("[status.signals]", '[status.signals]\nfault_code = "STATUS.CODE"'),))
    )
    for code, mode in ((0, VehicleMode.AUTONOMOUS), (77, VehicleMode.FAULT)):
        reader.receive(256, bytes((2, code)))
        assert reader.assembler.status is not None
        assert (reader.assembler.status.mode, reader.assembler.status.fault_code) == (mode, code)


def test_the_mode_may_stand_in_a_message_of_the_sample(tmp_path: Path) -> None:
    state = ' SG_ STATE : 60|3@1+ (1,0) [0|7] "" PC'
    dbc = (
        ("V : 48|16@1- (0.01,0)", "V : 48|12@1- (0.1,0)"),
        ("\n\nBO_ 256", f"\n{state}\n\nBO_ 256"),
        ("VAL_ 256 MODE", "VAL_ 272 STATE"),
    )
    toml = (('mode = "STATUS.MODE"', 'mode = "POSE.STATE"'),)
    reader = Reader(load_vehicle(tmp_path, dbc=dbc, toml=toml))
    assert reader.receive(272, bytes(6) + (2 << 12 | 50).to_bytes(2, "little")) is not None
    assert reader.assembler.status is not None
    assert reader.assembler.status.mode is VehicleMode.AUTONOMOUS


@pytest.mark.parametrize(
    ("can_id", "arrives"),
    [(0x18FEF117, True), (0x0CFEF117, True), (0x18FEF118, False), (0x18FEF217, False)],
)
def test_a_j1939_message_is_found_by_its_group_and_sender_whatever_its_priority(
    tmp_path: Path, can_id: int, arrives: bool
) -> None:
    dbc = (("BO_ 272 POSE", f"BO_ {0x18FEF100 | 1 << 31} POSE"),)
    more = "\n[messages.POSE]\nj1939 = { source_address = 0x17 }\n"
    reader = Reader(load_vehicle(tmp_path, dbc=dbc, more=more))
    assert (reader.receive(can_id, pose(), is_extended=True) is not None) is arrives


def test_a_j1939_message_is_taken_from_any_sender_where_none_is_named(tmp_path: Path) -> None:
    dbc = (("BO_ 272 POSE", f"BO_ {0x18FEF100 | 1 << 31} POSE"),)
    reader = Reader(load_vehicle(tmp_path, dbc=dbc, more="\n[messages.POSE]\nj1939 = {}\n"))
    for sender in (0x00, 0x17, 0xFE):
        assert reader.receive(0x1CFEF100 | sender, pose(), is_extended=True) is not None


def test_an_identifier_of_11_bits_is_not_of_j1939(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"\$\.messages\.POSE\.j1939: POSE has an identifier of 11 bits"):
        load_vehicle(tmp_path, more="\n[messages.POSE]\nj1939 = {}\n")


def test_one_placeholder_may_send_everything(tmp_path: Path) -> None:
    dbc = (("8 CAR", "8 XXX"), ("2 CAR", "2 XXX"), ("8 PC", "8 XXX"), ("BU_: PC CAR", "BU_: PC CAR XXX"))
    assert [message.name for message in load_vehicle(tmp_path, dbc=dbc).commands] == ["CMD"]


BRANCHES = (
    (
        "BO_ 256 STATUS",
        "BO_ 288 EXTRA: 8 CAR\n"
        ' SG_ PAGE M : 0|8@1+ (1,0) [0|3] "" PC\n'
        ' SG_ LATERAL m0 : 8|16@1- (0.01,0) [-5|5] "m/s" PC\n'
        ' SG_ REAR m1 : 8|16@1- (0.001,0) [-1|1] "rad" PC\n'
        ' SG_ PEDAL m1 : 24|1@1+ (1,0) [0|1] "" PC\n\nBO_ 256 STATUS',
    ),
)
OF_BRANCHES = (
    (
        "[status.signals]",
        'lateral_speed_mps = "EXTRA.LATERAL"\nrear_wheel_angle_rad = "EXTRA.REAR"\n\n'
        '[status.signals]\ndriver_throttle = "EXTRA.PEDAL"',
    ),
)


def page(number: int, value: int, flag: int = 0) -> bytes:
    return bytes((number,)) + little(value) + bytes((flag, 0, 0, 0, 0))


def test_values_in_two_branches_of_a_multiplexer_are_both_kept_and_both_needed(tmp_path: Path) -> None:
    reader = Reader(load_vehicle(tmp_path, dbc=BRANCHES, toml=OF_BRANCHES))
    reader.receive(256, bytes((1, 0)), 0)
    reader.receive(288, page(0, 50), 1)
    assert reader.receive(272, pose(), 2) is None  # the other branch has not come yet
    reader.receive(288, page(1, 200, flag=1), 3)
    reader.receive(256, bytes((1, 0)), 3)
    reader.receive(288, page(0, -25), 4)
    sample = reader.receive(272, pose(), 5)
    assert sample is not None
    assert sample.others_fresh
    assert (sample.state.lateral_speed_mps, sample.state.rear_wheel_angle_rad) == (-0.25, 0.2)
    assert reader.assembler.status is not None
    assert reader.assembler.status.driver_throttle


def test_a_sample_by_time_has_no_counter_also_where_its_messages_have_one(tmp_path: Path) -> None:
    dbc = ((' SG_ V : 48|16@1- (0.01,0) [-50|50] "m/s" PC', ' SG_ V : 48|12@1- (0.1,0) [-50|50] "m/s" PC\n'
            ' SG_ COUNTER : 60|4@1+ (1,0) [0|15] "" PC'),)  # fmt: skip
    more = (
        '\n[protection.alive]\ncounter = { signal = "COUNTER", max_step = 3 }\n[protection.messages]\nPOSE = "alive"\n'
    )
    reader = Reader(load_vehicle(tmp_path, dbc=dbc, more=more))
    for counter in (4, 5):
        sample = reader.receive(272, bytes(7) + bytes((counter << 4,)), counter)
        assert sample is not None
        assert sample.counter == -1
    assert reader.receive(272, bytes(7) + bytes((5 << 4,)), 6) is None


def test_a_status_whose_mode_is_not_available_is_none(tmp_path: Path) -> None:
    dbc = (('4 "EMERGENCY_STOP" ;', '4 "EMERGENCY_STOP" 7 "SNA" ;'),)
    reader = Reader(load_vehicle(tmp_path, dbc=dbc, more='\n[signals."STATUS.MODE"]\nnot_available = [7]\n'))
    reader.receive(256, bytes((7, 0)), 1)
    assert at_present(reader.assembler.status) is None
    reader.receive(256, bytes((1, 0)), 2)
    reader.receive(256, bytes((7, 0)), 3)
    assert reader.assembler.status is not None
    assert reader.assembler.status.stamp_ns == 2 * MS


def test_the_greatest_age_of_each_part_is_kept(tmp_path: Path) -> None:
    reader = Reader(load_vehicle(tmp_path, dbc=TWO_PARTS, toml=BY_TIME))
    reader.receive(273, little(0, 0, 0, 0), 0)
    for at_ms in (5, 30):
        reader.receive(272, pose(), at_ms)
    reader.receive(273, little(0, 0, 0, 0), 40)
    reader.receive(272, pose(), 41)
    assert reader.assembler.oldest_ns == {"POSE": 0, "ATT": 30 * MS}


def test_the_row_has_the_newest_value_of_each_signal(tmp_path: Path) -> None:
    reader = Reader(load_vehicle(tmp_path))
    for x in (100, 125):
        reader.receive(272, pose(x=x))
        assert reader.assembler.row[:4] == [x / 100, 0.0, 0.0, 0.0]


def test_odometry_begins_at_0_with_the_first_sample_after_a_reset(tmp_path: Path) -> None:
    toml = (
        ('x_m = "POSE.X"\ny_m = "POSE.Y"\nheading_rad = "POSE.YAW"\n', 'front_wheel_angle_rad = "POSE.YAW"\n'),
        ("[status.signals]", '[state.pose]\nsource = "odometry"\n\n[status.signals]'),
    )
    reader = Reader(load_vehicle(tmp_path, toml=toml))
    way_m = []
    for at_ms in (0, 20, 40, 60):
        if at_ms == 40:
            reader.assembler.reset()
        sample = reader.receive(272, pose(speed=1000), at_ms)
        assert sample is not None
        way_m.append(sample.state.x_m)
    assert way_m == pytest.approx([0.0, 0.2, 0.0, 0.2])


def test_the_sign_of_a_field_may_come_in_a_message_outside_the_sample(tmp_path: Path) -> None:
    toml = (('speed_mps = "POSE.V"', 'speed_mps = { value = "POSE.V", negative_if = "STATUS.BRAKE" }'),)
    reader = Reader(load_vehicle(tmp_path, toml=toml))
    sample = reader.receive(272, pose(speed=500), 0.0)
    assert sample is not None
    assert not sample.others_fresh
    for flag, speed_mps in ((0x08, -5.0), (0x00, 5.0)):
        reader.receive(256, bytes((flag, 0)), 10.0)
        sample = reader.receive(272, pose(speed=500), 20.0)
        assert sample is not None
        assert sample.others_fresh
        assert sample.state.speed_mps == speed_mps


def status_of(reader: Reader) -> VehicleStatus:
    status = reader.assembler.status
    assert status is not None
    return status


NOT_AVAILABLE = '[signals."STATUS.BRAKE"]\nrange = [0, 3]\nnot_available = [3]\n'
TWO_BITS = (("SG_ BRAKE : 3|1@1+", "SG_ BRAKE : 3|2@1+"),)


def test_a_status_without_the_drivers_pedal_does_not_count_as_received(tmp_path: Path) -> None:
    reader = Reader(load_vehicle(tmp_path, dbc=TWO_BITS, more=NOT_AVAILABLE))
    reader.receive(256, bytes((0x02, 0)), 0.0)
    assert status_of(reader).mode is VehicleMode.AUTONOMOUS
    for at_ms in (100.0, 200.0, 310.0):
        reader.receive(256, bytes((0x1A, 0)), at_ms)
    assert status_of(reader).stamp_ns == 0
    sample = reader.receive(272, pose(), 320.0)
    assert sample is not None
    assert not sample.others_fresh


def test_a_sample_without_the_drivers_pedal_is_incomplete(tmp_path: Path) -> None:
    reader = Reader(
        load_vehicle(tmp_path, dbc=TWO_BITS, toml=(('["POSE"]', '["STATUS", "POSE"]'),), more=NOT_AVAILABLE)
    )
    reader.receive(272, pose(), 0.0)
    assert reader.receive(256, bytes((0x02, 0)), 1.0) is not None
    assert reader.receive(256, bytes((0x1A, 0)), 2.0) is None
    assert status_of(reader).stamp_ns == MS
    assert reader.assembler.incomplete == 1


PAGES = (
    (
        'SG_ MODE : 0|3@1+ (1,0) [0|7] "" PC\n SG_ BRAKE : 3|1@1+',
        'SG_ PAGE M : 0|1@1+ (1,0) [0|1] "" PC\n SG_ MODE m0 : 1|3@1+ (1,0) [0|7] "" PC\n SG_ BRAKE m1 : 1|1@1+',
    ),
)


@pytest.mark.parametrize("sample", ['["POSE"]', '["POSE", "STATUS"]'])
def test_a_branch_that_no_longer_comes_makes_the_message_old(tmp_path: Path, sample: str) -> None:
    reader = Reader(load_vehicle(tmp_path, dbc=PAGES, toml=(('["POSE"]', sample),)))
    for at_ms, page in ((0.0, 0x04), (20.0, 0x03), (40.0, 0x04)):
        reader.receive(256, bytes((page, 0)), at_ms)
    taken = reader.receive(272, pose(), 50.0)
    assert taken is not None
    assert taken.others_fresh
    assert status_of(reader).driver_brake
    for at_ms in range(60, 400, 20):
        reader.receive(256, bytes((0x04, 0)), at_ms)
    taken = reader.receive(272, pose(), 400.0)
    assert taken is None or not taken.others_fresh
    assert status_of(reader).stamp_ns == 20 * MS


def pedal_status(tmp_path: Path, driver: str, raw: int, notes: str = "") -> VehicleStatus:
    dbc = (('SG_ BRAKE : 3|1@1+ (1,0) [0|1] ""', 'SG_ BRAKE : 8|8@1+ (0.1,0) [0|25] "%"'),)
    toml = (('driver_brake = "STATUS.BRAKE"\n', f"[status.driver]\nbrake = {driver}\n"),)
    reader = Reader(load_vehicle(tmp_path, dbc=dbc, toml=toml, more=notes))
    reader.receive(256, bytes((0x02, raw)))
    return status_of(reader)


@pytest.mark.parametrize(("raw", "is_pressed"), [(49, False), (50, False), (51, True)])
def test_numbers_of_a_condition_are_in_the_unit_of_the_dbc(tmp_path: Path, raw: int, is_pressed: bool) -> None:
    driver = '{ signal = "STATUS.BRAKE", above = 5 }'
    assert pedal_status(tmp_path, driver, raw).driver_brake is is_pressed


def test_a_number_between_two_floats_is_equal_to_its_count(tmp_path: Path) -> None:
    assert 3 * 0.1 != 0.3
    for raw, is_equal in ((2, False), (3, True), (4, False)):
        assert pedal_status(tmp_path, '{ signal = "STATUS.BRAKE", equals = 0.3 }', raw).driver_brake is is_equal


def test_numbers_of_a_condition_are_as_the_notes_convert_the_signal(tmp_path: Path) -> None:
    notes = '[signals."STATUS.BRAKE"]\nscale = 2.0\n'
    driver = '{ signal = "STATUS.BRAKE", above = 0.1 }'
    assert not pedal_status(tmp_path, driver, 49, notes).driver_brake
    assert pedal_status(tmp_path, driver, 51, notes).driver_brake


@pytest.mark.parametrize(
    ("driver", "text"),
    [
        ('{ signal = "STATUS.BRAKE", above = 50 }', "above = 50 never holds: STATUS.BRAKE is in [0, 25] %"),
        ('{ not = { signal = "STATUS.BRAKE", below = 0 } }', "below = 0 never holds: STATUS.BRAKE is in [0, 25] %"),
        ('{ any = ["STATUS.BRAKE", { signal = "STATUS.BRAKE", in = [3, 26] }] }', "26 never holds"),
        ('{ signal = "STATUS.BRAKE", in = [] }', "in = [] never holds"),
        ('{ signal = "STATUS.MODE", equals = 5 }', "5 never holds: STATUS.MODE is one of 0 MANUAL, 1 READY"),
        (
            '{ signal = "STATUS.BRAKE", above = 25, magnitude = true }',
            "above = 25 never holds: the magnitude of STATUS.BRAKE is in [0, 25] %",
        ),
    ],
)
def test_a_comparison_that_never_holds_is_refused(tmp_path: Path, driver: str, text: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(f"v.toml: $.status.driver.brake: {text}")):
        pedal_status(tmp_path, driver, 0)
