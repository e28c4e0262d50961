"""The driver socket: private, polite, and impossible to keep waiting or to fill up."""

import os
import socket
import stat
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from vehicle_iface.errors import ConfigError
from vehicle_iface.sim.driver_socket import LONGEST_LINE, MOST_CLIENTS, DriverSocket, default_path, send_line


@pytest.fixture
def path(tmp_path: Path) -> str:
    return str(tmp_path / "pedals.sock")


@pytest.fixture
def driver(path: str) -> Iterator[DriverSocket]:
    driver = DriverSocket(path)
    yield driver
    driver.close()


class Client(socket.socket):
    """A raw connection for things that `send_line` would not do."""

    def __init__(self, path: str) -> None:
        super().__init__(socket.AF_UNIX, socket.SOCK_STREAM)
        self.settimeout(5.0)
        self.connect(path)


@pytest.fixture
def connect(path: str) -> Iterator[Callable[[], Client]]:
    clients: list[Client] = []

    def connect() -> Client:
        clients.append(Client(path))
        return clients[-1]

    yield connect
    for client in clients:
        client.close()


def echo(line: str) -> str:
    return f"received {line}"


def pressed(driver: DriverSocket, line: str) -> str:
    """What `send_line` gets while the vehicle polls."""
    answers: list[str] = []
    thread = threading.Thread(target=lambda: answers.append(send_line(driver.path, line)))
    thread.start()
    while thread.is_alive():
        driver.poll(echo)
        thread.join(0.001)
    return answers[0]


def test_a_line_pressed_is_a_line_answered(driver: DriverSocket) -> None:
    assert pressed(driver, "brake 1") == "received brake 1"


def test_only_its_own_user_can_reach_it(driver: DriverSocket) -> None:
    assert stat.S_IMODE(os.stat(driver.path).st_mode) == 0o600


def test_the_process_keeps_its_umask(path: str) -> None:
    before = os.umask(0o022)
    try:
        DriverSocket(path).close()
        assert os.umask(0o022) == 0o022
    finally:
        os.umask(before)


def test_it_is_gone_after_close_and_close_may_be_called_twice(path: str) -> None:
    driver = DriverSocket(path)
    driver.close()
    driver.close()
    assert not os.path.exists(path)


def test_close_leaves_a_successors_socket_alone(path: str) -> None:
    old = DriverSocket(path)
    os.rename(path, path + ".moved")
    new = DriverSocket(path)
    old.close()
    assert os.path.exists(path)
    new.close()
    os.unlink(path + ".moved")


def test_a_stale_socket_is_replaced(path: str) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(path)
    driver = DriverSocket(path)
    assert pressed(driver, "x") == "received x"
    driver.close()


def test_a_living_vehicles_socket_is_refused(driver: DriverSocket) -> None:
    with pytest.raises(ConfigError, match="another simulator uses"):
        DriverSocket(driver.path)


def test_anything_else_at_the_path_is_refused_and_untouched(path: str) -> None:
    Path(path).write_text("precious")
    with pytest.raises(ConfigError, match="is not a socket"):
        DriverSocket(path)
    assert Path(path).read_text() == "precious"


def test_a_path_that_cannot_be_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError):
        DriverSocket(str(tmp_path / "nowhere" / "x.sock"))
    with pytest.raises(ConfigError):
        DriverSocket(str(tmp_path / ("long" * 50)))


def test_a_line_to_a_socket_without_a_listener_is_an_error(path: str) -> None:
    with pytest.raises(ConfigError, match="vehicle-iface sim"):
        send_line(path, "status")


def test_a_line_without_an_answer_times_out(driver: DriverSocket) -> None:
    with pytest.raises(ConfigError, match="no answer"):
        send_line(driver.path, "status", timeout_s=0.01)


@pytest.mark.parametrize("line", ["two\nlines", "x" * LONGEST_LINE])
def test_press_sends_one_short_line_only(path: str, line: str) -> None:
    with pytest.raises(ConfigError, match="one line"):
        send_line(path, line)


def test_polling_without_clients_returns_at_once(driver: DriverSocket) -> None:
    assert driver.poll(echo) == 0


def test_a_line_that_comes_in_pieces_is_one_line(driver: DriverSocket, connect: Callable[[], Client]) -> None:
    client = connect()
    client.sendall(b"bra")
    assert driver.poll(echo) == 0
    client.sendall(b"ke 1\nste")
    assert driver.poll(echo) == 1
    assert client.recv(100) == b"received brake 1\n"
    client.sendall(b"er 1\n")
    assert driver.poll(echo) == 1
    assert client.recv(100) == b"received steer 1\n"


def test_a_line_that_is_too_long_is_refused_and_hung_up_on(driver: DriverSocket, connect: Callable[[], Client]) -> None:
    client = connect()
    client.sendall(b"x" * LONGEST_LINE)
    assert driver.poll(echo) == 0
    assert client.recv(1000).startswith(b"error: line too long")
    assert client.recv(1000) == b""


def test_a_flood_is_answered_a_few_lines_per_poll(driver: DriverSocket, connect: Callable[[], Client]) -> None:
    client = connect()
    client.sendall(b"x\n" * 100)
    assert all(driver.poll(echo) <= 4 for _ in range(25))
    answers = b""
    while answers.count(b"\n") < 100:
        driver.poll(echo)
        answers += client.recv(4096)
    assert answers == b"received x\n" * 100


def test_a_client_that_never_reads_is_hung_up_on(driver: DriverSocket, connect: Callable[[], Client]) -> None:
    client = connect()
    client.sendall(b"x\n" * 100)
    for _ in range(100):
        driver.poll(lambda _: "y" * 60_000)
    assert not driver._clients


def test_a_client_that_leaves_in_the_middle_changes_nothing(
    driver: DriverSocket, connect: Callable[[], Client]
) -> None:
    client = connect()
    client.sendall(b"brake 1\nbrak")
    client.close()
    assert driver.poll(echo) == 1
    assert driver.poll(echo) == 0
    assert pressed(driver, "x") == "received x"


def test_bytes_that_are_no_text_are_answered_too(driver: DriverSocket, connect: Callable[[], Client]) -> None:
    client = connect()
    client.sendall(b"\xff\xfe\x00\n")
    assert driver.poll(echo) == 1
    assert client.recv(100).startswith(b"received ")


def test_idle_clients_make_room_for_new_ones(driver: DriverSocket, connect: Callable[[], Client]) -> None:
    for _ in range(3 * MOST_CLIENTS):
        connect()
        driver.poll(echo)
    assert len(driver._clients) == MOST_CLIENTS
    assert pressed(driver, "x") == "received x"


def test_the_default_path_is_made_of_the_channel_and_stays_in_one_directory() -> None:
    assert default_path("vcan0").endswith("/vehicle-iface-sim-vcan0.sock")
    assert os.path.basename(default_path("../../etc/x")) == "vehicle-iface-sim-.._.._etc_x.sock"
