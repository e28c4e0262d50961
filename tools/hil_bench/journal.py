"""The journal of a run: what was executed is on the disk at once, so that an interrupted run can be continued.

The first line of `unfinished.jsonl` says what is run, each further line is the result of one case. It is removed when
the run is complete and its reports are written.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from hil_bench.identity import Device
from hil_bench.result import CaseResult, Verdict

NAME = "unfinished.jsonl"
EXECUTED = (Verdict.PASS, Verdict.FAIL)
"""Any other result may be different now."""


class JournalError(Exception):
    """A run cannot be continued, and why."""


class Header(msgspec.Struct, frozen=True, kw_only=True):
    """What must be the same for results to belong together."""

    format: int = 1
    arguments: list[str]
    """The command line."""
    folder: str
    """In which that command line was given."""
    began: str
    device: Device
    bench_hash: str
    profile: str
    profile_hash: str
    seed: int
    channel: str

    def describe_differences(self, other: "Header") -> list[str]:
        """What is different now, for people; empty if results of both belong together."""
        pairs = {
            "the device's command": (self.device.command, other.device.command),
            "the device's version": (self.device.version, other.device.version),
            "the device's files (SHA-256)": (self.device.hash[:12], other.device.hash[:12]),
            "the bench's files (SHA-256)": (self.bench_hash[:12], other.bench_hash[:12]),
            "the profile": (self.profile, other.profile),
            "the profile's files (SHA-256)": (self.profile_hash[:12], other.profile_hash[:12]),
            "the seed": (str(self.seed), str(other.seed)),
            "the channel": (self.channel, other.channel),
        }
        return [
            f"{what}: {then or 'unknown'} then, {now or 'unknown'} now"
            for what, (then, now) in pairs.items()
            if then != now
        ]


class Journal:
    """Of one run; `kept` are the results of an earlier part of it."""

    def __init__(self, path: Path, header: Header, kept: Sequence[CaseResult] = ()) -> None:
        self.header = header
        self._path = path
        self._kept: Mapping[tuple[str, int], CaseResult] = {(case.name, case.repetition): case for case in kept}

    @classmethod
    def begin(cls, folder: Path, header: Header) -> "Journal":
        """A new journal. Raises `OSError`."""
        folder.mkdir(parents=True, exist_ok=True)
        journal = cls(folder / NAME, header)
        journal._append(header)
        return journal

    @classmethod
    def resume(cls, folder: Path, header: Header) -> "Journal":
        """The journal in `folder`, if it is about the same. Raises `JournalError` and `OSError`."""
        before, results = read_journal(folder)
        different = before.describe_differences(header)
        if different:
            raise JournalError(f"{folder}: cannot be continued: {'; '.join(different)}; choose a new folder with --out")
        path = folder / NAME
        kept = [case for case in results if case.verdict in EXECUTED]
        fresh = path.with_suffix(".new")
        fresh.write_bytes(b"".join(msgspec.json.encode(one) + b"\n" for one in (before, *kept)))
        fresh.replace(path)
        return cls(path, before, kept)

    @property
    def elapsed_s(self) -> float:
        """Time of the earlier part of the run."""
        return max((case.began_s + case.duration_s for case in self._kept.values()), default=0.0)

    def find(self, name: str, repetition: int) -> CaseResult | None:
        """The result of a case that was executed before."""
        return self._kept.get((name, repetition))

    def add(self, case: CaseResult) -> None:
        """Write a result to the disk. Raises `OSError`."""
        self._append(case)

    def _append(self, entry: Header | CaseResult) -> None:
        with open(self._path, "ab") as file:
            file.write(msgspec.json.encode(entry) + b"\n")
            file.flush()
            os.fdatasync(file.fileno())


def read_journal(folder: Path) -> tuple[Header, list[CaseResult]]:
    """The journal in a folder; a line that was not written to its end is left out. Raises `JournalError`."""
    try:
        first, *lines = (folder / NAME).read_bytes().split(b"\n")[:-1]
        return msgspec.json.decode(first, type=Header), [msgspec.json.decode(line, type=CaseResult) for line in lines]
    except FileNotFoundError:
        raise JournalError(f"{folder}: holds no interrupted run ({NAME} is missing)") from None
    except (OSError, ValueError, msgspec.MsgspecError) as error:
        raise JournalError(f"{folder / NAME}: cannot be read: {error}") from None


def remove_journal(folder: Path) -> None:
    """Nothing is left to be continued. Raises `OSError`."""
    (folder / NAME).unlink(missing_ok=True)
