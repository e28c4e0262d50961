"""What the loop's parts count, gathered for the page and the summary."""

from typing import Any

import pytest

from tests.harness import Drive
from vehicle_iface.runtime import statistics
from vehicle_iface.telemetry.details import Causes


def test_every_group_of_causes_is_filled_by_the_part_that_counts_it(monkeypatch: pytest.MonkeyPatch) -> None:
    filled: set[str] = set()

    def noted(**groups: Any) -> Causes:
        filled.update(groups)
        return Causes(**groups)

    monkeypatch.setattr(statistics, "Causes", noted)
    Drive().loop.details()
    assert filled == set(Causes.__struct_fields__)
