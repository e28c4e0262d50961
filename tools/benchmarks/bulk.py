"""A recording to columns: `vehicle_iface.logs` beside a loop of cantools over its frames.

A candump log of a million frames (every message of reference.dbc in turn, random values in range) is made in a
temporary folder; a second one has 20 000. Decoding alone: payloads that are in memory already, ours as a matrix for
each message, cantools' one after the other. With the log: from the file to columns, beside cantools' log reader and
`decode_message`, as its own command has it, and beside a plain loop over the lines (split, fromhex, decode); the peers
take part of the log, counted by frame. Ours checks ranges as the command `decode` does, cantools has none to check.
That the columns hold the very numbers that cantools gives is proven on the 20 000.

Takes 10 s; --quick 2 s (20 000 frames only).

Target: at least 20 times as many frames in a second as cantools, from 20 000 frames on.
"""

import argparse
import io
import tempfile
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import numpy as np
from cantools import logreader
from cantools.database import Message
from cantools.database.can import Database

from benchmarks.parts.inputs import DBC_FOLDER, is_same, random_values
from benchmarks.parts.report import BenchmarkError, Cell, Report, Table, Target, progress
from benchmarks.parts.timing import Spread, interleaved, ratios
from vehicle_iface.codec.dbc_file import read_dbc
from vehicle_iface.logs.bulk_codec import BulkCodec
from vehicle_iface.logs.columns import DecodedLog, decode_log
from vehicle_iface.logs.frames import Bytes

NS_PER_S = 1_000_000_000
FEW, MANY = 20_000, 1_000_000
PART = 5_000
"""Frames that a peer takes in one round."""
PAYLOADS = 500
"""Different ones of each message."""
OURS, CANTOOLS, LINES = "ours", "cantools", "plain loop"
AT_LEAST = 20.0


@dataclass(frozen=True, slots=True)
class Log:
    """Frames, in a file and in memory."""

    path: Path
    count: int
    database: Database
    part: Sequence[tuple[Message, bytes]]
    """Its first frames."""
    matrices: Mapping[str, Bytes]
    """(n, length) Payloads of each message."""


