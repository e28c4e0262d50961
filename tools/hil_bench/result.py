"""Results of the bench: data that is stored as JSON and from which all reports are made.

Times are seconds from the beginning of a case unless they say otherwise; None where there is nothing to say.
"""

import json
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Literal

import msgspec

SCHEMA = Path(__file__).with_name("results.schema.json")


class Verdict(StrEnum):
    """Of a check, a case or a run."""

    PASS = "PASS"
    FAIL = "FAIL"
    NOT_EXECUTED = "NOT EXECUTED"
    NOT_APPLICABLE = "NOT APPLICABLE"
    """The vehicle does not have what is required; says nothing about the device."""


class Evidence(StrEnum):
    """What a result is evidence of. A virtual bus gives no evidence about hardware."""

    VIRTUAL_BUS = "virtual bus, simulated vehicle"
    REAL_BUS = "real bus, simulated vehicle"
    REAL_VEHICLE = "real bus, real vehicle"


class EventKind(StrEnum):
    """Kind of an event on the time line."""

    PREPARATION = "preparation"
    INJECTION = "injection"
    END_OF_INJECTION = "end of injection"
    DETECTION = "detection"
    """The device shows on the bus that it has detected the fault: a reason, ENABLE = 0, silence."""
    REACTION = "reaction"
    """The first command with the required reaction."""
    STANDSTILL = "standstill"
    CLEAN_UP = "clean-up"
    VIOLATION = "violation"
    """A failed check's first finding."""


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """One instant on a case's time line."""

    at_s: float
    kind: EventKind
    text: str


class Check(msgspec.Struct, frozen=True, kw_only=True):
    """One requirement and its verdict."""

    text: str
    """The requirement."""
    verdict: Verdict
    measured: float | None = None
    limit: float | None = None
    """Maximum of `measured`."""
    unit: str = ""
    found: list[str] = []
    """The first violations, each with its time."""


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    """Where the device really acts, beside the profile's threshold."""

    name: str
    """Of the threshold, in words."""
    unit: str
    acts_at: float | None
    """None: it did not act."""
    profile: float
    """The threshold as the profile has it, or as it follows from the profile."""
    lowest: float | None
    """Tolerance: `acts_at` must not be below; None: it may."""
    highest: float | None
    """Tolerance: `acts_at` must not be above; None: it may."""
    place: str = ""
    """Direction, speed and bend at which it was measured."""
    key: str = ""
    """Of the profile: table and key."""

    @property
    def verdict(self) -> Verdict:
        """PASS within the tolerance."""
        if self.acts_at is None:
            return Verdict.FAIL
        is_above = self.highest is not None and self.acts_at > self.highest
        is_below = self.lowest is not None and self.acts_at < self.lowest
        return Verdict.FAIL if is_above or is_below else Verdict.PASS


class Distribution(msgspec.Struct, frozen=True, kw_only=True):
    """Many measurements of one quantity."""

    name: str
    unit: str
    count: int
    p50: float
    p95: float
    p99: float
    max: float
    edges: list[float]
    """Edges of the histogram's bins, one more than `counts`."""
    counts: list[int]
    limit: float | None = None


class Series(msgspec.Struct, frozen=True, kw_only=True):
    """One line of a plot."""

    name: str
    at_s: Sequence[float]
    values: Sequence[float | None]
    """None, and in JSON also NaN and infinity: a gap."""


class Plot(msgspec.Struct, frozen=True, kw_only=True):
    """Lines over time, with the limits that hold for them."""

    title: str
    unit: str
    series: list[Series]
    lowest: float | None = None
    highest: float | None = None
    lowest_at: Series | None = None
    """A lower limit that varies, in place of `lowest`; likewise `highest_at`."""
    highest_at: Series | None = None


class Strip(msgspec.Struct, frozen=True, kw_only=True):
    """A signal with named values over time."""

    name: str
    at_s: list[float]
    values: list[str]
    """Each from its time until the next one; empty: none."""


class Path2D(msgspec.Struct, frozen=True, kw_only=True):
    """The route and where the vehicle went, m."""

    wanted_x_m: list[float]
    wanted_y_m: list[float]
    driven_x_m: list[float]
    driven_y_m: list[float]


