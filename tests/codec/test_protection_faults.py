"""A protection that profile and DBC disagree about is refused at the start, with all its faults and their places."""

import re
from pathlib import Path

import pytest

from vehicle_iface.codec.dbc_findings import ERROR, WARNING
from vehicle_iface.codec.lint import check_file
from vehicle_iface.errors import ConfigError

from .conftest import Variant
from .small_vehicle import COMMAND, POSE, SUM, load_vehicle, write_vehicle

# ruff: noqa: E501
RULE = """
[protection.brand]
checksum = { signal = "CHECKSUM", kind = "crc8", poly = 0x1D }
counter = { signal = "COUNTER", max_step = 3 }
[protection.messages]
CMD = "brand"
POSE = "sum"
"""
DATA_ID = 'CMD = { use = "brand", data_id = 0x1F8 }'
CHECKSUM = 'kind = "crc8", poly = 0x1D'
FAULTS = [
    ('CMD = "brand"', 'CMD = "brnd"', r"\$\.protection\.messages\.CMD: no rule \[protection\.brnd\]; nearest: brand"),
    ("CMD =", "CMDD =", r"\$\.protection\.messages\.CMDD: no message 'CMDD' in v\.dbc; nearest: CMD"),
    ('"CHECKSUM"', '"CHECKSUN"', r"\$\.protection\.brand\.checksum\.signal: no signal 'CHECKSUN' in CMD; nearest: CHECKSUM"),
    ('"COUNTER"', '"ALIVE"', r"\$\.protection\.brand\.counter\.signal: no signal 'ALIVE' in CMD"),
    ('"CHECKSUM"', '"ACC"', r"\$\.protection\.brand\.checksum\.signal: CMD\.ACC is bound to accel_mps2"),
    ('"COUNTER"', '"EN"', r"\$\.protection\.brand\.counter\.signal: CMD\.EN is bound to enable"),
    ('"COUNTER"', '"CHECKSUM"', r"\$\.protection\.brand\.checksum\.signal: CHECKSUM is the counter as well"),
    ("max_step = 3", "max_step = 63", r"\$\.protection\.brand\.counter\.max_step: 63: must be at most 62"),
    (", poly = 0x1D", "", r"\$\.protection\.brand\.checksum: poly is missing; kind 'crc8' needs it"),
    ("poly = 0x1D", "poly = 0x11D", r"\$\.protection\.brand\.checksum\.poly: 0x11d: must be at most 0xff, crc8 has 8 bits"),
    ("poly = 0x1D", "poly = 1, init = 256", r"\$\.protection\.brand\.checksum\.init: 0x100: must be at most 0xff"),
    (CHECKSUM, 'kind = "sum", xor_out = 256', r"\$\.protection\.brand\.checksum\.xor_out: 0x100: must be at most 0xff, CMD\.CHECKSUM has 8 bits"),
    (CHECKSUM, 'kind = "crc16", poly = 1', r"v\.dbc:\d+: CMD\.CHECKSUM: 8 bits; kind 'crc16' needs 16"),
    (CHECKSUM, 'kind = "sum", poly = 1', r"\$\.protection\.brand\.checksum\.poly: is not a key of kind 'sum', which has over, init, xor_out, table only"),
    (CHECKSUM, 'kind = "autosar-5", init = 1', r"\$\.protection\.brand\.checksum\.init: is not a key of kind 'autosar-5', which has no further keys"),
    (CHECKSUM, 'kind = "python"', r"\$\.protection\.brand\.checksum: function is missing; kind 'python' needs it"),
    (CHECKSUM, 'kind = "python", function = "own:f"', r"\$\.protection\.brand\.checksum\.function: 'own:f': must be FILE\.py:FUNCTION"),
    (CHECKSUM, 'kind = "sum", over = ["bytes", "id", "bytes"]', r"\$\.protection\.brand\.checksum\.over: \['bytes', 'id', 'bytes'\]: each part at most once"),
    (CHECKSUM, 'kind = "sum", over = ["bytes", "data_id"]', r"\$\.protection\.messages\.CMD: no data_id; the checksum covers one"),
    (CHECKSUM, 'kind = "sum", table = [1, 2, 3]', r"\$\.protection\.messages\.CMD: data id of 3 bytes; must be 1 or 64, one for each value of the counter"),
    (CHECKSUM, 'kind = "autosar-1"', r"\$\.protection\.messages\.CMD: no data_id; E2E profile 1 needs one"),
    ("POSE = ", 'STATUS = "empty"\nPOSE = ', r"\$\.protection\.messages\.STATUS: no rule \[protection\.empty\]"),
    ("[protection.messages]", "[protection.empty]\n[protection.messages]", r"\$\.protection\.empty: must have a checksum or a counter"),
    (RULE, SUM + '[protection.messages]\nPOSE = { use = "sum", data_id = [1, 2] }\n', r"\$\.protection\.messages\.POSE: data id of 2 bytes; must be 1, without a counter"),
    (RULE, SUM.replace('"sum" }', '"sum", over = ["counter"] }') + "[protection.messages]\n", r"\$\.protection\.sum\.checksum: there is no counter; name its signal under counter"),
    ("[protection.brand]", '[e2e]\nprofile = 1\ndata_ids = { "CMD" = 1 }\n[protection.brand]', r"\$\.protection\.messages\.CMD: CMD is in \$\.e2e\.data_ids as well; must have one protection"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "text"), FAULTS, ids=[text for *_, text in FAULTS])
