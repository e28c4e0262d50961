"""The bus that the demo chooses: SocketCAN where each bus of the profile has its interface, else embedded."""

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from vehicle_iface.cli import demo_bus
from vehicle_iface.cli.demo_bus import choose_bus
from vehicle_iface.profile import load_profile


class Interface(NamedTuple):
    name: str
    is_up: bool = True
    mtu: int = 16


@pytest.fixture
def set_interfaces(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., None]:
    """A machine with SocketCAN and just these interfaces, and no right to change them."""
    monkeypatch.setattr(demo_bus, "find_socketcan_error", lambda: "")
    monkeypatch.setattr(demo_bus, "_SYS_NET", tmp_path)
    monkeypatch.setattr("os.geteuid", lambda: 1000)

    def write(*interfaces: Interface) -> None:
        for interface in interfaces:
            (tmp_path / interface.name).mkdir(exist_ok=True)
            (tmp_path / interface.name / "flags").write_text("0x41" if interface.is_up else "0x40")
            (tmp_path / interface.name / "mtu").write_text(str(interface.mtu))

    return write


@pytest.mark.parametrize(
    ("profile", "interfaces", "options"),
    [
        ("reference", [Interface("vcan0")], "--interface socketcan --channel vcan0"),
        ("reference_fd", [Interface("vcan0", mtu=72)], "--interface socketcan --channel vcan0"),
        (
            "agilex_hunter_ins",
            [Interface("vcan0"), Interface("vcan1")],
            "--interface socketcan --channel vehicle=vcan0 --channel ins=vcan1",
        ),
    ],
)
def test_each_bus_of_the_profile_has_a_vcan_interface(
    set_interfaces: Callable[..., None], profile: str, interfaces: list[Interface], options: str
) -> None:
    set_interfaces(*interfaces)
    assert " ".join(choose_bus(load_profile(profile)).options) == options


@pytest.mark.parametrize(
    ("profile", "interfaces", "how"),
    [
        ("reference", [], "sudo ip link add dev vcan0 type vcan && sudo ip link set vcan0 up"),
        ("reference", [Interface("vcan0", is_up=False)], "sudo ip link set vcan0 up"),
        ("reference_fd", [Interface("vcan0")], "sudo ip link set vcan0 down && sudo ip link set vcan0 mtu 72 up"),
        (
            "agilex_hunter_ins",
            [Interface("vcan0")],
            "sudo ip link add dev vcan1 type vcan && sudo ip link set vcan1 up",
        ),
    ],
)
def test_without_the_interfaces_the_bus_is_embedded_and_the_commands_that_make_them_are_shown(
    set_interfaces: Callable[..., None], profile: str, interfaces: list[Interface], how: str
) -> None:
    set_interfaces(*interfaces)
    choice = choose_bus(load_profile(profile))
    assert choice.options == ["--interface", "embedded"]
    assert choice.why.endswith(f"For real CAN frames: {how}")


def test_root_makes_the_missing_interface_and_leaves_the_one_in_use_alone(
    set_interfaces: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    set_interfaces(Interface("vcan0"))
    called = []

    def run_ip(words: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        called.append(" ".join(words))
        if words[-1] == "up":
            set_interfaces(Interface(words[-2]))
        return subprocess.CompletedProcess(words, 0)

    monkeypatch.setattr("os.geteuid", lambda: 0)
    monkeypatch.setattr("subprocess.run", run_ip)
    assert choose_bus(load_profile("agilex_hunter_ins")).channels == {"vehicle": "vcan0", "ins": "vcan1"}
    assert called == ["ip link add dev vcan1 type vcan", "ip link set vcan1 up"]
    called.clear()
    assert choose_bus(load_profile("reference_fd")).channels == {}  # vcan0 carries no FD frames and is in use
    assert called == []
