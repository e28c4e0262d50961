"""A vehicle on several buses: names, identifiers, interfaces, and the program that drives the bench's vehicle there."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from hil_bench import buses, cli, routes
from hil_bench.applicable import adapt, find_inapplicable
from hil_bench.bus import RxFrame
from hil_bench.cases import CATALOGUE, catalogue_for, catalogue_of
from hil_bench.cases.buses import BUSES
from hil_bench.device import Commands, fill_template
from hil_bench.expect import Observation
from hil_bench.judges import dynamics
from hil_bench.peer.build import open_wire
from hil_bench.peer.wire import PeerWire
from hil_bench.profile import ProfileError
from hil_bench.result import Verdict
from scenes import WIRE
from vehicle_bus_contract.reference import AUTONOMOUS, Frame
from virtual_drive import VirtualDrive

ROOT = Path(__file__).resolve().parents[2]
HUNTER = "agilex_hunter_ins"
VEHICLE, INS = 0, 1
COMMAND_ID = 0x111


def copied(folder: Path, *changes: tuple[str, str], ins: Sequence[tuple[str, str]] = (), swapped: bool = False) -> str:
    """The Hunter's profile with other texts, and with other texts in the DBC of its INS."""
    toml = (ROOT / "dbc" / f"{HUNTER}.toml").read_text()
    if swapped:
        vehicle, other = re.findall(r"^\[buses\.\w+\]\n(?:.+\n)+", toml, re.MULTILINE)
        toml = toml.replace(vehicle, "").replace(other, f"{other}\n{vehicle}")
    dbc = (ROOT / "dbc" / "oxts_ins.dbc").read_text()
    for old, new in changes:
        assert old in toml
        toml = toml.replace(old, new)
    for old, new in ins:
        assert old in dbc
        dbc = dbc.replace(old, new)
    (folder / "mine.toml").write_text(toml)
    (folder / "oxts_ins.dbc").write_text(dbc)
    (folder / "agilex_hunter.dbc").write_text((ROOT / "dbc" / "agilex_hunter.dbc").read_text())
    return str(folder / "mine.toml")


def find_faults(profile: str, folder: Path, change: Callable[[Frame], list[Frame]]) -> list[str]:
    """Of five seconds of driving."""
    drive = VirtualDrive(profile, routes.straight(120.0), folder, change)
    drive.run_s(5.0)
    record = drive.record()
    return [*record.faults(), *dynamics.find_faults(drive.wire, record)]


def test_each_message_is_on_its_bus() -> None:
    wire = open_wire(HUNTER)
    assert wire.buses == ("vehicle", "ins")
    assert [dbc.name for dbc in (wire.dbc, *wire.further_files)] == ["agilex_hunter.dbc", "oxts_ins.dbc"]
    on = {name: wire.bus_of(name) for name in wire.ids}
    assert {name for name, bus in on.items() if bus == INS} == set(wire.sample) - {"MOTION_STATE"}
    position = wire.pack("LatitudeLongitude", 0)
    assert (position.bus, wire.name_of(position)) == (INS, "LatitudeLongitude")
    assert wire.name_of(replace(position, bus=VEHICLE)) is None
    assert {0x111, 0x211, 0x221, 0x421} == set(wire.ids_on(VEHICLE))
    assert {0x111, 0x421, 0x601, 0x606, 0x607, 0x609} == set(wire.ids_on(INS))


SAME_NAME = (
    ('trigger = "AccelLevel"', 'trigger = "ins:MOTION_STATE"'),
    ('"AccelLevel", "MOTION_STATE"]', '"ins:MOTION_STATE", "vehicle:MOTION_STATE"]'),
    ("AccelLevel.AccelForward", "ins:MOTION_STATE.AccelForward"),
    ('"MOTION_STATE.', '"vehicle:MOTION_STATE.'),
    ("MOTION_STATE = 0.05", '"vehicle:MOTION_STATE" = 0.05'),
    ('"LatitudeLongitude.PosLat"', '"ins:LatitudeLongitude.PosLat"'),
)
"""The INS has a message MOTION_STATE, too; one name has a bus that it does not need."""


def test_messages_with_the_same_name_and_identifier_are_distinguished_by_bus(tmp_path: Path) -> None:
    same_id = (("BO_ 1542 AccelLevel", "BO_ 545 MOTION_STATE"), ("BO_ 1542 10", "BO_ 545 10"))
    profile = copied(tmp_path, *SAME_NAME, ins=same_id)
    drive = VirtualDrive(profile, routes.straight(30.0), tmp_path)
    assert isinstance(drive.wire, PeerWire)
    assert drive.wire.sample[-2:] == ("ins:MOTION_STATE", "vehicle:MOTION_STATE")
    assert "LatitudeLongitude.PosLat" in drive.wire.signals
    drive.run_until(lambda: drive.vehicle.plant.speed_mps > 0.5, 15.0)
    record = drive.record()
    assert len(record.pairs) > 50
    assert not record.faults()


