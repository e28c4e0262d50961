"""A test that fails while the machine itself stands still is run again: then it shows nothing about the program.

With `--defer-to FILE`, any test that fails is not reported but written to the file, a node id a line: `tools/test` runs
those again when no other kernel runs, and that run decides. Two kernels on two processors hold each other up in more
ways than a witness sees; what failed is printed in either case.

In a kernel of `tools/vcan` a busy host takes the processor away: for 50 ms, and to stop is right; or for 12, and two
samples come at once, of which the newer is answered. The witness is `witness.py`, which nothing in that kernel can hold
up, or the test's own vehicle, whose thread only the test itself can keep waiting. Without a report of theirs a failure
is a failure.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol

from .claims import Claims

ATTEMPTS = 5
_WITNESS = Path(__file__).with_name("witness.py")


class Witness:
    """The process that watches, and its reports; raises `OSError` without the right to real-time priority."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(_WITNESS)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
        )
        assert self._process.stdout is not None
        self._output = self._process.stdout
        if not self._output.readline():
            self.close()
            raise PermissionError("a process of real-time priority is not allowed here")
        os.set_blocking(self._output.fileno(), False)

    def send_signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self._process.send_signal(number)

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        self._output.close()

    def take_delays_s(self) -> list[float]:
        """For how long the machine stood still each time since the last call, s."""
        return [float(line) for line in (self._output.read() or b"").split()]


class Standstill:
    """Runs a test again that failed in a unit of tests within which the machine stood still."""

    def __init__(
        self,
        take_delays_s: Callable[[], list[float]],
        unit: Callable[[pytest.Item], str],
        defer_to: Path | None = None,
        claims: Claims | None = None,
    ) -> None:
        """`unit` names what shares a setting-up: what went wrong there shows in a later test of it."""
        self._take_delays_s, self._unit, self._defer_to = take_delays_s, unit, defer_to
        self._claims = claims or Claims(None, unit)
        self._now = ""
        self._longest_s = 0.0
        self._attempts = 0
        self.again: list[str] = []
        """What was run again, and why."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> bool:
        """Once; and the same test once more behind it when there is reason to. Not at all if it is another's."""
        if not self._claims.is_ours(item):
            return True
        nextitem = self._claims.find_next(nextitem)
        seen_s = max(self._take_delays_s(), default=0.0)
        if self._unit(item) != self._now:
            self._now, self._longest_s, self._attempts = self._unit(item), 0.0, 1
        else:
            self._longest_s = max(self._longest_s, seen_s)
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        self._longest_s = max([self._longest_s, *self._take_delays_s()])
        has_failed = any(report.failed for report in reports)
        if has_failed and self._defer_to is not None:
            self._defer(item, reports, self._defer_to)
        elif has_failed and self._longest_s > 0.0 and self._attempts < ATTEMPTS:
            self._run_again(item, reports)
        else:
            for report in reports:
                item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Whoever reads the result reads this as well."""
        for line in self.again:
            terminalreporter.write_line(line)

    def _defer(self, item: pytest.Item, reports: list[pytest.TestReport], file: Path) -> None:
        self._note("deferred", item, reports)
        with open(file, "a", encoding="utf-8") as deferred:
            deferred.write(f"{item.nodeid}\n")

    def _note(self, what: str, item: pytest.Item, reports: list[pytest.TestReport]) -> None:
        reason = next(report.longreprtext for report in reports if report.failed)
        stood_still = f"the machine stood still for {self._longest_s * 1e3:.0f} ms"
        beside = "beside another kernel, which did not stand still"
        self.again.append(f"{what}, {stood_still if self._longest_s else beside}: {item.nodeid}")
        self.again += [f"  {line}" for line in reason.splitlines() if line.startswith("E ")]

    def _run_again(self, item: pytest.Item, reports: list[pytest.TestReport]) -> None:
        self._note("run again", item, reports)
        self._attempts += 1
        self._longest_s = 0.0
        item.session._setupstate.teardown_exact(None)  # what it shares with others was there when the machine stood
        items = item.session.items
        items.insert(items.index(item) + self._attempts - 1, item)
