"""How late the bench and its host were in a case: what may explain that a device was late.

Three witnesses: the bench's own ticks; a process of usual priority (`witness`), which sees what the host withholds from
any process; and the kernel's count of how long the device's threads waited for a processor (`/proc/PID/schedstat`).
"""

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from vehicle_bus_contract.reference import MS, S

from hil_bench import witness

WITHHELD_NS = 20 * MS
"""A process that is kept waiting for longer than this answers a sample two periods late."""
NOTICED_MS = 0.1
LOOK_NS, FIND_NS = 100 * MS, 10 * S
OWN_SHARE = 0.5
"""A device that runs for more than this share of the time keeps itself waiting, and the witness as well."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """Something that came late, and by how much."""

    at_s: float
    """On the case's time line: when it came."""
    by_s: float
    what: str

    def __str__(self) -> str:
        return f"{self.what} {self.by_s * 1e3:.0f} ms late at {self.at_s:.3f} s"


@dataclass(frozen=True, slots=True, kw_only=True)
class Lateness:
    """All that bench and host were late by in one case."""

    delays: Sequence[Delay] = ()
    """Each longer than what is harmless."""
    usual_s: float = 0.0
    """By which the host delays any process on average, beyond what is usual."""

    @property
    def worst(self) -> Delay | None:
        """The longest delay."""
        return max(self.delays, key=lambda delay: delay.by_s, default=None)

    def describe(self) -> str:
        """The worst delay, or the usual one, in words; empty if neither is worth a word."""
        if self.delays:
            more = f" ({len(self.delays)} delays)" if len(self.delays) > 1 else ""
            return f"{self.worst}{more}"
        usual_ms = self.usual_s * 1e3
        return f"any process got its processor {usual_ms:.1f} ms late on average" if usual_ms >= NOTICED_MS else ""


@dataclass(frozen=True, slots=True)
class Wait:
    """What the device's threads did until `at_ns`, for about `LOOK_NS`."""

    at_ns: int
    waited_ns: int
    """The one that waited longest."""
    ran_share: float
    """Of one processor's time, by all of them."""


@dataclass
class DeviceWatch:
    """Looks at the device's processes ten times a second: waits of its threads, and its memory."""

    find_processes: Callable[[], Sequence[int]]
    waits: list[Wait] = field(default_factory=list)
    memory: list[tuple[int, int]] = field(default_factory=list)
    """Monotonic time, ns, and bytes of its own (not of files), once a second."""

    def __post_init__(self) -> None:
        self._found_ns = self._looked_ns = -FIND_NS
        self._threads: dict[int, tuple[int, int]] = {}
        self._memory_of: list[int] = []

    def look(self, now_ns: int) -> None:
        """Do nothing until it is time. A process that has ended counts no longer."""
        if now_ns - self._looked_ns < LOOK_NS:
            return
        if now_ns - self._found_ns >= FIND_NS:
            self._found_ns = now_ns
            self._open()
        past_ns, self._looked_ns = now_ns - self._looked_ns, now_ns
        waited_ns = ran_ns = 0
        for number, before in self._threads.items():
            with suppress(OSError, ValueError):
                ran, waited, _ = map(int, os.pread(number, 96, 0).split())
                ran_ns, waited_ns = ran_ns + ran - before[0], max(waited_ns, waited - before[1])
                self._threads[number] = (ran, waited)
        if self._threads:
            self.waits.append(Wait(now_ns, waited_ns, ran_ns / past_ns))
        if self._memory_of and (not self.memory or now_ns - self.memory[-1][0] >= S):
            self.memory.append((now_ns, sum(map(_own_bytes, self._memory_of))))

    def close(self) -> None:
        """May be called twice."""
        for number in (*self._threads, *self._memory_of):
            os.close(number)
        self._threads, self._memory_of = {}, []

    def _open(self) -> None:
        self.close()
        for process in self.find_processes():
            with suppress(OSError):
                self._memory_of.append(os.open(f"/proc/{process}/statm", os.O_RDONLY))
            for file in Path(f"/proc/{process}/task").glob("*/schedstat"):
                with suppress(OSError, ValueError):
                    number = os.open(file, os.O_RDONLY)
                    self._threads[number] = (0, 0)
                    ran, waited, _ = map(int, os.pread(number, 96, 0).split())
                    self._threads[number] = (ran, waited)


class Witness:
    """The process `witness`, and what it wrote."""

    def __init__(self) -> None:
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  (closed by `close`)
        command = [sys.executable, "-S", "-E", witness.__file__]
        self._process = subprocess.Popen(command, stdout=self._output, stdin=subprocess.DEVNULL, start_new_session=True)

    def close(self) -> list[tuple[int, int, int]]:
        """End it; returns its records. May be called twice."""
        if self._output.closed:
            return []
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()
        self._output.seek(0)
        written = self._output.read()
        self._output.close()
        whole = len(written) - len(written) % witness.RECORD.size
        return [(at, worst, total) for at, worst, total in witness.RECORD.iter_unpack(written[:whole])]


def sum_up(
    own: Sequence[Delay], waits: Sequence[Wait], records: Sequence[tuple[int, int, int]], begin_ns: int, from_ns: int
) -> Lateness:
    """Of the bench's own delays, the device's waits and the witness' records, from `from_ns` on."""
    busy = [(wait.at_ns - LOOK_NS, wait.at_ns) for wait in waits if wait.ran_share > OWN_SHARE]

    def is_own_doing(at_ns: int) -> bool:
        return any(begin <= at_ns <= end + LOOK_NS for begin, end in busy)

    found = [one for one in own if one.at_s >= (from_ns - begin_ns) / S]
    late_ns = 0
    seen = [record for record in records if record[0] >= from_ns and not is_own_doing(record[0])]
    for at_ns, worst_ns, total_ns in seen:
        late_ns += total_ns
        if worst_ns > WITHHELD_NS:
            found.append(Delay(at_s=(at_ns - begin_ns) / S, by_s=worst_ns / S, what="a process beside the device was"))
    for wait in waits:
        if wait.at_ns >= from_ns and wait.waited_ns > WITHHELD_NS and wait.ran_share <= OWN_SHARE:
            what = "the device got its processor"
            found.append(Delay(at_s=(wait.at_ns - begin_ns) / S, by_s=wait.waited_ns / S, what=what))
    usual_s = late_ns / S / (len(seen) * witness.WAKE_UPS) if seen else 0.0
    return Lateness(delays=sorted(found, key=lambda delay: delay.at_s), usual_s=usual_s)


def _own_bytes(number: int) -> int:
    """Resident memory that is not of files, from an open `statm`; 0 of a process that has ended."""
    try:
        _, resident, shared, *_ = map(int, os.pread(number, 128, 0).split())
    except (OSError, ValueError):
        return 0
    return (resident - shared) * os.sysconf("SC_PAGE_SIZE")
