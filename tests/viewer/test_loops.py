"""Without an address the page is that of the one loop that runs, and several are offered."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest
import viser

from tests.narrowing import at_present
from vehicle_iface import clock
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryWriter, address
from vehicle_iface.telemetry.running import find_running_loops
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer import browser_memory
from vehicle_iface_viewer.__main__ import main
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.live import LiveLoops
from vehicle_iface_viewer.loops import KnownLoop, LoopList
from vehicle_iface_viewer.panels.loop_bar import choice_html, shown_html
from vehicle_iface_viewer.serving import open_server

from .test_access import camera, joined, packed, wait_for_client


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only folder of named telemetry."""
    monkeypatch.setattr(address, "telemetry_folders", lambda: [tmp_path])
    return tmp_path


def write(name: str, channel: str = "vcan0", profile: str = "reference") -> TelemetryWriter:
    return TelemetryWriter(
        name, SessionInfo(channel=channel, bus=f"SocketCAN {channel}", profile=profile, pid=os.getpid())
    )


def lists(*names: str) -> LoopList:
    found = LoopList()
    found.update(0)
    assert tuple(found.known) == names
    return found


def test_without_a_loop_the_default_one_is_waited_for(folder: Path) -> None:
    with write("ended"):
        pass
    (folder / f"vehicle-iface-{os.getuid()}-garbage").write_bytes(b"\0" * 100)
    (folder / f"vehicle-iface-{os.getuid()}-no name").write_bytes(b"")
    assert find_running_loops() == []
    assert lists().find_usual() == "default"


def test_the_only_loop_is_shown_whatever_its_name() -> None:
    with write("demo-8080"):
        assert lists("demo-8080").find_usual() == "demo-8080"


def test_several_are_listed_and_none_is_chosen(capsys: pytest.CaptureFixture[str]) -> None:
    with ExitStack() as both:
        first, _ = both.enter_context(write("default")), both.enter_context(write("truck", "can\n1", "fs_ai"))
        first.publish(Snapshot(clock.monotonic_ns() - 3 * NS_PER_S, 3, 0))
        assert lists("default", "truck").find_usual() is None
        assert main(["--list"]) == 0
    table = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert table[0] == ["ADDRESS", "PID", "PROFILE", "CHANNEL", "STATE", "LAST", "DATA"]
    assert table[1][:5] == ["default", str(os.getpid()), "reference", "vcan0", "ENGAGED"]
    assert 3.0 <= float(table[1][5]) < 60.0
    assert table[2] == ["truck", str(os.getpid()), "fs_ai", "can?1", "-", "none", "yet"]


def test_a_machine_without_a_loop_has_an_empty_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    assert capsys.readouterr().out == "viewer: no loop is running\n"


