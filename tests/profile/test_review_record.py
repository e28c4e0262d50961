"""The record of a review: written into a profile's text without touching the rest, and compared with what is there."""

import tomllib
from collections.abc import Callable
from datetime import date
from pathlib import Path

import msgspec
import pytest

from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import inspect_profile, load_profile
from vehicle_iface.profile.review_edit import insert_review, require_editable, write_review
from vehicle_iface.profile.review_record import (
    ReviewRecord,
    find_changes,
    hash_checksums,
    hash_file,
    hash_files,
    hash_values,
)

DBC = Path(__file__).resolve().parents[2] / "dbc"
REFERENCE = (DBC / "reference.toml").read_text(encoding="utf-8")
LINE = "reviewed = false               # true once limits and signs have been checked against the real vehicle"
OTHERS = [line for line in REFERENCE.splitlines() if line != LINE]


def record(**changes: object) -> ReviewRecord:
    values: dict[str, object] = {
        "date": date(2026, 11, 30),
        "checks": ("turn the wheel left", 'say "ä"'),
        "log": "walk.log",
        "log_sha256": "a" * 64,
        "profile_sha256": hash_values(REFERENCE),
        "dbc_sha256": hash_file(DBC / "reference.dbc"),
    }
    return ReviewRecord(**values | changes)  # type: ignore[arg-type]


@pytest.fixture
def profile(tmp_path: Path) -> Path:
    """A profile of one's own."""
    for name in ("reference.toml", "reference.dbc"):
        (tmp_path / name).write_bytes((DBC / name).read_bytes())
    return tmp_path / "reference.toml"


def test_a_record_that_was_written_is_read_back_and_every_other_line_stays(profile: Path) -> None:
    write_review(profile, record())
    lines = profile.read_text(encoding="utf-8").splitlines()
    assert lines[: len(OTHERS) + 1] == [
        line if line != LINE else LINE.replace("false", "true", 1) for line in REFERENCE.splitlines()
    ]
    assert lines[len(OTHERS) + 1] == ""
    assert lines[len(OTHERS) + 2].startswith("[review]")
    read = load_profile(profile)
    assert read.reviewed
    assert read.review == record()


@pytest.mark.parametrize(
    ("edit", "place"),
    [
        (lambda text: text.replace(LINE, "reviewed = true"), "reviewed = true"),
        (lambda text: text.replace(LINE, "  reviewed=false#x"), "  reviewed=true#x"),
        (lambda text: text.replace(LINE + "\n", ""), "reviewed = true"),
        (lambda text: text.replace(LINE + "\n", "").replace("dbc = ", "'dbc' = "), "reviewed = true"),
        (lambda text: text.replace("\n", "\r\n"), LINE.replace("false", "true", 1)),
        (lambda text: text.rstrip("\n"), LINE.replace("false", "true", 1)),
    ],
)
def test_the_key_is_set_where_it_is_and_added_where_it_is_missing(edit: Callable[[str], str], place: str) -> None:
    text = edit(REFERENCE)
    edited = insert_review(text, record())
    assert place in edited.splitlines()
    assert set(text.splitlines()) - set(edited.splitlines()) <= {LINE, "  reviewed=false#x"}
    assert edited.count("\r\n") == (edited.count("\n") if "\r\n" in text else 0)
    assert tomllib.loads(edited)["review"]["log"] == "walk.log"


def test_an_earlier_record_is_replaced_and_what_stands_behind_it_stays() -> None:
    once = insert_review(REFERENCE, record())
    behind = once + '\n# a remark on the bus\n[signals."MOTION.SPEED"]\nscale = 1.0   # more\n'
    twice = insert_review(behind, record(log="second.log"))
    assert twice.count("[review]") == 1
    assert tomllib.loads(twice)["review"]["log"] == "second.log"
    assert '\n# a remark on the bus\n[signals."MOTION.SPEED"]\nscale = 1.0   # more\n' in twice
    assert insert_review(once, record()) == once


@pytest.mark.parametrize(
    "text",
    [
        REFERENCE.replace(LINE, f'{LINE}\nreview = {{ log = "x" }}'),
        REFERENCE.replace(LINE, '"reviewed" = false'),
        REFERENCE.replace(LINE, f'{LINE}\nnotes = """\n[review]\n"""'),
    ],
)
def test_a_layout_that_is_not_understood_is_left_alone_and_the_lines_are_shown(profile: Path, text: str) -> None:
    profile.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"by hand:\nreviewed = true\n\[review\]"):
        write_review(profile, record())
    assert profile.read_text(encoding="utf-8") == text


