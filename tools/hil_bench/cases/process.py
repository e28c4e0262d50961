"""Cases of the device's process: paused, ended, killed, short of memory, under a stepped clock."""

import signal

from hil_bench.case import Case, Need, Then
from hil_bench.cases.common import ANY, STALE, STANDSTILL_S
from hil_bench.expect import (
    DrivesOn,
    Ends,
    EndsOrderly,
    FallsSilent,
    LetsGo,
    MomentaryAtMost,
    Standstill,
    StaysOut,
    Stops,
    WatchdogActs,
)
from hil_bench.faults import base, process, vehicle

PROCESS = (
    *(
        Case(
            name=f"paused-{name}",
            fault=row,
            tags=("process",),
            proves=what,
            injected=f"SIGSTOP to the device, SIGCONT {seconds} s later",
            inject=process.pause(),
            for_s=seconds,
            after_s=1.5,
            see=see,
            then=then,
            allow=ANY,
            needs=(Need.OWN_PROCESS, *((Need.REARM,) if then is Then.REARM else ())),
        )
        for name, row, seconds, what, see, then in (
            (
                "30-ms",
                "P5",
                0.03,
                "A cycle that is 30 ms late does not end the drive.",
                (MomentaryAtMost((*STALE, "DEADLINE_MISSED"), 0.1),),
                Then.GOES_ON,
            ),
            (
                "2-s",
                "P1 B10",
                2.0,
                "After two seconds without the processor no command comes from old state, and none in a burst.",
                (WatchdogActs(), StaysOut()),
                Then.REARM,
            ),
            (
                "5-s",
                "P1 B10",
                5.0,
                "The same after five seconds, when the receive queue has overflowed.",
                (WatchdogActs(), StaysOut()),
                Then.REARM,
            ),
        )
    ),
    Case(
        name="paused-100-ms",
        fault="P5",
        tags=("process",),
        proves="After 0.1 s without the processor only fresh samples are answered, and the drive continues.",
        injected="SIGSTOP to the device, SIGCONT 0.1 s later; the vehicle's watchdog is off",
        inject=base.combine(vehicle.change_vehicle(has_watchdog=False), process.pause()),
        for_s=0.1,
        see=(MomentaryAtMost((*STALE, "DEADLINE_MISSED"), 0.15),),
        allow=ANY,
        needs=(Need.OWN_PROCESS,),
    ),
    *(
        Case(
            name=f"ended-by-{name}",
            fault="P2",
            tags=("process",),
            proves=f"{what}: stop commands until standstill, then ENABLE = 0, then nothing.",
            injected=what,
            inject=process.send_signals(number),
            for_s=0.1,
            see=(Stops(("SHUTDOWN",), until_end=False), EndsOrderly(), Ends((0,), 12.0)),
            then=Then.ENDED,
            needs=(Need.OWN_PROCESS,),
        )
        for name, number, what in (
            ("sigterm", signal.SIGTERM, "SIGTERM"),
            ("sigint", signal.SIGINT, "SIGINT"),
        )
    ),
    Case(
        name="ended-twice",
        fault="P2",
        tags=("process",),
        proves="A second signal ends the stop at once, with ENABLE = 0.",
        injected="SIGTERM twice within 0.3 s",
        inject=process.send_signals(signal.SIGTERM, signal.SIGTERM, apart_s=0.3),
        for_s=0.1,
        see=(LetsGo(("SHUTDOWN",), within_s=0.5), Ends((0,), 4.0)),
        then=Then.ENDED,
        allow=frozenset({"doubled", "command", "release"}),
        needs=(Need.OWN_PROCESS,),
    ),
    Case(
        name="killed",
        fault="P3",
        tags=("process",),
        proves="No process of a killed device sends on: the vehicle's watchdog stops it.",
        injected="SIGKILL",
        inject=process.send_signals(signal.SIGKILL),
        for_s=0.5,
        after_s=1.5,
        see=(FallsSilent(0.05), WatchdogActs(), Standstill(STANDSTILL_S), Ends((-9,), 2.0)),
        then=Then.ENDED,
        exit_status=(-9,),
        needs=(Need.OWN_PROCESS,),
        allow=ANY,
    ),
    Case(
        name="many-descriptors",
        fault="P7",
        tags=("process",),
        proves="A device with more than 1024 open descriptors drives normally.",
        injected="the device starts with 1100 open descriptors",
        open_files=1100,
        inject=base.inject_nothing,
        for_s=2.0,
        see=(DrivesOn(),),
        needs=(Need.OWN_PROCESS,),
    ),
    Case(
        name="no-more-memory",
        fault="P7",
        tags=("process",),
        proves="A device that gets no more memory drives on.",
        injected="for 3 s the operating system gives the device no more memory (RLIMIT_AS, RLIMIT_DATA)",
        inject=process.limit_memory,
        for_s=3.0,
        see=(DrivesOn(),),
        needs=(Need.OWN_PROCESS,),
    ),
    *(
        Case(
            name=f"wall-clock-{name}",
            fault="P4",
            tags=("process", "clock"),
            proves="A step of the wall clock changes nothing.",
            injected=f"the wall clock steps by {by_s:+.0f} s, and back",
            inject=process.step_wall_clock(by_s),
            for_s=0.5,
            see=(DrivesOn(),),
            needs=(Need.OWN_PROCESS, Need.ROOT),
        )
        for name, by_s in (("ahead-10-s", 10.0), ("back-10-s", -10.0), ("back-an-hour", -3600.0))
    ),
)
