"""What all faults are made of: the type of an injection, and how several become one."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager

from hil_bench.rig import Rig
from hil_bench.vehicle import Fault

Injection = Callable[[Rig], AbstractContextManager[None]]
ALWAYS = 1 << 40
"""A count that is never reached."""


class NotApplicableError(OSError):
    """This vehicle or device cannot have the fault."""


@contextmanager
def with_fault(rig: Rig, fault: Fault) -> Iterator[None]:
    """Put `fault` between the vehicle and the bus."""
    rig.vehicle.faults.append(fault)
    try:
        yield
    finally:
        rig.vehicle.faults.remove(fault)


@contextmanager
def call_each_tick(rig: Rig, call: Callable[[], None]) -> Iterator[None]:
    """Run `call` in every tick, until the end or until the rig drops all of its calls."""
    rig.every_tick.append(call)
    try:
        yield
    finally:
        if call in rig.every_tick:
            rig.every_tick.remove(call)


def combine(*injections: Injection) -> Injection:
    """Inject several faults at once."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        with ExitStack() as stack:
            for injection in injections:
                stack.enter_context(injection(rig))
            yield

    return inject


@contextmanager
def inject_nothing(_rig: Rig) -> Iterator[None]:
    """Let the vehicle drive undisturbed."""
    yield
