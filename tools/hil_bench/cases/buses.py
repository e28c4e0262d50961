"""Cases of a vehicle on several buses: a further one is lost, or silent. Cases of the link are about the first."""

from hil_bench.case import Case, Then
from hil_bench.cases.common import ANY, BROKEN_LINK, LINK, STALE
from hil_bench.expect import FallsSilent, NamesBus, StaysOut, Stops
from hil_bench.faults import frames, link
from hil_bench.parts import Part

FURTHER = 1
"""The number of the bus that these cases are about."""

BUSES = (
    Case(
        name="further-bus-lost",
        fault="B17",
        tags=("bus", "link", "buses"),
        proves="A lost further bus ends all commands on every bus, and is named; none is sent until it is armed.",
        injected="the interface of the second bus goes down for 0.8 s while the vehicle is driven",
        inject=link.take_link_down(bus=FURTHER),
        for_s=0.8,
        after_s=1.5,
        see=(FallsSilent(), StaysOut(), NamesBus(FURTHER)),
        then=Then.REARM,
        allow=BROKEN_LINK,
        needs=LINK,
    ),
    Case(
        name="further-bus-silent",
        fault="S1",
        tags=("bus", "state", "buses"),
        proves="Without the messages of a further bus the vehicle is stopped; the drive continues when they are back.",
        injected="no message on the second bus for 0.3 s",
        inject=frames.mute_bus(FURTHER),
        for_s=0.3,
        about=(Part.FURTHER_STATE,),
        see=(Stops(STALE),),
        allow=ANY,
    ),
)
