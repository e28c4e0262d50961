"""`--channel`: each bus of a profile gets its interface, and every other combination is refused with the command."""

import json
import re
import socket
from collections.abc import Iterator, Sequence
from pathlib import Path
from unittest import mock

import pytest

from tests.buses.two_buses import load_vehicle, write_vehicle
from vehicle_iface import cli, opening
from vehicle_iface.bus import socketcan, traffic_monitor
from vehicle_iface.bus.several import SeveralBuses
from vehicle_iface.cli.channels import find_channels
from vehicle_iface.errors import BusError, BusGoneError, ConfigError
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import Profile, load_profile

RIGHT = r"; write vehicle-iface run --channel vehicle=can0 --channel ins=can1"


@pytest.fixture
def profile(tmp_path: Path) -> Profile:
    return load_profile(write_vehicle(tmp_path))


@pytest.fixture
def with_one_named_bus(tmp_path: Path) -> Profile:
    path = write_vehicle(tmp_path)
    path.write_text(re.sub(r"\[buses\.vehicle\].*?(?=\[buses)", "", path.read_text(), flags=re.DOTALL))
    path.write_text(path.read_text().replace("vehicle:", "ins:"))
    return load_profile(path)


@pytest.mark.parametrize(
    ("given", "found"),
    [([], {"": "vcan0"}), (["can0"], {"": "can0"})],
)
def test_the_only_bus_is_the_channel_that_is_given_or_vcan0(given: Sequence[str], found: dict[str, str]) -> None:
    assert find_channels(given, load_profile("reference"), command="run") == found


@pytest.mark.parametrize("given", ["can7", "ins=can7"])
def test_the_only_bus_may_be_named_where_it_has_a_name(with_one_named_bus: Profile, given: str) -> None:
    assert find_channels([given], with_one_named_bus, command="run") == {"ins": "can7"}


def test_the_channel_of_another_kind_of_interface_is_taken_as_it_is() -> None:
    found = find_channels(["a=b"], load_profile("reference"), command="run", interface="virtual")
    assert found == {"": "a=b"}


def test_the_buses_have_the_profile_s_order_whatever_that_of_the_options_is(profile: Profile) -> None:
    found = find_channels(["ins=can1", "vehicle=can0"], profile, command="run")
    assert list(found.items()) == [("vehicle", "can0"), ("ins", "can1")]


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ([], r"--channel: no channel for vehicle and ins of profile reference" + RIGHT),
        (["vehicle=can0"], r"--channel: no channel for ins of profile reference" + RIGHT),
        (["ins=can1"], r"--channel: no channel for vehicle of profile reference" + RIGHT),
        (["can0"], r"--channel can0: profile reference has the buses vehicle and ins" + RIGHT),
        (["imu=can1"], r"--channel imu=can1: profile reference has no bus imu" + RIGHT),
        (["vehicle=can0", "vehicle=can1"], r"--channel vehicle=can1: vehicle is on can0 already" + RIGHT),
        (["vehicle="], r"--channel vehicle=: the channel's name is missing" + RIGHT),
        (["vehicle=can0", "ins=can0"], r"--channel ins=can0: is that of vehicle; each bus has its own"),
    ],
)
def test_channels_that_do_not_fit_the_buses_are_refused_in_one_line_with_the_right_command(
    profile: Profile, given: Sequence[str], fault: str
) -> None:
    with pytest.raises(ConfigError, match=f"^{fault}$"):
        find_channels(given, profile, command="run")


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        (["vehicle=can0"], "--channel vehicle=can0: profile reference has one bus, without a name; "),
        (["can0", "can1"], "--channel: profile reference has one bus, and 2 channels were given; "),
    ],
)
def test_names_and_several_channels_are_refused_for_one_bus_without_a_name(given: Sequence[str], fault: str) -> None:
    with pytest.raises(ConfigError, match=f"^{fault}write --channel can0$"):
        find_channels(given, load_profile("reference"), command="run")


