"""`vehicle-iface commission`: guided checks with a person in the vehicle, before it is first armed."""

import argparse
import logging
import select
import shutil
import sys
from collections.abc import Callable
from contextlib import closing
from datetime import date, datetime
from pathlib import Path

from vehicle_iface import clock
from vehicle_iface.arming import is_virtual
from vehicle_iface.cli.channels import find_channels
from vehicle_iface.cli.exit_status import CONTRADICTED, DONE, NOT_SEEN
from vehicle_iface.cli.files import check_writable, write_text
from vehicle_iface.cli.logging import CLEAR_LINE
from vehicle_iface.cli.option_types import EMBEDDED
from vehicle_iface.cli.signals import Flag, on_end_signals
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.codec.binding import Binding
from vehicle_iface.codec.database import build_database, load_binding
from vehicle_iface.commission.frame_log import FrameLog
from vehicle_iface.commission.readings import Moment, Readings
from vehicle_iface.commission.report import WORDS, Commissioning, render_page, summarize, to_json
from vehicle_iface.commission.steps import Step, build_steps
from vehicle_iface.commission.walk import Listener, Presenter, StepResult, Walk
from vehicle_iface.errors import ConfigError
from vehicle_iface.opening import Channels, open_buses, require_socketcan
from vehicle_iface.profile import Profile, load_profile
from vehicle_iface.profile.review_edit import require_editable, write_review
from vehicle_iface.profile.review_record import (
    ReviewRecord,
    find_changes,
    hash_checksums,
    hash_file,
    hash_files,
    hash_values,
)
from vehicle_iface.review.review import review_drive
from vehicle_iface.review.series import read_drive
from vehicle_iface.units import NS_PER_S

log = logging.getLogger("vehicle_iface")


def commission(options: argparse.Namespace) -> int:
    """Run the guided checks and write the report. If all checks pass, write the record of them into the profile."""
    profile = load_profile(options.profile)
    if options.interface == EMBEDDED:
        raise ConfigError("--interface embedded: nobody can move that vehicle; for a try use vehicle-iface sim")
    channels = find_channels(options.channels, profile, command="commission", interface=options.interface)
    require_socketcan(options.interface, profile)
    binding = load_binding(profile)
    if options.write:
        require_editable(Path(profile.file))
    for path, option in ((options.out, "--out"), (options.json, "--json")):
        if path:
            check_writable(path, option)
    now = datetime.fromtimestamp(clock.wall_ns() / NS_PER_S).astimezone()
    record = Path(options.record or f"{profile.name}-walk-{now:%Y%m%d-%H%M%S}.log")
    hashes = _Hashes(profile)
    end = Flag()
    on_end_signals(end.set)
    database = build_database(binding)
    with closing(
        open_buses(
            options.interface,
            channels,
            profile,
            received=(*database.received, *database.sent),  # those sent, too: review compares them with the motion
        )
    ) as bus:
        log.info("%s: listening, nothing is sent; frames are recorded to %s", bus.description, record)
        presenter = TerminalPresenter(is_ended=lambda: end.is_set)
        found = walk_and_review(binding, bus, presenter, record, channels=channels, step_timeout_s=options.step_timeout)
    on_end_signals(None)
    for line in summarize(found):
        print_safely(line)
    virtual = [channel for channel in channels.values() if is_virtual(options.interface, channel)]
    if found.is_sound and virtual:
        print_safely(f"not written: {' and '.join(virtual)}: a walk on a virtual bus proves nothing about the vehicle")
    is_written = (
        found.is_sound
        and not virtual
        and _offer_to_write(profile, hashes.make_record(found, now.date()), options.write)
    )
    if options.out:
        write_text(options.out, render_page(found), "--out")
    if options.json:
        write_text(options.json, to_json(found, is_written=is_written), "--json")
    return CONTRADICTED if found.contradictions else DONE if found.is_sound else NOT_SEEN


