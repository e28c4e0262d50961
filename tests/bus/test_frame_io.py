"""The bus in C beside the bus in Python: the same frames, counts and errors from the same datagrams."""

import gc
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import ModuleType

import pytest

from tests.wire_library import SANITIZERS, build_wire, find_runtime, load_wire, run_tests
from vehicle_iface import wire
from vehicle_iface.bus import frame_io
from vehicle_iface.bus.frame_io import FrameReceiver, FrameSender, PythonReceiver, PythonSender
from vehicle_iface.bus.raw_socket import pack_frame
from vehicle_iface.frame import CanFrame

HERE = Path(__file__).parent
STAMPED = 35
FRAMES = (CanFrame(0x123, b"\x01\x02"), CanFrame(0x18FF0001, bytes(64), is_extended=True, is_fd=True), CanFrame(1, b""))


def _fake_kernel(folder: Path) -> str:
    library = folder / "fake_kernel.so"
    command = ["cc", "-shared", "-fPIC", "-O1", "-Wall", "-Werror", str(HERE / "fake_kernel.c"), "-o", str(library)]
    subprocess.run(command, check=True)
    return str(library)


def test_c_and_python_do_the_same_with_every_datagram_and_frame(tmp_path: Path) -> None:
    run_tests([HERE / "on_fake_kernel.py"], build_wire(tmp_path), _fake_kernel(tmp_path))


@pytest.mark.timeout(300)
def test_no_datagram_or_frame_makes_c_leave_its_memory(tmp_path: Path) -> None:
    library = build_wire(tmp_path, *SANITIZERS)
    run_tests([HERE / "on_fake_kernel.py"], library, find_runtime("libasan.so"), _fake_kernel(tmp_path))


class Ends:
    """Sender and receiver at the two ends of a real socket pair with kernel stamps."""

    def __init__(self, c: ModuleType | None) -> None:
        self.near, self.far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.near.setsockopt(socket.SOL_SOCKET, STAMPED, 1)
        self.receiver: FrameReceiver
        self.sender: FrameSender
        if c is None:
            self.receiver, self.sender = PythonReceiver(self.near.fileno(), 1), PythonSender(self.far.fileno())
        else:
            self.receiver = c.FrameReceiver(self.near.fileno(), CanFrame, 1)
            self.sender = c.FrameSender(self.far.fileno(), pack_frame)


@pytest.fixture(scope="module")
def c_wire(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """The C code."""
    return load_wire(str(build_wire(tmp_path_factory.mktemp("wire"))))


@pytest.fixture(params=["c", "python"])
def ends(request: pytest.FixtureRequest, c_wire: ModuleType) -> Iterator[Ends]:
    made = Ends(c_wire if request.param == "c" else None)
    with made.near, made.far:
        yield made


def test_frames_come_as_they_were_sent_with_the_kernels_stamps(ends: Ends) -> None:
    assert ends.sender.send(FRAMES) == 3
    assert ends.receiver.receive(True) == 3
    inbox: list[CanFrame] = []
    assert ends.receiver.take(inbox, -5, 2**62) == 0
    stamps_ns = [frame.stamp_ns for frame in inbox]
    assert stamps_ns == sorted(stamps_ns)
    assert stamps_ns[0] > 10**18
    assert inbox == [frame._replace(stamp_ns=ns, bus=1) for frame, ns in zip(FRAMES, stamps_ns, strict=True)]
    assert ends.receiver.receive(False) == 0


def test_a_queue_that_is_full_ends_the_call_without_an_error(ends: Ends) -> None:
    accepted = [ends.sender.send(FRAMES[:1] * 8) for _ in range(1000)]
    assert accepted[-1] == 0
    received = 0
    while count := ends.receiver.receive(False):
        received += count
    assert received == sum(accepted)


def test_an_error_of_the_socket_is_raised(ends: Ends) -> None:
    ends.near.close()
    with pytest.raises(ConnectionRefusedError):
        ends.sender.send(FRAMES)
    with pytest.raises(OSError, match="Bad file descriptor"):
        ends.receiver.receive(False)


def test_c_rejects_what_it_cannot_use(c_wire: ModuleType) -> None:
    for arguments in ((0, list, 0), (0, CanFrame, "0"), ("0", CanFrame, 0), (0, CanFrame)):
        with pytest.raises(TypeError):
            c_wire.FrameReceiver(*arguments)
    receiver, sender = c_wire.FrameReceiver(0, CanFrame, 0), c_wire.FrameSender(0, lambda _: bytes(73))
    taken: tuple[object, ...]
    for taken in (((), 0, 0), ([], 0), ([], "0", 0), ([], 0, None)):
        with pytest.raises(TypeError):
            receiver.take(*taken)
    with pytest.raises(OverflowError):
        receiver.take([], 2**63, 0)
    with pytest.raises(ValueError, match="at most 8"):
        sender.send(FRAMES * 3)
    with pytest.raises(ValueError, match="1 to 72 bytes"):
        sender.send((None,))


def test_no_frame_leaves_an_object_behind(ends: Ends) -> None:
    def carry() -> None:
        for _ in range(200):
            ends.sender.send(FRAMES)
            ends.receiver.receive(False)
            ends.receiver.take([], 10**9, 2**62)
            with suppress(struct.error):
                ends.sender.send((CanFrame(1, "no bytes"),))  # type: ignore[arg-type]
        gc.collect()

    carry()
    before = sys.getallocatedblocks()
    carry()
    assert abs(sys.getallocatedblocks() - before) < 100


@pytest.mark.parametrize("choice", ["c", "python"])
def test_the_environment_chooses_the_code(choice: str, c_wire: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "vehicle_iface._wire", c_wire)
    monkeypatch.setattr("vehicle_iface._wire", c_wire, raising=False)
    wire.find_problem.cache_clear()
    monkeypatch.setenv(wire.VARIABLE, choice)
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with near, far:
        kinds = {type(frame_io.open_receiver(near.fileno(), 0)), type(frame_io.open_sender(near.fileno()))}
    assert kinds == (
        {PythonReceiver, PythonSender} if choice == "python" else {c_wire.FrameReceiver, c_wire.FrameSender}
    )
