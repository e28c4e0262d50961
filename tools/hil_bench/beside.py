"""Executes cases on several interfaces at the same time, each interface in a process of its own.

A case shares nothing with the cases beside it but the computer. What the computer can explain (a late bench, a late
answer) is therefore no result: such a case is executed again, alone. Damaged frames and values beyond a limit are a
FAIL at once.
"""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection, wait

import msgspec

from hil_bench.bench_config import BenchConfig
from hil_bench.case import Case
from hil_bench.errors import UnexpectedNodeError
from hil_bench.judges import select_content
from hil_bench.priority import realtime_priority
from hil_bench.result import CaseResult, Verdict

Task = tuple[Case, int]
"""A case and its repetition."""
Execute = Callable[[BenchConfig, Case, int], CaseResult]
POLL_S = 0.5
END_S = 60.0
"""A case that was interrupted has ended its device within this time."""
ALONE = {"clock", "load"}
"""Tags of cases that would disturb others."""


def must_run_alone(case: Case) -> bool:
    """Whether a case measures the computer, changes something that all share, or would disturb the cases beside it."""
    return case.on_vxcan or case.is_measured or case.profile is not None or bool(ALONE & set(case.tags))


def is_settled(found: CaseResult) -> bool:
    """Whether a result that was found beside other cases stands."""
    failed = [check for check in found.checks if check.verdict is Verdict.FAIL]
    is_certain = found.verdict is Verdict.FAIL and bool(select_content(failed))
    return is_certain or found.verdict in (Verdict.PASS, Verdict.NOT_APPLICABLE)


class Crew:
    """The processes, one for each interface; none where there is only one interface.

    Open it before any thread is started: the processes are copies of this one.
    """

    def __init__(self, config: BenchConfig, channels: Sequence[str], tasks: Sequence[Task], execute: Execute) -> None:
        self._tasks = [task for task in tasks if not must_run_alone(task[0])]
        self.unsettled: set[tuple[str, int]] = set()
        """Name and repetition of the cases that must be executed again, alone."""
        used = channels[: len(self._tasks)] if len(channels) > 1 else ()
        self._workers = [_Worker(replace(config, channel=channel), self._tasks, execute) for channel in used]

    def results(self, on_start: Callable[[Case], None]) -> Iterator[tuple[Case, CaseResult]]:
        """The results that stand, in the order in which the cases end; what is missing must be executed alone."""
        numbers = iter(range(len(self._tasks)))
        for worker in self._workers:
            self._hand_out(worker, numbers, on_start)
        while busy := {worker.pipe: worker for worker in self._workers if worker.number is not None}:
            for worker in [worker for pipe, worker in busy.items() if pipe in wait(list(busy))]:
                number, found = worker.number, worker.receive()
                self._hand_out(worker, numbers, on_start)
                case, repetition = self._tasks[number or 0]
                if found is not None and is_settled(found):
                    yield case, found
                else:
                    self.unsettled.add((case.name, repetition))

    def close(self) -> None:
        """End all, and the cases that they execute, in an orderly way."""
        for worker in self._workers:
            worker.interrupt()
        for worker in self._workers:
            worker.end()

    def _hand_out(self, worker: "_Worker", numbers: Iterator[int], on_start: Callable[[Case], None]) -> None:
        number = next(numbers, None) if worker.is_alive else None
        if number is not None:
            on_start(self._tasks[number][0])
        worker.send(number)


class _Worker:
    """A process that executes one case after the other on one interface."""

    def __init__(self, config: BenchConfig, tasks: Sequence[Task], execute: Execute) -> None:
        self.number: int | None = None
        """Of the task that it executes."""
        self.is_alive = True
        context = multiprocessing.get_context("fork")
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, config, tasks, execute, os.getpid()))
        self._process.start()
        theirs.close()

    def send(self, number: int | None) -> None:
        self.number = number
        with suppress(OSError):
            self.pipe.send(number)

    def receive(self) -> CaseResult | None:
        """Its result; None if it died."""
        try:
            return msgspec.msgpack.decode(self.pipe.recv_bytes(), type=CaseResult)
        except (EOFError, OSError):
            self.is_alive = False
            return None

    def interrupt(self) -> None:
        """Interrupt the case that it executes, and let it end."""
        if self.number is not None:
            self._process.terminate()
        self.send(None)

    def end(self) -> None:
        """Wait until it has ended."""
        self._process.join(END_S)
        self._process.kill()
        self.pipe.close()


def _serve(pipe: Connection, config: BenchConfig, tasks: Sequence[Task], execute: Execute, parent: int) -> None:
    """Execute tasks by their numbers until None comes or the parent is gone."""
    with suppress(KeyboardInterrupt, OSError, EOFError, UnexpectedNodeError), realtime_priority():
        while os.getppid() == parent:
            if not pipe.poll(POLL_S):
                continue
            number = pipe.recv()
            if number is None:
                return
            pipe.send_bytes(msgspec.msgpack.encode(execute(config, *tasks[number])))
