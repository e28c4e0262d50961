"""The log of two buses is read back, each message on the channel of its own bus."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from tests.buses.two_buses import load_vehicle, write_vehicle
from tests.harness import START_NS, ms
from vehicle_iface import cli
from vehicle_iface.review.series import read_drive
from vehicle_iface.sim.wire import simulated_vehicle

NAMED = {"vehicle": "vehicle", "ins": "ins"}
INTERFACES = {"vehicle": "can0", "ins": "can1"}
CHANNELS = ["--channel", "vehicle=can0", "--channel", "ins=can1"]


def write_log(folder: Path, channels: Mapping[str, str]) -> Path:
    """Half a second of the simulated vehicle, which stands READY, as candump writes it."""
    database = load_vehicle(folder)
    vehicle = simulated_vehicle(database, start_ns=START_NS)
    names, lines = list(channels.values()), []
    for at_ns in range(START_NS, START_NS + ms(500), ms(10)):
        for frame in vehicle.advance(at_ns):
            stamp = f"{at_ns / 1e9:.6f}"
            lines.append(f"({stamp}) {names[frame.bus]} {frame.can_id:03X}#{frame.data.hex().upper()}\n")
    (folder / "drive.log").write_text("".join(lines), encoding="utf-8")
    return folder / "drive.log"


@pytest.mark.parametrize(("channels", "options"), [(INTERFACES, CHANNELS), (NAMED, [])])
def test_both_messages_of_one_identifier_are_decoded(
    tmp_path: Path, channels: Mapping[str, str], options: list[str]
) -> None:
    log, out, profile = write_log(tmp_path, channels), tmp_path / "out.npz", str(tmp_path / "v.toml")
    assert cli.main(["decode", str(log), "--profile", profile, "--out", str(out), *options]) == 0
    with np.load(out) as arrays:
        assert set(arrays["vehicle:STATUS.MODE"]) == {1}
        assert set(arrays["ins:STATUS.FIX"]) == {3}
        assert len(arrays["vehicle:STATUS.MODE"]) > 10
        assert len(arrays["INS_POS.E"]) == 50


def test_a_chosen_message_is_decoded_on_its_bus_only(tmp_path: Path) -> None:
    log, out, profile = write_log(tmp_path, INTERFACES), tmp_path / "out.npz", str(tmp_path / "v.toml")
    options = ["--out", str(out), "--message", "ins:STATUS"]
    assert cli.main(["decode", str(log), "--profile", profile, *options, *CHANNELS]) == 0
    with np.load(out) as arrays:
        assert {name.partition(".")[0].partition(":stamp")[0] for name in arrays if "." in name} == {"ins:STATUS"}


def test_a_drive_on_two_buses_is_reviewed(tmp_path: Path) -> None:
    log = write_log(tmp_path, INTERFACES)
    database = load_vehicle(tmp_path)
    drive = read_drive(log, database.profile, channels=INTERFACES)
    assert set(drive.frames) == {message.name for message in (*database.received, *database.sent)}
    assert len(drive.state["heading_rad"].values) == len(drive.state["speed_mps"].values) == 50
    assert cli.main(["review", str(log), "--profile", str(tmp_path / "v.toml"), *CHANNELS]) in (0, 1)


@pytest.mark.parametrize("command", ["decode --out x.npz", "review"])
def test_a_log_that_calls_the_buses_otherwise_is_refused_with_its_channels(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    name, *options = command.split()
    log, profile = str(write_log(tmp_path, INTERFACES)), str(tmp_path / "v.toml")
    assert cli.main([name, log, "--profile", profile, *options]) == 2
    error = capsys.readouterr().err
    assert "can0" in error
    assert "can1" in error
    assert "--channel" in error
    assert cli.main([name, log, "--profile", profile, *options, "--channel", "can0"]) == 2
    assert f"write vehicle-iface {name} {log} --channel vehicle=can0 --channel ins=can1" in capsys.readouterr().err


def test_two_buses_are_not_on_one_channel(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, same = str(write_log(tmp_path, INTERFACES)), ["--channel", "vehicle=can0", "--channel", "ins=can0"]
    assert cli.main(["review", log, "--profile", str(write_vehicle(tmp_path)), *same]) == 2
    assert "--channel ins=can0: is that of vehicle" in capsys.readouterr().err