def walk_and_review(
    binding: Binding,
    bus: Listener,
    presenter: Presenter,
    record: Path,
    *,
    channels: Channels,
    step_timeout_s: float,
    now_ns: Callable[[], int] = clock.monotonic_ns,
) -> Commissioning:
    """Run all steps for the profile, then review the recorded log."""
    readings = Readings(binding, build_database(binding))
    steps = build_steps(binding, readings.labels)
    with FrameLog(record, channels.values(), wall_offset_ns=clock.wall_ns() - clock.monotonic_ns()) as frame_log:
        walk = Walk(bus, readings, frame_log.write, presenter, step_timeout_s=step_timeout_s, now_ns=now_ns)
        results = walk.go(steps)
    has_log = frame_log.count > 0
    log_channels = dict(zip(channels, frame_log.channels, strict=True))
    return Commissioning(
        profile_name=binding.profile.name,
        log_name=record.name if has_log else "",
        log_sha256=hash_file(record) if has_log else "",
        steps=results,
        review=review_drive(read_drive(record, binding.profile, channels=log_channels)) if has_log else None,
    )


class _Hashes:
    """The hashes of profile, DBCs and Python checksums when the checks began."""

    def __init__(self, profile: Profile) -> None:
        self._profile_sha256 = hash_values(Path(profile.file).read_text(encoding="utf-8"))
        self._dbc_sha256 = hash_files(profile.dbc_files)
        self._checksums_sha256 = hash_checksums(profile.checksum_files)

    def make_record(self, found: Commissioning, today: date) -> ReviewRecord:
        return ReviewRecord(
            date=today,
            checks=tuple(step.ask for step in found.steps),
            log=found.log_name,
            log_sha256=found.log_sha256,
            profile_sha256=self._profile_sha256,
            dbc_sha256=self._dbc_sha256,
            checksums_sha256=self._checksums_sha256,
        )


def _offer_to_write(profile: Profile, record: ReviewRecord, is_told_to: bool) -> bool:
    """Write the record if `--write` was given or the person agrees; return whether it was written."""
    path = Path(profile.file)
    try:
        require_editable(path)
    except ConfigError as error:
        print_safely(f"not written: {error}")
        return False
    if not is_told_to and not _confirm(f"Write reviewed = true and the record of this walk into {path}? [y/N] "):
        print_safely("not written: --write, or y, writes reviewed = true and the record of the walk into the profile")
        return False
    changes = find_changes(record, profile=path, dbcs=profile.dbc_files, checksums=profile.checksum_files)
    if changes:
        raise ConfigError(f"{' and '.join(changes)}: changed during the walk, nothing was written; walk again")
    write_review(path, record)
    print_safely(f"written: reviewed = true and [review] in {path}")
    return True


def _confirm(question: str) -> bool:
    if not sys.stdin.isatty():
        return False
    print_safely(question, end="")
    return sys.stdin.readline().strip().lower() in ("y", "yes")


class TerminalPresenter:
    """Shows the steps on standard output. On a terminal it updates one line in place, and Enter skips a step."""

    def __init__(self, *, is_ended: Callable[[], bool]) -> None:
        self._is_ended = is_ended
        self._in_place, self._has_keys = sys.stdout.isatty(), sys.stdin.isatty()

    def begin(self, step: Step, number: int, count: int) -> None:
        """Show the instruction of a step."""
        print_safely(f"{number}/{count}  {_capitalized(step.ask)}.{' Enter skips.' if self._has_keys else ''}")

    def show(self, step: Step, moment: Moment) -> None:
        """Show the current observation on one line."""
        if self._in_place:
            text = "     " + " · ".join(dict.fromkeys(check.show(moment) for check in step.checks))
            print_safely(CLEAR_LINE + text[: shutil.get_terminal_size().columns - 1], end="")

    def end(self, result: StepResult) -> None:
        """Show the result of a step."""
        clear = CLEAR_LINE if self._in_place else ""
        for one in result.results:
            print_safely(f"{clear}     {WORDS[one.judgement]}: {one.text}")
            clear = ""

    def wants_to_skip(self) -> bool:
        """Whether Enter was pressed."""
        if not self._has_keys or not select.select([sys.stdin], [], [], 0)[0]:
            return False
        if not sys.stdin.readline():
            self._has_keys = False  # end of input: nobody can skip any more
            return False
        return True

    def wants_to_end(self) -> bool:
        """Whether SIGINT or SIGTERM was received."""
        return self._is_ended()


def _capitalized(text: str) -> str:
    return text[0].upper() + text[1:]
