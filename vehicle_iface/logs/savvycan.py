"""The CSV of SavvyCAN (GVRET): `Time Stamp,ID,Extended,Dir,Bus,LEN,D1,…`, stamps in microseconds.

Older versions write no column `Dir`. The bytes of the payload and the identifier are hexadecimal.
"""

from collections.abc import Sequence

from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.frames import EXTENDED, GREATEST_STAMP_S, LAST_ID, LAST_STANDARD_ID, MAX_FD_BYTES, Frame
from vehicle_iface.logs.text_logs import FrameLine, SingleLineFormat
from vehicle_iface.units import NS_PER_S

_NS_PER_US = 1_000
_COLUMNS = ("Time Stamp", "ID", "Extended", "Bus", "LEN", "D1")


class SavvyCanFormat(SingleLineFormat):
    """Reads the lines after the header. `ConfigError` names the columns that the header lacks."""

    stamps = "as logged (SavvyCAN: microseconds since its start, or of the wall clock)"

    def sort_out(self, text: str, number: int) -> FrameLine | None:
        """Return every line except the header: it should be a frame."""
        if number > 1:
            return FrameLine(number, text)
        names = [name.strip() for name in text.split(",")]
        missing = [name for name in _COLUMNS if name not in names]
        if missing:
            raise ConfigError(f"SavvyCAN's header lacks {', '.join(missing)}: must have {', '.join(_COLUMNS)}")
        self._stamp, self._id, self._extended, self._bus, self._length, self._data = map(names.index, _COLUMNS)
        return None

    def parse_line(self, line: FrameLine) -> Frame:
        """Parse the frame of a line. `ValueError` when it is none."""
        cells = [cell.strip() for cell in line.text.split(",")]
        if len(cells) <= self._length:
            raise ValueError(f"{len(cells)} columns: must be {self._data} and those of the payload")
        stamp_us, can_id = int(cells[self._stamp]), int(cells[self._id], 16)
        if not 0 <= can_id <= LAST_ID:
            raise ValueError(f"identifier {can_id:X}: must be at most {LAST_ID:X}")
        if abs(stamp_us) * _NS_PER_US > GREATEST_STAMP_S * NS_PER_S:
            raise ValueError(f"stamp {stamp_us}: must be at most {GREATEST_STAMP_S} s, in microseconds")
        is_extended = cells[self._extended].lower() == "true" or can_id > LAST_STANDARD_ID
        key = can_id | EXTENDED if is_extended else can_id
        return Frame(line.number, stamp_us * _NS_PER_US, key, self._payload(cells), cells[self._bus])

    def _payload(self, cells: Sequence[str]) -> bytes:
        length = int(cells[self._length])
        if not 0 <= length <= MAX_FD_BYTES:
            raise ValueError(f"LEN {length}: must be 0 … {MAX_FD_BYTES}")
        present = [cell for cell in cells[self._data : self._data + length] if cell]
        if len(present) != length:
            raise ValueError(f"{len(present)} bytes: must be {length}, as the line says")
        return bytes(int(cell, 16) for cell in present)
