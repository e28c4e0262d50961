"""Soaks a drive: `vehicle-iface run --arm` and a simulated vehicle with a bad cable between them, for as long as told.

The cable loses, doubles, delays and damages frames in both directions, and every minute the loop's link goes down for
a second. The loop falls silent by contract; an operator resets the vehicle and arms the loop
again. What was on either end of the cable is judged from the bus contract alone: nothing is
driven on without a fresh sample, no command is repeated, doubled, without a cause or beyond its limits, no counter
leaves one out, and nothing is sent from a lost link until the next arming. The loop's own counts must be those of what
reached it, its memory must not grow, and it must not keep descriptors.

Where vcan0 is missing, all of it runs inside tools/vcan. Judge on a quiet machine only: a user-mode kernel that stands
still for 100 ms trips the vehicle's watchdog; the loop then lets go, as it must, and is armed again.
"""

import argparse
import json
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from vehicle_bus_contract.cable import LOOP_END, VEHICLE_END, Cable, CableError
from vehicle_bus_contract.socketcan import ReceivedFrame, open_socket, receive

from drive_checks.check_drive import table
from drive_checks.long_drive import CannotError, Programs
from drive_checks.soak_judge import Judge, LinkOutage, SoakLog, without_expired, wrong_with_cable, wrong_with_counts
from vehicle_iface.bus.link_state import OPEN
from vehicle_iface.errors import ConfigError
from vehicle_iface.sim.driver_socket import send_line
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import TelemetryReader

TOOLS = Path(__file__).resolve().parents[1]
MODULE = "drive_checks.soak"
CLEAN, WRONG, CANNOT, INTERRUPTED = 0, 1, 2, 130
DELAY_MS = 20
"""Of every frame but those that overtake; longer than a message's period, or none would be overtaken."""
SHORTEST_S = 20.0
DOWN_S = 1.0
"""How long a flap takes."""
LAST_FLAP_S = 10.0
"""Before the end: the drive shall end engaged."""
WARM_S = 5.0
"""After the first engagement the loop's memory is measured for the first time."""
ENGAGED_WITHIN_S = 20.0
LOOK_S = 0.1
STRETCH_S = 20.0
"""So much is judged at a time."""
ARMING_S = 2.0
"""An operator waits so long for an arming to show."""
STANDS_MPS = 0.05
MOST_GROWTH_MIB = 2.0


class Size(NamedTuple):
    """What the loop's process takes."""

    memory_mib: float
    """Resident."""
    descriptors: int


class Running(Programs):
    """The soak's processes."""

    def pid(self, name: str) -> int:
        """The process of that name."""
        return self._running[name].pid

    def size(self, name: str) -> Size:
        """What it takes now."""
        folder = Path(f"/proc/{self.pid(name)}")
        words = (folder / "status").read_text().partition("VmRSS:")[2].split()
        return Size(int(words[0]) / 1024, len(list((folder / "fd").iterdir())))


class Operator:
    """Looks at the loop, resets the vehicle when it has stopped itself, and arms the loop again when it is out."""

    def __init__(self, programs: Running, address: str, pedals: str, log: SoakLog) -> None:
        self._programs, self._pedals, self._log = programs, pedals, log
        self._reader = TelemetryReader(address)
        self._armed_s = 0.0
        self.state = ControllerState.STARTING

    def look(self) -> None:
        """Do what is to be done now."""
        self._reader.poll()
        newest = self._reader.newest()
        if newest is None:
            return
        self.state = ControllerState(newest.controller_state)
        if self.state is ControllerState.FAULT and time.monotonic() - self._armed_s > ARMING_S:
            self._help()

    def close(self) -> None:
        """Look no more."""
        self._reader.close()

    def _link_state(self) -> str:
        details = self._reader.details()
        return details.link.state if details is not None else ""

    def _help(self) -> None:
        """Once its watchdog has braked the vehicle to rest: one that is reset while it rolls leaves its path."""
        vehicle = json.loads(send_line(self._pedals, "status"))
        mode = vehicle["mode"]
        if mode in ("AUTONOMOUS", "FAULT") and abs(vehicle["speed_mps"]) > STANDS_MPS:
            return
        if mode == "FAULT":
            send_line(self._pedals, "reset")
        elif mode == "MANUAL":
            send_line(self._pedals, "ready")
        elif self._link_state() in {state.name for state in OPEN}:
            self._armed_s = time.monotonic()
            self._log.armings_ns.append(time.time_ns())
            os.kill(self._programs.pid("loop"), signal.SIGUSR1)


