"""Runs the tests that judge one module once for each of its mutants, each time in a fork of this process.

A change inside a function is made in a process that has collected the tests already, by giving the function its new
code: that costs a few milliseconds. Any other change, and each that survived so, is judged in a process that has
imported nothing of the project yet, and imports the changed source in place of the right one.
"""

import contextlib
import gc
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import json
import mmap
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any, NoReturn

import hypothesis
import pytest

from mutation_testing.mutants import Mutant, functions

SURVIVED, KILLED = 0, 1
MEMORY_BYTES = 4 << 30
"""A mutant that collects things for ever ends here."""
EXAMPLES = 25
"""For each law that does not ask for more: what only a hundred find is found by luck."""
PYTEST = (
    *("-x", "-q", "-s", "-o", "timeout=0", "-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:faulthandler"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),  # hypothesis has been imported already
)


class BaselineError(Exception):
    """The tests fail, or are none, without any mutant."""


def judge(
    root: Path, module: str, tests: Sequence[str], found: Sequence[Mutant], said: Callable[[Mutant, bool], None]
) -> None:
    """Calls `said(mutant, killed)` for each mutant. Raises `BaselineError`."""
    with tempfile.TemporaryFile("w+") as output:
        verdicts: dict[int, bool] = {}
        limit_s = 0.0
        for line in _lines_of(partial(_collected, root, module, tests, found), output):
            told = json.loads(line)
            if "baseline_s" in told:
                limit_s = 10.0 + 5.0 * told["baseline_s"]
            elif told["killed"]:
                verdicts[told["mutant"]] = True
                said(found[told["mutant"]], True)
        if not limit_s:
            output.seek(0)
            raise BaselineError(f"{module}: its tests do not pass without any mutant:\n{output.read()}")
        for place, mutant in enumerate(found):
            if place not in verdicts:
                said(mutant, _in_fork(partial(_fresh, root, mutant, tests), limit_s) != SURVIVED)


def _lines_of(work: Callable[[int], NoReturn], output: Any) -> Iterator[str]:
    """What `work` writes to a pipe, in a fork; what it says otherwise goes to `output`."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reader)
            os.dup2(output.fileno(), 1)
            os.dup2(output.fileno(), 2)
            work(writer)
        finally:
            if sys.exc_info()[0] is not None:
                traceback.print_exc()
            os._exit(1)
    os.close(writer)
    try:
        with os.fdopen(reader) as lines:
            yield from lines
    finally:
        os.waitpid(child, 0)


def _in_fork(work: Callable[[], int], limit_s: float) -> int:
    """What `work` comes to; a fork that is ended by a signal, as by its time limit, has killed its mutant."""
    child = os.fork()
    if child == 0:
        verdict = KILLED
        try:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_REAL, limit_s)
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
            silence = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silence, 1)
            os.dup2(silence, 2)
            verdict = work()
        finally:
            os._exit(verdict)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status)


def _fresh(root: Path, mutant: Mutant, tests: Sequence[str]) -> int:
    name = module_name(mutant.module)
    sys.meta_path.insert(0, _MutantFinder(name, str(root / mutant.module), mutant.changed))
    return SURVIVED if _pytest(root, tests, _Repeatable()) == 0 else KILLED


def _collected(root: Path, module: str, tests: Sequence[str], found: Sequence[Mutant], pipe: int) -> NoReturn:
    plugin = _PerMutantRunner(root, module, found, lambda told: os.write(pipe, (json.dumps(told) + "\n").encode()))
    os._exit(_pytest(root, tests, plugin))


def _pytest(root: Path, tests: Sequence[str], plugin: object) -> int:
    os.chdir(root)
    sys.path.insert(0, str(root))
    return int(pytest.main([*PYTEST, *tests], plugins=[plugin]))


def module_name(path: str) -> str:
    """vehicle_iface/safety/gate.py is vehicle_iface.safety.gate."""
    return path.removesuffix(".py").replace("/", ".")


class _MutantFinder(importlib.abc.MetaPathFinder):
    def __init__(self, name: str, path: str, source: bytes) -> None:
        self._name, self._path, self._source = name, path, source

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,  # noqa: ARG002  (the import system's)
        target: ModuleType | None = None,  # noqa: ARG002
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._name:
            return None
        loader = _MutantLoader(fullname, self._path)
        loader.changed = self._source
        return importlib.util.spec_from_file_location(fullname, self._path, loader=loader)


class _MutantLoader(importlib.machinery.SourceFileLoader):
    changed = b""

    def get_code(self, fullname: str) -> CodeType:  # noqa: ARG002  (so that no cache of the right one is read)
        return compile(self.changed, self.path, "exec", dont_inherit=True)


class _Repeatable:
    """Laws are tried with the same examples each time, and a counterexample is not made smaller."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self) -> None:
        phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
        hypothesis.settings.register_profile(
            "mutation",
            max_examples=EXAMPLES,
            derandomize=True,
            database=None,
            deadline=None,
            phases=phases,
            report_multiple_bugs=False,
        )
        hypothesis.settings.load_profile("mutation")


