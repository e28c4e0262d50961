"""Two kernels share the tests on vcan: each unit of tests goes to the kernel that is first to make its folder.

Both have the same list; one begins at its start and the other at its end, so both are busy until nothing is left.
A folder and not a file: what a kernel of `tools/vcan` creates on the host is atomic only for `mkdir`.
"""

from collections.abc import Callable
from pathlib import Path

import pytest


class Claims:
    """What of the list is run here."""

    def __init__(self, folder: Path | None, unit: Callable[[pytest.Item], str]) -> None:
        """`unit` names what stays together; without a folder everything is run here."""
        self._folder = folder
        self._unit = unit
        self._ours: dict[str, bool] = {}

    def is_ours(self, item: pytest.Item) -> bool:
        """Whether the item is run here; claims its unit if nobody has."""
        unit = self._unit(item)
        if unit not in self._ours:
            self._ours[unit] = self._claim(unit)
        return self._ours[unit]

    def find_next(self, item: pytest.Item | None) -> pytest.Item | None:
        """This item, or the first behind it that is run here; its unit is claimed with this call."""
        if item is None or self.is_ours(item):
            return item
        items = item.session.items
        return next((one for one in items[items.index(item) + 1 :] if self.is_ours(one)), None)

    def _claim(self, unit: str) -> bool:
        if self._folder is None:
            return True
        try:
            (self._folder / unit.encode().hex()[-200:]).mkdir()
        except FileExistsError:
            return False
        return True
