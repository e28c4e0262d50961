"""The log is written by a thread of its own."""

import logging
import threading

import pytest

from vehicle_iface.cli.logging import log_to_terminal


def test_a_traceback_is_written_by_the_logs_thread_and_not_by_the_one_that_logs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    threads: list[threading.Thread] = []
    format_exception = logging.Formatter.formatException

    def watch(self: logging.Formatter, ei: object) -> str:
        if "%(levelname)-7s" in (self._fmt or ""):  # not pytest's own
            threads.append(threading.current_thread())
        return format_exception(self, ei)  # type: ignore[arg-type]

    monkeypatch.setattr(logging.Formatter, "formatException", watch)
    with log_to_terminal(verbose=False):
        try:
            raise ZeroDivisionError("a mistake")
        except ZeroDivisionError:
            logging.getLogger("vehicle_iface").exception("the controller raised %d times", 1)
    said = capsys.readouterr().err
    assert "the controller raised 1 times" in said
    assert "ZeroDivisionError: a mistake" in said
    assert threads
    assert threading.main_thread() not in threads
