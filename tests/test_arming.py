"""A real bus is commanded only by a reviewed profile and up to a speed that was said."""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from vehicle_iface import arming
from vehicle_iface.arming import is_virtual, require_reviewed_profile
from vehicle_iface.cli import main
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile

NEW = load_profile("reference")
REVIEWED = msgspec.structs.replace(NEW, reviewed=True)
REAL: dict[str, Any] = {"interface": "socketcan", "channel": "can0"}


@pytest.mark.parametrize("cap_mps", [None, 1.0])
def test_a_profile_that_nobody_has_reviewed_commands_no_real_bus(cap_mps: float | None) -> None:
    with pytest.raises(ConfigError, match=r"can0 is a real bus and reference is not reviewed: .*reviewed = true"):
        require_reviewed_profile(NEW, **REAL, speed_cap_mps=cap_mps)


def test_a_real_bus_wants_a_speed_and_is_told_how_to_give_it() -> None:
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
def test_what_cannot_be_told_is_real(interface: str, channel: str, expected: bool) -> None:
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