def test_a_rule_that_does_not_fit_is_refused(tmp_path: Path, old: str, new: str, text: str) -> None:
    protection = SUM + RULE if old != RULE else RULE
    assert old in protection
    with pytest.raises(ConfigError, match=text):
        load_vehicle(tmp_path, protection.replace(old, new))


DBC_FAULTS = [
    ("CHECKSUM : 63|8@0+", "CHECKSUM : 63|7@0+", r"CMD\.CHECKSUM: 7 bits; kind 'crc8' needs 8"),
    ("COUNTER : 6|6@0+ (1,0) [0|63]", "COUNTER : 6|1@0+ (1,0) [0|1]", r"CMD\.COUNTER: 2 values: a counter needs 3 at least; leave \$\.protection\.brand\.counter out"),
    ("COUNTER : 6|6@0+ (1,0) [0|63]", "COUNTER : 6|2@0+ (1,0) [0|3]", r"\$\.protection\.brand\.counter\.max_step: 3: must be at most 2"),
    ("COUNTER : 6|6@0+ (1,0) [0|63]", "COUNTER : 6|6@0+ (1,0) [1|63]", r"CMD\.COUNTER: range from 1: a counter must begin at 0"),
    (" CHECKSUM : 63|8@0+", " CHECKSUM m1 : 63|8@0+", r"CMD\.CHECKSUM: is multiplexed; \$\.protection\.brand\.checksum\.signal needs a signal of every frame"),
    (" COUNTER : 6|6", " COUNTER M : 6|6", r"CMD\.COUNTER: is multiplexed"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "text"), DBC_FAULTS, ids=[new for _, new, _ in DBC_FAULTS])
def test_a_signal_that_cannot_protect_is_refused_with_its_line(tmp_path: Path, old: str, new: str, text: str) -> None:
    assert old in COMMAND
    command = COMMAND.replace(old, new)
    if " m1 :" in new:
        command += ' SG_ KIND M : 47|2@0+ (1,0) [0|3] "" CAR\n'
    with pytest.raises(ConfigError, match=text):
        load_vehicle(tmp_path, SUM + RULE, command=command)


def test_a_float_cannot_protect(tmp_path: Path) -> None:
    command = COMMAND.replace("CHECKSUM : 63|8@0+", "CHECKSUM : 39|32@0-")
    path = write_vehicle(tmp_path, SUM + RULE, command=command)
    dbc = path.with_suffix(".dbc")
    dbc.write_text(dbc.read_text("utf-8") + "SIG_VALTYPE_ 401 CHECKSUM : 1;\n", encoding="utf-8")
    found = [str(finding) for finding in check_file(path) if finding.severity == ERROR]
    text = r"v\.dbc:\d+: error: CMD\.CHECKSUM: is a float; \$\.protection\.brand\.checksum\.signal needs an integer"
    assert any(re.search(text, line) for line in found), found