class Soak:
    """One soak, from its first frame to its verdict."""

    def __init__(self, options: argparse.Namespace, programs: Running, cable: Cable) -> None:
        self._options, self._programs, self._cable = options, programs, cable
        self._sockets = {end: open_socket(end) for end in (LOOP_END, VEHICLE_END)}
        self._received: dict[str, list[ReceivedFrame]] = {LOOP_END: [], VEHICLE_END: []}
        self._dropped = dict.fromkeys(self._sockets, 0)
        self._log = SoakLog(time.time_ns())
        self._judge = Judge(self._log)
        self._sizes: dict[str, Size] = {}
        self._judged_s = self._told_s = time.monotonic()

    def drive(self, over: threading.Event) -> None:
        """Until the time is up, somebody else has ended, or it is enough."""
        address, pedals = f"soak-{os.getpid()}", str(self._programs.folder / "pedals.sock")
        self._programs.start_ours("sim", "sim", "--channel", VEHICLE_END, "--driver-socket", pedals)
        what = ["--channel", LOOP_END, "--route", self._options.route, "--arm"]
        files = ["--telemetry", address, "--summary", str(self._programs.folder / "summary.json")]
        self._programs.start_ours("loop", "run", *what, *files)
        os.nice(10)  # judging comes after driving, on one processor too
        operator = Operator(self._programs, address, pedals, self._log)
        try:
            begun_s = self._wait_until_engaged(operator, over)
            if begun_s is not None:
                self._soak(operator, over, begun_s)
        except ConfigError as error:
            self._programs.wrong.append(str(error))
        finally:
            operator.close()

    def verdict(self, over: threading.Event) -> dict[str, Any]:
        """All there is to tell; `wrong` lists what is wrong. The programs have ended."""
        self._look()
        self._take(until_ns=time.time_ns())
        self._judge.finish()
        for raw in self._sockets.values():
            raw.close()
        path = self._programs.folder / "summary.json"
        summary = json.loads(path.read_text() or "{}") if path.exists() else {}
        wrong = [*self._programs.wrong, *self._judge.wrong, *self._wrong_with_process()]
        if over.is_set():
            wrong.append("interrupted: this soak proves nothing")
        status = self._programs.status("loop")
        if not summary or status:
            wrong.append(f"the loop ended with status {status}" if summary else f"no summary (status {status})")
        missed = sum(self._dropped.values())
        if missed:
            wrong.append(f"{missed} frames were not seen: this soak proves nothing")
        if summary:
            wrong = without_expired(wrong, summary)
            wrong += [*wrong_with_summary(summary), *wrong_with_counts(self._judge, summary)]
        for way, name in ((self._judge.to_loop, "to the loop"), (self._judge.to_vehicle, "to the vehicle")):
            wrong += wrong_with_cable(way, name, self._chances())
        return self._figures() | self._judge.as_dict() | _of_summary(summary) | {"wrong": list(dict.fromkeys(wrong))}

    def end_begins(self) -> None:
        """The loop is about to be told to end."""
        self._log.end_ns = time.time_ns()

    def _soak(self, operator: Operator, over: threading.Event, begun_s: float) -> None:
        options = self._options
        flap_s, end_s = begun_s + options.flap_every, begun_s + options.duration
        measures = {"begin": begun_s + WARM_S, "middle": begun_s + options.duration / 2}
        while not over.wait(LOOK_S):
            now_s = time.monotonic()
            if self._has_lost_somebody() or now_s >= end_s:
                break
            for name, at_s in measures.items():
                if name not in self._sizes and now_s >= at_s:
                    self._sizes[name] = self._programs.size("loop")
            if now_s >= flap_s and end_s - flap_s >= LAST_FLAP_S:
                flap_s += options.flap_every
                self._log.outages.append(LinkOutage(*self._cable.interrupt(DOWN_S)))
            operator.look()
            self._look()
            self._tell(now_s - begun_s, operator)
        if not self._has_lost_somebody():
            self._wait_until_engaged(operator, threading.Event())
            self._sizes["end"] = self._programs.size("loop")

    def _wait_until_engaged(self, operator: Operator, over: threading.Event) -> float | None:
        """The instant, or None when it does not come."""
        deadline_s = time.monotonic() + ENGAGED_WITHIN_S
        while not over.wait(LOOK_S) and not self._has_lost_somebody():
            operator.look()
            self._look()
            if operator.state in (ControllerState.ENGAGED, ControllerState.STOPPING):
                return time.monotonic()
            if time.monotonic() > deadline_s:
                self._programs.wrong.append(f"not engaged in {ENGAGED_WITHIN_S:.0f} s: {operator.state.name}")
                return None
        return None

    def _has_lost_somebody(self) -> bool:
        gone = self._programs.ended()
        if gone is not None and not any(text.startswith(f"{gone} ended") for text in self._programs.wrong):
            self._programs.fail(gone)
        return gone is not None

    def _look(self) -> None:
        begin_ns = time.time_ns()
        for end, raw in self._sockets.items():
            for received in receive(raw):
                self._received[end].append(received)
                self._dropped[end] = max(self._dropped[end], received.dropped)
                if received.frame.stamp_ns > begin_ns:  # on a busy machine frames arrive as fast as they are read
                    break
        if time.monotonic() - self._judged_s >= STRETCH_S:
            self._judged_s = time.monotonic()
            self._take(until_ns=begin_ns - int(0.5e9))

    def _take(self, until_ns: int) -> None:
        """Judge what was seen until then at both ends."""
        parts: list[list[ReceivedFrame]] = []
        for end, received in self._received.items():
            count = sum(each.frame.stamp_ns <= until_ns for each in received)
            parts.append(received[:count])
            self._received[end] = received[count:]
        self._judge.take(*parts)

    def _tell(self, now_s: float, operator: Operator) -> None:
        """On a terminal in one line that changes, elsewhere once a minute."""
        in_place = sys.stdout.isatty()
        if time.monotonic() - self._told_s < (1.0 if in_place else 60.0):
            return
        self._told_s = time.monotonic()
        line = (
            f"{now_s:5.0f} of {self._options.duration:.0f} s  {operator.state.name}  flaps {len(self._log.outages)}  "
            f"armed again {len(self._log.armings_ns) - 1}  pairs {self._judge.pairs}  wrong {len(self._judge.wrong)}"
        )
        print(f"\r\x1b[2K{line}" if in_place else line, end="" if in_place else "\n", flush=True)

    def _wrong_with_process(self) -> list[str]:
        sizes, wrong = self._sizes, []
        if {"begin", "end"} <= sizes.keys():
            grown_mib = sizes["end"].memory_mib - sizes["begin"].memory_mib
            if grown_mib > MOST_GROWTH_MIB:
                wrong.append(f"the loop's memory grew by {grown_mib:.1f} MiB")
            if sizes["end"].descriptors > sizes["begin"].descriptors:
                wrong.append(f"descriptors: {sizes['begin'].descriptors}, in the end {sizes['end'].descriptors}")
        else:
            wrong.append("the loop did not last until it could be measured")
        return wrong

    def _chances(self) -> dict[str, float]:
        options = self._options
        shares = (options.loss, options.duplicate, options.corrupt, options.reorder)
        return dict(
            zip(("lost", "repeated", "bad CRC", "wrong sequence"), (each / 100 for each in shares), strict=True)
        )

    def _figures(self) -> dict[str, Any]:
        return {
            "duration_s": round((time.time_ns() - self._log.begin_ns) / 1e9, 1),
            "flaps": len(self._log.outages),
            "armed_again": len(self._log.armings_ns) - 1,
            "stalls_of_the_machine": len(self._log.stalls),
            "memory_mib": {name: round(size.memory_mib, 2) for name, size in self._sizes.items()},
            "descriptors": {name: size.descriptors for name, size in self._sizes.items()},
        }


