"""The page of a drive that is being recorded says so, and says it when something of it is lost."""

from pathlib import Path

import msgspec
import pytest

from vehicle_iface.reason import Reason
from vehicle_iface.recorder.files import STATUS, RecorderStatus
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import SessionInfo, Snapshot, WriterState
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.banner import banner_html
from vehicle_iface_viewer.recorder_monitor import RecorderHealth, RecorderMonitor

NOW_NS = 100 * NS_PER_S
WELL = RecorderStatus(at_ns=NOW_NS, written={"frames": 9}, lost={"frames": 0})


def fault(folder: Path, status: RecorderStatus | bytes | None, now_ns: int = NOW_NS) -> str:
    if status is not None:
        content = status if isinstance(status, bytes) else msgspec.json.encode(status).ljust(4096)
        (folder / STATUS).write_bytes(content)
    state = RecorderMonitor().check(str(folder), now_ns)
    assert state is not None
    return state.fault


def banner(state: RecorderHealth | None) -> str:
    snapshot = Snapshot(NOW_NS, ControllerState.ENGAGED, Reason.NOMINAL)
    info = SessionInfo(channel="vcan0", bus="SocketCAN vcan0")
    return banner_html(
        View(now_ns=NOW_NS, address="a", writer_state=WriterState.LIVE, snapshot=snapshot, info=info, recorder=state)
    )


def test_without_a_recorder_the_page_shows_none() -> None:
    assert RecorderMonitor().check("", NOW_NS) is None
    assert "record" not in banner(None).lower()


def test_while_all_is_well_the_page_shows_the_folder(tmp_path: Path) -> None:
    assert fault(tmp_path, WELL) == ""
    assert "recording to /somewhere" in banner(RecorderHealth(folder="/somewhere"))


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (msgspec.structs.replace(WELL, lost={"frames": 1200, "snapshots": 0}), "1,200 frames LOST"),
        (msgspec.structs.replace(WELL, trouble="No space left on device"), "No space left on device"),
        (msgspec.structs.replace(WELL, at_ns=NOW_NS - 12 * NS_PER_S), "no status for 12 s"),
        (b"", "no status from the recorder"),
        (b"[" * 4000, "no status from the recorder"),
        (None, "no status from the recorder"),
    ],
)
def test_a_fault_of_the_recorder_is_on_the_page(
    tmp_path: Path, status: RecorderStatus | bytes | None, words: str
) -> None:
    said = fault(tmp_path, status)
    assert said == words
    assert f"RECORDER: {words}" in banner(RecorderHealth(folder=str(tmp_path), fault=said))


def test_a_recorder_that_has_ended_in_order_need_not_report_on(tmp_path: Path) -> None:
    over = msgspec.structs.replace(WELL, is_over=True)
    assert fault(tmp_path, over, NOW_NS + 60 * NS_PER_S) == ""


def test_it_is_looked_at_once_a_second(tmp_path: Path) -> None:
    monitor = RecorderMonitor()
    (tmp_path / STATUS).write_bytes(msgspec.json.encode(WELL))
    first = monitor.check(str(tmp_path), NOW_NS)
    (tmp_path / STATUS).unlink()
    assert monitor.check(str(tmp_path), NOW_NS + NS_PER_S - 1) is first
    later = monitor.check(str(tmp_path), NOW_NS + NS_PER_S)
    assert later is not None
    assert later.fault