def test_a_name_on_several_buses_must_include_the_bus(tmp_path: Path) -> None:
    same_name = [("AccelLevel", "MOTION_STATE")]
    text = "MOTION_STATE is on the buses vehicle and ins; write vehicle:MOTION_STATE or ins:MOTION_STATE"
    with pytest.raises(ProfileError, match=text):
        open_wire(copied(tmp_path, ("AccelLevel", "ins:MOTION_STATE"), ins=same_name))
    noted = ("[state]\n", "[messages.MOTION_STATE]\ncycle_ms = 20\n[state]\n")
    with pytest.raises(ProfileError, match=text):
        open_wire(copied(tmp_path, *SAME_NAME, noted, ins=same_name))
    with pytest.raises(ProfileError, match="gps:RateLevel"):
        open_wire(copied(tmp_path, ('"RateLevel.AngRateDown"', '"gps:RateLevel.AngRateDown"')))
    with pytest.raises(ProfileError, match="dbc"):
        open_wire(copied(tmp_path, ('dbc = "oxts_ins.dbc"', "")))


@pytest.mark.parametrize("swapped", [False, True], ids=["first", "second"])
def test_commands_on_the_wrong_bus_are_found_and_not_obeyed(swapped: bool, tmp_path: Path) -> None:
    profile = copied(tmp_path, swapped=swapped)
    assert open_wire(profile).buses == (("ins", "vehicle") if swapped else ("vehicle", "ins"))

    def move(frame: Frame) -> list[Frame]:
        return [replace(frame, bus=1 - frame.bus)] if frame.can_id == COMMAND_ID else [frame]

    drive = VirtualDrive(profile, routes.straight(60.0), tmp_path, move)
    drive.run_s(2.0)
    assert not any(instant.mode == AUTONOMOUS for instant in drive.vehicle.history)
    must = "MOTION_COMMAND on the bus ins; it belongs on vehicle"
    assert any(must in text for text in drive.record().faults())


def test_a_command_that_is_also_sent_on_the_other_bus_is_found(tmp_path: Path) -> None:
    found = find_faults(HUNTER, tmp_path, lambda frame: [frame, replace(frame, bus=1 - frame.bus)])
    assert any("CONTROL_MODE_SETTING on the bus ins" in text for text in found)
    assert any("MOTION_COMMAND on the bus ins" in text for text in found)


def changed(profile: str, signal: str, value: float) -> Callable[[Frame], list[Frame]]:
    """Each fiftieth command with another value."""
    wire, count = PeerWire(profile), 0

    def change(frame: Frame) -> list[Frame]:
        nonlocal count
        decoded = wire.intact(frame)
        count += decoded is not None and decoded.name == "MOTION_COMMAND"
        if decoded is None or decoded.name != "MOTION_COMMAND" or count % 50:
            return [frame]
        return [wire.pack(decoded.name, 0, **{**decoded.signals, f"MOTION_COMMAND.{signal}": value})]

    return change


@pytest.mark.parametrize(
    ("signal", "value", "must"),
    [("LINEAR_VELOCITY", 2.0, "m/s asked for"), ("STEERING_ANGLE", 0.6, "front wheels to 0.6")],
)
def test_defects_of_commands_on_the_second_bus_are_found(signal: str, value: float, must: str, tmp_path: Path) -> None:
    profile = copied(tmp_path, swapped=True)
    wire = open_wire(profile)
    assert wire.bus_of("MOTION_COMMAND") == 1
    assert not find_faults(profile, tmp_path, lambda frame: [frame])
    found = find_faults(profile, tmp_path, changed(profile, signal, value))
    assert any(must in text for text in found), found[:5]


def without_two_of_ten() -> Callable[[Frame], list[Frame]]:
    count = 0

    def change(frame: Frame) -> list[Frame]:
        nonlocal count
        count += frame.can_id == COMMAND_ID
        return [] if frame.can_id == COMMAND_ID and count % 10 < 2 else [frame]

    return change


def test_lost_commands_on_the_second_bus_are_found(tmp_path: Path) -> None:
    found = find_faults(copied(tmp_path, swapped=True), tmp_path, without_two_of_ten())
    assert any("no command for" in text for text in found), found[:5]


@pytest.mark.parametrize("device", ["sound", "drives on"])
def test_a_silent_further_bus_stops_the_vehicle_and_a_device_that_drives_on_fails(device: str, tmp_path: Path) -> None:
    drive = VirtualDrive(HUNTER, routes.straight(60.0), tmp_path)
    drive.run_until(lambda: drive.vehicle.plant.speed_mps > 0.5, 15.0)
    case = adapt(next(case for case in BUSES if case.name == "further-bus-silent"), drive.wire)
    assert case.inject is not None
    begin_ns = drive.bus.now_ns
    if device == "sound":
        with case.inject(SimpleNamespace(vehicle=drive.vehicle)):  # type: ignore[arg-type]
            drive.run_s(case.for_s)
    else:
        drive.run_s(case.for_s)
    end_ns = drive.bus.now_ns
    drive.run_s(1.5)
    record = drive.record()
    observed = Observation(
        begin_ns=record.begin_ns,
        inject_ns=begin_ns,
        end_ns=end_ns,
        then_ns=drive.bus.now_ns,
        samples_ns=[],
        pairs=record.pairs,
        decoded=[],
        frames=[],
        history=drive.vehicle.history,
        exit_status=0,
        exit_ns=drive.bus.now_ns,
        route=routes.straight(60.0),
        wire=drive.wire,
    )
    found, _ = case.see[0].judge(observed)
    assert found.verdict is (Verdict.PASS if device == "sound" else Verdict.FAIL), found
    if device == "sound":
        assert drive.vehicle.mode == AUTONOMOUS
        assert not record.pairs[-1].is_stop


