"""The page of a drive that is being recorded says so, and says it when something of it is lost."""

from pathlib import Path

import msgspec
import pytest

from vehicle_iface.reason import Reason
from vehicle_iface.recorder.files import REPORT, Report
from vehicle_iface.runtime.telemetry import SessionInfo, Snapshot, WriterState
from vehicle_iface.status import ControllerState
from vehicle_iface.units import NS_PER_S
from viewer import panels
from viewer.feed import View
from viewer.recorder import RecorderState, RecorderWatch

NOW_NS = 100 * NS_PER_S
WELL = Report(at_ns=NOW_NS, written={"frames": 9}, lost={"frames": 0})


def fault(folder: Path, report: Report | bytes | None, now_ns: int = NOW_NS) -> str:
    if report is not None:
        content = report if isinstance(report, bytes) else msgspec.json.encode(report).ljust(4096)
        (folder / REPORT).write_bytes(content)
    state = RecorderWatch().state(str(folder), now_ns)
    assert state is not None
    return state.fault


def banner(state: RecorderState | None) -> str:
    snapshot = Snapshot(NOW_NS, ControllerState.ENGAGED, Reason.NOMINAL)
    info = SessionInfo(channel="vcan0", bus="SocketCAN vcan0")
    return panels.banner_html(
        View(now_ns=NOW_NS, address="a", link=WriterState.LIVE, snapshot=snapshot, info=info, recorder=state)
    )


def test_without_a_recorder_the_page_speaks_of_none() -> None:
    assert RecorderWatch().state("", NOW_NS) is None
    assert "record" not in banner(None).lower()


def test_while_all_is_well_the_page_says_where_it_goes(tmp_path: Path) -> None:
    assert fault(tmp_path, WELL) == ""
    assert "recorded to /somewhere" in banner(RecorderState(folder="/somewhere"))


@pytest.mark.parametrize(
    ("report", "words"),
    [
        (msgspec.structs.replace(WELL, lost={"frames": 1200, "snapshots": 0}), "1,200 frames LOST"),
        (msgspec.structs.replace(WELL, trouble="No space left on device"), "No space left on device"),
        (msgspec.structs.replace(WELL, at_ns=NOW_NS - 12 * NS_PER_S), "no word for 12 s"),
        (b"", "no word from the recorder"),
        (b"[" * 4000, "no word from the recorder"),
        (None, "no word from the recorder"),
    ],
)
def test_what_is_wrong_with_it_is_on_the_page(tmp_path: Path, report: Report | bytes | None, words: str) -> None:
    said = fault(tmp_path, report)
    assert said == words
    assert f"RECORDER: {words}" in banner(RecorderState(folder=str(tmp_path), fault=said))


def test_a_recorder_that_has_ended_in_order_need_not_speak_on(tmp_path: Path) -> None:
    over = msgspec.structs.replace(WELL, is_over=True)
    assert fault(tmp_path, over, NOW_NS + 60 * NS_PER_S) == ""


def test_it_is_looked_at_once_a_second(tmp_path: Path) -> None:
    watch = RecorderWatch()
    (tmp_path / REPORT).write_bytes(msgspec.json.encode(WELL))
    first = watch.state(str(tmp_path), NOW_NS)
    (tmp_path / REPORT).unlink()
    assert watch.state(str(tmp_path), NOW_NS + NS_PER_S - 1) is first
    later = watch.state(str(tmp_path), NOW_NS + NS_PER_S)
    assert later is not None
    assert later.fault
