"""Trajectories as CSV files.

    # frame_id: map
    time_s,x_m,y_m,heading_rad,speed_mps
    0.0,1.5,-2.0,0.1,0.0

Columns may stand in any order; `accel_mps2`, `yaw_rate_radps` and `front_wheel_angle_rad` may follow. Lines
starting with `#` are comments. Encoding UTF-8, with or without a byte order mark; any line ends.
"""

import math
import os
import re
from collections.abc import Sequence
from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError, TrajectoryFileError
from vehicle_iface.trajectory import FloatArray, IntArray, Trajectory
from vehicle_iface.units import NS_PER_S
from vehicle_iface.value import Value

TIME_COLUMN = "time_s"
REQUIRED_COLUMNS = (TIME_COLUMN, "x_m", "y_m", "heading_rad", "speed_mps")
OPTIONAL_COLUMNS = ("accel_mps2", "yaw_rate_radps", "front_wheel_angle_rad")

_COLUMNS = REQUIRED_COLUMNS + OPTIONAL_COLUMNS
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_COMMA_NUMBER = re.compile(r"[+-]?\d+,\d+", re.ASCII)
_FRAME_COMMENT = re.compile(r"#\s*frame_id\s*:(.*)")
_MAX_TIME_S = 9_000_000_000
"""Maximum time, about 285 years: longer ones in nanoseconds do not fit 63 bits."""
_SAFE_ROUNDING_S = 1_000_000.0
"""Below this a float64 number of seconds is nearer than 0.2 ns to the decimal that it was read from."""


class _Text(Value, frozen=True, kw_only=True):
    """A file's lines by kind. Indices count from 0; messages count from 1."""

    path: str
    lines: list[str]
    frame_id: str
    columns: list[str]
    header_index: int
    row_indices: list[int]

    def refuse(self, index: int, reason: str, column: int | None = None) -> NoReturn:
        """Raise with file, line and, where there is one, the column's number and name."""
        _refuse(self.path, index, reason, column, self.columns)


def load_csv(path: str | os.PathLike[str], stamp_ns: int = 0) -> Trajectory:
    """Load the trajectory in the file `path`, its time 0 at `stamp_ns`.

    Raises `TrajectoryFileError` naming file, line, column and value when the file cannot be read or anything
    in it is not as the module's docstring says.
    """
    text = _sort_lines(os.fspath(path))
    table = _parse_table(text)
    if table is None:
        table = _parse_cells(text)
    values = {name: table[:, i] for i, name in enumerate(text.columns)}
    times_ns = _to_ns(text, values.pop(TIME_COLUMN))
    return Trajectory(stamp_ns=stamp_ns, frame_id=text.frame_id, time_from_start_ns=times_ns, **values)


def line_of_point(path: str | os.PathLike[str], point: int) -> int:
    """Return the number of the line, from 1, in which the file `path` has trajectory point `point`, from 0.

    Raises `TrajectoryFileError` when the file cannot be read, `IndexError` when it has no such point.
    """
    return _sort_lines(os.fspath(path)).row_indices[point] + 1