def wrong_with_summary(summary: dict[str, Any]) -> list[str]:
    """What the loop itself says went wrong, and no cable can make."""
    counted = {name: summary["counts"][name] for name in ("controller_errors", "trajectories_rejected")}
    counted["tx_blocked"] = sum(summary["tx_blocked"].values())
    counted |= {f"implausible: {why}": count for why, count in summary["implausible"].items() if why != "out of order"}
    counted["receive_overflow"] = summary["bus_counters"]["receive_overflow"]
    wrong = [f"the loop counts {name.replace('_', ' ')}: {count}" for name, count in counted.items() if count]
    fault = summary["latched_fault"]
    return [*wrong, f"latched fault {fault}"] if fault else wrong


def _of_summary(summary: dict[str, Any]) -> dict[str, Any]:
    if not summary:
        return {}
    counts, latency = summary["counts"], summary["latency"]
    told = ("samples", "commands", "commands_late", "samples_expired", "stops_on_stale_state", "commands_refused")
    figures: dict[str, Any] = {f"run_{name}": counts[name] for name in told}
    figures["run_late_ticks"] = counts["grid_overruns"]
    figures["run_drops"] = {cause: count for cause, count in summary["drops"].items() if count}
    figures["run_lost"] = summary["lost"]
    if latency["count"]:
        figures |= {f"run_latency_{name}_ms": round(latency[f"{name}_s"] * 1e3, 2) for name in ("p50", "p99", "max")}
    return figures