def test_an_ended_loop_stays_in_the_list_as_ended_and_runs_again_when_it_is_restarted() -> None:
    known = LoopList()
    with write("car"):
        known.update(0)
    with write("truck"):
        known.update(NS_PER_S // 2)
        assert list(known.known) == ["car"]  # not looked for yet
        known.update(NS_PER_S)
        assert {name: one.has_ended for name, one in known.known.items()} == {"truck": False, "car": True}
        assert known.find_usual() == "truck"
        rows = choice_html(known.known.values(), "<car>")
        assert rows.count("ENDED") == 1
        assert rows.index("NO DATA") < rows.index(">truck<") < rows.index("ENDED") < rows.index(">car<")
        assert 'href="?loop=truck"' in rows
        assert "The loop &lt;car&gt; is not running" in rows
        with write("car"):
            known.update(2 * NS_PER_S)
            assert not known.known["car"].has_ended
    for number in range(30):
        with write(f"loop{number}"):
            known.update((3 + number) * NS_PER_S)
    assert len(known.known) == 21


def test_the_state_in_the_list_is_that_of_the_loops_own_page() -> None:
    with write("car") as writer:
        writer.publish(Snapshot(clock.monotonic_ns(), 3, 0, has_state=True, speed_mps=5.0))
        (one,) = find_running_loops()
    assert "DRIVING" in choice_html([KnownLoop(loop=one)])
    assert "other loops" not in shown_html("car", one.info, [KnownLoop(loop=one)])
    assert "other loops" in shown_html("truck", None, [KnownLoop(loop=one)])
    assert f"<b>car</b> <span>reference · vcan0 · pid {os.getpid()}</span>" in shown_html("car", one.info)


class Visit:
    """A visitor of `loops`; its browser says what it wants when it is asked to."""

    def __init__(self, loops: LiveLoops, client: viser.ClientHandle, monkeypatch: pytest.MonkeyPatch) -> None:
        asked: dict[Sequence[str], Callable[[Mapping[str, str]], None]] = {}
        monkeypatch.setattr(browser_memory, "ask", lambda _, names, on_answer: asked.update({names: on_answer}))
        self.visitor = loops.admit(client)
        self.answer = asked.get(("loop", "beside"))
        self._loops, self._tick, self._now_ns = loops, 0, clock.monotonic_ns()

    def shown(self, later_s: float = 0.0) -> str | None:
        """The address of the loop that is shown after another update."""
        self._now_ns += round(later_s * NS_PER_S)
        self._loops.update(self._now_ns, self._tick)
        self.visitor.update(self._now_ns, self._tick)
        self._tick += 15
        return self.visitor.browser.watched.address if self.visitor.browser else None

    @property
    def bar(self) -> str:
        return self.visitor._bar.content


@pytest.fixture
def client() -> Iterator[viser.ClientHandle]:
    server = open_server(Access(port=0))
    with joined(server) as browser:
        browser.send(packed(camera()))
        wait_for_client(server, browser)
        (found,) = server.get_clients().values()
        yield found
    server.stop()


def test_a_browser_chooses_by_the_address_of_its_page(
    client: viser.ClientHandle, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ExitStack() as both:
        for name in ("car", "truck"):
            both.enter_context(write(name))
        loops = LiveLoops(None)
        visit = Visit(loops, client, monkeypatch)
        assert visit.answer is not None
        assert visit.shown() is None
        visit.answer({"loop": "../../etc/passwd"})
        assert visit.shown() is None
        assert "CHOOSE A LOOP" in visit.bar
        visit.answer({"loop": "truck"})
        assert visit.shown() == "truck"
        assert visit.bar.startswith('<div id="loop" class="vi-loops"><b>truck</b>')
        assert 'href="?loop=car"' in visit.bar
        silent = Visit(loops, client, monkeypatch)
        assert silent.shown(1.0) is None
        assert silent.bar == ""
        assert silent.shown(3.0) is None
        assert "CHOOSE A LOOP" in silent.bar
        loops.close()


def test_a_browser_that_names_no_loop_sees_the_only_one_and_keeps_it(
    client: viser.ClientHandle, monkeypatch: pytest.MonkeyPatch
) -> None:
    with write("car"):
        loops = LiveLoops(None)
        visit = Visit(loops, client, monkeypatch)
        assert visit.answer is not None
        visit.answer({})
        assert visit.shown() == "car"
    with write("truck"):
        assert visit.shown(1.1) == "car"
        assert 'href="?loop=truck"' in visit.bar
        waiting = Visit(loops, client, monkeypatch)
        assert waiting.answer is not None
        waiting.answer({"loop": "van"})
        assert waiting.shown() is None
        with write("van"):
            assert waiting.shown(5.0) == "van"
    loops.close()


def test_a_second_vehicle_is_drawn_beside_in_the_same_frame_only_and_a_refusal_says_why(
    client: viser.ClientHandle, monkeypatch: pytest.MonkeyPatch
) -> None:
    def publish(writer: TelemetryWriter, frame_id: str, x_m: float) -> None:
        now_ns = clock.monotonic_ns()
        place = {"has_state": True, "stamp_ns": now_ns, "x_m": x_m, "has_reference": True, "frame_id": frame_id}
        writer.publish(Snapshot(now_ns, 3, 0, **place, spatial_reference_x_m=x_m))  # type: ignore[arg-type]

    with write("car") as car, write("truck") as truck:
        publish(car, "map", 10.0)
        loops = LiveLoops(None)
        visit = Visit(loops, client, monkeypatch)
        assert visit.answer is not None
        visit.answer({"loop": "car", "beside": "truck"})
        assert visit.shown() == "car"
        assert "<b>truck</b> not drawn: its place is not known" in visit.bar
        assert 'href="?loop=car"' in visit.bar
        browser = visit.visitor.browser
        assert browser is not None
        browser._big_map.note_gpu(has_gpu=True)
        companion = browser._companion
        assert companion is not None
        publish(truck, "odom", 15.0)
        visit.shown()
        assert "not drawn: its positions are in the frame odom, not in map" in visit.bar
        assert not at_present(companion._vehicle._frame.visible)
        publish(truck, "map", 15.0)
        visit.shown()
        assert "<b>truck</b> drawn beside it, display only" in visit.bar
        assert at_present(companion._vehicle._frame.visible)
        first, second = (one._frame.position for one in (browser._showing.scene._vehicle, companion._vehicle))
        assert second[0] - first[0] == pytest.approx(5.0)
        assert companion._vehicle._body.color != browser._showing.scene._vehicle._body.color
        assert (companion._ball.visible, companion._label.visible, companion._label.text) == (True, True, "truck")
        for tick in range(12):
            loops.update(clock.monotonic_ns(), tick)
            visit.visitor.update(clock.monotonic_ns(), tick)
        assert ">truck</text>" in browser._map_panel._beside.content
        alone = Visit(loops, client, monkeypatch)
        assert alone.answer is not None
        alone.answer({"loop": "car", "beside": "car"})
        assert alone.shown() == "car"
        assert 'href="?loop=car&amp;beside=truck"' in alone.bar
        loops.close()


def test_where_a_loop_was_named_no_other_is_offered(
    client: viser.ClientHandle, monkeypatch: pytest.MonkeyPatch
) -> None:
    with write("car"), write("truck"):
        loops = LiveLoops("car")
        visit = Visit(loops, client, monkeypatch)
        assert visit.answer is None
        assert visit.shown(1.1) == "car"
        assert "truck" not in visit.bar
        loops.close()
