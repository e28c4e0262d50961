"""Proves a drive: a simulated vehicle, the viewer, a recorder and `vehicle-iface run --arm`, each a process of its own.

Afterwards tools/check_drive judges what was recorded on the bus, and the loop's own summary is judged too.
Where vcan0 is missing, all of it runs inside tools/vcan, which makes vcan0 or boots a kernel that has it.

Judge on a quiet machine only: a user-mode kernel that stands still for 100 ms, because this machine does something
else, trips the vehicle's watchdog, as it must, and the drive has failed. The page is served, and nobody looks at it.
"""

import argparse
import ctypes
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

from vehicle_bus_contract.candump import read_candump

from drive_checks.check_drive import LATERAL_LIMIT_M, PROFILES, judge, table
from vehicle_iface.process import module_command
from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import TelemetryReader

TOOLS = Path(__file__).resolve().parents[1]
CLEAN, WRONG, CANNOT, INTERRUPTED = 0, 1, 2, 130
VCAN = "vcan0"
MODULE = "drive_checks.long_drive"
ARPHRD_CAN = "280"
FD_MTU = 72
ROUTES = ("figure8", "circle")
"""Those that go on for ever."""
SHORTEST_S = 10.0
ENGAGING_S = 5.0
"""The loop may take so long of its time to engage."""
PAGE_S = 60.0
ENDING_S = 20.0
"""The vehicle has 10 s to stop; what runs longer than this is killed, and that is wrong."""
RECEIVE_BYTES = 16 << 20
ROUTINE = {"NOT_ENGAGED", "NOMINAL", "STATE_STALE", "SHUTDOWN"}
"""What a command may say in a drive without incident; a stop for state that did not come is right, and counted."""
COUNTED_BY_CAUSE = ("drops", "lost", "implausible", "deviations", "tx_blocked")
RUN_FIGURES = ("samples", "commands", "commands_late", "samples_expired", "stops_on_stale_state")
"""Told, not judged: samples may have queued up before the loop's first answer, and the record shows any later ones."""
PR_SET_PDEATHSIG = 1


class CannotError(Exception):
    """There is nothing to drive on, or nowhere to leave the results; the message says what to do."""


