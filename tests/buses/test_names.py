"""Profiles with several buses: which message a name means, and what is said where that is not clear."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from tests.buses.two_buses import BUSES, CAR, load_vehicle, write_vehicle
from vehicle_iface.codec.database import J1939_PGN, find_masked, load_database
from vehicle_iface.codec.decoder import Decoder, DropCause
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.codec.lint import check_file
from vehicle_iface.errors import ConfigError
from vehicle_iface.frame import CanFrame, FrameKey
from vehicle_iface.profile import inspect_profile, load_profile
from vehicle_iface.profile.bus_names import rename_messages

EVERYWHERE = """
name = "everywhere"
dbc = "v.dbc"
ignored = ["A.S"]
[signals."A.S"]
unit = "m"
[messages.A]
cycle_ms = 10
[constants]
"A.S" = 1.0
[e2e]
profile = 1
data_ids = { A = 1 }
[protection.sum]
counter = { signal = "S" }
[protection.messages]
A = "sum"
[state]
sample = ["A"]
trigger = "A"
max_age_s = { A = 0.1 }
[state.pose]
valid = { any = ["A.S", { signal = "A.S", in = ["A.S", 1] }] }
[state.signals]
x_m = { mean = ["A.S"] }
y_m = { sum = ["A.S"] }
heading_rad = { value = "A.S", negative_if = { not = { all = ["A.S"] } } }
speed_mps = "A.S"
[status.when]
manual = { signal = "A.S", equals = "A.S" }
[status.driver]
brake = "A.S"
[status.signals]
gear = "A.S"
[command.signals]
enable = ["A.S"]
[command.periods]
A = 0.1
[command.values]
"A.S" = { echo = "A.S" }
[body.signals]
horn = "A.S"
[report.signals]
state = "A.S"
[[send]]
message = "A"
when = "armed"
once = true
values = { "A.S" = { echo = "A.S" }, OTHER = { complement = "A.S" } }
"""
"""Each place that names a message; those of [[send]] and of values are signals of its own message, or values."""


def test_the_messages_of_all_buses_are_bound_each_to_its_own(tmp_path: Path) -> None:
    database = load_vehicle(tmp_path)
    keys = {message.name: message.key for message in (*database.received, *database.sent)}
    assert keys == {
        "INS_POS": FrameKey(1537, bus=1),
        "INS_ATT": FrameKey(1543, bus=1),
        "WHEELS": FrameKey(272),
        "vehicle:STATUS": FrameKey(256),
        "ins:STATUS": FrameKey(256, bus=1),
        "CMD": FrameKey(128),
    }
    assert {message.dbc_name for message in (*database.received, *database.sent)} == {
        *("INS_POS", "INS_ATT", "WHEELS", "STATUS", "CMD"),
    }


def test_a_name_of_one_bus_may_have_it_in_front(tmp_path: Path) -> None:
    edits = {'"INS_POS"': '"ins:INS_POS"', '"INS_POS.E"': '"ins:INS_POS.E"', "{ INS_ATT": '{ "ins:INS_ATT"'}
    assert load_vehicle(tmp_path, edits).profile == load_vehicle(tmp_path).profile


def test_the_same_identifier_on_another_bus_is_another_message(tmp_path: Path) -> None:
    database = load_vehicle(tmp_path)
    decoder = Decoder(database.received)
    status, fix = decoder.decode(CanFrame(256, b"\x0a\x07")), decoder.decode(CanFrame(256, b"\x03", bus=1))
    assert status is not None
    assert fix is not None
    assert (status.name, status.values) == ("vehicle:STATUS", (2, 1, 7))
    assert (fix.name, fix.values) == ("ins:STATUS", (3,))
    assert decoder.decode(CanFrame(256, b"\x0a\x07", bus=1)) is None
    assert decoder.decode(CanFrame(272, bytes(4), bus=1)) is None
    assert decoder.drops == {(DropCause.WRONG_LENGTH, "ins:STATUS"): 1, (DropCause.UNKNOWN_ID, ""): 1}
    assert decoder.seen[FrameKey(256)] == 1
    assert decoder.seen[FrameKey(256, bus=1)] == 2


def test_a_message_known_by_a_part_of_its_identifier_is_known_on_its_bus_only(tmp_path: Path) -> None:
    position = next(message for message in load_vehicle(tmp_path).sample if message.name == "INS_POS")
    decoder = Decoder([replace(position, can_id=0x18FEF121, is_extended=True, id_mask=J1939_PGN)])
    other_priority = CanFrame(0x0CFEF121, bytes(8), is_extended=True, bus=1)
    assert decoder.decode(other_priority) is not None
    assert decoder.decode(other_priority._replace(bus=0)) is None
    masked = (replace(position, can_id=0x18FEF121, is_extended=True, id_mask=J1939_PGN),)
    assert masked[0].is_masked
    assert not position.is_masked
    assert find_masked(masked, 0x0CFEF133, bus=1) is masked[0]
    assert find_masked(masked, 0x0CFEF221, bus=1) is None


def test_a_frame_is_encoded_for_the_bus_of_its_message(tmp_path: Path) -> None:
    database = load_vehicle(tmp_path, {'"vehicle:STATUS.ALIVE" }': '"vehicle:STATUS.ALIVE" }\n' + HELLO})
    encoder = Encoder(database.sent)
    assert encoder.encode("INS_POS_AID", None).bus == 1
    assert encoder.encode_values("CMD", (0, 0, 0.0, 0.0)).bus == 0


HELLO = '[[send]]\nmessage = "INS_POS_AID"\nwhen = "armed"\nonce = true\n'


@pytest.mark.parametrize(
    ("edits", "fault"),
    [
        (
            {'"vehicle:STATUS.MODE"': '"STATUS.MODE"'},
            r"v\.toml: \$\.status\.signals\.mode: STATUS is on the buses vehicle and ins; "
            r"write vehicle:STATUS or ins:STATUS",
        ),
        (
            {'"INS_POS.E"': '"vehicle:INS_POS.E"'},
            r"v\.toml: \$\.state\.signals\.x_m: INS_POS is not on the bus vehicle, but on ins",
        ),
        (
            {'"INS_POS.E"': '"imu:INS_POS.E"'},
            r"v\.toml: \$\.state\.signals\.x_m: imu:INS_POS: no bus 'imu'; must be one of: vehicle, ins",
        ),
        (
            {'"INS_POS.E"': '"ins:INS_POSE.E"'},
            r"v\.toml: \$\.state\.signals\.x_m: no message 'ins:INS_POSE' in ins\.dbc; nearest: INS_POS",
        ),
        (
            {'"INS_POS.E"': '"INS_POSE.E"'},
            r"v\.toml: \$\.state\.signals\.x_m: no message 'INS_POSE' in car\.dbc or ins\.dbc; nearest: INS_POS",
        ),
        (
            {"{ INS_ATT = 0.03": '{ "ins:INS_ATT" = 0.03, INS_ATT = 0.03'},
            r"v\.toml: \$\.state\.max_age_s\.INS_ATT: is there as ins:INS_ATT as well; remove one of them",
        ),
        (
            {'"CMD.ECHO" =': '"vehicle:CMD.ECHO" =', "constants = {}": 'constants = { "CMD.ECHO" = 2.0 }'},
            r"v\.toml: \$\.constants\.CMD\.ECHO: \$\.command\.values has it as well",
        ),
        (
            {"reviewed =": 'dbc = "car.dbc"\nreviewed ='},
            r"v\.toml: \$\.dbc: is of the short form for one bus, and \[buses\] names the buses; keep one of them",
        ),
        ({BUSES: "[bus]\nbitrate = 500000\n" + BUSES}, r"v\.toml: \$\.bus: is of the short form for one bus"),
        ({BUSES: "[buses]\n"}, r"v\.toml: \$\.buses: must have at least one table \[buses\.NAME\]"),
        ({"[buses.ins]": "[buses.i-s]"}, r"v\.toml: \$\.buses\.i-s: 'i-s': must be a name of letters, digits and"),
        ({'dbc = "ins.dbc"\n': ""}, r"v\.toml: \$\.buses\.ins: dbc is missing"),
        ({"bitrate = 1000000\n": ""}, r"v\.toml: \$\.buses\.ins: bitrate is missing"),
        ({"[buses.vehicle]\n": "[bus]\n"}, r"v\.toml: \$\.bus\.dbc: unknown key"),
        ({BUSES: ""}, r"v\.toml: \$: dbc is missing\nv\.toml: \$: bus is missing"),
        ({'"ins.dbc"': '"nowhere.dbc"'}, r".*/nowhere\.dbc: cannot be read"),
        ({'"ins.dbc"': '"i\\u0000s.dbc"'}, r"v\.toml: \$\.buses\.ins\.dbc: 'i\\x00s\.dbc': must be a file's name"),
    ],
)
def test_a_faulty_table_of_buses_is_rejected_with_its_place(
    tmp_path: Path, edits: Mapping[str, str], fault: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        load_vehicle(tmp_path, edits)
    assert re.search(f"^{fault}", str(refused.value), re.MULTILINE), refused.value


def test_an_ambiguous_name_is_one_fault_with_its_line(tmp_path: Path) -> None:
    path = write_vehicle(tmp_path, {'"vehicle:STATUS.MODE"': '"STATUS.MODE"'})
    (error,) = [finding for finding in check_file(path) if finding.severity == "error"]
    assert path.read_text(encoding="utf-8").splitlines()[error.line - 1] == 'mode = "STATUS.MODE"'


def test_a_fault_of_a_dbc_is_reported_with_its_own_file_and_line(tmp_path: Path) -> None:
    path = write_vehicle(tmp_path)
    (tmp_path / "car.dbc").write_text(CAR.replace("ACC : 16|16", "ACC : 31|16"), encoding="utf-8")
    errors = {(Path(finding.file).name, finding.line) for finding in check_file(path) if finding.severity == "error"}
    assert errors == {("car.dbc", 7)}
    with pytest.raises(ConfigError, match=r"^car\.dbc:7: CMD\.STEER: overlapping"):
        load_database(load_profile(path))


def test_two_buses_may_have_the_same_dbc(tmp_path: Path) -> None:
    more = BUSES + '[buses.spare]\ndbc = "ins.dbc"\nbitrate = 1000000\n'
    edits = {BUSES: more, '"INS_POS", "INS_ATT"': '"ins:INS_POS", "spare:INS_ATT"', "{ INS_ATT": '{ "spare:INS_ATT"'}
    edits |= {'"INS_POS.': '"ins:INS_POS.', '"INS_ATT.': '"spare:INS_ATT.'}
    database = load_vehicle(tmp_path, edits)
    assert [message.key.bus for message in database.sample] == [1, 2, 0]


def test_one_bus_may_have_a_name(tmp_path: Path) -> None:
    write_vehicle(tmp_path)
    text = (tmp_path / "v.toml").read_text(encoding="utf-8")
    text = text.replace(BUSES[BUSES.index("[buses.ins]") :], "").replace('"ins:STATUS.FIX"', '"vehicle:STATUS.BRAKE"')
    (tmp_path / "v.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"no message 'INS_POS' in car\.dbc"):
        load_database(load_profile(tmp_path / "v.toml"))


def test_a_bus_without_a_name_is_not_named(tmp_path: Path) -> None:
    write_vehicle(tmp_path)
    text = (tmp_path / "v.toml").read_text(encoding="utf-8").replace(BUSES, "[bus]\nbitrate = 500000\n")
    (tmp_path / "v.toml").write_text(f'dbc = "car.dbc"\n{text}', encoding="utf-8")
    faults = inspect_profile(tmp_path / "v.toml").faults
    wanted = "vehicle:STATUS: the only bus has no name; write STATUS, or name it with [buses.vehicle]"
    assert f"$.status.signals.mode: {wanted}" in faults


def test_every_place_of_a_profile_that_names_a_message_is_known(tmp_path: Path) -> None:
    reference = (Path(__file__).parents[2] / "dbc/reference.toml").read_text(encoding="utf-8")
    head = reference[reference.index("[geometry]") : reference.index("[e2e]")]
    path = tmp_path / "v.toml"
    top, _, tables = EVERYWHERE.partition("[signals")
    path.write_text(f"{top}{head}[signals{tables}", encoding="utf-8")
    profile = inspect_profile(path).profile
    assert profile is not None
    places: set[str] = set()

    def note(place: str, name: str) -> str:
        places.add(place)
        return f"bus:{name}"

    renamed = rename_messages(profile, note)
    assert renamed.faults == []
    text = str(renamed.profile)
    left = re.findall(r"(?<!bus:)\bA(?:\.S)?'", text)
    assert left == ["A.S'"] * 4  # values of conditions, and signals of the message's own
