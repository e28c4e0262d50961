"""How much work one pass is: operations are counted, not seconds, so that a busy machine changes nothing."""

import sys
from collections import Counter
from pathlib import Path
from types import FrameType

import pytest

import vehicle_iface
from tests.harness import Drive
from vehicle_iface import wire
from vehicle_iface.telemetry import SessionInfo, TelemetryWriter

PASSES = 100
MOST = {"clock": 7, "function": 235, "built-in": 197, "protocol": 0}
"""For a sample, of the program in Python: reads of a clock (the harness's bus has none), calls of the program's own
functions and of functions in C, and checks of a protocol, each of which is some hundred bytecodes."""
PACKAGE = str(Path(vehicle_iface.__file__).parent)
SIMULATED = str(Path(PACKAGE, "sim"))


class Tally:
    """Counts the calls of the loop, without those of the simulated vehicle."""

    def __init__(self) -> None:
        self.found: Counter[str] = Counter()
        self._left: FrameType | None = None
        """The function of another program, or the harness, that the loop has called and that has not returned."""

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        if self._left is not None:
            if event == "return" and frame is self._left:
                self._left = None
        elif event == "call":
            path, name = frame.f_code.co_filename, frame.f_code.co_name
            if name == "now_ns":
                self.found["clock"] += 1
            elif name == "__instancecheck__":
                self.found["protocol"] += 1
            elif path.startswith(PACKAGE) and not path.startswith(SIMULATED):
                self.found["function"] += 1
            elif path.startswith("/"):
                self._left = frame
        elif event == "c_call":
            self.found["built-in"] += 1


def count_calls(drive: Drive, passes: int) -> Counter[str]:
    """The calls for so many samples, by kind."""
    tally, end = Tally(), drive.loop.summary().samples + passes
    while drive.loop.summary().samples < end:
        sys.setprofile(tally)
        try:
            drive.loop.step()
        finally:
            sys.setprofile(None)
    return tally.found


@pytest.fixture
def driving(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Drive:
    """Engaged, published, and in Python whatever is built."""
    monkeypatch.setenv(wire.VARIABLE, "python")
    writer = TelemetryWriter(str(tmp_path / "loop"), SessionInfo(channel="embedded", bus="embedded"))
    return Drive(telemetry=writer).engage(speed_mps=1.0)


def test_a_sample_costs_no_more_calls_than_it_did(driving: Drive) -> None:
    found = count_calls(driving, PASSES)
    assert {kind: found[kind] / PASSES for kind, most in MOST.items() if found[kind] > most * PASSES} == {}
    assert found["clock"] > 4 * PASSES < found["function"]  # they were counted
