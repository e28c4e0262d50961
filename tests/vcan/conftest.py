"""Real programs on a real vcan0: started, watched, ended, and their words shown when a test fails."""

import atexit
import functools
import gc
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Generator, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from vehicle_bus_contract.cable import LOOP_END, VEHICLE_END, Cable

from . import peer
from .claims import Claims
from .fork_server import Forked, ForkServer
from .observer import CHANNEL, PATIENCE_S, Observer
from .peer import Vehicle
from .standstill import Standstill, Witness
from .verdict import breaches

ROOT = Path(__file__).resolve().parents[2]
IFF_UP = 1
WITH_BROWSER = "test_end_to_end.py"
_HOW = "run it through tools/vcan: tools/vcan python -m pytest tests/vcan"


class Program:
    """One process of the program; every line that it prints is kept."""

    def __init__(self, name: str, process: subprocess.Popen[str] | Forked) -> None:
        self.name = name
        self.lines: list[str] = []
        self._changed = threading.Condition()
        self._process = process
        self._reader = threading.Thread(target=self._read, name=f"reads {name}")
        self._reader.start()

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def wait_for_line(self, pattern: str, patience_s: float = PATIENCE_S) -> re.Match[str]:
        """The first line that matches, now or later."""
        deadline_s = time.monotonic() + patience_s
        seen = 0
        while True:
            with self._changed:
                while seen < len(self.lines):
                    match = re.search(pattern, self.lines[seen])
                    seen += 1
                    if match:
                        return match
                left_s = deadline_s - time.monotonic()
                is_over = not self._reader.is_alive()
                if not is_over and left_s > 0.0:
                    self._changed.wait(min(left_s, 0.5))
                    continue
            raise AssertionError(f"{self.name} never printed {pattern!r}\n{self.text}")

    def send_signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self._process.send_signal(number)

    def wait_for_end(self, patience_s: float = PATIENCE_S) -> int:
        """Its exit status, once it has ended by itself and its last lines are kept."""
        try:
            status = self._process.wait(patience_s)
            self._reader.join(patience_s)
            return status
        except subprocess.TimeoutExpired:
            raise AssertionError(f"{self.name} has not ended in {patience_s:.0f} s\n{self.text}") from None

    def kill(self) -> None:
        """End it without a chance to do anything more."""
        self._process.kill()
        self._process.wait()
        self._reader.join()

    @property
    def text(self) -> str:
        """All that it has printed."""
        return "\n".join(self.lines)

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                with self._changed:
                    self.lines.append(line.rstrip("\n"))
                    self._changed.notify_all()
        with self._changed:
            self._changed.notify_all()


