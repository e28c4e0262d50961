"""Laws are tested on what they say, not on how fast a machine checks them; and no test leaves its signals behind."""

import signal
from collections.abc import Generator

import pytest
from hypothesis import settings

settings.register_profile("unhurried", settings.get_profile(settings.get_current_profile_name()), deadline=None)
settings.load_profile("unhurried")

OPERATORS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol() -> Generator[None, object, object]:
    """The program's command line, called in this process, changes how it handles signals: what it ignores from then
    on would be ignored by every program that a later test begins."""
    before = {number: signal.getsignal(number) for number in OPERATORS}
    try:
        return (yield)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
