"""Stamps of received frames."""

import time

import pytest
from hil_bench.bus import SO_TIMESTAMPING, STAMPS, Clocks
from vehicle_bus_contract.reference import MS, S


def test_stamps_do_not_go_back_with_the_wall_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "monotonic_ns", lambda: 100 * S)
    monkeypatch.setattr(time, "time_ns", lambda: 5000 * S)
    clocks = Clocks()
    clocks.update()

    def stamp(at_ns: int) -> int:
        record = STAMPS.pack(*divmod(at_ns, S), 0, 0, 0, 0)
        return clocks.stamps([(1, SO_TIMESTAMPING, record)])[0]

    assert [stamp(5000 * S - back_ms * MS) - 100 * S for back_ms in (50, 30, 45, 20)] == [
        -50 * MS,
        -30 * MS,
        -30 * MS,
        -20 * MS,
    ]