class CaseResult(msgspec.Struct, frozen=True, kw_only=True):
    """Result of one repetition of a case."""

    name: str
    proves: str
    """One sentence."""
    fault: str = ""
    """Its row in the catalogue of faults: B1, S4, …; empty for a manoeuvre or a measurement."""
    tags: list[str] = []
    verdict: Verdict
    why: str = ""
    """FAIL: the first failed check; NOT EXECUTED: what is missing; NOT APPLICABLE: what the vehicle has not."""
    evidence: Evidence
    repetition: int = 1
    seed: int = 0
    began_s: float = 0.0
    """From the beginning of the run."""
    duration_s: float = 0.0
    lateness: str = ""
    """How late bench and host were; empty if they were not."""
    void: list[str] = []
    """Of each earlier attempt that had no result: how late bench and host were."""
    injected: str = ""
    """The injected fault."""
    checks: list[Check] = []
    events: list[Event] = []
    measured: list[Measured] = []
    distributions: list[Distribution] = []
    plots: list[Plot] = []
    path: Path2D | None = None
    counts: dict[str, int] = {}
    """Frames, samples, commands, losses, counter gaps, …"""
    spent_s: dict[str, float] = {}
    """Where the time went, by stage: start of the device, engaging, …"""
    strips: list[Strip] = []
    candump: str = ""
    """File with every frame, relative to the report's folder."""
    device_log: str = ""
    """File with the device's output, relative to the report's folder."""
    recording: str = ""
    """Folder in which the device recorded the drive, relative to the report's folder."""
    page: str = ""
    """File that shows the drive, or that says why there is none, relative to the report's folder."""


class FaultRow(msgspec.Struct, frozen=True, kw_only=True):
    """A row of the catalogue of faults, and which cases of the whole catalogue inject it."""

    row: str
    """B1, S4, …"""
    text: str
    cases: list[str]
    why_none: str = ""
    """Why it cannot be injected on a bus, where that is known."""


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """Result of the selected cases."""

    format: Literal[1] = 1
    """Changes when an older reader would misunderstand; any other value is rejected."""
    verdict: Verdict
    """FAIL if any case failed; NOT EXECUTED if none was executed or the run was interrupted; else PASS.

    NOT APPLICABLE if no case applies to the vehicle.
    """
    strict: bool = False
    """A case that was not executed counts as a failure."""
    interrupted: str = ""
    """In which case of how many; empty for a complete run."""
    evidence: Evidence
    began: str
    """Wall clock, ISO 8601 with the offset to UTC."""
    duration_s: float
    command: str
    """The command line."""
    channel: str
    profile: str
    profile_hash: str
    """SHA-256 of the profile's TOML and DBC."""
    device: str
    """How the device under test was started."""
    device_version: str = ""
    """What it says itself."""
    device_hash: str = ""
    """SHA-256 of the files that the command names."""
    seed: int
    environment: dict[str, str]
    """Host, kernel, processors, adapter, Python, versions of the libraries, revision of the bench."""
    faults: list[FaultRow] = []
    """Rows of the catalogue of faults."""
    cases: list[CaseResult]


def schema() -> str:
    """JSON schema of results.json, which is also beside this module in `SCHEMA`."""
    return json.dumps(msgspec.json.schema(Run), indent=1, ensure_ascii=False)


def verdict_of(cases: list[CaseResult], *, interrupted: str = "") -> Verdict:
    """Verdict of a list of cases; an interrupted run never passes."""
    verdicts = {case.verdict for case in cases}
    if interrupted:
        verdicts.discard(Verdict.PASS)
    if verdicts == {Verdict.NOT_APPLICABLE}:
        return Verdict.NOT_APPLICABLE
    return next((v for v in (Verdict.FAIL, Verdict.PASS) if v in verdicts), Verdict.NOT_EXECUTED)


def judge_strictly(run: Run) -> Run:
    """The run in which a case that was not executed counts as a failure; an interrupted one keeps its verdict."""
    is_lacking = any(case.verdict is Verdict.NOT_EXECUTED for case in run.cases) and not run.interrupted
    return msgspec.structs.replace(run, strict=True, verdict=Verdict.FAIL if is_lacking else run.verdict)


def write(run: Run, path: Path) -> None:
    """As JSON. Raises `msgspec.MsgspecError` for what could not be read again (NaN)."""
    encoded = msgspec.json.encode(run)
    msgspec.json.decode(encoded, type=Run)
    path.write_bytes(encoded + b"\n")


def read(path: Path) -> Run:
    """Raises `msgspec.MsgspecError` with the place, and `OSError`."""
    return msgspec.json.decode(path.read_bytes(), type=Run)