def run(options: argparse.Namespace) -> Report:
    database = Database(messages=list(read_dbc(DBC_FOLDER / "reference.dbc").messages.values()))
    rounds = 11 if options.quick else 31
    with tempfile.TemporaryDirectory(prefix="vehicle-iface-bench-") as folder:
        logs = [_log(database, count, Path(folder)) for count in ((FEW,) if options.quick else (FEW, MANY))]
        _prove(logs[0])
        measured = [(log, _measured(log, rounds if log.count == FEW else rounds // 3)) for log in logs]
    rows: list[Sequence[Cell]] = []
    targets: list[Target] = []
    for log, both in measured:
        for what, rates in both.items():
            speeds = [Spread.of(rates[name]).median if name in rates else None for name in (OURS, CANTOOLS, LINES)]
            ratio = ratios(rates[OURS], rates[CANTOOLS])
            lines = ratios(rates[OURS], rates[LINES]).median if LINES in rates else None
            rows.append((what, log.count, *speeds, ratio.median, ratio.p10, ratio.p90, lines))
            name = f"{what}, {log.count:,} frames, vs cantools"
            targets.append(Target(what=name, value=ratio.median, at_least=AT_LEAST, unit="x"))
    columns = ("what", "frames", *(f"{name}, frames/s" for name in (OURS, CANTOOLS, LINES)))
    columns = (*columns, "vs cantools", "p10", "p90", "vs plain loop")
    method = (
        f"{rounds} rounds ({rounds // 3} at a million), each contestant in turn; a peer takes {PART:,} frames a round; "
        "medians, and medians of each round's ratio"
    )
    return Report(method=method, tables=[Table(title="reference.dbc", columns=columns, rows=rows)], targets=targets)


def _measured(log: Log, rounds: int) -> dict[str, dict[str, list[float]]]:
    """Frames in a second, in each round, of decoding alone and with the log."""
    progress(f"bulk: {log.count} frames, {rounds} rounds")
    codecs = {message.name: BulkCodec(message, checked=True) for message in log.database.messages}
    head = log.path.read_text(encoding="ascii").splitlines(keepends=True)[:PART]
    alone: dict[str, Callable[[], object]] = {
        OURS: lambda: [codecs[name].decode(data) for name, data in log.matrices.items()],
        CANTOOLS: lambda: deque((message.decode(data, decode_choices=False) for message, data in log.part), maxlen=0),
    }
    with_log: dict[str, Callable[[], object]] = {
        OURS: partial(_decoded, log),
        CANTOOLS: lambda: deque(_read("".join(head), log.database), maxlen=0),
        LINES: lambda: deque(_loop(head, log.database), maxlen=0),
    }
    counts = {OURS: log.count, CANTOOLS: PART, LINES: PART}
    return {
        what: {
            name: [counts[name] * NS_PER_S / one for one in times] for name, times in interleaved(jobs, rounds).items()
        }
        for what, jobs in (("decoding alone", alone), ("with the log", with_log))
    }


def _decoded(log: Log) -> DecodedLog:
    return decode_log(log.path, log.database.messages, checked=True)


def _loop(lines: Sequence[str], database: Database) -> Iterator[tuple[float, object]]:
    """As one writes it without a log reader."""
    for line in lines:
        stamp, _, frame = line.split()
        can_id, _, payload = frame.partition("#")
        message = database.get_message_by_frame_id(int(can_id, 16))
        yield float(stamp[1:-1]), message.decode(bytes.fromhex(payload), decode_choices=False)


def _read(text: str, database: Database) -> Iterator[object]:
    for frame in logreader.Parser(io.StringIO(text)):
        yield database.decode_message(frame.frame_id, frame.data, decode_choices=False)


def _log(database: Database, count: int, folder: Path) -> Log:
    """Every message in turn, 0.5 ms apart."""
    progress(f"bulk: making a log of {count} frames")
    payloads = {
        message.name: [message.encode(values) for values in random_values(message, PAYLOADS)]
        for message in database.messages
    }
    round_robin = [
        (message, payloads[message.name][number]) for number in range(PAYLOADS) for message in database.messages
    ]
    path = folder / f"{count}.candump"
    with path.open("w", encoding="ascii") as file:
        for number, (message, data) in enumerate(islice(cycle(round_robin), count)):
            seconds, micros = divmod(number * 500, 1_000_000)
            file.write(f"({1_700_000_000 + seconds}.{micros:06d}) vcan0 {message.frame_id:03X}#{data.hex().upper()}\n")
    frames = list(islice(cycle(round_robin), count))
    matrices = {
        message.name: np.frombuffer(b"".join(data for other, data in frames if other is message), np.uint8).reshape(
            -1, message.length
        )
        for message in database.messages
    }
    return Log(path, count, database, frames[:PART], matrices)


def _prove(log: Log) -> None:
    """The columns are what cantools gives frame by frame, in the log's order; nothing is lost or refused."""
    progress("bulk: proving that both decode to the same")
    expected: dict[str, list[Any]] = {message.name: [] for message in log.database.messages}
    with log.path.open(encoding="ascii") as lines:
        for frame in logreader.Parser(lines):
            message = log.database.get_message_by_frame_id(frame.frame_id)
            expected[message.name].append(message.decode(frame.data, decode_choices=False))
    recording = _decoded(log)
    if recording.decoded != log.count or recording.refused:
        raise BenchmarkError(f"{recording.decoded} of {log.count} frames decoded, {len(recording.refused)} refused")
    for message in log.database.messages:
        alone = BulkCodec(message, checked=True).decode(log.matrices[message.name])
        columns = recording.messages[message.name]
        bad = [name for name, is_bad in (*columns.out_of_range.items(), *alone.out_of_range.items()) if is_bad.any()]
        if bad:
            raise BenchmarkError(f"{message.name}: {', '.join(bad)} out of range")
        for signal in message.signals:
            wanted = [values[signal.name] for values in expected[message.name]]
            for values in (columns.values[signal.name], alone.values[signal.name]):
                if not is_same(values.tolist(), wanted):
                    raise BenchmarkError(f"{message.name}.{signal.name}: not what cantools gives")