class Programs:
    """The drive's processes, each out of the terminal's reach, so that Ctrl-C ends them in order."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.wrong: list[str] = []
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, command: Sequence[str], *, output: str = "") -> None:
        """A process whose words, or whose output and errors, are kept in the folder."""
        words = self._file(f"{name}.txt")
        with words, self._file(output or f"{name}.txt") as out:
            self._running[name] = subprocess.Popen(
                command,
                env=module_command("vehicle_iface")[1] | {"PYTHONUNBUFFERED": "1"},
                start_new_session=True,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=words,
                preexec_fn=_die_with_parent,
            )

    def start_ours(self, name: str, *arguments: str) -> None:
        """`vehicle-iface ARGUMENTS…`."""
        self.start(name, [*module_command("vehicle_iface")[0], *arguments])

    def said(self, name: str) -> str:
        """All that a process has said."""
        return (self.folder / f"{name}.txt").read_text(errors="replace")

    def ended(self) -> str | None:
        """Who has ended, if anybody."""
        return next((name for name, process in self._running.items() if process.poll() is not None), None)

    def fail(self, name: str) -> None:
        """Somebody has ended who should not have."""
        status = self._running[name].returncode
        last = self.said(name).strip().splitlines()[-1:]
        self.wrong.append(f"{name} exited unexpectedly with status {status}: {' '.join(last)}")

    def end(self) -> None:
        """The loop first, for it has to stop the vehicle; the recorder only when nobody sends any more."""
        for name in ("loop", "sim", "recorder", "viewer"):
            process = self._running.get(name)
            if process is None:
                continue
            if process.poll() is None:
                process.terminate()
            try:
                process.wait(ENDING_S)
            except subprocess.TimeoutExpired:
                self.wrong.append(f"{name} did not end in {ENDING_S:.0f} s and was killed")
                process.kill()
                process.wait()

    def status(self, name: str) -> int | None:
        """The exit status of a process; None if it was not started, or runs."""
        process = self._running.get(name)
        return None if process is None else process.returncode

    def _file(self, name: str) -> IO[bytes]:
        return (self.folder / name).open("ab")


def main() -> int:
    options = _options()
    if options.channel == VCAN and not interface(VCAN).exists():
        command = [sys.executable, str(TOOLS / "vcan"), sys.executable, "-P", "-m", MODULE, *sys.argv[1:]]
        os.execv(sys.executable, command)
    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    memory = Path("/dev/shm")
    try:
        check_channel(options.channel, is_fd=PROFILES[options.profile].is_fd)
        if shutil.which("candump") is None:
            raise CannotError("there is no candump; run: sudo apt-get install can-utils")
        out = _out(options)
        with tempfile.TemporaryDirectory(
            prefix="long-drive-", dir=memory if os.access(memory, os.W_OK) else None
        ) as hot:
            return _prove(options, Path(hot), out, over)
    except CannotError as error:
        print(f"long_drive: {error}", file=sys.stderr)
        return CANNOT


def _prove(options: argparse.Namespace, hot: Path, out: Path, over: threading.Event) -> int:
    """Drive, keep what came of it, judge it."""
    programs = Programs(hot)
    try:
        _drive(options, programs, over)
    finally:
        programs.end()
        for path in hot.iterdir():
            if path.is_file():
                shutil.copy(path, out)
    result = _verdict(options, programs)
    (out / "verdict.json").write_text(json.dumps(result, indent=2) + "\n")
    print(table(result))
    print(f"  kept in {out}: {', '.join(sorted(path.name for path in out.iterdir()))}")
    if over.is_set():
        print("  interrupted: this drive proves nothing")
        return INTERRUPTED
    return WRONG if result["wrong"] else CLEAN


def _drive(options: argparse.Namespace, programs: Programs, over: threading.Event) -> None:
    """Start everything, and return when the loop has ended, somebody else has, or it is enough."""
    address = f"long-drive-{os.getpid()}"
    bus = ["--channel", options.channel, "--profile", options.profile]
    programs.start("recorder", ["candump", "-L", "-r", str(RECEIVE_BYTES), options.channel], output="log.candump")
    programs.start_ours("sim", "sim", *bus, "--driver-socket", str(programs.folder / "pedals.sock"))
    programs.start_ours("viewer", "view", "--connect", address, "--port", "0")
    if not _page_is_served(programs, over):
        return
    what = ["--route", options.route, "--arm", "--duration", str(options.duration)]
    files = ["--telemetry", address, "--summary", str(programs.folder / "summary.json")]
    programs.start_ours("loop", "run", *bus, *what, *files)
    _say(f"driving {options.route} for {options.duration:.0f} s on {options.channel}, profile {options.profile}\n")
    _watch(options.duration, programs, address, over)


def _page_is_served(programs: Programs, over: threading.Event) -> bool:
    """Wait for the viewer: what it costs to start is no part of the drive."""
    deadline_s = time.monotonic() + PAGE_S
    while not over.wait(0.2):
        page = re.search(r"viewer: (http://\S+)", programs.said("viewer"))
        if page is not None:
            try:
                urllib.request.urlopen(page.group(1), timeout=PAGE_S).close()
            except OSError as error:
                programs.wrong.append(f"the page {page.group(1)}: {error}")
                return False
            return True
        gone = programs.ended()
        if gone is not None:
            programs.fail(gone)
            return False
        if time.monotonic() > deadline_s:
            programs.wrong.append(f"the viewer has not served its page in {PAGE_S:.0f} s")
            return False
    return False


def _watch(duration_s: float, programs: Programs, address: str, over: threading.Event) -> None:
    """Say how it goes: on a terminal in one line that changes, elsewhere once a minute."""
    in_place = sys.stdout.isatty()
    begun_s = told_s = time.monotonic()
    with TelemetryReader(address) as reader:
        while not over.wait(1.0):
            gone, now_s = programs.ended(), time.monotonic()
            if gone is not None:
                if gone != "loop":
                    programs.fail(gone)
                break
            if now_s - begun_s > duration_s + ENDING_S + PAGE_S:
                programs.wrong.append("the loop has not ended at the end of its time")
                break
            if in_place or now_s - told_s >= 60.0:
                told_s = now_s
                line = f"{now_s - begun_s:5.0f} of {duration_s:.0f} s  {_progress(reader)}"
                _say(f"\r\x1b[2K{line}" if in_place else f"{line}\n")
    if in_place:
        _say("\n")


def _progress(reader: TelemetryReader) -> str:
    reader.poll()
    now = reader.newest()
    if now is None:
        return "nothing is known of the loop yet"
    details = reader.details()
    link = details.link.state if details is not None else "-"
    return (
        f"{ControllerState(now.controller_state).name} {Reason(now.reason).name}  samples {now.samples}  "
        f"commands {now.commands}  drops {now.drops}  link {link}"
    )


def _verdict(options: argparse.Namespace, programs: Programs) -> dict[str, Any]:
    """What check_drive finds in the record, and what else is wrong with the drive."""
    log = programs.folder / "log.candump"
    try:
        result = judge(read_candump(log), PROFILES[options.profile], options.route, LATERAL_LIMIT_M)
    except (OSError, ValueError) as error:
        result = {"wrong": [f"the record: {error}"]}
    wrong = [*programs.wrong, *result.pop("wrong"), *_wrong_with_drive(result, options.duration)]
    path = programs.folder / "summary.json"
    summary = json.loads(path.read_text() or "{}") if path.exists() else {}
    wrong += wrong_with_run(summary, programs.status("loop"))
    counts = summary.get("counts", {})
    figures = {f"run_{name}": counts[name] for name in RUN_FIGURES if name in counts}
    latency = summary.get("latency", {})
    if latency.get("count"):
        figures |= {f"run_latency_{name}_ms": round(latency[f"{name}_s"] * 1e3, 2) for name in ("p50", "p99", "max")}
    return result | figures | {"wrong": wrong}


def _wrong_with_drive(result: dict[str, Any], duration_s: float) -> list[str]:
    """A drive that was too short, or not without incident."""
    if "driven_s" not in result:
        return []
    wrong = []
    if result["driven_s"] < duration_s - ENGAGING_S:
        wrong.append(f"driven for {result['driven_s']:.1f} s of {duration_s:.0f} s")
    for told, count in result["pairs_by_reason"].items():
        if told.partition(",")[0] not in ROUTINE:
            wrong.append(f"commands that say {told}: {count}")
    return wrong


def wrong_with_run(summary: dict[str, Any], status: int | None) -> list[str]:
    """What the loop itself says was not as it should be."""
    if not summary or status is None:
        return [f"the loop left no summary (status {status})"]
    wrong = [f"the loop ended with status {status}"] if status else []
    if summary["latched_fault"]:
        wrong.append(f"latched fault {summary['latched_fault']}")
    if summary["link"]["state"] != "UP" or summary["link"]["transitions"]:
        wrong.append(f"link {summary['link']['state']}, changed {len(summary['link']['transitions'])} times")
    counted = {f"{group}: {cause}": n for group in COUNTED_BY_CAUSE for cause, n in summary[group].items()}
    counted["incomplete samples"] = summary["incomplete_samples"]
    for name in (
        "frames_not_sent",
        "commands_refused",
        "foreign_commands",
        "controller_errors",
        "trajectories_rejected",
        "link_losses",
    ):
        counted[name.replace("_", " ")] = summary["counts"][name]
    for name in ("error_frames", "receive_overflow", "send_missed", "send_no_room"):
        counted[name.replace("_", " ")] = summary["bus_counters"][name]
    return [*wrong, *(f"{name} {count}" for name, count in counted.items() if count)]


def interface(channel: str) -> Path:
    return Path("/sys/class/net") / channel


def check_channel(channel: str, *, is_fd: bool) -> None:
    """A virtual interface with room for the profile's frames; made if need be."""
    if not interface(channel).exists():
        raise CannotError(f"there is no {channel}; run: sudo ip link add dev {channel} type vcan up")
    is_virtual = "/virtual/" in str(interface(channel).resolve())
    if not is_virtual or (interface(channel) / "type").read_text().strip() != ARPHRD_CAN:
        raise CannotError(f"{channel} is no virtual CAN interface: a simulated vehicle has no place on a real bus")
    if not is_fd or int((interface(channel) / "mtu").read_text()) >= FD_MTU:
        return
    ip = shutil.which("ip", path=os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin", "/sbin"])) or "ip"
    lines = [f"link set {channel} down", f"link set {channel} mtu {FD_MTU}", f"link set {channel} up"]
    for line in lines:  # a running interface refuses another size
        if subprocess.run([ip, *line.split()], check=False).returncode:
            mend = " && ".join(f"sudo ip {each}" for each in lines)
            raise CannotError(f"{channel} has no room for CAN FD frames; run: {mend}")


def _out(options: argparse.Namespace) -> Path:
    """Where the results go, made and empty."""
    name = f"long-drive-{options.profile}-{time.strftime('%Y%m%d-%H%M%S')}"
    folder = Path(options.out or Path(tempfile.gettempdir()) / name).absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise CannotError(f"--out {folder}: must be empty or new")
    except OSError as error:
        raise CannotError(f"--out {folder}: {error.strerror}") from error
    return folder


def _die_with_parent() -> None:
    """A drive that is killed leaves nobody driving."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def _say(text: str) -> None:
    print(text, end="", flush=True)


def _duration(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not SHORTEST_S <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text}: must be a number of seconds, at least {SHORTEST_S:.0f}")
    return value


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="tools/long_drive",
        description=__doc__,
        epilog="Exit status: 0 when neither the record nor the summary has anything wrong, 1 when something is wrong,\n"
        "2 when nothing could be driven, 130 when it was interrupted.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--profile", default="reference", choices=PROFILES, help="the vehicle (default reference)")
    parser.add_argument("--duration", type=_duration, default=600.0, metavar="S", help="in s (default 600)")
    parser.add_argument("--route", default="figure8", choices=ROUTES, help="what to drive (default figure8)")
    parser.add_argument("--channel", default=VCAN, help="a virtual CAN interface (default vcan0)")
    parser.add_argument(
        "--out", metavar="FOLDER", help="where record, summary, verdict and words go (default: a new one in /tmp)"
    )
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
