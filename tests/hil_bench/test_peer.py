"""The bench's own reading of any profile: signals, conditions, protection, places, and what follows for the cases."""

import itertools
import json
import math
import random
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from hil_bench import cli
from hil_bench.applicable import adapt, find_inapplicable, scale_for
from hil_bench.case import Need, Then
from hil_bench.cases import CATALOGUE, catalogue_for
from hil_bench.cases.files import FILES
from hil_bench.expect import MomentaryAtMost
from hil_bench.faults.base import NotApplicableError
from hil_bench.faults.frames import drop_samples
from hil_bench.faults.signals import freeze_sample
from hil_bench.parts import Part, parts_of
from hil_bench.peer.build import build_vehicle, examine, open_wire
from hil_bench.peer.conditions import holds, satisfy_all
from hil_bench.peer.infer import InferredStop
from hil_bench.peer.place import Place
from hil_bench.peer.protection import Protection, read_bits, write_bits
from hil_bench.peer.units import size_of
from hil_bench.peer.wire import PeerWire
from hil_bench.profile import ProfileError
from hil_bench.vocabulary import Wait
from hil_bench.wire import Wire
from scenes import ROOT, SHIPPED, WIRE, find_case
from vehicle_bus_contract.reference import AUTONOMOUS, DRIVE, MS, Frame, S

from vehicle_iface.codec.database import load_database
from vehicle_iface.errors import ConfigError
from vehicle_iface.motion_sources import cap_unconfirmed_speed
from vehicle_iface.profile import load_profile
from vehicle_iface.safety.feasibility import find_violation
from vehicle_iface.trajectories.csv_file import load_csv

ROVER = ROOT / "docs" / "examples" / "06_own_vehicle" / "rover.toml"
NINE = b"123456789"


