"""A real bus is commanded only by a reviewed profile and up to a speed that was said."""

import json
from datetime import date
from pathlib import Path
from typing import Any

import msgspec
import pytest

from vehicle_iface import arming
from vehicle_iface.arming import is_virtual, report_review, require_reviewed_profile
from vehicle_iface.cli import main, run
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile
from vehicle_iface.profile.review_edit import write_review
from vehicle_iface.profile.review_record import ReviewRecord, hash_file, hash_values

NEW = load_profile("reference")
REVIEWED = msgspec.structs.replace(NEW, reviewed=True)
REAL: dict[str, Any] = {"interface": "socketcan", "channel": "can0"}


@pytest.mark.parametrize("cap_mps", [None, 1.0])
def test_an_unreviewed_profile_does_not_arm_on_a_real_bus(cap_mps: float | None) -> None:
    with pytest.raises(ConfigError, match=r"can0 is a real bus and reference is not reviewed: .*reviewed = true"):
        require_reviewed_profile(NEW, **REAL, speed_cap_mps=cap_mps)


def test_a_real_bus_requires_a_speed_cap_and_the_error_names_the_option() -> None:
    with pytest.raises(ConfigError, match=r"can0 is a real bus: .*--speed-cap 1.0 \(m/s; the profile allows 20.0\)"):
        require_reviewed_profile(REVIEWED, **REAL, speed_cap_mps=None)


def test_the_cap_lowers_the_greatest_speed_and_never_raises_it() -> None:
    assert require_reviewed_profile(REVIEWED, **REAL, speed_cap_mps=1.5).limits.speed_max_mps == 1.5
    assert require_reviewed_profile(REVIEWED, **REAL, speed_cap_mps=50.0).limits.speed_max_mps == 20.0
    assert (
        require_reviewed_profile(NEW, interface="embedded", channel="vcan0", speed_cap_mps=2.0).limits.speed_max_mps
        == 2.0
    )
    assert require_reviewed_profile(NEW, interface="embedded", channel="vcan0", speed_cap_mps=None) is NEW


@pytest.mark.parametrize(
    ("interface", "channel", "expected"),
    [
        ("embedded", "vcan0", True),
        ("virtual", "x", True),
        ("pcan", "PCAN_USBBUS1", False),
        ("vector", "0", False),
        ("socketcan", "can0", False),
        ("socketcan", "lo", False),
    ],
)
def test_an_unknown_bus_counts_as_real(interface: str, channel: str, expected: bool) -> None:
    assert is_virtual(interface, channel) is expected


def test_an_interface_with_hardware_behind_it_is_real_whatever_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "exists", lambda self: str(self) == "/sys/class/net/vcan0/device")
    assert not is_virtual("socketcan", "vcan0")


def test_the_command_refuses_before_it_opens_the_bus(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arming, "is_virtual", lambda *_: False)
    assert main(["run", "--channel", "can0", "--route", "circle", "--arm"]) == 2
    assert "not reviewed" in capsys.readouterr().err


def reviewed_copy(folder: Path) -> Path:
    """The reference profile in a folder of its own, with the record of a walk."""
    for name in ("reference.toml", "reference.dbc"):
        (folder / name).write_bytes((Path(NEW.dbc).parent / name).read_bytes())
    profile, dbc = folder / "reference.toml", folder / "reference.dbc"
    record = ReviewRecord(
        date=date(2026, 11, 30),
        checks=("turn the wheel left", "press the brake"),
        log="walk.log",
        log_sha256="0123456789ab" + "c" * 52,
        profile_sha256=hash_values(profile.read_text(encoding="utf-8")),
        dbc_sha256=hash_file(dbc),
    )
    write_review(profile, record)
    return profile


def drive_briefly(folder: Path, profile: Path) -> str:
    """What an armed run on a bus that counts as real says about the review in its summary."""
    summary = folder / "summary.json"
    where = ["--interface", "embedded", "--telemetry", str(folder / "telemetry"), "--summary", str(summary)]
    drive = ["--profile", str(profile), "--route", "line", "--arm", "--speed-cap", "1", "--duration", "0.1"]
    assert main(["run", *where, *drive]) == 0
    return str(json.loads(summary.read_text())["review"])


def test_an_armed_run_on_a_real_bus_shows_the_record_of_the_review_and_what_has_changed_since(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for place in (arming, run):
        monkeypatch.setattr(place, "is_virtual", lambda *_: False)
    profile = reviewed_copy(tmp_path)
    text = "2026-11-30, 2 checks (walk.log, SHA-256 0123456789ab…)"
    assert drive_briefly(tmp_path, profile) == text
    shown = capsys.readouterr()
    assert f"review of reference: {text}" in shown.err
    assert "review it again" not in shown.err
    assert text in shown.out
    profile.write_text(profile.read_text(encoding="utf-8").replace("wheelbase_m = 2.7", "wheelbase_m = 2.6"))
    assert drive_briefly(tmp_path, profile) == f"{text}; changed since: reference.toml"
    warning = (
        "WARNING reference.toml: not as it was when it was reviewed; review it again with vehicle-iface commission"
    )
    assert warning in capsys.readouterr().err


def test_a_review_by_hand_is_named_as_one() -> None:
    assert report_review(REVIEWED).text == "reviewed = true, without a record of a walk"