def test_a_profile_of_the_package_is_not_written() -> None:
    with pytest.raises(ConfigError, match="is part of vehicle-iface and not written; copy it and its DBC"):
        require_editable(DBC / "reference.toml")


def test_a_profile_that_is_read_only_is_not_written(profile: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda path, _mode: path != profile)  # root may write whatever the mode is
    with pytest.raises(ConfigError, match="may not be written; copy it"):
        write_review(profile, record())


def test_values_count_and_comments_do_not(profile: Path) -> None:
    dbc = profile.with_suffix(".dbc")
    write_review(profile, record())
    text = profile.read_text(encoding="utf-8")
    profile.write_text(text.replace("# SI units", "# in SI units"), encoding="utf-8")
    assert find_changes(record(), profile=profile, dbcs=[dbc], checksums=[]) == []
    profile.write_text(text.replace('yaw_rate_radps = "MOTION', '# "MOTION'), encoding="utf-8")
    assert find_changes(record(), profile=profile, dbcs=[dbc], checksums=[]) == ["reference.toml"]
    dbc.write_bytes(dbc.read_bytes() + b"\n")
    assert find_changes(record(), profile=profile, dbcs=[dbc], checksums=[]) == ["reference.toml", "reference.dbc"]


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        ('log_sha256 = "12"', "$.review.log_sha256: Expected `str` of length >= 64".replace("`", "")),
        ('date = "yesterday"', "$.review.date: "),
        ("checks = []", "$.review.checks: "),
        ("mileage = 3", "$.review.mileage: unknown key"),
    ],
)
def test_a_record_that_is_none_is_a_fault_with_its_place(profile: Path, lines: str, fault: str) -> None:
    profile.write_text(f"{REFERENCE}\n[review]\n{lines}\n", encoding="utf-8")
    assert any(one.startswith(fault) for one in inspect_profile(profile).faults), inspect_profile(profile).faults


def test_each_of_several_dbcs_counts_and_their_order_does(tmp_path: Path) -> None:
    for name in ("car.dbc", "ins.dbc"):
        (tmp_path / name).write_text(name)
    car, ins = tmp_path / "car.dbc", tmp_path / "ins.dbc"
    (tmp_path / "v.toml").write_text(REFERENCE, encoding="utf-8")
    reviewed = record(dbc_sha256=hash_files([car, ins]))
    assert find_changes(reviewed, profile=tmp_path / "v.toml", dbcs=[car, ins], checksums=[]) == []
    assert find_changes(reviewed, profile=tmp_path / "v.toml", dbcs=[ins, car], checksums=[]) == ["ins.dbc/car.dbc"]
    ins.write_text("another")
    assert find_changes(reviewed, profile=tmp_path / "v.toml", dbcs=[car, ins], checksums=[]) == ["car.dbc/ins.dbc"]


def test_the_python_file_of_a_checksum_counts(tmp_path: Path) -> None:
    for name in ("j1939_truck.toml", "j1939_truck.dbc", "j1939_checksums.py"):
        (tmp_path / name).write_bytes((DBC / name).read_bytes())
    path = tmp_path / "j1939_truck.toml"
    truck = load_profile(path)
    assert truck.checksum_files == [tmp_path / "j1939_checksums.py"]
    without = record(
        profile_sha256=hash_values(path.read_text(encoding="utf-8")), dbc_sha256=hash_files(truck.dbc_files)
    )
    reviewed = msgspec.structs.replace(without, checksums_sha256=hash_checksums(truck.checksum_files))
    write_review(path, reviewed)
    assert load_profile(path).review == reviewed

    def changes(record: ReviewRecord) -> list[str]:
        return find_changes(record, profile=path, dbcs=truck.dbc_files, checksums=truck.checksum_files)

    assert changes(reviewed) == []
    assert changes(without) == ["j1939_checksums.py"]  # written before the file was covered
    (tmp_path / "j1939_checksums.py").write_text("def tsc1(can_id, data): return 0\n")
    assert changes(reviewed) == ["j1939_checksums.py"]
