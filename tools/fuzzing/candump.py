"""Recordings: candump logs to columns.

Law: each line is counted exactly once, and it does not matter how the log is cut into chunks.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fuzzing.engine.input_bytes import written
from vehicle_iface.codec.dbc_file import read_dbc
from vehicle_iface.errors import ConfigError
from vehicle_iface.logs import candump, columns
from vehicle_iface.logs.reading import open_log
from vehicle_iface.profile import load_profile

LENGTH = 1024
_MESSAGES = [
    *{
        message.frame_id: message
        for name in ("reference_fd", "reference")
        for message in read_dbc(Path(load_profile(name).dbc)).messages.values()
    }.values()
]
_CHUNKS = (candump.CHUNK_BYTES, 48)


def run(data: bytes) -> None:
    path = written("log", data)
    try:
        whole, pieces = (_decoded(path, size) for size in _CHUNKS)
    except ConfigError:  # the first bytes are those of another kind of file
        return
    accounted = (
        whole.decoded + whole.foreign + whole.remote + whole.errors + whole.blank + whole.comments + len(whole.refused)
    )
    assert whole.lines == accounted, "a line was counted twice, or not at all"
    assert [*columns.summarize(whole)] == [*columns.summarize(pieces)]
    assert whole.refused == pieces.refused
    ours, theirs = columns.to_arrays(whole), columns.to_arrays(pieces)
    assert ours.keys() == theirs.keys()
    for name, column in ours.items():
        assert column.dtype != object, name
        assert np.array_equal(column, theirs[name], equal_nan=column.dtype == np.float64), name


def _decoded(path: Path, chunk_bytes: int) -> columns.DecodedLog:
    candump.CHUNK_BYTES = chunk_bytes
    return columns.scan_log(open_log(path), _MESSAGES, checked=True)


def seeds() -> Iterator[bytes]:
    yield b"(1700000000.000001) vcan0 110#0011223344556677\n(1700000000.000001234) can0 1A0##1" + b"00" * 16 + b"\n"
    yield b"(0.000000) vcan0 12345678#\n\n(0.1) vcan0 110#R\n(0.000000) vcan0 20000040#0000000000000000\n"
    yield b"(1.000000) vcan0 110#R8\r\n (1.000000) vcan0 110#00\nrubbish\n(1.000000) vcan0 110#0011223344556677 R"
    yield b" (000.000000)  vcan0  110   [8]  00 11 22 33 44 55 66 77\n (000.010000)  vcan0  1A0  [12] 00 11\n\terror\n"
    yield b"  vcan0  110   [8]  00 11 22 33 44 55 66 77\n  vcan0  20000004   [2]  00 11                 ERRORFRAME\n"
    lines = (f"(1.{number:06}) vcan0 {message.frame_id:03X}" for number, message in enumerate(_MESSAGES))
    for line, message in zip(lines, _MESSAGES, strict=True):
        yield f"{line}{'##1' if message.is_fd else '#'}{'00' * message.length}\n".encode()
