"""What all faults are made of: the type of an injection, and how several become one."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager

from vehicle_bus_contract.reference import FAULT, MANUAL, S

from hil_bench.rig import Rig
from hil_bench.vehicle import Fault
from hil_bench.vocabulary import Wait

Injection = Callable[[Rig], AbstractContextManager[None]]
ALWAYS = 1 << 40
"""A count that is never reached."""
RELEASE_S = 0.25


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


def a_tick_later(injection: Injection) -> Injection:
    """The other faults begin before it."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        rig.tick()
        with injection(rig):
            yield

    return inject


@contextmanager
def inject_nothing(_rig: Rig) -> Iterator[None]:
    """Let the vehicle drive undisturbed."""
    yield


def repeat(every_s: float, lasts_s: float, **changed: object) -> Injection:
    """At the beginning of each `every_s`, attributes of the vehicle have other values for `lasts_s`."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        before = {name: getattr(rig.vehicle, name) for name in changed}
        ticks = 0

        def change() -> None:
            nonlocal ticks
            is_on = ticks * rig.vehicle.period_ns / S % every_s < lasts_s
            ticks += 1
            for name, value in changed.items():
                setattr(rig.vehicle, name, value if is_on else before[name])

        with call_each_tick(rig, change):
            yield
        for name, value in before.items():
            setattr(rig.vehicle, name, value)

    return inject


def release(rig: Rig) -> None:
    """The vehicle is switched to MANUAL and back to READY: the device releases it, and is not armed."""
    rig.vehicle.mode = MANUAL if rig.wire.can_report("MANUAL") else FAULT
    rig.run_for(RELEASE_S + rig.wire.later_s[Wait.STATUS])
    rig.vehicle.make_ready()
    rig.run_for(RELEASE_S + rig.wire.later_s[Wait.STATUS])