def test_all_faults_of_the_protection_are_reported_at_once(tmp_path: Path) -> None:
    protection = SUM + RULE.replace("poly = 0x1D", "poly = 0x11D").replace("max_step = 3", "max_step = 63")
    protection = protection.replace('POSE = "sum"', 'POSE = "summ"\nNONE = "sum"')
    with pytest.raises(ConfigError) as refused:
        load_vehicle(tmp_path, protection, pose=POSE.replace("SUM", "S"), ignored=("POSE.S",))
    assert str(refused.value).splitlines() == [
        "v.toml: $.protection.brand.checksum.poly: 0x11d: must be at most 0xff, crc8 has 8 bits",
        "v.toml: $.protection.messages.POSE: no rule [protection.summ]; nearest: sum",
        "v.toml: $.protection.messages.NONE: no message 'NONE' in v.dbc; nearest: POSE",
        "v.toml: $.protection.brand.counter.max_step: 63: must be at most 62",
    ]


def test_each_wrong_key_of_a_rule_is_reported_with_its_line(tmp_path: Path) -> None:
    protection = SUM + RULE.replace('"crc8"', '"crc7"').replace("max_step = 3", "max_stap = 3")
    path = write_vehicle(tmp_path, protection.replace('POSE = "sum"', "POSE = { use = 'sum', data_id = 65536 }"))
    lines = path.read_text("utf-8").splitlines()
    found = {(finding.line, finding.text) for finding in check_file(path) if finding.severity == ERROR}
    assert {(lines[line - 1].partition(" ")[0], text) for line, text in found if "protection" in text} == {
        (
            "checksum",
            "$.protection.brand.checksum.kind: Invalid enum value 'crc7'; must be one of: autosar-1, autosar-2, "
            "autosar-5, autosar-11, sum, xor, crc8, crc16, python; nearest: crc8",
        ),
        ("counter", "$.protection.brand.counter.max_stap: unknown key; did you mean 'max_step'?"),
        ("POSE", "$.protection.messages.POSE.data_id: Expected int <= 65535, not 65536"),
    }


def test_the_check_explains_a_missing_part(tmp_path: Path) -> None:
    protection = SUM + RULE.replace('checksum = { signal = "CHECKSUM", kind = "crc8", poly = 0x1D }', "")
    command = "\n".join(line for line in COMMAND.splitlines() if "CHECKSUM" not in line) + "\n"
    findings = check_file(write_vehicle(tmp_path, protection, command=command))
    assert {finding.severity for finding in findings} == {WARNING}
    gaps = [finding.text for finding in findings if "not detected" in finding.text]
    assert gaps == [
        "POSE: a checksum but no counter: repeated and lost frames are not detected",
        "CMD: a counter but no checksum: damaged frames are not detected",
    ]


def test_the_parts_of_a_sample_need_counters(variant: Variant) -> None:
    toml = (
        ("[e2e]", "[protection.alive]\nchecksum = { signal = 'CRC', kind = 'crc8', poly = 0x1D }\n[e2e]"),
        ("[e2e.data_ids]", "[protection.messages]\nPOSE = 'alive'\n[e2e.data_ids]"),
        ("\nPOSE = 0x110", ""),
    )
    with pytest.raises(
        ConfigError, match=r"\$\.protection\.messages\.POSE: missing; the other parts of the sample have one"
    ):
        variant(toml=toml)


def test_the_reference_vehicle_written_by_parts_is_protected_in_the_same_way(variant: Variant) -> None:
    parts = """
[protection.e2e]
checksum = { signal = "CRC", kind = "crc8", poly = 0x1D, over = ["data_id", "bytes"] }
counter = { signal = "COUNTER" }
[protection.messages]
"""
    text = (Path(__file__).parents[2] / "dbc/reference.toml").read_text(encoding="utf-8")
    whole = text[text.index("[e2e]") : text.index("[state]")]
    ids = re.findall(r"^(\w+) = (0x\d+)$", whole, re.MULTILINE)
    lines = "".join(f'{name} = {{ use = "e2e", data_id = {number} }}\n' for name, number in ids)
    ours = variant(toml=((whole, f"{parts}{lines}\n"),))
    usual = variant()
    assert len(ids) == 8
    for one, other in zip((*ours.received, *ours.sent), (*usual.received, *usual.sent), strict=True):
        assert one.protection is not None
        assert other.protection is not None
        assert (one.protection.counter_states, one.protection.max_step) == (15, 3)
        for counter in range(15):
            data, same = bytearray(range(8)), bytearray(range(8))
            one.protection.protect(data, counter)
            other.protection.protect(same, counter)
            assert data == same