@pytest.mark.parametrize("command", ["run --route circle", "sim", "doctor"])
def test_every_subcommand_on_a_bus_needs_all_of_them(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = command.split()
    assert cli.main([*words, "--profile", str(write_vehicle(tmp_path)), "--channel", "ins=can1"]) == 2
    assert f"vehicle-iface {words[0]} --channel vehicle=can0 --channel ins=can1" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["run --route circle", "sim"])
def test_several_buses_need_socketcan(tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    where = ["--interface", "virtual", "--channel", "vehicle=a", "--channel", "ins=b"]
    assert cli.main([*command.split(), "--profile", str(write_vehicle(tmp_path)), *where]) == 2
    assert "--interface virtual: profile reference has the buses vehicle and ins" in capsys.readouterr().err


def test_a_vehicle_on_two_buses_drives_on_the_embedded_bus_without_channels(tmp_path: Path) -> None:
    path, summary = write_vehicle(tmp_path), tmp_path / "summary.json"
    options = ["--interface", "embedded", "--route", "circle", "--arm", "--duration", "1.5", "--summary", str(summary)]
    telemetry = ["--telemetry", str(tmp_path / "telemetry")]
    assert cli.main(["run", "--profile", str(path), *options, *telemetry]) == 0
    assert json.loads(summary.read_text())["commands"] > 10


class Sockets:
    """Stands in the place of `open_socket`: AF_UNIX pairs."""

    def __init__(self) -> None:
        self.lacking = ""
        self.far: dict[str, list[socket.socket]] = {}
        self.near: list[socket.socket] = []
        self.can_ids: dict[str, list[list[int]]] = {}

    def open(self, channel: str, can_ids: Sequence[int] | None, **_: object) -> socket.socket:
        if channel == self.lacking:
            raise BusGoneError(f"{channel}: no such CAN interface")
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.near.append(near)
        self.far.setdefault(channel, []).append(far)
        self.can_ids.setdefault(channel, []).append(sorted(can_ids or ()))
        return near


@pytest.fixture
def sockets() -> Iterator[Sockets]:
    made = Sockets()
    yield made
    for one in (*made.near, *(far for ends in made.far.values() for far in ends)):
        one.close()


def open_two(tmp_path: Path, sockets: Sockets) -> SeveralBuses:
    database = load_vehicle(tmp_path)
    with (
        mock.patch.object(socketcan, "open_socket", sockets.open),
        mock.patch.object(traffic_monitor, "open_socket", sockets.open),
    ):
        bus = opening.open_buses(
            "socketcan",
            {"vehicle": "can0", "ins": "can1"},
            database.profile,
            received=(*database.received, *database.sent),
            sent=database.sent,
        )
    assert isinstance(bus, SeveralBuses)
    return bus


def test_each_bus_is_filtered_to_its_own_messages_and_its_frames_bear_its_number(
    tmp_path: Path, sockets: Sockets
) -> None:
    bus = open_two(tmp_path, sockets)
    assert bus.description == "SocketCAN vehicle=can0, ins=can1"
    assert sockets.can_ids == {"can0": [[128, 256, 272], [128], []], "can1": [[256, 1537, 1543], [], []]}
    frame = (256).to_bytes(4, "little") + b"\x01\0\0\0" + b"\x03" + bytes(7)
    for channel in ("can1", "can0"):
        sockets.far[channel][0].send(frame)
    assert sorted(frame.bus for frame in bus.drain()) == [0, 1]
    assert bus.send(CanFrame(128, b"a", bus=0)) == 1
    assert sockets.far["can0"][0].recv(16)[:4] == (128).to_bytes(4, "little")
    sockets.far["can1"][0].close()
    with pytest.raises(BusError, match=r"^bus ins: can1: "):
        bus.send(CanFrame(128, b"a", bus=1))
    bus.close()


def test_a_bus_that_cannot_be_opened_closes_the_others_and_is_named(tmp_path: Path, sockets: Sockets) -> None:
    sockets.lacking = "can1"
    with pytest.raises(BusGoneError, match=r"^bus ins: can1: no such CAN interface$"):
        open_two(tmp_path, sockets)
    assert [one.fileno() for one in sockets.near] == [-1, -1, -1]
