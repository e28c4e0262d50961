"""Continues an interrupted run: its command line again, and the results that it has already."""

import argparse
import datetime
import os
import sys
from pathlib import Path

from hil_bench.bench_config import BenchConfig
from hil_bench.identity import hash_bench, identify_device
from hil_bench.journal import NAME, Header, Journal, JournalError, read_journal

WITH_RESUME = ("resume", "json", "strict")
"""Options that may stand beside --resume; the interrupted run has all others."""


def restore_options(parser: argparse.ArgumentParser, options: argparse.Namespace) -> argparse.Namespace:
    """The options of the run in `options.resume`, in whose working directory the bench then is.

    Raises `JournalError` if there is none, or if other options are given.
    """
    defaults = vars(parser.parse_args([]))
    others = [name for name, value in vars(options).items() if name not in WITH_RESUME and value != defaults[name]]
    if others:
        named = ", ".join(f"--{name.replace('_', '-')}" for name in others)
        raise JournalError(f"--resume {options.resume}: continues with the options of that run; leave out {named}")
    folder = Path(options.resume).resolve()
    header, _ = read_journal(folder)
    os.chdir(header.folder)
    restored = parser.parse_args(header.arguments)
    restored.resume, restored.out, restored.arguments = str(folder), str(folder), header.arguments
    restored.json, restored.strict = restored.json or options.json, restored.strict or options.strict
    return restored


def check_folder(folder: Path) -> None:
    """Raise `JournalError` unless a new run can be written there."""
    if (folder / NAME).exists():
        raise JournalError(f"--out {folder}: holds an interrupted run; continue it with --resume {folder}")
    if folder.exists() and any(folder.iterdir()):
        raise JournalError(f"--out {folder}: is not empty; choose a new folder")


def open_journal(options: argparse.Namespace, config: BenchConfig) -> Journal:
    """The journal of a new run, or that of the run to be continued. Raises `JournalError` and `OSError`."""
    header = Header(
        arguments=options.arguments,
        folder=str(Path.cwd()),
        began=datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        device=identify_device(config.commands, options.device_version),
        bench_hash=hash_bench(),
        profile=config.wire.name,
        profile_hash=config.wire.hash,
        seed=config.seed,
        channel=config.described_channels,
    )
    folder = config.folder.parent
    return Journal.resume(folder, header) if options.resume else Journal.begin(folder, header)


def describe_interruption(reason: str, folder: Path) -> str:
    """For the error output."""
    return f"{reason}; links, clock, cables and disks are restored; continue with: {sys.argv[0]} --resume {folder}"
