"""Waiting for a bus in virtual time."""

import math
from typing import cast
from unittest.mock import Mock, create_autospec

import pytest

from tests.harness import Clock
from vehicle_iface.bus.base import Bus
from vehicle_iface.errors import BusError
from vehicle_iface.runtime.open_wait import wait_until_open
from vehicle_iface.units import s_from_ns


class Interface:
    """Is there from some instant on, in seconds, and down for the second before that."""

    def __init__(self, there_at_s: float) -> None:
        self.clock = Clock()
        self.begin_ns = self.clock.t_ns
        self.there_at_s = there_at_s
        self.ended_at_s = math.inf
        self.opened: list[Mock] = []

    @property
    def now_s(self) -> float:
        return s_from_ns(self.clock.t_ns - self.begin_ns)

    def open(self) -> Bus:
        if self.now_s < self.there_at_s:
            raise BusError("can0 is down" if self.now_s >= self.there_at_s - 1.0 else "there is no can0")
        bus = create_autospec(Bus, instance=True)
        self.opened.append(bus)
        return cast(Bus, bus)

    def comes(self, limit_s: float = math.inf) -> bool:
        return wait_until_open(
            self.open,
            limit_s=limit_s,
            is_over=lambda: self.now_s >= self.ended_at_s,
            now_ns=self.clock.now_ns,
            sleep_until=self.clock.sleep_until,
        )


def test_a_bus_that_is_there_is_not_waited_for_and_given_back(caplog: pytest.LogCaptureFixture) -> None:
    interface = Interface(0.0)
    assert interface.comes()
    assert interface.now_s == 0.0
    assert caplog.messages == []
    interface.opened[0].close.assert_called_once_with()


def test_a_wait_is_logged_at_once_every_five_seconds_and_on_change(
    caplog: pytest.LogCaptureFixture,
) -> None:
    interface = Interface(12.5)
    assert interface.comes()
    assert interface.now_s == pytest.approx(12.5)
    assert [text.removeprefix("waiting (") for text in caplog.messages] == [
        "0 s so far): there is no can0",
        "5 s so far): there is no can0",
        "10 s so far): there is no can0",
        "12 s so far): can0 is down",
    ]


def test_a_request_to_end_ends_the_wait() -> None:
    interface = Interface(1000.0)
    interface.ended_at_s = 3.0
    assert not interface.comes()
    assert interface.now_s == pytest.approx(3.0)


@pytest.mark.parametrize(("limit_s", "there_at_s"), [(0.05, 0.11), (2.0, 2.1), (2.0, 1000.0)])
def test_after_the_limit_the_error_is_why_the_bus_cannot_be_used(limit_s: float, there_at_s: float) -> None:
    interface = Interface(there_at_s)
    with pytest.raises(BusError, match="can0"):
        interface.comes(limit_s)
    assert limit_s <= interface.now_s <= limit_s + 0.1
    assert Interface(limit_s - 0.01).comes(limit_s)