def checksum(kind: str, width: int, more: Mapping[str, object], data: bytes = NINE) -> int:
    """Over the bytes before it."""
    places = list(range(8 * len(data), 8 * len(data) + width))
    own = Protection(checksum_bits=places, checksum_signal="SUM", kind=kind, **more)  # type: ignore[arg-type]
    sealed = own.seal(0x1F8, data + bytes((width + 7) // 8))
    return read_bits(sealed, places)


@pytest.mark.parametrize(
    ("kind", "width", "more", "expected"),
    [
        ("crc8", 8, {"poly": 0x1D, "init": 0xFF, "xor_out": 0xFF}, 0x4B),  # CRC-8/SAE-J1850
        ("crc8", 8, {"poly": 0x31, "reflect": True}, 0xA1),  # CRC-8/MAXIM
        ("crc16", 16, {"poly": 0x1021, "init": 0xFFFF}, 0x29B1),  # CRC-16/CCITT-FALSE
        ("crc16", 16, {"poly": 0x1021, "init": 0xFFFF, "xor_out": 0xFFFF, "reflect": True}, 0x906E),  # CRC-16/X-25
        ("sum", 8, {}, sum(NINE) & 0xFF),
        ("xor", 8, {"init": 0x5A}, 0x31 ^ 0x5A),
        ("sum", 4, {}, sum(byte >> 4 for byte in NINE) + sum(byte & 15 for byte in NINE) & 15),
        ("sum", 8, {"over": ("id", "length", "bytes")}, sum(NINE) + 0xF8 + 0x01 + 10 & 0xFF),
    ],
)
def test_checksums_have_their_published_values(
    kind: str, width: int, more: Mapping[str, object], expected: int
) -> None:
    assert checksum(kind, width, more) == expected


def test_bits_are_written_where_they_are_read() -> None:
    places = [12, 11, 10, 9, 23]
    for number in range(32):
        data = write_bits(b"\xff\xff\xff", places, number)
        assert read_bits(data, places) == number
        assert read_bits(data, [place for place in range(24) if place not in places]) == (1 << 19) - 1


@pytest.mark.parametrize(
    ("unit", "size"),
    [
        ("km/h", 1 / 3.6),
        ("Deg", math.radians(1)),
        ("m / s", 1.0),
        ("%", 0.01),
        ("rpm", math.tau / 60),
        ("1/km", 0.001),
        ("", 1.0),
        (None, 1.0),
    ],
)
def test_units_are_recognised_by_their_spellings(unit: str | None, size: float) -> None:
    assert size_of(unit) == pytest.approx(size)
    assert size_of("furlong") is None


CONDITIONS: list[str | Mapping[str, object]] = [
    "A",
    {"not": "A"},
    {"signal": "A", "equals": 2},
    {"signal": "A", "in": ["TWO", 1]},
    {"signal": "B", "above": 3.0, "magnitude": True},
    {"signal": "B", "below": -1.0},
    {"all": ["A", {"not": {"signal": "B", "above": 0.0}}]},
    {"any": [{"signal": "A", "equals": 1}, {"all": ["B", {"not": "A"}]}]},
    {"all": []},
]


def number_of(_signal: str, number: object) -> float:
    return 2.0 if number == "TWO" else float(str(number))


@pytest.mark.parametrize("wanted", [True, False])
@pytest.mark.parametrize("condition", CONDITIONS, ids=str)
def test_a_signal_value_is_chosen_for_every_form_of_condition(
    condition: str | Mapping[str, object], wanted: bool
) -> None:
    values = {"A": (0.0, 1.0, 2.0), "B": (0.0, -4.0, 4.0)}
    every = [{"A": a, "B": b} for a, b in itertools.product(*values.values())]
    found = list(satisfy_all([(condition, wanted)], {}, values.__getitem__, number_of))
    assert all(holds(condition, one, number_of) is wanted for one in found if one.keys() == {"A", "B"})
    assert bool(found) is any(holds(condition, one, number_of) is wanted for one in every)
    for fixed in every:
        kept = next(satisfy_all([(condition, wanted)], fixed, values.__getitem__, number_of), None)
        assert (kept == fixed) is (holds(condition, fixed, number_of) is wanted)


def test_a_signal_without_a_value_fulfils_no_comparison() -> None:
    assert not holds({"signal": "A", "below": 5.0}, {}, number_of)


def test_an_antenna_is_measured_where_it_is() -> None:
    place = Place(
        source="geographic",
        frame_id="map",
        latitude_deg=52.0,
        longitude_deg=5.0,
        mount_x_m=2.0,
        mount_y_m=0.0,
        mount_rad=0.1,
    )
    told = place.measure(100.0, 0.0, math.pi / 2)
    assert told["heading_rad"] == pytest.approx(math.pi / 2 + 0.1)
    assert (told["latitude_deg"] - 52.0) * 111_267.0 == pytest.approx(2.0, abs=0.01)  # a degree of latitude at 52°
    assert (told["longitude_deg"] - 5.0) * 68_677.0 == pytest.approx(100.0, abs=0.05)  # and of longitude


def test_modes_are_reported_by_the_values_of_conditions() -> None:
    wire = open_wire("pacmod3")
    assert isinstance(wire, PeerWire)
    for mode in range(4):
        newest: dict[str, float] = {}
        for name in wire.periods_s:
            told = wire.intact(wire.pack(name, 0, MODE=mode, SPEED=3.0))
            assert told is not None
            newest.update(told.signals)
        assert wire.mode_of(newest) == mode
        assert wire.fields.read("speed_mps", newest) == pytest.approx(3.0)
    assert not wire.can_report("EMERGENCY_STOP")


def test_without_a_gear_what_drives_drives_forwards_whatever_speed_is_measured() -> None:
    wire = open_wire("vbox_kart")
    assert isinstance(wire, PeerWire)
    accel_mps2 = [
        wire.reader.read({wire.carriers(field)[0]: 1.0}, speed_mps=-0.3, direction=-1.0)["ACCEL_REQUEST"]
        for field in ("drive_mps2", "brake_mps2")
    ]
    assert accel_mps2 == [1.0, 1.0]  # the brake acts against the measured motion


@pytest.mark.parametrize(("slope_mps2", "is_stop"), [(0.0, False), (-0.3, False), (-1.2, True), (0.8, False)])
def test_a_commanded_speed_that_falls_as_in_a_stop_counts_as_a_stop(slope_mps2: float, is_stop: bool) -> None:
    wire = open_wire("agilex_hunter")
    assert isinstance(wire, PeerWire)
    stop = InferredStop(wire)
    found = [
        stop.is_stop({"SPEED_REQUEST": 1.0 + slope_mps2 * 0.02 * i}, speed_mps=1.0, direction=1.0, at_ns=20 * MS * i)
        for i in range(20)
    ]
    assert found[-1] is is_stop
    assert stop.is_stop({"SPEED_REQUEST": 0.0}, speed_mps=0.5, direction=1.0, at_ns=400 * MS)


# Which cases apply


def test_every_case_applies_to_the_reference_vehicle_unchanged() -> None:
    assert frozenset(Part) - parts_of(WIRE) == {Part.FURTHER_STATE}  # it has one bus
    for case in CATALOGUE:
        assert find_inapplicable(case, WIRE) == "", case.name
        assert adapt(case, WIRE) is case


def test_the_fd_vehicle_has_no_sample_of_several_messages() -> None:
    wire = Wire("reference_fd")
    left_out = [case.name for case in CATALOGUE if find_inapplicable(case, wire)]
    assert left_out == ["cycles-mixed"]


@pytest.mark.parametrize("profile", SHIPPED)
def test_a_case_that_needs_what_a_vehicle_lacks_does_not_apply(profile: str) -> None:
    wire = open_wire(profile)
    there = parts_of(wire)
    for case in CATALOGUE:
        why = find_inapplicable(case, wire)
        lacking = [part for part in case.about if part not in there]
        assert all(part.value in why for part in lacking)
        assert why or not lacking
    assert not find_inapplicable(find_case("state-lost"), wire)
    assert not find_inapplicable(find_case("killed"), wire)


class _DrivenVehicle(SimpleNamespace):
    """A rig in virtual time, with a vehicle that drives in a bend and is not commanded."""

    def __init__(self, profile: str) -> None:
        wire = open_wire(profile)
        vehicle = build_vehicle(wire)
        vehicle.mode, vehicle.gear, vehicle.has_watchdog = AUTONOMOUS, DRIVE, False
        vehicle.plant.speed_mps, vehicle.plant.wheel_rad = 2.0, 0.1
        super().__init__(
            wire=wire, vehicle=vehicle, random=random.Random(0), every_tick=[], delay_s=lambda: 0.0, now_ns=S
        )

    def tick(self) -> list[Frame]:
        """The frames of the vehicle's next tick."""
        vehicle = self.vehicle
        vehicle.plant.speed_mps += 0.005
        self.now_ns += vehicle.period_ns
        vehicle.move(vehicle.period_ns / S, self.now_ns)
        frames: list[Frame] = vehicle.next_frames()
        for call in tuple(self.every_tick):
            call()
        return frames


@pytest.mark.parametrize("profile", SHIPPED)
def test_each_fault_of_the_state_that_applies_to_a_vehicle_changes_what_it_sends(profile: str) -> None:
    wire = open_wire(profile)
    without_effect = []
    for case in CATALOGUE:
        if case.inject is None or "state" not in case.tags or case.at_mps < 0.0 or find_inapplicable(case, wire):
            continue
        faulty, sound = _DrivenVehicle(profile), _DrivenVehicle(profile)
        assert faulty.tick() == sound.tick()
        try:
            with case.inject(faulty):  # type: ignore[arg-type]
                changed = any(faulty.tick() != sound.tick() or faulty.delay_s() > 0.0 for _ in range(200))
        except NotApplicableError:
            continue
        if not changed:
            without_effect.append(case.name)
    assert without_effect == []


@pytest.mark.parametrize("profile", SHIPPED)
def test_half_the_rate_is_half_of_each_message(profile: str) -> None:
    faulty, sound = _DrivenVehicle(profile), _DrivenVehicle(profile)
    with drop_samples(2)(faulty):  # type: ignore[arg-type]
        ends = [(sound.tick(), faulty.tick()) for _ in range(200)]
    for name in sound.wire.sample:
        sent, left = (sum(sound.wire.name_of(one) == name for tick in ends for one in tick[way]) for way in (0, 1))
        assert abs(left - sent / 2) <= 1, name


@pytest.mark.parametrize("profile", SHIPPED)
def test_a_frozen_state_has_a_frozen_position(profile: str) -> None:
    ride = _DrivenVehicle(profile)
    wire = ride.wire
    messages = {wire.part_of(name) for name in ("POS_X", "POS_Y", "SPEED") if wire.has(name)}
    assert messages <= set(wire.sample)
    with freeze_sample()(ride):  # type: ignore[arg-type]
        seen: dict[str, set[tuple[tuple[str, float], ...]]] = {name: set() for name in messages}
        for frame in (frame for _ in range(100) for frame in ride.tick()):
            decoded = wire.intact(frame)
            if decoded is not None and decoded.name in seen:
                seen[decoded.name].add(
                    tuple((name, value) for name, value in decoded.signals.items() if name != "COUNTER")
                )
    assert {name: len(values) for name, values in seen.items()} == dict.fromkeys(messages, 1)


def test_the_hunter_has_neither_position_nor_protection() -> None:
    there = parts_of(open_wire("agilex_hunter"))
    assert not there & {Part.POSITION, Part.CHECKSUM, Part.COUNTER, Part.GEAR, Part.BRAKE, Part.REASON}
    assert {Part.MANUAL, Part.FAULT, Part.EMERGENCY_STOP, Part.WHEELS, Part.STATUS, Part.REVERSE} <= there


def test_a_smaller_vehicle_drives_smaller_and_slower_routes_in_its_own_frame() -> None:
    wire = open_wire("agilex_hunter")
    for name in ("drive-u-turn", "drive-reverse-bay", "state-lost-at-speed", "overspeed", "many-points"):
        route = find_case(name).route()
        driven = scale_for(route, wire)
        assert max(map(abs, driven.speed_mps)) <= 0.9 * wire.profile["limits"]["speed_max_mps"] + 1e-9
        assert driven.heading_rad == route.heading_rad
        share = max(map(abs, driven.speed_mps)) / max(map(abs, route.speed_mps))
        assert share <= 0.8 * 1.5 / 5.0 + 1e-9
        assert driven.time_s[-1] >= route.time_s[-1]
        assert all(b > a for a, b in itertools.pairwise(driven.time_s))
    assert wire.frame_id == "odom"


def test_a_slower_vehicle_gets_longer_limits_and_odometry_is_armed_again() -> None:
    wire, case = open_wire("agilex_hunter"), find_case("state-lost")
    driven = adapt(case, wire)
    assert driven.for_s == pytest.approx(case.for_s + wire.later_s[Wait.STATE])
    assert (case.then, driven.then) == (Then.GOES_ON, Then.REARM)
    assert Need.REARM in driven.needs
    assert adapt(find_case("half-the-rate"), wire).then is Then.GOES_ON


def test_a_vehicle_with_odometry_that_need_not_stop_is_armed_again_only_if_it_has_stopped() -> None:
    driven = adapt(find_case("paused-30-ms"), open_wire("pacmod3"))
    assert driven.then is Then.MAY_GO_ON
    assert Need.REARM in driven.needs
    assert [one.most_s for one in driven.see if isinstance(one, MomentaryAtMost)] == [math.inf]


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("[command.signals]", "[command.none]", "can only be watched"),
        ('"MOTION_COMMAND.STEERING_ANGLE"', '"MOTION_COMMAND.ANGLE"', "ANGLE"),
        (
            '"MOTION_COMMAND.STEERING_ANGLE"',
            '"MOTION_COMMAND.STEERING_ANGLE"\n[signals."MOTION_COMMAND.STEERING_ANGLE"]\nunit = "gon"',
            "unit 'gon'",
        ),
        ('"MOTION_COMMAND.STEERING_ANGLE"', '[["MOTION_COMMAND.STEERING_ANGLE"]]', "is no profile"),
        ("lateral_jerk_mps3", "# lateral_jerk_mps3", "lateral_jerk_mps3 is missing"),
    ],
)
def test_a_profile_that_the_bench_cannot_simulate_is_rejected_with_the_reason(
    old: str, new: str, why: str, tmp_path: Path
) -> None:
    files = open_wire("agilex_hunter")
    text = files.path.read_text().replace(old, new)
    (tmp_path / files.dbc.name).write_text(files.dbc.read_text())
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ProfileError, match=why):
        open_wire(str(tmp_path / "mine.toml"))


