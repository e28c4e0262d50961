"""What a run does while it waits for its bus."""

import gc

import pytest

from vehicle_iface import clock
from vehicle_iface.bus.base import Bus
from vehicle_iface.cli import run
from vehicle_iface.errors import BusError


def test_garbage_is_collected_although_it_is_not_during_a_start(monkeypatch: pytest.MonkeyPatch) -> None:
    collects: list[bool] = []

    def open_bus() -> Bus:
        collects.append(gc.isenabled())
        raise BusError("can0 is not there")

    end = run._EarlyEnd()
    monkeypatch.setattr(clock, "sleep_until", lambda _: end.set())
    gc.disable()
    try:
        assert not run._wait_for_bus(open_bus, 60.0, end)
    finally:
        gc.enable()
    assert collects == [True]
