"""What cannot be sent is refused at the start: each value with its place and what is allowed."""

from pathlib import Path

import pytest

from tests.plain_vehicle import COMMAND, SIGNALS, load_vehicle, write_vehicle
from vehicle_iface.codec.lint import check_file
from vehicle_iface.errors import ConfigError

MORE = """\
 SG_ MAGIC : 4|4@1+ (1,0) [0|15] "" CAR
 SG_ STEP : 48|4@1+ (1,0) [1|15] "" CAR
 SG_ WIDE : 52|12@1+ (1,0) [0|4095] "" CAR
 SG_ BIT : 1|1@1+ (1,0) [0|1] "" CAR
 SG_ RANGED : 8|8@1+ (1,0) [0|100] "" CAR

BO_ 112 BEAT: 2 PC
 SG_ KIND M : 0|4@1+ (1,0) [0|15] "" CAR
 SG_ A m1 : 8|4@1+ (1,0) [0|15] "" CAR
 SG_ B m2 : 8|4@1+ (1,0) [0|15] "" CAR
 SG_ COUNT : 12|4@1+ (1,0) [0|15] "" CAR
"""
BEAT = '[[send]]\nmessage = "BEAT"\nwhen = "always"\n'


def values(line: str) -> str:
    return f"[command.values]\n{line}\n"