@pytest.mark.parametrize("profile", SHIPPED)
def test_the_program_accepts_every_kind_of_route_as_a_vehicle_drives_it(profile: str, tmp_path: Path) -> None:
    wire, own = open_wire(profile), cap_unconfirmed_speed(load_profile(profile))
    for name in ("drive-slalom", "drive-double-lane-change", "drive-u-turn", "state-lost", "state-lost-at-speed"):
        path = scale_for(find_case(name).route(), wire).write(tmp_path / "route.csv", wire.frame_id)
        assert not find_violation(load_csv(path), own.limits, own.geometry.wheelbase_m)


@pytest.mark.parametrize("profile", ["agilex_hunter", "agilex_hunter_ins", "j1939_truck", "vbox_kart"])
def test_the_program_rejects_every_profile_that_a_case_has_broken(profile: str, tmp_path: Path) -> None:
    wire = open_wire(profile)
    for file in (*wire.further_files, wire.path, wire.dbc):
        (tmp_path / file.name).write_text(file.read_text())
    load_database(load_profile(str(tmp_path / wire.path.name)))  # it is what is spoilt that is rejected
    for case in FILES:
        if case.profile is not None and not find_inapplicable(case, wire):
            toml, dbc = case.profile(wire.path.read_text(), wire.dbc.read_text())
            (tmp_path / "mine.toml").write_text(toml)
            (tmp_path / wire.dbc.name).write_text(dbc)
            with pytest.raises(ConfigError):
                load_database(load_profile(str(tmp_path / "mine.toml")))


