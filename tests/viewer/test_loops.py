"""Without an address the page is that of the one loop that runs, and several are listed."""

import os
from contextlib import ExitStack
from pathlib import Path

import pytest

from vehicle_iface import clock
from vehicle_iface.errors import ConfigError
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryWriter, address
from vehicle_iface.telemetry.running import find_running_loops
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.__main__ import main
from vehicle_iface_viewer.loops import choose_loop


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only folder of named telemetry."""
    monkeypatch.setattr(address, "telemetry_folders", lambda: [tmp_path])
    return tmp_path


def write(name: str, channel: str = "vcan0", profile: str = "reference") -> TelemetryWriter:
    return TelemetryWriter(
        name, SessionInfo(channel=channel, bus=f"SocketCAN {channel}", profile=profile, pid=os.getpid())
    )


def test_without_a_loop_the_default_one_is_waited_for(folder: Path) -> None:
    assert choose_loop() == "default"
    with write("ended"):
        pass
    (folder / f"vehicle-iface-{os.getuid()}-garbage").write_bytes(b"\0" * 100)
    (folder / f"vehicle-iface-{os.getuid()}-no name").write_bytes(b"")
    assert find_running_loops() == []
    assert choose_loop() == "default"


def test_the_only_loop_is_chosen_whatever_its_name() -> None:
    with write("demo-8080"):
        assert choose_loop() == "demo-8080"


def test_several_are_listed_and_none_is_chosen(capsys: pytest.CaptureFixture[str]) -> None:
    with ExitStack() as both:
        first, _ = both.enter_context(write("default")), both.enter_context(write("truck", "can\n1", "fs_ai"))
        first.publish(Snapshot(clock.monotonic_ns() - 3 * NS_PER_S, 3, 0))
        with pytest.raises(ConfigError) as error:
            choose_loop()
        assert main([]) == 2
        assert main(["--list"]) == 0
    assert str(error.value).startswith("2 loops are running; choose one with --connect ADDRESS\n")
    table = [line.split() for line in str(error.value).splitlines()[1:]]
    assert table[0] == ["ADDRESS", "PID", "PROFILE", "CHANNEL", "STATE", "LAST", "DATA"]
    assert table[1][:5] == ["default", str(os.getpid()), "reference", "vcan0", "ENGAGED"]
    assert 3.0 <= float(table[1][5]) < 60.0
    assert table[2] == ["truck", str(os.getpid()), "fs_ai", "can?1", "-", "none", "yet"]
    printed = capsys.readouterr()
    assert "2 loops are running" in printed.err
    assert "truck" in printed.out


def test_a_machine_without_a_loop_has_an_empty_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    assert capsys.readouterr().out == "viewer: no loop is running\n"