def beat(line: str, rest: str = "period_s = 0.1\n") -> str:
    return f"{BEAT}{rest}values = {{ {line} }}\n"


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (values('"CMD.MAGIC" = 300'), r"\$\.command\.values\.CMD\.MAGIC: 300\.0: must be in \[0, 15\]"),
        (values('"CMD.MAGIK" = 3'), r"\$\.command\.values\.CMD\.MAGIK: no signal 'MAGIK' in CMD; nearest: MAGIC"),
        (values('"CMB.MAGIC" = 3'), r"\$\.command\.values\.CMB\.MAGIC: no message 'CMB' in v\.dbc; nearest: CMD"),
        (
            values('"POSE.X" = 3'),
            r"\$\.command\.values\.POSE\.X: must be of a command message: CMD; others are a \[\[send",
        ),
        (values('"CMD.ACC" = 3'), r"\$\.command\.values\.CMD\.ACC: CMD\.ACC is bound to accel_mps2"),
        (values('"MAGIC" = 3'), r"\$\.command\.values: 'MAGIC': must be MESSAGE\.SIGNAL"),
        (
            values('"CMD.MAGIC" = "cuont"'),
            r"\$\.command\.values\.CMD\.MAGIC: 'cuont': must be a number, \"count\", or a",
        ),
        (values('"CMD.MAGIC" = { value = 1 }'), r"value and when must stand together"),
        (values('"CMD.MAGIC" = { when = "armed", echo = "STATUS.ALIVE" }'), r"value and when must stand together"),
        (
            values('"CMD.MAGIC" = { value = 1, when = "engage" }'),
            r"MAGIC\.when: 'engage': must be one of: armed, engaging",
        ),
        (values('"CMD.MAGIC" = { value = 16, when = "armed" }'), r"CMD\.MAGIC: 16\.0: must be in \[0, 15\]$"),
        (
            values('"CMD.STEP" = { value = 1, when = "armed" }'),
            r"CMD\.STEP: 0\.0: must be in \[1, 15\]; it is sent while when",
        ),
        (values('"CMD.STEP" = "count"'), r"CMD\.STEP: 0: must be in \[1, 15\]"),
        (values('"CMD.MAGIC" = { echo = "STATUS.ALIVE" }'), r"CMD\.MAGIC: 16: must be in \[0, 15\]"),
        (values('"CMD.RANGED" = { echo = "STATUS.ALIVE" }'), r"CMD\.RANGED: 101: must be in \[0, 100\]"),
        (values('"CMD.MAGIC" = { echo = "STATUS.ALIV" }'), r"no signal 'ALIV' in STATUS; nearest: ALIVE"),
        (values('"CMD.MAGIC" = { echo = "STATE.ALIVE" }'), r"no message 'STATE' in v\.dbc; nearest: STATUS"),
        (values('"CMD.MAGIC" = { echo = "ALIVE" }'), r"MAGIC\.echo: 'ALIVE': must be MESSAGE\.SIGNAL"),
        (values('"CMD.MAGIC" = { echo = "CMD.BIT" }'), r"CMD\.BIT is sent by the program; only a received signal"),
        (values('"CMD.WIDE" = { echo = "POSE.V" }'), r"POSE\.V is in 'm/s', and CMD\.WIDE has no unit"),
        (values('"CMD.MAGIC" = { complement = "WIDE" }'), r"MAGIC has 4 bits and WIDE 12: must be as many"),
        (values('"CMD.MAGIC" = { complement = "WIDTH" }'), r"no signal 'WIDTH' in CMD; nearest: WIDE"),
        (
            values('"CMD.MAGIC" = { complement = "STEP" }\n"CMD.STEP" = { complement = "MAGIC" }'),
            r"CMD\.MAGIC: STEP is a complement itself",
        ),
        (BEAT, r"\$\.send\[0\]: must have one of once = true and period_s"),
        (f"{BEAT}once = true\nperiod_s = 0.1\n", r"\$\.send\[0\]: must have one of once = true and period_s"),
        (
            f"{BEAT}period_s = 0.001\n",
            r"\$\.send\[0\]\.period_s: 0\.001: must be at least \$\.timing\.sample_period_s = 0\.01",
        ),
        (f"{BEAT}period_s = -1.0\n", r"\$\.send\[0\]\.period_s: Expected `?float`? > 0"),
        (f"{BEAT}period = 1.0\n", r"\$\.send\[0\]\.period: unknown key; did you mean 'period_s'"),
        (
            BEAT.replace("always", "ever") + "once = true\n",
            r"\$\.send\[0\]\.when: 'ever': must be one of: .*released, always",
        ),
        (f"{BEAT}once = true\n{BEAT}once = true\n", r"\$\.send\[1\]\.message: BEAT is in \$\.send already"),
        (
            '[[send]]\nmessage = "BEET"\nwhen = "armed"\nonce = true\n',
            r"\$\.send\[0\]\.message: no message 'BEET' in v\.dbc",
        ),
        ('[[send]]\nmessage = "CMD"\nwhen = "armed"\nonce = true\n', r"\$\.send: CMD is a message of command, too"),
        ('[[send]]\nmessage = "POSE"\nwhen = "armed"\nonce = true\n', r"\$\.send: POSE is a message of sample, too"),
        (beat("COUNT = 16"), r"\$\.send\[0\]\.values\.COUNT: 16\.0: must be in \[0, 15\]"),
        (beat("COUNTER = 1"), r"\$\.send\[0\]\.values\.COUNTER: no signal 'COUNTER' in BEAT; nearest: COUNT"),
        (beat("KIND = 1, B = 2"), r"\$\.send\[0\]\.values\.B: BEAT\.B is not in the branch that KIND chooses"),
        (beat('KIND = 1, B = "count"'), r"\$\.send\[0\]\.values\.B: BEAT\.B is not in the branch"),
        (beat('KIND = "count"'), r"\$\.send\[0\]\.values\.KIND: BEAT\.KIND is a multiplexer: must be a number"),
    ],
)
def test_a_message_that_cannot_be_sent_is_refused_with_its_place(tmp_path: Path, more: str, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        load_vehicle(tmp_path, more, command=COMMAND + MORE)


def test_a_constant_of_the_old_spelling_is_checked_as_well_and_stands_in_one_place_only(tmp_path: Path) -> None:
    edits = {"constants = {}": 'constants = { "CMD.MAGIC" = 300 }'}
    with pytest.raises(ConfigError, match=r"\$\.constants\.CMD\.MAGIC: 300\.0: must be in \[0, 15\]"):
        load_vehicle(tmp_path, command=COMMAND + MORE, edits=edits)
    with pytest.raises(ConfigError, match=r"\$\.constants\.CMD\.MAGIC: \$\.command\.values has it as well"):
        load_vehicle(tmp_path, values('"CMD.MAGIC" = 3'), command=COMMAND + MORE, edits=edits)


def test_something_must_enable_the_vehicle(tmp_path: Path) -> None:
    plain = {field: name for field, name in SIGNALS.items() if field != "enable"}
    with pytest.raises(ConfigError, match=r"\$\.command\.signals: enable is missing; .* when = \"engaging\""):
        load_vehicle(tmp_path, f"{BEAT}once = true\n", command=COMMAND + MORE, signals=plain)
    load_vehicle(tmp_path, values('"CMD.EN" = { value = 1, when = "enabled" }'), command=COMMAND, signals=plain)


def test_all_faults_are_reported_at_once_each_with_the_line_of_its_key(tmp_path: Path) -> None:
    more = (
        '[command.values]\n"CMD.MAGIC" = 16\n'
        '[[send]]\nmessage = "BEAT"\nwhen = "armed"\nonce = true\n'
        "[send.values]\nCOUNT = 17\n"
        '[[send]]\nmessage = "BEET"\nwhen = "armed"\nonce = true\n'
    )
    path = write_vehicle(tmp_path, more, command=COMMAND + MORE)
    lines = path.read_text(encoding="utf-8").splitlines()
    found = {(lines[one.line - 1], one.text.partition(":")[0]) for one in check_file(path) if one.severity == "error"}
    assert found == {
        ('"CMD.MAGIC" = 16', "$.command.values.CMD.MAGIC"),
        ("COUNT = 17", "$.send[0].values.COUNT"),
        ('message = "BEET"', "$.send[1].message"),
    }
