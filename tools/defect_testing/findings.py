"""What was measured so far, kept in a file so that an interrupted measurement continues."""

from enum import StrEnum
from pathlib import Path

import msgspec

from defect_testing.plan import ROOT, Defect

FILE = ROOT / "tools" / "bench_defects.json"


class Scope(StrEnum):
    """Which cases were run."""

    NAMED = "named"
    """Those that the plan expects to catch the defect."""
    QUICK = "quick"
    WHOLE = "whole"
    VIRTUAL_NAMED = "named, in virtual time"
    VIRTUAL_QUICK = "quick, in virtual time"
    VIRTUAL_WHOLE = "whole, in virtual time"

    @property
    def is_virtual(self) -> bool:
        """Whether the program's loop was run alone, without vcan0."""
        return self in (Scope.VIRTUAL_NAMED, Scope.VIRTUAL_QUICK, Scope.VIRTUAL_WHOLE)

    @property
    def is_quick(self) -> bool:
        return self in (Scope.QUICK, Scope.VIRTUAL_QUICK)

    @property
    def is_named(self) -> bool:
        return self in (Scope.NAMED, Scope.VIRTUAL_NAMED)

    @property
    def is_whole(self) -> bool:
        return self in (Scope.WHOLE, Scope.VIRTUAL_WHOLE)


class Outcome(msgspec.Struct, frozen=True):
    """What the bench found, of cases that were all executed as far as the first failure."""

    case: str = ""
    """The case that failed; empty: none."""
    check: str = ""
    """The check of it that failed, and how."""
    cases: tuple[str, ...] = ()
    """Those that were to run."""


class Entry(msgspec.Struct):
    """What is known of one defect."""

    digest: str
    outcomes: dict[Scope, Outcome] = {}


class Findings(msgspec.Struct):
    """What is known: by defect, and by device and case whether the sound device passes it."""

    defects: dict[str, Entry] = {}
    sound: dict[str, bool] = {}

    @classmethod
    def read(cls, path: Path = FILE) -> "Findings":
        """Empty where there is no such file."""
        return msgspec.json.decode(path.read_bytes(), type=cls) if path.exists() else cls()

    def write(self, path: Path = FILE) -> None:
        """Replace the file as a whole."""
        content = msgspec.json.format(msgspec.json.encode(self, order="sorted"), indent=1)
        part = path.with_suffix(".part")
        part.write_bytes(content + b"\n")
        part.replace(path)

    def outcome(self, defect: Defect, scope: Scope) -> Outcome | None:
        """None where it was not measured, has changed since, or was caught by a case that the sound device fails."""
        entry = self.defects.get(defect.id)
        if entry is None or entry.digest != defect.digest:
            return None
        found = entry.outcomes.get(scope)
        is_other = scope.is_named and found is not None and not found.case and found.cases != defect.cases
        is_unsound = found is not None and found.case and not self.is_sound(defect, found.case, scope)
        return None if is_other or is_unsound else found

    def note(self, defect: Defect, scope: Scope, outcome: Outcome) -> None:
        """Replaces what was known, and all of it where the defect has changed."""
        entry = self.defects.get(defect.id)
        if entry is None or entry.digest != defect.digest:
            entry = self.defects[defect.id] = Entry(defect.digest, {})
        entry.outcomes[scope] = outcome

    def catch(
        self, defect: Defect, *, quick: frozenset[str] | None = None, virtual: bool = True
    ) -> tuple[Scope, Outcome] | None:
        """What caught the defect, on vcan0 if there; with `quick`, which of these cases. None where nothing did.

        A case that the sound device fails, too, catches nothing. Without `virtual`, virtual time does not count.
        """
        for scope in Scope:
            found = self.outcome(defect, scope)
            if found is None or not found.case or (scope.is_virtual and not virtual):
                continue
            if quick is None or found.case in quick:
                return scope, found
        return None

    def was_caught(self, defect: Defect, *, virtual: bool) -> bool:
        """Whether it was caught in virtual time, or else on vcan0."""
        found = [self.outcome(defect, scope) for scope in Scope if scope.is_virtual is virtual]
        return any(one is not None and one.case for one in found)

    def is_judged(self, defect: Defect, scope: Scope) -> bool:
        """Whether it is known that the defect is, or is not, caught by these cases."""
        return self.outcome(defect, scope) is not None

    def is_sound(self, defect: Defect, case: str, scope: Scope) -> bool:
        """Whether the device without defects passes this case, as far as is known."""
        return self.sound.get(sound_key(defect, case, scope), True)


def sound_key(defect: Defect, case: str, scope: Scope) -> str:
    """Of `Findings.sound`; for a defect of timing the device must have been in time as well."""
    device = "minimal" if defect.is_minimal else "program"
    return f"{device} {case}{', in time' if defect.timing else ''}{', in virtual time' if scope.is_virtual else ''}"