def main() -> int:
    options = _options()
    if not Path("/sys/class/net/vcan0").exists():
        command = [sys.executable, str(TOOLS / "vcan"), sys.executable, "-P", "-m", MODULE, *sys.argv[1:]]
        os.execv(sys.executable, command)
    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    try:
        if options.json:
            Path(options.json).touch()
        with tempfile.TemporaryDirectory(prefix="soak-", dir="/dev/shm") as hot:
            return _prove(options, Running(Path(hot)), over)
    except (CannotError, CableError) as error:
        print(f"soak: {error}", file=sys.stderr)
    except OSError as error:
        print(f"soak: {error.filename}: {error.strerror}", file=sys.stderr)
    return CANNOT


def _prove(options: argparse.Namespace, programs: Running, over: threading.Event) -> int:
    shares = {name: getattr(options, name) for name in ("loss", "duplicate", "corrupt", "reorder")}
    faults = [word for name, share in shares.items() if share for word in (name, f"{share:g}%")]
    with closing(Cable(["delay", f"{DELAY_MS}ms", *faults])) as cable:
        print(f"soaking {options.route} for {options.duration:.0f} s: {' '.join(faults)}", flush=True)
        soak = Soak(options, programs, cable)
        try:
            soak.drive(over)
        finally:
            soak.end_begins()
            programs.end()
        result = soak.verdict(over)
    if sys.stdout.isatty():
        print()
    print(table(result))
    if options.json:
        Path(options.json).write_text(json.dumps(result, indent=2) + "\n")
    if over.is_set():
        return INTERRUPTED
    if not result["wrong"]:
        return CLEAN
    kept = tempfile.mkdtemp(prefix="soak-")
    for name in ("loop.txt", "sim.txt", "summary.json"):
        if (programs.folder / name).exists():
            shutil.copy(programs.folder / name, kept)
    print(f"  what the programs said is in {kept}")
    return WRONG


def _number(text: str, least: float, most: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{text}: must be a number from {least:g} to {most:g}")
    return value


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="tools/soak",
        description=__doc__,
        epilog="Exit status: 0 when nothing is wrong, 1 when something is, 2 when nothing could be driven,\n"
        "130 when it was interrupted. Needs root for the interfaces, as there is inside tools/vcan.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )

    def seconds(text: str) -> float:
        return _number(text, SHORTEST_S, 1e9)

    def percent(text: str) -> float:
        return _number(text, 0.0, 100.0)

    def every(text: str) -> float:
        return _number(text, 10.0, 1e9)

    parser.add_argument("--duration", type=seconds, default=600.0, metavar="S", help="in s (default 600)")
    parser.add_argument("--route", default="circle", choices=("circle", "figure8"), help="default circle")
    parser.add_argument(
        "--flap-every", type=every, default=60.0, metavar="S", help="link down for 1 s, in s (default 60)"
    )
    for name, what in (
        ("loss", "lost"),
        ("duplicate", "doubled"),
        ("reorder", "sent past the others"),
        ("corrupt", "damaged in one bit"),
    ):
        text = f"frames {what}, in %% of those each way (default 1)"
        parser.add_argument(f"--{name}", type=percent, default=1.0, metavar="PERCENT", help=text)
    parser.add_argument("--json", metavar="FILE", help="write everything there, for programs")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
