"""The plan of defects, `tools/bench_defects.toml`: what each controller does wrong, and which cases must catch it."""

import hashlib
from collections.abc import Collection, Sequence
from pathlib import Path

import msgspec
from promise_testing.project_copy import PlanError, changed_source

ROOT = Path(__file__).resolve().parents[2]
PLAN = ROOT / "tools" / "bench_defects.toml"
MINIMAL = "tests/hil_bench/"
"""Files of the minimal controller."""


class Defect(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One thing that a controller does wrong: a change of a file, or a flag of the minimal controller."""

    id: str
    does: str
    """A predicate whose subject is the controller."""
    cases: tuple[str, ...] = ()
    """Those expected to catch it."""
    not_visible: str = ""
    """Why the bus cannot show it."""
    file: str = ""
    """Below the root of the project."""
    was: str = ""
    """Occurs exactly once in the file."""
    becomes: str = ""
    flag: str = ""
    timing: bool = False
    """It shows only in the lateness of answers."""
    process: bool = False
    """It shows only in the process: its memory, its exit status. Virtual time does not have it."""
    unseen: bool = False
    """Written without looking at the cases: it may have none, and is then measured with the whole catalogue."""

    @property
    def label(self) -> str:
        """What errors name it by."""
        return self.id

    @property
    def is_minimal(self) -> bool:
        """Whether it is the minimal controller's, not the program's."""
        return bool(self.flag) or self.file.startswith(MINIMAL)

    @property
    def is_visible(self) -> bool:
        """Whether the bus can show it."""
        return not self.not_visible

    @property
    def digest(self) -> str:
        """Changes with the defect, not with its description or its cases."""
        parts = (self.file, self.was, self.becomes, self.flag, str(self.timing))
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:12]


class Plan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All defects."""

    defect: tuple[Defect, ...]


def load_plan(path: Path = PLAN) -> tuple[Defect, ...]:
    """Raises `PlanError` for a file that is no plan."""
    try:
        return msgspec.toml.decode(path.read_bytes(), type=Plan).defect
    except msgspec.DecodeError as error:
        raise PlanError(f"{path}: {error}") from None


def find_faults(
    defects: Sequence[Defect], cases: Collection[str], flags: Collection[str], root: Path = ROOT
) -> list[str]:
    """What does not fit code and catalogue: each change, flag and case must exist; each name only once."""
    faults, seen = [], set[str]()
    for defect in defects:
        if defect.id in seen:
            faults.append(f"{defect.id}: named twice")
        seen.add(defect.id)
        faults += [f"{defect.id}: no such case: {case}" for case in defect.cases if case not in cases]
        if bool(defect.cases) + bool(defect.not_visible) != 1 and not defect.unseen:
            faults.append(f"{defect.id}: needs either cases or not_visible")
        if bool(defect.flag) == bool(defect.file):
            faults.append(f"{defect.id}: needs either file, was and becomes, or flag")
        elif defect.flag and defect.flag not in flags:
            faults.append(f"{defect.id}: no such flag: {defect.flag}")
        elif defect.file:
            try:
                changed_source(defect, (root / defect.file).read_text(encoding="utf-8"))
            except (PlanError, OSError) as error:
                faults.append(str(error))
    return faults


def draw_sample(defects: Sequence[Defect], count: int) -> list[Defect]:
    """So many of them, by chance and each time the same."""
    return sorted(defects, key=lambda defect: hashlib.sha256(defect.id.encode()).digest())[:count]