def test_the_list_names_cases_that_do_not_apply(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--list", "--profile", "agilex_hunter"]) == 0
    said = capsys.readouterr().out
    assert "NOT APPLICABLE to agilex_hunter: needs a gear on its bus" in said
    assert "not applicable to agilex_hunter" in said.splitlines()[-1]
    assert cli.main(["--list", "--json", "--profile", "agilex_hunter"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert "gear" in rows["gear-contradicts"]["not_applicable"]
    assert "not_applicable" not in rows["state-lost"]
    assert cli.main(["--list"]) == 0
    assert capsys.readouterr().out.endswith(f"\n{len(catalogue_for(WIRE))} cases\n")


def test_a_speed_that_nothing_confirms_is_limited() -> None:
    limits = {name: open_wire(name).profile["limits"]["speed_max_mps"] for name in ("fs_ai_ads_dv", "pacmod3")}
    assert limits == {"fs_ai_ads_dv": 3.0, "pacmod3": 10.0}


def test_a_j1939_message_is_recognised_at_any_priority(tmp_path: Path) -> None:
    text = ROVER.read_text() + "\n[messages.STATUS]\nj1939 = { source_address = 0x10 }\n"
    (tmp_path / "rover.dbc").write_text(ROVER.with_name("rover.dbc").read_text())
    (tmp_path / "rover.toml").write_text(text)
    wire = open_wire(str(tmp_path / "rover.toml"))
    frame = wire.pack("STATUS", 1, MODE=AUTONOMOUS)
    other = replace(frame, can_id=frame.can_id ^ 0x0400_0000)
    assert wire.name_of(other) == "STATUS"
    assert wire.intact(wire.seal(other)) is not None
    assert wire.name_of(replace(other, can_id=other.can_id ^ 1)) is None
    assert wire.name_of(Frame(0, 0x123, b"")) is None


def test_a_command_contains_only_the_signals_of_its_branch() -> None:
    wire = open_wire("new_eagle_raptor")
    told = [wire.intact(wire.pack("AKit_AccelPdlRequest", 0, **{f"AKit_AccelPdlRequest.{name}": value}))
            for name, value in (("AKit_AccelReqType", 0.0), ("AKit_AccelReqType", 1.0))]  # fmt: skip
    assert told[0] is not None
    assert told[1] is not None
    assert "AKit_AccelPdlRequest.AKit_AccelPdlReq" in told[0].signals
    assert "AKit_AccelPdlRequest.AKit_AccelPdlReq" not in told[1].signals


def test_a_vehicle_that_is_only_watched_cannot_be_judged() -> None:
    with pytest.raises(ProfileError, match="can only be watched"):
        open_wire("toyota_rav4")


def hunter_frames(mode: int, speed: float, *, from_ms: int = 0, to_ms: int = 1000) -> list[Frame]:
    """CONTROL_MODE_SETTING ten times a second, MOTION_COMMAND fifty times."""
    wire = open_wire("agilex_hunter")
    said = [
        (at_ms, wire.pack("MOTION_COMMAND", 0, **{"MOTION_COMMAND.LINEAR_VELOCITY": speed}))
        for at_ms in range(from_ms, to_ms, 20)
    ]
    said += [
        (at_ms + 1, wire.pack("CONTROL_MODE_SETTING", 0, **{"CONTROL_MODE_SETTING.MODE": mode}))
        for at_ms in range(from_ms, to_ms, 100)
    ]
    return [replace(frame, stamp_ns=S + at_ms * MS) for at_ms, frame in sorted(said, key=lambda one: one[0])]


def test_a_speed_without_can_control_is_found_once_the_message_must_have_come() -> None:
    wire = open_wire("agilex_hunter")
    found = examine(wire, hunter_frames(0, 0.5)).violations
    assert all("LINEAR_VELOCITY is 0.5 although the vehicle is not enabled" in text for text in found)
    assert found[0].startswith("0.140 s")
    assert len(found) == 43
    late = [*hunter_frames(0, 0.0, to_ms=200), *hunter_frames(1, 0.5, from_ms=200)]
    assert not examine(wire, late).violations


def test_commands_that_end_with_a_release_do_not_count_as_silence() -> None:
    wire = open_wire("agilex_hunter")
    driven, again = hunter_frames(1, 0.5), hunter_frames(1, 0.5, from_ms=3000, to_ms=4000)
    released = hunter_frames(0, 0.0, from_ms=1000, to_ms=3000)
    end = [frame for frame in released if frame.can_id == 0x421]
    assert not examine(wire, [*driven, *end, *again]).silences
    assert [pair.is_enabled for pair in examine(wire, [*driven, *end]).pairs][-20:] == [False] * 20
    assert examine(wire, [*driven, *again]).silences


def test_a_count_that_does_not_advance_is_a_gap_of_a_counter_and_no_wrong_value() -> None:
    wire = open_wire("pacmod3")

    def counted(*counts: int) -> list[Frame]:
        told = ((count, {"GLOBAL_CMD.COUNTER": count, "GLOBAL_CMD.COMPLEMENT": 15 - count}) for count in counts)
        frames = (
            wire.pack("GLOBAL_CMD", count, **values, **{"GLOBAL_CMD.SANITY_CHECK_REQUIRED": 1})
            for count, values in told
        )
        return [replace(frame, stamp_ns=S + at * 33 * MS) for at, frame in enumerate(frames)]

    assert not examine(wire, counted(14, 15, 0, 1)).counter_gaps
    record = examine(wire, counted(1, 3, 3))
    assert [text.partition(": ")[2] for text in record.counter_gaps] == [
        "GLOBAL_CMD.COUNTER from 1 to 3",
        "GLOBAL_CMD.COUNTER from 3 to 3",
    ]
    assert not record.violations


@pytest.mark.parametrize(("state", "is_found"), [(3, True), (7, False)])
def test_a_frame_with_an_undefined_value_need_not_be_echoed(state: int, is_found: bool) -> None:
    wire = PeerWire("fs_ai_ads_dv")

    def told(at_ms: int, handshake: int, state: int = 3) -> Frame:
        values = {"VCU2AI_Status.HANDSHAKE": float(handshake), "VCU2AI_Status.AS_STATE": float(state)}
        return replace(wire.pack_signals("VCU2AI_Status", 0, values), stamp_ns=S + at_ms * MS)

    def answered(at_ms: int) -> Frame:
        return replace(wire.pack("AI2VCU_Status", 0, **{"AI2VCU_Status.HANDSHAKE": 0}), stamp_ns=S + at_ms * MS)

    frames = [told(0, 0), *(told(at_ms, 1, state) for at_ms in range(10, 500, 10)), answered(500)]
    assert any("HANDSHAKE" in text for text in examine(wire, frames).violations) is is_found


def test_odometry_may_be_off_by_a_share_of_the_way() -> None:
    case = find_case("drive-figure-eight")
    (own, far), (other, _) = ((adapt(case, open_wire(name)), case.route()) for name in ("fs_ai_ads_dv", "vbox_kart"))
    assert own.max_path_error_m is not None
    assert other.max_path_error_m is not None
    assert own.max_path_error_m > 0.005 * 0.5 * far.length_m()
    assert other.max_path_error_m < 0.5


def test_messages_of_two_commands_are_not_taken_for_one_after_a_loss() -> None:
    wire = open_wire("new_eagle_raptor")

    def told(at_ms: int, enable: float, lost: str = "") -> list[Frame]:
        enables = {name.partition(".")[0]: {name: enable} for name in wire.profile["command"]["signals"]["enable"]}
        names = [name for name in wire.command if name != lost]
        frames = [wire.pack(name, at_ms // 20, **enables.get(name, {})) for name in names]
        return [replace(frame, stamp_ns=S + at_ms * MS + place) for place, frame in enumerate(frames)]

    frames = [*told(0, 0.0), *told(20, 0.0, lost=wire.command[0]), *told(40, 1.0), *told(60, 1.0)]
    record = examine(wire, frames)
    assert [pair.is_enabled for pair in record.pairs] == [False, True, True]
    assert not [text for text in record.violations if "contradict" in text]
    assert len(record.doubled) == 1


@pytest.mark.parametrize("profile", SHIPPED)
def test_a_tow_is_stronger_than_the_brake_and_leaves_no_signals_range(profile: str) -> None:
    wire = open_wire(profile)
    assert wire.tow_mps2 > -wire.profile["limits"]["accel_min_mps2"]
    if isinstance(wire, PeerWire) and wire.has("ACCEL"):
        assert wire.tow_mps2 < 0.9 * wire.greatest("ACCEL")[0]


@pytest.mark.parametrize("profile", SHIPPED)
def test_a_device_that_requests_engagement_is_watched_for_longer_than_its_profile_allows(profile: str) -> None:
    wire = open_wire(profile)
    case = adapt(find_case("vehicle-never-engages"), wire)
    assert case.for_s > wire.profile["timing"]["engage_timeout_s"] + 5.0
