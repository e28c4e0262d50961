"""Bytes to numbers and back: the compiled codec beside cantools and a loop over signals as in opendbc.

Every message of every DBC in dbc/ without a multiplexer (the loop over signals knows none), with payloads of random
values in range. All decode to the same numbers and encode to the same bytes: proven before anything is timed. cantools
decodes without choices (numbers, not names) and encodes with its usual checks; the loop over signals has none. Ours is
`MessageCodec`: `checked` (as the program runs it: ranges, enumerations, finite) and unchecked; the targets are for the
checked one.

Takes 5 s; --quick 1 s.

Target: decoding at least 6 times as fast as cantools (geometric mean of a database), twice at the worst message;
encoding at least 5 times, and 3.5 times.
"""

import argparse
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from cantools.database import Message

from benchmarks.parts.inputs import DBC_FOLDER, is_same, random_values
from benchmarks.parts.per_signal import PerSignalCodec
from benchmarks.parts.report import BenchmarkError, Cell, Report, Table, Target, progress
from benchmarks.parts.timing import NS_PER_US, Spread, geometric_mean, interleaved, ratios
from vehicle_iface.codec import MessageCodec
from vehicle_iface.codec.dbc_file import read_dbc

PAYLOADS = 100
OURS, OURS_UNCHECKED, CANTOOLS, PER_SIGNAL = "ours", "ours unchecked", "cantools", "per signal"
COLUMNS = (
    "message",
    "signals",
    "bytes",
    f"{OURS} µs",
    f"{OURS_UNCHECKED} µs",
    f"{PER_SIGNAL} µs",
    f"{CANTOOLS} µs",
    "vs cantools",
    "p10",
    "p90",
    "unchecked vs cantools",
    "vs per signal",
)
Job = Callable[[], object]


@dataclass(frozen=True, slots=True)
class Measured:
    """One message, one direction."""

    row: Sequence[Cell]
    vs_cantools: float
    unchecked_vs_cantools: float
    vs_per_signal: float


def run(options: argparse.Namespace) -> Report:
    rounds = 15 if options.quick else 151
    tables: list[Table] = []
    targets: list[Target] = []
    for path in sorted(DBC_FOLDER.glob("*.dbc")):
        jobs = [_jobs(message) for message in read_dbc(path).messages.values() if not message.is_multiplexed()]
        for direction, worst_at_least, mean_at_least in (("decode", 2.0, 6.0), ("encode", 3.5, 5.0)):
            found = [_measured(message, job[direction], direction, rounds) for message, job in jobs]
            tables.append(Table(title=f"{path.name}: {direction}", columns=COLUMNS, rows=[*_rows(found)]))
            what = f"{path.name}: {direction}, checked, vs cantools"
            mean, worst = _mean(found), min(one.vs_cantools for one in found)
            targets.append(Target(what=f"{what}, geometric mean", value=mean, at_least=mean_at_least, unit="x"))
            targets.append(Target(what=f"{what}, worst message", value=worst, at_least=worst_at_least, unit="x"))
    method = (
        f"{rounds} rounds in which each codec in turn works off the same {PAYLOADS} payloads; µs are medians for one "
        f"message, ratios are medians of each round's own ratio, p10 and p90 their tenths"
    )
    return Report(method=method, tables=tables, targets=targets)


def _jobs(message: Message) -> tuple[Message, Mapping[str, Mapping[str, Job]]]:
    """What each contestant has to do with one message, after a proof that they all come to the same."""
    values = random_values(message, PAYLOADS)
    checked, unchecked, per_signal = (
        MessageCodec(message),
        MessageCodec(message, checked=False),
        PerSignalCodec(message),
    )
    names = checked.names
    rows = [tuple(one[name] for name in names) for one in values]
    payloads = [message.encode(one) for one in values]
    for one, row, data in zip(values, rows, payloads, strict=True):
        _prove(
            message,
            cantools=is_same(message.decode(data, decode_choices=False), one),
            ours=is_same(checked.decode(data), row) and checked.encode(row) == data,
            ours_unchecked=is_same(unchecked.decode(data), row) and unchecked.encode(row) == data,
            per_signal=per_signal.decode(data) == one and per_signal.encode(one) == data,
        )
    decoded_by = {
        OURS: _each(checked.decode, payloads),
        OURS_UNCHECKED: _each(unchecked.decode, payloads),
        PER_SIGNAL: _each(per_signal.decode, payloads),
        CANTOOLS: _each(partial(message.decode, decode_choices=False), payloads),
    }
    encoded_by = {
        OURS: _each(checked.encode, rows),
        OURS_UNCHECKED: _each(unchecked.encode, rows),
        PER_SIGNAL: _each(per_signal.encode, values),
        CANTOOLS: _each(message.encode, values),
    }
    return message, {"decode": decoded_by, "encode": encoded_by}


def _prove(message: Message, **same: bool) -> None:
    wrong = [name.replace("_", " ") for name, is_same in same.items() if not is_same]
    if wrong:
        raise BenchmarkError(f"{message.name}: {', '.join(wrong)}: not the same as the others")


def _each(call: Callable[..., object], inputs: Iterable[object]) -> Job:
    """One after the other, nothing kept: the thinnest loop that Python has."""
    return lambda: deque(map(call, inputs), maxlen=0)


def _measured(message: Message, jobs: Mapping[str, Job], direction: str, rounds: int) -> Measured:
    progress(f"codec: {message.name}, {direction}")
    took = interleaved(jobs, rounds)
    micros = {name: Spread.of(times).median / PAYLOADS / NS_PER_US for name, times in took.items()}
    vs_cantools = ratios(took[CANTOOLS], took[OURS])
    unchecked = ratios(took[CANTOOLS], took[OURS_UNCHECKED]).median
    vs_per_signal = ratios(took[PER_SIGNAL], took[OURS]).median
    row: Sequence[Cell] = (
        message.name,
        len(message.signals),
        message.length,
        *(micros[name] for name in (OURS, OURS_UNCHECKED, PER_SIGNAL, CANTOOLS)),
        *(vs_cantools.median, vs_cantools.p10, vs_cantools.p90, unchecked, vs_per_signal),
    )
    return Measured(row, vs_cantools.median, unchecked, vs_per_signal)


def _rows(found: Sequence[Measured]) -> list[Sequence[Cell]]:
    nothing = [None] * 6
    unchecked = geometric_mean(one.unchecked_vs_cantools for one in found)
    per_signal = geometric_mean(one.vs_per_signal for one in found)
    mean = ("geometric mean", *nothing, _mean(found), None, None, unchecked, per_signal)
    return [*(one.row for one in found), mean]


def _mean(found: Sequence[Measured]) -> float:
    return geometric_mean(one.vs_cantools for one in found)