class Programs:
    """Everything that a test has started."""

    def __init__(self, folder: Path, channel: str = CHANNEL) -> None:
        self.folder = folder
        self.channel = channel
        self.started: list[Program] = []
        self._memory = tempfile.TemporaryDirectory(dir="/dev/shm")
        self.telemetry = f"{self._memory.name}/telemetry"
        """In this kernel's own memory: what one process maps of the host's files, another does not see."""

    def start(self, *arguments: str) -> Program:
        """`vehicle-iface ARGUMENTS…`."""
        process = _fork_server().start(list(arguments), self._environment, ROOT)
        return self._keep(Program(arguments[0], process))

    def start_python(self, *arguments: str, name: str) -> Program:
        """This Python, with the project at hand."""
        return self.start_command(sys.executable, *arguments, name=name)

    def start_command(self, *command: str, name: str) -> Program:
        """Any command, with the project at hand."""
        process = subprocess.Popen(
            command,
            cwd=ROOT,
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        return self._keep(Program(name, process))

    def run(self, *arguments: str) -> Program:
        """The loop, with its summary in the test's folder."""
        outputs = ("--telemetry", self.telemetry, "--summary", str(self.folder / "summary.json"))
        return self.start("run", "--channel", self.channel, *outputs, *arguments)

    def kill_all(self) -> None:
        """Nothing of ours runs on."""
        for program in self.started:
            program.kill()
        self._memory.cleanup()

    @property
    def _environment(self) -> dict[str, str]:
        return os.environ | {"PYTHONUNBUFFERED": "1", "PYTHONPATH": f"{ROOT}:{ROOT / 'tools'}"}

    def _keep(self, program: Program) -> Program:
        self.started.append(program)
        return program

    @property
    def text(self) -> str:
        """The output of each program."""
        return "\n".join(f"── {program.name}\n{program.text}" for program in self.started)


@functools.cache
def _fork_server() -> ForkServer:
    server = ForkServer(ROOT)
    atexit.register(server.close)
    return server


def set_link(state: str) -> None:
    """`ip link set vcan0 up` or `down`."""
    subprocess.run(["ip", "link", "set", CHANNEL, state], check=True, capture_output=True)


def mtu() -> int:
    """How much a frame on the interface may be."""
    return int(Path(f"/sys/class/net/{CHANNEL}/mtu").read_text())


def set_mtu(size: int) -> None:
    """Room for FD frames with 72, for classical ones only with 16."""
    if mtu() == size:
        return
    set_link("down")  # a running interface refuses another size
    subprocess.run(["ip", "link", "set", CHANNEL, "mtu", str(size)], check=True, capture_output=True)
    set_link("up")


def _link_is_up() -> bool:
    return bool(int(Path(f"/sys/class/net/{CHANNEL}/flags").read_text(), 16) & IFF_UP)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--all-defects", action="store_true", help="try every defect of the bench, not one of a kind")
    parser.addoption("--share", type=Path, metavar="FOLDER", help="leave out what another run has claimed there")
    parser.addoption("--from-the-end", action="store_true", help="begin with the last of the tests that are shared")
    parser.addoption("--defer-to", type=Path, metavar="FILE", help="where failed tests go, to be run alone")


def pytest_sessionstart(session: pytest.Session) -> None:
    with suppress(PermissionError):  # without real-time priority nothing shows that the machine stood still
        witness = Witness()
        session.config.add_cleanup(witness.close)
        defer_to: Path | None = session.config.getoption("--defer-to")
        share: Path | None = session.config.getoption("--share")

        def take_delays_s() -> list[float]:
            return [*witness.take_delays_s(), *peer.take_delays_s()]

        session.config.pluginmanager.register(Standstill(take_delays_s, _unit, defer_to, Claims(share, _claimed)))
    gc.disable()  # with all frames of a test it takes 0.1 s, in which the test's own vehicle would be silent


def pytest_runtest_logfinish() -> None:
    """Between two tests no program waits for the vehicle."""
    gc.collect()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    units: dict[str, list[pytest.Item]] = {}
    for item in items:
        units.setdefault(_claimed(item), []).append(item)
    order = reversed(units) if config.getoption("--from-the-end", default=False) else iter(units)
    # A browser holds up the other kernel, too, so that the bench there would find itself late: it comes last.
    items[:] = sorted((item for unit in order for item in units[unit]), key=lambda item: item.path.name == WITH_BROWSER)


def _unit(item: pytest.Item) -> str:
    """What stands or falls together: a test, or all tests of a module that share what one of them has set up."""
    return item.path.name if _of_module(item) else item.nodeid


def _claimed(item: pytest.Item) -> str:
    """What stays together on one kernel: the same, but that each kernel has its own interface."""
    return item.path.name if _of_module(item) - {"vcan0"} else item.nodeid


def _of_module(item: pytest.Item) -> set[str]:
    """The names of fixtures that the test shares with others of its module."""
    assert isinstance(item, pytest.Function)
    definitions = item._fixtureinfo.name2fixturedefs
    return {name for name in item.fixturenames if any(one.scope == "module" for one in definitions.get(name, ()))}


@pytest.fixture(scope="module")
def vcan0() -> Iterator[None]:
    """The interface, up before and after."""
    if not Path(f"/sys/class/net/{CHANNEL}").exists():
        pytest.fail(f"there is no {CHANNEL} here; {_HOW}", pytrace=False)
    yield
    if not _link_is_up():
        set_link("up")


@pytest.fixture
def bus(vcan0: None) -> Iterator[Observer]:  # noqa: ARG001
    """Sees every frame of the test; nobody else is on the bus at its start, and the link is up."""
    if not _link_is_up():
        set_link("up")
    observer = Observer()
    yield observer
    observer.close()
    if not _link_is_up():
        set_link("up")
    _judge(observer)


def _judge(observer: Observer) -> None:
    """However the test ended: from its first frame to its last the controller kept to the bus contract."""
    found = breaches(frame for frame in observer.frames if not observer.is_foreign(frame))
    assert not found, "\n".join(found)


@pytest.fixture
def programs(request: pytest.FixtureRequest, bus: Observer, tmp_path: Path) -> Iterator[Programs]:  # noqa: ARG001
    """Starts programs, and ends them all."""
    started = Programs(tmp_path)
    request.node.stash[_PROGRAMS] = started
    yield started
    started.kill_all()


@pytest.fixture
def vehicle(bus: Observer) -> Iterator[Vehicle]:
    """The independent vehicle at the origin, READY, sending."""
    peer = Vehicle()
    peer.start()
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    yield peer
    peer.close()


@pytest.fixture
def cable(vcan0: None) -> Iterator[Cable]:  # noqa: ARG001
    """A cable of its own, without a fault yet; vcan0 stays idle."""
    made = Cable()
    yield made
    made.close()


@pytest.fixture
def loop_end(cable: Cable) -> Iterator[Observer]:  # noqa: ARG001
    """Sees what the loop sends, and what arrives at the loop."""
    observer = Observer(LOOP_END)
    yield observer
    observer.close()
    _judge(observer)


@pytest.fixture
def vehicle_end(cable: Cable) -> Iterator[Observer]:  # noqa: ARG001
    """Sees what the vehicle sends, and what arrives at the vehicle."""
    observer = Observer(VEHICLE_END)
    yield observer
    observer.close()


@pytest.fixture
def far_vehicle(vehicle_end: Observer) -> Iterator[Vehicle]:
    """The independent vehicle at its end of the cable."""
    peer = Vehicle(channel=VEHICLE_END)
    peer.start()
    vehicle_end.wait_for("the vehicle's first sample", "CHASSIS")
    yield peer
    peer.close()


@pytest.fixture
def cable_programs(
    request: pytest.FixtureRequest,
    loop_end: Observer,  # noqa: ARG001
    tmp_path: Path,
) -> Iterator[Programs]:
    """Starts programs at the loop's end of the cable, and ends them all."""
    started = Programs(tmp_path, LOOP_END)
    request.node.stash[_PROGRAMS] = started
    yield started
    started.kill_all()


_PROGRAMS = pytest.StashKey[Programs]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A failing test shows what its programs printed."""
    report = yield
    programs = item.stash.get(_PROGRAMS, None)
    if report.failed and programs is not None:
        report.sections.append(("programs", programs.text))
    return report
