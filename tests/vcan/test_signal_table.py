"""The page's table of signals on a real bus, beside what candump has written of the same seconds."""

import re
import subprocess
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import cantools
import pytest
from cantools.database import Database

from vehicle_iface.telemetry import SessionInfo, WriterState
from vehicle_iface_viewer.bus_table.report import BusReport
from vehicle_iface_viewer.bus_table.source import ListenerProcess
from vehicle_iface_viewer.feed import View

from .conftest import ROOT, Programs
from .driving import driven
from .observer import CHANNEL, PATIENCE_S, Observer
from .peer import Vehicle

_LINE = re.compile(r"\((?P<stamp>[\d.]+)\) \S+ (?P<can_id>[0-9A-F]{3})#(?P<data>[0-9A-F]*)")
_SPAN_S = 4.0
_LOOP_SENDS = {"DRIVE_COMMAND", "STEER_COMMAND", "BODY_COMMAND", "CONTROLLER_STATUS"}


@pytest.fixture
def listener() -> Iterator[ListenerProcess]:
    opened = ListenerProcess(None)
    yield opened
    opened.close()


def read(listener: ListenerProcess) -> BusReport | None:
    info = SessionInfo(channel=CHANNEL, bus=f"SocketCAN {CHANNEL}", profile="reference")
    return listener.read(View(now_ns=0, address="a", writer_state=WriterState.LIVE, session=1, info=info))


def test_rates_values_and_identifiers_are_those_of_candump(
    programs: Programs,
    bus: Observer,
    vehicle: Vehicle,  # noqa: ARG001
    listener: ListenerProcess,
    tmp_path: Path,
) -> None:
    driven(programs, bus)
    deadline_s = time.monotonic() + PATIENCE_S
    while not ((report := read(listener)) and report.frames) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    log = tmp_path / "candump.log"
    with log.open("w") as output, subprocess.Popen(["candump", "-L", CHANNEL], stdout=output) as candump:
        end_s = time.monotonic() + _SPAN_S
        while time.monotonic() < end_s:
            report = read(listener)
            listener.signals.want("POSE.POS_X, m")
            time.sleep(0.05)
        candump.terminate()
    assert report is not None
    stamps_s, payloads = _parse(log)
    dbc = cantools.database.load_file(ROOT / "dbc" / "reference.dbc")
    assert isinstance(dbc, Database)
    assert report.problem == ""
    assert {int(row.can_id, 16) for row in report.rows} == set(stamps_s)
    for row in report.rows:
        can_id = int(row.can_id, 16)
        rate_hz = (len(stamps_s[can_id]) - 1) / (stamps_s[can_id][-1] - stamps_s[can_id][0])
        assert row.rate_hz == pytest.approx(rate_hz, rel=0.1), row.name
        assert row.is_sent == (row.name in _LOOP_SENDS)
        seen = defaultdict(set)
        for data in payloads[can_id]:
            for name, value in dict(dbc.decode_message(can_id, data)).items():
                seen[name].add(f"{value:.7g}" if isinstance(value, int | float) else str(value))
        for signal in row.signals:
            assert signal.value in seen[signal.name], f"{row.name}.{signal.name}"
        assert {signal.name for signal in row.signals} == set(seen)
    # Plotted at the full rate: each value of candump, but for those that only one of them has received.
    plotted = listener.signals.between("POSE.POS_X, m", 0, 1 << 62)["value"].tolist()
    assert len(plotted) > 0.8 * len(payloads[0x110])
    values = [str(dict(dbc.decode_message(0x110, data))["POS_X"]) for data in payloads[0x110]]
    assert ",".join(map(str, plotted[20:-20])) in ",".join(values)
    assert report.lost == 0
    assert sum(row.error_count for row in report.rows) == 0


def _parse(log: Path) -> tuple[dict[int, list[float]], dict[int, list[bytes]]]:
    """Stamps in s and payloads, by identifier."""
    stamps_s: dict[int, list[float]] = defaultdict(list)
    payloads: dict[int, list[bytes]] = defaultdict(list)
    for line in log.read_text().splitlines():
        found = _LINE.fullmatch(line)
        if found is not None:
            stamps_s[int(found["can_id"], 16)].append(float(found["stamp"]))
            payloads[int(found["can_id"], 16)].append(bytes.fromhex(found["data"]))
    return dict(stamps_s), dict(payloads)
