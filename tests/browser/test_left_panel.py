"""The panel to the left in a real browser: the table of messages, its filter, events, latency and counters."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Page, expect

from vehicle_iface import clock
from vehicle_iface.codec.database import load_database
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.app import App
from vehicle_iface_viewer.bus_table.bus_signals import BusSignals
from vehicle_iface_viewer.bus_table.finder import MessageFinder
from vehicle_iface_viewer.bus_table.monitor import BusMonitor
from vehicle_iface_viewer.bus_table.report import BusReport, SignalKey
from vehicle_iface_viewer.bus_table.sampler import SignalSampler
from vehicle_iface_viewer.feed import View

from .processes import Publisher
from .test_plots import REQUESTED, VEHICLE, choose, wait_for_columns

Start = Callable[..., Publisher]


class Bus:
    """A simulated vehicle on a bus of its own, and a monitor that receives it; every 300th frame is damaged."""

    def __init__(self) -> None:
        database = load_database(load_profile("reference"))
        finder = MessageFinder(database)
        self.monitor, self.signals, self._sampler = BusMonitor(finder), BusSignals(), SignalSampler(finder)
        self._keys: list[SignalKey] = []
        self._vehicle = simulated_vehicle(database, start_ns=clock.monotonic_ns())
        self._due_ns = 0
        self._report: BusReport | None = None

    def read(self, _view: View) -> BusReport | None:
        now_ns = clock.monotonic_ns()
        while (at_ns := self._vehicle.next_due_ns) < now_ns:
            frames = [self._damage(frame._replace(stamp_ns=at_ns)) for frame in self._vehicle.advance(at_ns)]
            self.monitor.add(frames)
            self._sampler.add(frames)
        self.signals.extend(self._keys, self._sampler.take())
        if (keys := self.signals.advance()) != self._keys:
            self._keys = keys
            self._sampler.choose(keys)
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + NS_PER_S // 2
            self._report = self.monitor.report(now_ns)
            self.signals.update(self._report)
        return self._report

    def fork(self) -> Bus:
        return self

    def close(self) -> None: ...

    def _damage(self, frame: CanFrame) -> CanFrame:
        is_hit = frame.can_id == 0x112 and frame.stamp_ns // 10_000_000 % 100 == 0
        return frame._replace(data=bytes([frame.data[0] ^ 1, *frame.data[1:]])) if is_hit else frame


@pytest.fixture
def app(address: str) -> Iterator[App]:
    app = App(Access(port=0), address, Bus())
    wanted = threading.Event()
    wanted.set()
    thread = threading.Thread(target=app.run, args=(wanted.is_set,))
    thread.start()
    yield app
    wanted.clear()
    thread.join()
    app.close()


@pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")  # as the program does
def test_all_messages_are_listed_the_faulty_one_first_and_can_be_filtered(publish: Start, app: App, page: Page) -> None:
    loop = publish()
    page.goto(f"http://127.0.0.1:{app.port}/?free=MOTION.YAW_RATE,+rad/s&and=NO.SUCH")
    messages = page.locator("#signals .vi-message")
    expect(messages).to_have_count(4)
    expect(messages.first).to_contain_text("0x112 CHASSIS")
    expect(messages.first).to_contain_text("× bad CRC")
    pose = page.locator('[data-id="0x110"]')
    expect(pose).to_contain_text("100.0/100 Hz")
    expect(pose).to_contain_text("POS_X")
    field = page.get_by_role("textbox").first
    field.fill("yaw_rate")
    expect(messages).to_have_count(1)
    expect(messages).to_contain_text("0x111 MOTION")
    expect(messages).to_contain_text("rad/s")
    expect(messages).not_to_contain_text("HEADING")
    field.fill("")
    expect(messages).to_have_count(4)
    notes = page.get_by_text("is not among the signals")
    expect(notes).to_have_text("“NO.SUCH” is not among the signals, at least not yet, and not drawn")
    choose(page, "and", "POSE.POS_X, m")
    expect(notes).to_have_count(0)
    wait_for_columns(page, "Free plot", VEHICLE, "x{8}")
    wait_for_columns(page, "Free plot", REQUESTED, "x{8}")
    page.wait_for_url(re.compile(r"free=MOTION.YAW_RATE%2C\+rad%2Fs&and=POSE.POS_X%2C\+m"))
    page.get_by_role("tab", name="Events").click()
    expect(page.locator("#events")).to_contain_text("mode ENGAGED")
    loop.order("fault")
    expect(page.locator("#events .vi-event").first).to_contain_text("mode FAULT")
    expect(page.locator("#events .vi-event").first).to_contain_text("DEVIATION")
    loop.order("engaged")
    page.get_by_role("tab", name="Latency").click()
    expect(page.locator("#latency")).to_contain_text("p99")
    expect(page.locator("#latency")).to_contain_text("0.2 … 0.5 ms")
    page.get_by_role("tab", name="Counters").click()
    expect(page.locator("#details")).to_contain_text("drops · bad CRC POSE")