def test_cases_for_several_buses_apply_only_to_vehicles_with_several(capsys: pytest.CaptureFixture[str]) -> None:
    assert catalogue_of(1) == CATALOGUE
    assert catalogue_of(2) == (*CATALOGUE, *BUSES)
    wire = open_wire(HUNTER)
    assert not any(find_inapplicable(case, wire) for case in BUSES)
    assert all(case.name.startswith("further-bus") for case in BUSES)
    assert cli.main(["--list", "--profile", HUNTER]) == cli.PASSED
    assert f"{len(catalogue_for(wire))} cases" in capsys.readouterr().out


def test_each_bus_has_its_own_interface(monkeypatch: pytest.MonkeyPatch) -> None:
    wire = open_wire(HUNTER)
    monkeypatch.setattr(buses, "is_virtual", lambda _: False)
    channels = buses.read_channels(["ins=can1", "vehicle=can0"], wire)
    assert channels == ("can0", "can1")
    assert buses.describe_channels(channels, wire) == "vehicle=can0, ins=can1"
    assert buses.read_channels(["vcan9"], WIRE) == ("vcan9",)
    assert buses.channel_options(("vcan9",), WIRE) == "--channel vcan9"
    for given in (["can0"], ["vehicle=can0"], ["vehicle=can0", "gps=can1"], ["vehicle=can0", "ins=can0"]):
        with pytest.raises(ProfileError, match="--channel vehicle=can0 --channel ins=can1"):
            buses.read_channels(given, wire)
    with pytest.raises(ProfileError, match="--channel can0"):
        buses.read_channels(["can0", "can1"], WIRE)
    monkeypatch.setattr(buses, "is_virtual", lambda _: True)
    with pytest.raises(OSError, match="ip link add vcan-none type vcan") as error:
        buses.read_channels(["vehicle=vcan0", "ins=vcan-none"], wire)
    assert error.value.filename == "vcan-none"


def test_the_device_gets_all_interfaces() -> None:
    wire = open_wire(HUNTER)
    values = dict.fromkeys(("profile", "trajectory"), "x")
    values |= {"channel": "vcan0", "channels": buses.channel_options(("vcan0", "vcan1"), wire)}
    own = fill_template(Commands().start, values)
    at = own.index("--channel")
    assert own[at : at + 4] == ["--channel", "vehicle=vcan0", "--channel", "ins=vcan1"]
    assert (
        fill_template("sh -c 'run {channels} {{}}'", values)[2] == "run --channel vehicle=vcan0 --channel ins=vcan1 {}"
    )
    one = fill_template(Commands().start, values | {"channels": "--channel vcan0"})
    assert one[at : at + 3] == ["--channel", "vcan0", "--profile"]


def test_frames_are_sent_and_received_on_their_buses(monkeypatch: pytest.MonkeyPatch) -> None:
    wire = open_wire(HUNTER)
    sent: list[tuple[str, Frame]] = []
    waiting = {"vcan0": [Frame(3, 0x221, b""), Frame(5, 0x221, b"")], "vcan1": [Frame(4, 0x601, b"", bus=1)]}

    def open_one(channel: str, identifiers: Sequence[int] | None, number: int = 0) -> SimpleNamespace:
        assert identifiers is not None
        assert number == ("vcan0", "vcan1").index(channel)

        def send(frame: Frame) -> bool:
            sent.append((channel, frame))
            return True

        return SimpleNamespace(
            send=send,
            drain=lambda: [RxFrame(frame, False, 0) for frame in waiting[channel]],
            packets=lambda: number,
            reopen=lambda: sent.append((channel, Frame(0, 0, b""))),
            rejected=number + 1,
        )

    monkeypatch.setattr(buses, "Bus", open_one)
    both = buses.open_bus(("vcan0", "vcan1"), wire)
    assert both.send(wire.pack("AccelLevel", 0))
    assert both.send(wire.pack("MOTION_STATE", 0))
    both.reopen()
    assert [channel for channel, _ in sent] == ["vcan1", "vcan0", "vcan0"]
    assert [rx.frame.stamp_ns for rx in both.drain()] == [3, 4, 5]
    assert (both.rejected, both.packets(), both.channel) == (3, 0, "vcan0")