def save_csv(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
    """Write `trajectory` so that `load_csv` gives back the very same numbers; the stamp is not kept.

    Raises `TrajectoryFileError` when the file cannot be written or could not be read back: no points, or a
    frame id with blanks at its ends.
    """
    name, frame = os.fspath(path), trajectory.frame_id
    if not len(trajectory):
        raise TrajectoryFileError(f"{name}: a trajectory without points cannot be saved")
    if frame != frame.strip():
        raise TrajectoryFileError(f"{name}: frame_id {frame!r} cannot be saved: must have no blanks at its ends")
    times = [f"{ns // NS_PER_S}.{ns % NS_PER_S:09d}" for ns in trajectory.time_from_start_ns.tolist()]
    numbers = [map(repr, getattr(trajectory, column).tolist()) for column in _COLUMNS[1:]]
    rows = [f"# frame_id: {frame}", ",".join(_COLUMNS), *map(",".join, zip(times, *numbers, strict=True)), ""]
    try:
        Path(name).write_text("\n".join(rows), encoding="utf-8", newline="\n")
    except (OSError, ValueError) as error:
        raise TrajectoryFileError(f"{name}: cannot be written: {error}") from error


def _refuse(path: str, index: int, reason: str, column: int | None = None, columns: Sequence[str] = ()) -> NoReturn:
    place = "" if column is None else f", column {column + 1}"
    if column is not None and column < len(columns):
        place += f" ({columns[column]})"
    raise TrajectoryFileError(f"{path}, line {index + 1}{place}: {reason}")


def _decode(path: str) -> str:
    """Decode the file without byte order mark, line ends as `\\n`."""
    try:
        data = Path(path).read_bytes()
    except (OSError, ValueError) as error:
        raise TrajectoryFileError(f"{path}: cannot be read: {error}") from error
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start]
        index, column = before.count(b"\n"), error.start - before.rfind(b"\n")
        reason = f"byte 0x{data[error.start]:02x} at character {column}: the file must be UTF-8 text"
        raise TrajectoryFileError(f"{path}, line {index + 1}: {reason}") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _sort_lines(path: str) -> _Text:
    """Sort the lines into comments, header and rows; skip blank ones."""
    lines = _decode(path).split("\n")
    plain = [i for i, line in enumerate(lines) if line and not line.isspace() and not line.startswith("#")]
    if not plain:
        raise TrajectoryFileError(f"{path}, line 1: the file is empty: must begin with {_header_text()}")
    header_index = plain[0]
    columns = _parse_header(path, header_index, lines[header_index])
    if len(plain) == 1:
        _refuse(path, header_index, "no rows follow the header")
    return _Text(
        path=path,
        lines=lines,
        frame_id=_find_frame_id(path, lines),
        columns=columns,
        header_index=header_index,
        row_indices=plain[1:],
    )


def _find_frame_id(path: str, lines: list[str]) -> str:
    """Return the frame of the comment `# frame_id: …`; `map` without one."""
    found: str | None = None
    for index, line in enumerate(lines):
        match = _FRAME_COMMENT.match(line) if line.startswith("#") else None
        if match is None:
            continue
        name = match[1].strip()
        if not name:
            _refuse(path, index, "frame_id is empty: must be the name of a frame of reference, like 'map'")
        try:
            checks.frame_id("frame_id", name)
        except InvalidValueError as error:
            _refuse(path, index, str(error))
        if found not in (None, name):
            _refuse(path, index, f"frame_id {name!r}: was {found!r} before; a file has one frame")
        found = name
    return found or "map"


def _header_text() -> str:
    return f"the header {','.join(REQUIRED_COLUMNS)}"


def _parse_header(path: str, index: int, line: str) -> list[str]:
    """Return the columns' names, checked to be known, complete and unique."""
    names = [cell.strip() for cell in line.split(",")]
    if len(names) == 1 and (delimiter := _find_delimiter(line)):
        _refuse(path, index, f"{line.strip()!r}: cells are separated by {delimiter}, must be by ','")
    if not set(names) & set(_COLUMNS):
        _refuse(path, index, f"{line.strip()!r}: must be {_header_text()}")
    for column, name in enumerate(names):
        if name not in _COLUMNS:
            _refuse(path, index, f"unknown column {name!r}: allowed are {', '.join(_COLUMNS)}", column)
        if name in names[:column]:
            _refuse(path, index, f"duplicate column {name!r}", column)
    missing = [name for name in REQUIRED_COLUMNS if name not in names]
    if missing:
        _refuse(path, index, f"missing column {', '.join(missing)}: must be {_header_text()}")
    return names


def _find_delimiter(line: str) -> str | None:
    """Return the name of the delimiter that the line seems to use instead of the comma."""
    return next((name for mark, name in ((";", "';'"), ("\t", "a tab"), ("|", "'|'")) if mark in line), None)


