"""Real-time settings of Linux and Python for the loop; each setting that fails reports what is missing.

Measurements, and the settings that follow (two shared cores, Python 3.11, the embedded loop):

- SCHED_FIFO is what matters. It is for the calling thread alone: the thread that writes the log stays ordinary,
  and so do all threads and processes that are started later.
- A collection of everything takes 8 to 13 ms after the start, and 8 µs once what exists then is frozen. It is frozen
  without a collection: the garbage of a start is 1,300 objects, less than half a MiB. The loop itself
  makes no cycles: 10⁶ passes left none, and not a kilobyte. A user's controller may: `collect_garbage_if_due` moves
  collecting between two passes, and does not switch it off.
- Locking memory whole (MCL_CURRENT) takes the process from 53 to 164 MB resident, most of it buffers that nobody
  ever touches; locking each page once it is touched (MCL_ONFAULT) takes nothing. Memory mapped later
  (MCL_FUTURE) is left out: at the limit it would make allocations fail, and the loop's memory stays flat.
- OpenBLAS starts its threads when NumPy is imported. They sleep and take no resident memory, but a controller's
  product of two large matrices would wait for them, and they are not SCHED_FIFO. So it is told to use one thread.
- An ordinary process is woken up to 50 µs late, to save power; any process may request 1 ns.
"""

import ctypes
import errno
import gc
import os
import re
from collections.abc import Callable
from pathlib import Path

from vehicle_iface.value import Value

FIFO_PRIORITY = 50
"""Above everything ordinary, below the kernel's interrupt threads of a real-time kernel (50 shares their class)."""
UNARMED_PRIORITY = FIFO_PRIORITY - 10
"""A loop that only watches never delays one that drives."""
LIMITS_FILE = "/etc/security/limits.d/vehicle-iface.conf"
FIX_FIFO = f'echo "$USER - rtprio {FIFO_PRIORITY}" | sudo tee -a {LIMITS_FILE}'
FIX_LOCK = f'echo "$USER - memlock unlimited" | sudo tee -a {LIMITS_FILE}'
"""Both hold from the next login on."""

# From <sys/mman.h> and <linux/prctl.h>
MCL_CURRENT, MCL_ONFAULT = 1, 4
PR_SET_TIMERSLACK = 29
TIMER_SLACK_NS = 1

_BLAS = re.compile(r"openblas|libmkl_rt|libblis")
_BLAS_SETTERS = (
    *(f"{before}openblas_set_num_threads{after}" for before in ("", "scipy_") for after in ("", "64_", "_64")),
    "MKL_Set_Num_Threads",
    "bli_thread_set_num_threads",
)


class RealtimeSettings(Value, frozen=True, kw_only=True):
    """The requested settings."""

    priority: int = FIFO_PRIORITY
    cpu: int | None = None
    """The only processor that it shall run on; None leaves that to the kernel."""


def apply_settings(priority: int = FIFO_PRIORITY, *, cpu: int | None = None) -> list[str]:
    """Apply the settings to this thread and process; return those that failed, each with its remedy."""
    settings = RealtimeSettings(priority=priority, cpu=cpu)
    problems = (step(settings) for step in STEPS)
    return [problem for problem in problems if problem]


def release_priority() -> None:
    """Make this thread ordinary again: what follows the last pass must not delay another loop on this machine."""
    if hasattr(os, "sched_setscheduler"):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def collect_garbage_if_due() -> None:
    """Collect garbage where Python would have; call it between two passes.

    From the first call on nothing is collected anywhere else. Costs 0.3 µs, and 4 µs each few thousand passes.
    """
    gc.disable()
    counts, limits = gc.get_count(), gc.get_threshold()
    if 0 < limits[0] < counts[0]:
        gc.collect(max(number for number in range(3) if 0 < limits[number] < counts[number]))


def may_fifo(priority: int = FIFO_PRIORITY) -> bool:
    """Whether this thread would get SCHED_FIFO; it is tried, and given back."""
    if not hasattr(os, "sched_setscheduler"):
        return False
    policy, param = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return False
    os.sched_setscheduler(0, policy, param)
    return True


def may_lock() -> bool:
    """Whether this process could lock its memory; it is tried, and given back."""
    if _lock_memory(RealtimeSettings()):
        return False
    ctypes.CDLL(None).munlockall()
    return True


def _freeze_start(_: RealtimeSettings) -> str:
    """Exclude all existing objects from garbage collection, the garbage among them as well."""
    gc.freeze()
    return ""


def _use_one_blas_thread(_: RealtimeSettings) -> str:
    """Matrix products in the calling thread only."""
    unconfigured = [path for path in _blas_libraries() if not _set_one_thread(path)]
    if not unconfigured:
        return ""
    return (
        f"{', '.join(Path(path).name for path in unconfigured)} may compute in threads that are not real-time; "
        "`export OMP_NUM_THREADS=1` before the start"
    )


def _pin(settings: RealtimeSettings) -> str:
    """One processor, where one was asked for."""
    if settings.cpu is None:
        return ""
    if not hasattr(os, "sched_setaffinity"):
        return "this system binds no thread to a processor"
    try:
        os.sched_setaffinity(0, {settings.cpu})
    except (OSError, ValueError, OverflowError):
        allowed = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
        return f"CPU {settings.cpu} is not available, this process may use {allowed}; `taskset -p {os.getpid()}`"
    return ""


def _wake_in_time(_: RealtimeSettings) -> str:
    """No rounding of the times to wake up at; a SCHED_FIFO thread has none anyway."""
    if hasattr(os, "sched_setscheduler"):
        ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, TIMER_SLACK_NS, 0, 0, 0)
    return ""


def _lock_memory(_: RealtimeSettings) -> str:
    """Keep each page in memory once it has been touched."""
    if not hasattr(os, "sched_setscheduler"):
        return "this system locks no memory: a pass can wait for the disk when memory runs short"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_ONFAULT) == 0:
        return ""
    cause = {errno.ENOMEM: "more than its limit `ulimit -l`", errno.EPERM: "no permission for it"}
    why = cause.get(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return f"memory is not locked ({why}), a pass can wait for the disk when it runs short; `{FIX_LOCK}`"


def _set_fifo(settings: RealtimeSettings) -> str:
    """Run this thread before every ordinary program; what it starts later is ordinary again."""
    if not hasattr(os, "sched_setscheduler"):
        return "this system has no SCHED_FIFO: other programs can delay the loop"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(settings.priority))
    except PermissionError:
        return f"no permission for SCHED_FIFO, other programs can delay the loop; `{FIX_FIFO}`, or run as root"
    return ""


STEPS: tuple[Callable[[RealtimeSettings], str], ...] = (
    _freeze_start,
    _use_one_blas_thread,
    _pin,
    _wake_in_time,
    _lock_memory,
    _set_fifo,
)
"""Applied in this order; each returns why it failed, or an empty text."""


def _blas_libraries() -> list[str]:
    """Files of the BLAS libraries in this process, as far as it can be seen."""
    try:
        maps = Path("/proc/self/maps").read_text(encoding="utf-8", errors="surrogateescape")
    except OSError:
        return []
    mapped = {line.split(maxsplit=5)[5] for line in maps.splitlines() if line.count("/")}
    return sorted(path for path in mapped if _BLAS.search(path) and ".so" in path)


def _set_one_thread(path: str) -> bool:
    try:
        library = ctypes.CDLL(path)
    except OSError:
        return False
    for name in _BLAS_SETTERS:
        if hasattr(library, name):
            getattr(library, name)(1)
            return True
    return False