class _PerMutantRunner(_Repeatable):
    def __init__(self, root: Path, module: str, found: Sequence[Mutant], tell: Callable[[dict[str, Any]], Any]) -> None:
        self._path = str(root / module)
        self._name = module_name(module)
        self._found, self._tell = found, tell
        self._running = mmap.mmap(-1, 4)
        """Which test a fork is at."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        if not session.items or session.testsfailed:
            return False
        reached = self._baseline(session)
        if reached is None:
            return True
        self._tell({"baseline_s": sum(took_s for took_s, _ in reached) + 1e-3})
        by_cost = sorted(range(len(reached)), key=lambda place: reached[place][0])
        bare = {inner.__code__.co_qualname: inner for inner in self._functions()}
        gc.freeze()  # so that no fork copies everything only to look for garbage
        for number, mutant in enumerate(self._found):
            function = bare.get(mutant.function)
            code = _code_of(mutant, self._path) if function is not None else None
            places = [place for place in by_cost if mutant.function in reached[place][1]]
            if function is None or code is None or code.co_freevars != function.__code__.co_freevars or not places:
                continue
            limit_s = 3.0 + 10.0 * sum(reached[place][0] for place in places)
            killed = _in_fork(partial(self._run_with, session, function, code, places), limit_s) != SURVIVED
            if killed:  # what killed one is likely to kill its neighbours
                killer = int.from_bytes(self._running[:4], "little")
                by_cost.remove(killer)
                by_cost.insert(0, killer)
            self._tell({"mutant": number, "killed": killed})
        return True

    def _run_with(self, session: pytest.Session, function: Any, code: CodeType, places: list[int]) -> int:
        function.__code__ = code
        for place, following in zip(places, [*places[1:], None], strict=True):
            self._running[:4] = place.to_bytes(4, "little")
            after = None if following is None else session.items[following]
            session.config.hook.pytest_runtest_protocol(item=session.items[place], nextitem=after)
            if session.testsfailed:
                return KILLED
        return SURVIVED

    def _functions(self) -> Iterator[Any]:
        yield from functions(importlib.import_module(self._name), self._path)

    def _baseline(self, session: pytest.Session) -> list[tuple[float, list[str]]] | None:
        """For each test how long it takes and which functions of the module it calls; None where one fails."""
        with tempfile.TemporaryFile("w+") as notes:

            def run() -> int:
                result = []
                for item, following in zip(session.items, [*session.items[1:], None], strict=True):
                    with _calls(self._path) as called:
                        begun_s = time.perf_counter()
                        session.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                    result.append((time.perf_counter() - begun_s, sorted(called)))
                json.dump(result, notes)
                notes.flush()
                return KILLED if session.testsfailed else SURVIVED

            if _in_fork(run, limit_s=600.0) != SURVIVED:
                for item in session.items:  # once more, for what it has to say
                    session.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
                return None
            notes.seek(0)
            return [(took_s, called) for took_s, called in json.load(notes)]


@contextlib.contextmanager
def _calls(path: str) -> Iterator[set[str]]:
    """The outermost functions written in this file that are called meanwhile."""
    called: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename == path:
            called.add(frame.f_code.co_qualname.partition(".<locals>")[0])

    sys.setprofile(note)
    try:
        yield called
    finally:
        sys.setprofile(None)


def _code_of(mutant: Mutant, path: str) -> CodeType | None:
    """The changed function's code."""
    waiting = [compile(mutant.changed, path, "exec", dont_inherit=True)]
    while waiting:
        code = waiting.pop()
        if code.co_qualname == mutant.function:
            return code
        waiting += [inner for inner in code.co_consts if isinstance(inner, CodeType)]
    return None