def _parse_table(text: _Text) -> FloatArray | None:
    """Parse all cells at once into (rows, columns); None on any fault, which `_parse_cells` then names."""
    rows = [text.lines[i] for i in text.row_indices]
    try:
        table: npt.NDArray[np.float64] = np.loadtxt(rows, delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    if table.shape != (len(rows), len(text.columns)) or not np.isfinite(table).all():
        return None
    return table


def _parse_cells(text: _Text) -> FloatArray:
    """Parse cell by cell into (rows, columns); raise at the first bad cell."""
    return np.array([_row(text, index) for index in text.row_indices], dtype=np.float64)


def _row(text: _Text, index: int) -> list[float]:
    line = text.lines[index]
    cells = line.split(",")
    if (count := len(cells)) != (wanted := len(text.columns)):
        text.refuse(index, _explain_cell_count(line, count, wanted), min(count, wanted))
    return [_number(text, index, column, cell.strip()) for column, cell in enumerate(cells)]


def _explain_cell_count(line: str, count: int, wanted: int) -> str:
    """Return the likely reason why a row has another number of cells than the header."""
    said = f"{line.strip()!r} has {count} cells, the header has {wanted}"
    if delimiter := _find_delimiter(line):
        return f"{said}: cells are separated by {delimiter}, must be by ','"
    if count > wanted and _COMMA_NUMBER.search(line):
        return f"{said}: if these are decimal commas, write decimal points: 0.5, not 0,5"
    return said


def _number(text: _Text, index: int, column: int, cell: str) -> float:
    if cell.lower().lstrip("+-") in ("nan", "inf", "infinity"):
        text.refuse(index, f"{cell!r} is not finite", column)
    if not _NUMBER.fullmatch(cell):
        text.refuse(index, f"{cell!r} is not a number", column)
    value = float(cell)
    if not math.isfinite(value):
        text.refuse(index, f"{cell!r} is too large", column)
    return value


def _to_ns(text: _Text, times_s: FloatArray) -> IntArray:
    """Convert decimal seconds to the nearest nanoseconds; reject decreasing times."""
    column = text.columns.index(TIME_COLUMN)

    def refuse(row: int, reason: str) -> NoReturn:
        index = text.row_indices[row]
        text.refuse(index, f"{_cell(text, index, column)!r} {reason}", column)

    outside = np.flatnonzero((times_s < 0.0) | (times_s > _MAX_TIME_S))
    if outside.size:
        refuse(int(outside[0]), f"is out of range: must be 0 to {_MAX_TIME_S} s")
    times_ns: IntArray = np.rint(times_s * NS_PER_S).astype(np.int64)
    for row in _find_uncertain_rows(times_s).tolist():
        times_ns[row] = _to_exact_ns(_cell(text, text.row_indices[row], column))
    falls = np.flatnonzero(times_ns[1:] < times_ns[:-1])
    if falls.size:
        before = _cell(text, text.row_indices[int(falls[0])], column)
        refuse(int(falls[0]) + 1, f"is before the previous row's {before!r}: time must not decrease")
    return times_ns


def _find_uncertain_rows(times_s: FloatArray) -> IntArray:
    """Return the rows whose nanosecond a float does not determine: huge times, and those about half-way between two."""
    times_ns = times_s * NS_PER_S
    halfway = np.abs(np.abs(times_ns - np.rint(times_ns)) - 0.5) < 0.2
    return np.flatnonzero(halfway | (times_s > _SAFE_ROUNDING_S)).astype(np.int64)


def _cell(text: _Text, index: int, column: int) -> str:
    return text.lines[index].split(",")[column].strip()


def _to_exact_ns(cell: str) -> int:
    """Convert decimal seconds to the nearest nanosecond, halves to the even one."""
    return int((Decimal(cell) * NS_PER_S).quantize(Decimal(1), rounding=ROUND_HALF_EVEN))
