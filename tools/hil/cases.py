"""The catalogue: every case of the bench, in one place.

The rows (B1, F2, S3, …) are those of the catalogue of faults; a row that can only be injected from inside a controller
is not here. Times are those of the bus contract.
"""

import re
import signal
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from bus_contract import Frame

from hil import faults as f
from hil import routes
from hil.case import Case, Need, Then
from hil.expect import (
    Answers,
    DrivesOn,
    Ends,
    EndsOrderly,
    FallsSilent,
    FollowsGaps,
    GivesUp,
    HazardLights,
    LetsGo,
    MomentaryAtMost,
    NeverEnables,
    ReachesEnd,
    Refuses,
    Standstill,
    StaysOut,
    Stops,
    WatchdogActs,
)
from hil.rig import Rig
from hil.vehicle import Utterance

STALE = ("STATE_STALE",)
INVALID = ("STATE_INVALID",)
LINK = (Need.OWN_PROCESS, Need.VIRTUAL, Need.ROOT, Need.REARM)
CABLE = (Need.OWN_PROCESS, Need.VXCAN, Need.ROOT)
DROPPED = frozenset({"unanswered"})
BAD_CABLE = frozenset({"unanswered", "doubled", "counter", "damaged", "burst", "periods"})
ANY = frozenset({"silence", "unanswered", "doubled"})
BROKEN_LINK = ANY | {"counter"}
"""A command that met a link that was lost never was on the bus."""
STANDSTILL_S = 2.5
"""From some 3 m/s by the safe deceleration, with the actuators' lag."""

BUS = (
    Case(
        name="link-down",
        fault="B1 B2 B3",
        tags=("bus", "link"),
        proves="A link that goes down ends commanding; when it is back the device stays out until it is armed.",
        injected="the interface goes down for 0.8 s while the vehicle is driven",
        inject=f.link(),
        for_s=0.8,
        after_s=1.5,
        see=(FallsSilent(), StaysOut()),
        then=Then.REARM,
        allow=BROKEN_LINK,
        needs=LINK,
    ),
    Case(
        name="link-blip",
        fault="B4",
        tags=("bus", "link"),
        proves="A link that is down for a moment is noticed, although it is up again before anybody looks.",
        injected="the interface goes down and up again within 5 ms",
        inject=f.link(down_s=0.005),
        for_s=0.3,
        after_s=1.5,
        see=(FallsSilent(), StaysOut()),
        then=Then.REARM,
        allow=BROKEN_LINK,
        needs=LINK,
    ),
    Case(
        name="link-deleted-and-made-anew",
        fault="B5 B6",
        tags=("bus", "link"),
        proves="An interface that is deleted and made anew under its name is used again, when armed.",
        injected="the interface is deleted, and made anew 0.8 s later",
        inject=f.made_anew(),
        for_s=0.8,
        after_s=2.0,
        see=(FallsSilent(), StaysOut()),
        then=Then.REARM,
        allow=BROKEN_LINK,
        needs=LINK,
    ),
    Case(
        name="link-down-at-start",
        fault="B7",
        tags=("bus", "link", "refusal"),
        proves="A device whose interface is down refuses to begin.",
        injected="the interface is down when the device is started",
        link_is_down=True,
        at_mps=-1.0,
        for_s=0.1,
        see=(Refuses(3),),
        then=Then.ENDED,
        exit_status=(3,),
        needs=(Need.OWN_PROCESS, Need.VIRTUAL, Need.ROOT),
    ),
    Case(
        name="link-absent-at-start",
        fault="B7",
        tags=("bus", "link", "refusal"),
        proves="A device whose interface is not there refuses to begin.",
        injected="the device is told to use an interface that there is not",
        channel="vcan-none",
        at_mps=-1.0,
        for_s=0.1,
        see=(Refuses(3),),
        then=Then.ENDED,
        exit_status=(3,),
        needs=(Need.OWN_PROCESS,),
    ),
    Case(
        name="transmit-queue-stuck",
        fault="B8 B9",
        tags=("bus", "cable"),
        proves="Commands that cannot leave are given up: silence, and no old one comes when the queue moves.",
        injected="nothing leaves the device's end of the cable for 1 s (tbf at 8 bit/s)",
        on_vxcan=True,
        inject=f.queue("tbf", "rate", "8bit", "burst", "16", "limit", "100000"),
        for_s=1.0,
        after_s=1.5,
        see=(FallsSilent(), StaysOut(), WatchdogActs()),
        then=Then.REARM,
        allow=BROKEN_LINK,
        needs=(*CABLE, Need.REARM),
    ),
    Case(
        name="flood-of-strangers",
        fault="B11",
        tags=("bus", "load", "quick"),
        proves="Frames that are none of the device's business cost it no sample.",
        injected="strangers' frames at 90 % bus load for 2 s",
        inject=f.load(0.9),
        for_s=2.0,
        see=(DrivesOn(),),
    ),
    Case(
        name="flood-of-state-identifiers",
        fault="B12",
        tags=("bus", "e2e"),
        proves="A flood of damaged frames with the vehicle's identifiers is no state: the vehicle is stopped.",
        injected="ten random frames with the sample's identifiers every 10 ms",
        inject=f.flood(f.damaged_sample, 10),
        for_s=0.8,
        after_s=1.2,
        see=(Stops(STALE, until_end=False),),
        then=Then.REARM,
        allow=ANY,
        needs=(Need.REARM,),
    ),
    Case(
        name="second-vehicle",
        fault="B12",
        tags=("bus", "e2e"),
        proves="A second vehicle on the bus is not mixed up with the first; the drive ends rather than jumps.",
        injected="another vehicle's samples between the vehicle's own, 40 m away",
        inject=f.second_vehicle(),
        for_s=0.8,
        after_s=1.2,
        see=(Stops((*STALE, *INVALID), within_s=0.25, until_end=False),),
        then=Then.REARM,
        allow=ANY,
        needs=(Need.REARM,),
    ),
    Case(
        name="bus-off",
        fault="B13",
        tags=("bus", "error-frames"),
        proves="A CAN controller that reports bus-off ends commanding until it is armed again.",
        injected="an error frame of class bus-off",
        inject=f.flood(f.error_frame(0x40), 1),
        for_s=0.05,
        after_s=1.2,
        see=(FallsSilent(), StaysOut()),
        then=Then.REARM,
        allow=ANY,
        needs=(Need.VIRTUAL, Need.REARM),
    ),
    Case(
        name="error-passive",
        fault="B13",
        tags=("bus", "error-frames"),
        proves="Warnings of the CAN controller are no frames of the vehicle's, and no reason to stop.",
        injected="error frames of the classes warning and passive for 0.3 s",
        inject=f.flood(f.error_frame(0x4, bytes((0, 0x20, 0, 0, 0, 0, 130, 130))), 1),
        for_s=0.3,
        see=(DrivesOn(),),
        needs=(Need.VIRTUAL,),
    ),
    *(
        Case(
            name=f"cable-{name}",
            fault="B14",
            tags=("bus", "cable", "e2e"),
            proves=f"{what} on the cable, both ways, is dropped or borne; a stop only where the state grows old by it.",
            injected=f"netem on both ends of the cable for 3 s: {' '.join(words)}",
            on_vxcan=True,
            inject=f.both(f.queue("netem", *words), f.queue("netem", *words, at="{bench}")),
            for_s=3.0,
            see=(MomentaryAtMost(STALE, most),),
            allow=BAD_CABLE | {"silence"},
            needs=CABLE,
        )
        for name, what, words, most in (
            ("loses-1-percent", "One frame in a hundred that is lost", ("loss", "1%"), 0.2),
            ("loses-5-percent", "One frame in twenty that is lost", ("loss", "5%"), 0.6),
            ("loses-10-percent", "One frame in ten that is lost", ("loss", "10%"), 1.5),
            ("doubles", "One frame in ten that comes twice", ("duplicate", "10%"), 0.2),
            ("reorders", "Frames that overtake each other", ("delay", "3ms", "reorder", "95%"), 0.6),
            ("damages", "One frame in fifty with a bit that is wrong", ("corrupt", "2%"), 0.6),
        )
    ),
    Case(
        name="second-commander",
        fault="B15",
        tags=("bus", "quick"),
        proves="Of two commanders on one vehicle the device is the one that falls silent.",
        injected="somebody else's commands with the device's identifiers for 0.3 s",
        inject=f.flood(f.rival_command, 2),
        for_s=0.3,
        after_s=1.2,
        see=(FallsSilent(0.05), StaysOut()),
        then=Then.REARM,
        allow=ANY,
        needs=(Need.REARM,),
    ),
    Case(
        name="replay-of-the-bus",
        fault="B16",
        tags=("bus",),
        proves="A log of the whole bus, played back, is not driven by: the device finds its own old commands in it.",
        injected="the last 1.5 s of the bus are played back, while the vehicle is silent",
        inject=f.replayed(1.5),
        for_s=1.0,
        after_s=1.2,
        see=(FallsSilent(0.6), StaysOut()),
        then=Then.REARM,
        allow=ANY,
        needs=(Need.REARM,),
    ),
)

FRAMES = (
    *(
        Case(
            name=f"frames-{name}",
            fault="F1",
            tags=("frames",),
            proves=f"Frames {what} are dropped whole, and the sound ones beside them are driven by.",
            injected=f"after each frame of the sample another one, {what}, for 0.5 s",
            inject=f.frames(f.also(change)),
            see=(DrivesOn(),),
        )
        for name, what, change in (
            ("too-short", "that are too short", f.too_short),
            ("empty", "without data", f.empty),
            ("extended", "with an extended identifier of the same number", f.extended),
            ("remote", "that are remote requests", f.remote),
            ("other-format", "of the other format (CAN FD, classical)", f.other_format),
        )
    ),
    *(
        Case(
            name=f"frames-always-{name}",
            fault="F1",
            tags=("frames",),
            proves=f"A vehicle whose frames are all {what} has no state: it is stopped.",
            injected=f"every frame of the sample {what}, for 0.4 s",
            inject=f.frames(change),
            for_s=0.4,
            see=(Stops(STALE), HazardLights()),
            allow=ANY,
        )
        for name, what, change in (
            ("too-short", "too short", f.too_short),
            ("extended", "with an extended identifier of the same number", f.extended),
            ("remote", "remote requests", f.remote),
            ("other-format", "of the other format (CAN FD, classical)", f.other_format),
        )
    ),
    Case(
        name="crc-wrong-once",
        fault="F2",
        tags=("frames", "e2e"),
        proves="One wrong checksum costs one sample, and nothing else.",
        injected="one frame with a wrong checksum",
        inject=f.frames(f.crc_wrong, count=1, of=()),
        see=(DrivesOn(),),
        allow=DROPPED,
    ),
    Case(
        name="crc-wrong-four-times",
        fault="F2",
        tags=("frames", "e2e"),
        proves="Four wrong checksums in a row cost a moment at most.",
        injected="four samples with wrong checksums",
        inject=f.frames(f.crc_wrong, count=4),
        see=(MomentaryAtMost(STALE, 0.15),),
        allow=ANY,
    ),
    Case(
        name="crc-always-wrong",
        fault="F2",
        tags=("frames", "e2e", "quick"),
        proves="State whose checksum is always wrong is no state: stop, then silence.",
        injected="every frame of the sample with a wrong checksum for 0.8 s",
        inject=f.frames(f.crc_wrong),
        for_s=0.8,
        after_s=1.2,
        see=(Stops(STALE, until_end=False), HazardLights(), StaysOut()),
        then=Then.REARM,
        allow=ANY,
        needs=(Need.REARM,),
    ),
    Case(
        name="bits-flipped",
        fault="F2 B14",
        tags=("frames", "e2e"),
        proves="A bit that is wrong somewhere in one frame of ten never becomes a wrong state.",
        injected="a random bit of every tenth frame is wrong, for 2 s",
        inject=f.frames(f.sometimes(0.1, f.bit_flipped)),
        for_s=2.0,
        see=(MomentaryAtMost(STALE, 1.0),),
        allow=ANY,
    ),
    Case(
        name="counter-stuck",
        fault="F3",
        tags=("frames", "e2e"),
        proves="A counter that stands still is an old sample sent again: the vehicle is stopped.",
        injected="every sample with the same counter for 0.4 s",
        inject=f.counter_of(lambda counter: 7),  # noqa: ARG005
        for_s=0.4,
        see=(Stops(STALE, within_s=0.2),),
        allow=ANY,
    ),
    Case(
        name="counter-skips-two",
        fault="F3",
        tags=("frames", "e2e"),
        proves="Two samples that were lost are borne.",
        injected="the counter leaves out two values",
        inject=f.skips(2),
        see=(DrivesOn(),),
        allow=DROPPED,
    ),
    Case(
        name="counter-jumps",
        fault="F3",
        tags=("frames", "e2e"),
        proves="A counter that jumps is not believed at once, and the drive goes on from it.",
        injected="the counter jumps by six after every tenth sample, for 1 s",
        inject=f.skips(6, every=10),
        for_s=1.0,
        see=(MomentaryAtMost(STALE, 0.1), Answers(0.75, 0.94)),
        allow=ANY,
    ),
    Case(
        name="counter-wraps-early",
        fault="F3",
        tags=("frames", "e2e"),
        proves="A counter that comes round after eight values is out of sequence every time.",
        injected="the counter runs from 0 to 7 for 0.6 s",
        inject=f.counter_of(lambda counter: counter % 8),
        for_s=0.6,
        see=(MomentaryAtMost(STALE, 0.3), Answers(0.7, 0.94)),
        allow=ANY,
    ),
    Case(
        name="fifteen-samples-lost",
        fault="F3 S1",
        tags=("frames", "state"),
        proves="Exactly as many lost samples as the counter has values look like none: the time out finds them.",
        injected="fifteen samples are lost",
        inject=f.frames(f.lost, count=15),
        for_s=0.3,
        see=(Stops(STALE, until_end=False),),
        allow=ANY,
    ),
    Case(
        name="foreign-data-id",
        fault="F4",
        tags=("frames", "e2e"),
        proves="A frame that was sealed for another message is dropped: nothing but such frames is no state.",
        injected="every frame of the sample sealed with another data id for 0.4 s",
        inject=f.frames(f.foreign_data_id),
        for_s=0.4,
        see=(Stops(STALE),),
        allow=ANY,
    ),
    Case(
        name="enumeration-unknown",
        fault="F5",
        tags=("frames", "values"),
        proves="A number that no enumeration knows drops its frame whole.",
        injected="a frame of reference that has no name, for 0.4 s",
        inject=f.values(POSE_FRAME=3),
        for_s=0.4,
        see=(Stops((*STALE, "FRAME_MISMATCH", *INVALID)),),
        allow=ANY,
    ),
    Case(
        name="value-out-of-range",
        fault="F5",
        tags=("frames", "values"),
        proves="A value beyond the range that the DBC gives drops its frame whole.",
        injected="a speed above the DBC's greatest, for 0.4 s",
        inject=f.out_of_range("SPEED"),
        for_s=0.4,
        see=(Stops(STALE),),
        allow=ANY,
    ),
    Case(
        name="mode-unknown",
        fault="F5",
        tags=("frames", "values"),
        proves="A mode of the vehicle's that has no name is not taken for a known one: no driving on.",
        injected="mode 7 for 0.6 s",
        inject=f.values(MODE=7),
        for_s=0.6,
        see=(Stops((*STALE, *INVALID, "VEHICLE_NOT_AUTONOMOUS", "VEHICLE_FAULT"), within_s=0.25, until_end=False),),
        after_s=1.0,
        then=Then.REARM,
        allow=ANY,
        needs=(Need.REARM,),
    ),
    Case(
        name="cycles-mixed",
        fault="F6",
        tags=("frames", "e2e"),
        proves="Parts of different cycles are never combined to one sample.",
        injected="the last part of one sample, the others of the next, and so on for 0.4 s: none is ever whole",
        inject=f.mixed_cycles(),
        for_s=0.4,
        see=(Stops(STALE),),
        allow=ANY,
    ),
)

STATE = (
    Case(
        name="state-lost",
        fault="S1",
        tags=("state", "quick"),
        proves="Without state the vehicle is stopped, and driven on when it is back in time.",
        injected="no sample for 0.3 s",
        inject=f.frames(f.lost),
        for_s=0.3,
        see=(Stops(STALE),),
        allow=ANY,
    ),
    Case(
        name="state-lost-for-long",
        fault="S1",
        tags=("state",),
        proves="Half a second without state ends in silence, and the vehicle's own watchdog acts.",
        injected="no sample for 1.2 s",
        inject=f.frames(f.lost),
        for_s=1.2,
        after_s=1.2,
        see=(Stops(STALE, until_end=False), FallsSilent(0.6), WatchdogActs(0.75), StaysOut()),
        then=Then.REARM,
        allow=ANY,
        needs=(Need.REARM,),
    ),
    Case(
        name="state-lost-at-speed",
        fault="S1",
        tags=("state", "manoeuvre"),
        proves="Without state the vehicle is braked from 12 m/s, and driven on when it is back in time.",
        injected="no sample for 0.4 s at 12 m/s",
        route=lambda: routes.straight(600.0, 13.0),
        at_mps=12.0,
        inject=f.frames(f.lost),
        for_s=0.4,
        see=(Stops(STALE),),
        allow=ANY,
    ),
    Case(
        name="emergency-stop-from-12-mps",
        fault="S5",
        tags=("state", "manoeuvre"),
        proves="An emergency stop at speed, to standstill: the stop is held as long as the pose is invalid.",
        injected="POSE_VALID = 0 for 7 s at 12 m/s",
        route=lambda: routes.straight(600.0, 13.0),
        at_mps=12.0,
        inject=f.attribute(pose_valid=False),
        for_s=7.0,
        see=(Stops(INVALID), Standstill(6.0), HazardLights()),
        after_s=3.0,
        allow=DROPPED,
    ),
    Case(
        name="status-lost",
        fault="S1",
        tags=("state", "driver"),
        proves="Without the status nobody knows what the driver does: the vehicle is stopped.",
        injected="no status for 0.6 s",
        inject=f.frames(f.lost, of=("VEHICLE_STATUS",)),
        for_s=0.6,
        see=(Stops((*STALE, "VEHICLE_NOT_AUTONOMOUS"), within_s=0.25, until_end=False),),
        allow=ANY,
    ),
    Case(
        name="half-the-rate",
        fault="S2",
        tags=("state",),
        proves="Samples at half the rate are young enough: no stop.",
        injected="every other sample is lost for 1 s",
        inject=f.left_out(2),
        for_s=1.0,
        see=(DrivesOn(),),
        allow=DROPPED,
    ),
    Case(
        name="jitter",
        fault="S2",
        tags=("state",),
        proves="Samples that come up to 8 ms late are young enough: no stop.",
        injected="every sample late by 0 to 8 ms for 1 s",
        inject=f.jitter(0.008),
        for_s=1.0,
        see=(DrivesOn(),),
    ),
    Case(
        name="one-sample-missing",
        fault="S2",
        tags=("state",),
        proves="One sample that is missing is borne.",
        injected="one sample is lost",
        inject=f.frames(f.lost, count=1),
        see=(DrivesOn(),),
        allow=DROPPED,
    ),
    Case(
        name="position-jumps-once",
        fault="S3",
        tags=("state", "plausibility"),
        proves="One position that cannot be is dropped.",
        injected="one sample 30 m to the side",
        inject=f.added(1, POS_Y=30.0),
        see=(DrivesOn(),),
        allow=DROPPED,
    ),
    Case(
        name="position-jumps",
        fault="S3",
        tags=("state", "plausibility"),
        proves="Positions that cannot be, one after the other, stop the vehicle.",
        injected="samples 30 m away, to one side and the other, for 0.4 s",
        inject=lambda rig: f.frames(lambda r, u: [_sideways(r, u)])(rig),
        for_s=0.4,
        see=(Stops((*INVALID, *STALE), until_end=False),),
        allow=ANY,
    ),
    Case(
        name="state-frozen",
        fault="S4",
        tags=("state", "plausibility"),
        proves="Values that stand still under a live counter, while the vehicle moves, stop it.",
        injected="every sample as the first one, with a live counter, for 1 s at 4 m/s",
        at_mps=4.0,
        inject=f.frozen(),
        for_s=1.0,
        see=(Stops((*INVALID, *STALE), within_s=0.2, until_end=False),),
        after_s=1.2,
        then=Then.REARM,
        allow=ANY,
        needs=(Need.REARM,),
    ),
    Case(
        name="pose-invalid",
        fault="S5",
        tags=("state",),
        proves="A pose that calls itself invalid stops the vehicle.",
        injected="POSE_VALID = 0 for 0.3 s",
        inject=f.attribute(pose_valid=False),
        for_s=0.3,
        see=(Stops(INVALID), HazardLights()),
        allow=DROPPED,
    ),
    Case(
        name="pose-invalid-in-a-bend",
        fault="S5",
        tags=("state", "limits"),
        proves="A stop in a bend at speed gives the wheels back no faster than the lateral jerk allows.",
        injected="POSE_VALID = 0 for 0.5 s, in a bend of 25 m",
        route=routes.bend,
        at_mps=6.5,
        inject=f.attribute(pose_valid=False),
        see=(Stops(INVALID), HazardLights()),
        allow=DROPPED,
    ),
    Case(
        name="other-frame-of-reference",
        fault="S5",
        tags=("state",),
        proves="A pose in another frame of reference than the trajectory's stops the vehicle.",
        injected="the pose is in ODOM for 0.3 s",
        inject=f.attribute(pose_frame="ODOM"),
        for_s=0.3,
        see=(Stops(("FRAME_MISMATCH", *INVALID)),),
        allow=DROPPED,
    ),
    Case(
        name="older-samples-again",
        fault="S6",
        tags=("state", "e2e"),
        proves="A sample that is older than the newest is dropped.",
        injected="after every tenth sample the one of 80 ms before comes again, for 1 s",
        inject=f.older_again(10),
        for_s=1.0,
        see=(MomentaryAtMost(STALE, 0.3), Answers(0.75, 1.04)),
        allow=ANY,
    ),
    Case(
        name="drifting-off",
        fault="C2",
        tags=("state", "deviation"),
        proves="A vehicle that is more than 3 m off its path is stopped, and stays so.",
        injected="the vehicle drifts to the left by 4 m/s, whatever it steers",
        inject=f.attribute(plant_drift_mps=4.0),
        for_s=3.0,
        see=(Stops(("DEVIATION",), within_s=2.5), Standstill(5.5)),
        then=Then.HOLDS,
        after_s=1.0,
    ),
    Case(
        name="steering-hangs",
        fault="C2",
        tags=("state", "deviation", "limits"),
        proves="Wheels that hang are not led away from, and a vehicle that leaves its path by them is stopped.",
        injected="the wheels stay where they are, before a curve of 7 m",
        route=routes.u_turn,
        inject=f.attribute(plant_wheel_rate_limit_radps=0.0),
        for_s=5.0,
        see=(Stops(("DEVIATION",), within_s=4.5), Standstill(7.0)),
        then=Then.HOLDS,
        after_s=2.0,
    ),
    Case(
        name="rolling-back",
        fault="C2",
        tags=("state", "deviation"),
        proves="A vehicle that rolls against its direction of travel is stopped.",
        injected="a slope pulls the vehicle backwards by 7 m/s²",
        at_mps=1.0,
        inject=f.attribute(plant_pushed_mps2=-7.0),
        for_s=1.2,
        see=(Stops(("DEVIATION",), within_s=1.2, until_end=False),),
        then=Then.HOLDS,
        after_s=1.0,
        allow=frozenset({"command"}),
    ),
    Case(
        name="overspeed",
        fault="C2",
        tags=("state", "deviation", "slow"),
        proves="A vehicle that is pushed above the speed limit is stopped.",
        injected="a tow pulls the vehicle forward by 14 m/s² until far above the limit",
        route=lambda: routes.straight(900.0, 8.0),
        at_mps=6.0,
        inject=f.attribute(plant_pushed_mps2=14.0),
        for_s=2.0,
        see=(Stops(("DEVIATION",), within_s=2.2, until_end=False),),
        then=Then.HOLDS,
        after_s=0.5,
    ),
)

DRIVER = (
    *(
        Case(
            name=f"driver-{name}",
            fault="V1",
            tags=("driver", *(("quick",) if name == "brakes" else ())),
            proves=f"A driver who {what} has the vehicle with the next sample, until the device is armed again.",
            injected=f"the driver {what} for 0.3 s",
            inject=f.becomes(**changed),
            for_s=0.3,
            after_s=1.5,
            see=(LetsGo(("DRIVER_OVERRIDE",), within_s=0.06), StaysOut()),
            then=Then.REARM,
            allow=DROPPED,
            needs=(Need.REARM,),
        )
        for name, what, changed in (
            ("brakes", "brakes", {"driver_brake": True}),
            ("accelerates", "accelerates", {"driver_throttle": True}),
            ("steers-left", "steers to the left", {"driver_torque_nm": 3.5}),
            ("steers-right", "steers to the right", {"driver_torque_nm": -3.5}),
        )
    ),
    Case(
        name="driver-rests-a-hand",
        fault="V1",
        tags=("driver",),
        proves="A hand on the wheel, below the threshold, is no override.",
        injected="2.9 N·m for 0.5 s",
        inject=f.attribute(driver_torque_nm=2.9),
        see=(DrivesOn(),),
    ),
    Case(
        name="driver-lets-go-again",
        fault="V1",
        tags=("driver",),
        proves="An override is latched: a driver who lets go has not armed the device.",
        injected="the driver brakes for 0.2 s, lets go, and the vehicle is READY again for 2.5 s",
        inject=f.for_a_moment(driver_brake=True),
        for_s=0.2,
        after_s=2.5,
        see=(LetsGo(("DRIVER_OVERRIDE", "NOT_ENGAGED"), within_s=0.06), StaysOut()),
        then=Then.REARM,
        needs=(Need.REARM,),
    ),
    Case(
        name="vehicle-never-engages",
        fault="V2",
        tags=("driver", "engagement"),
        proves="A vehicle that does not engage is asked for three seconds, not for ever.",
        injected="the vehicle stays READY whatever it is asked",
        at_mps=-1.0,
        inject=f.attribute(engages=False),
        for_s=12.0,
        see=(GivesUp(3.0),),
        then=Then.REARM,
        needs=(Need.REARM, Need.START),
        answers_in_time=False,
    ),
    Case(
        name="vehicle-not-ready",
        fault="V2",
        tags=("driver", "engagement"),
        proves="A vehicle in MANUAL is not asked for anything.",
        injected="the vehicle is in MANUAL for 8 s from the beginning",
        at_mps=-1.0,
        inject=f.becomes(mode=0),
        for_s=8.0,
        see=(NeverEnables(),),
        then=Then.REARM,
        needs=(Need.REARM, Need.START),
        answers_in_time=False,
    ),
    Case(
        name="vehicle-drops-out",
        fault="V2",
        tags=("driver", "engagement"),
        proves="A vehicle that silently leaves AUTONOMOUS is let go of within 200 ms.",
        injected="the vehicle goes to MANUAL by itself",
        inject=f.becomes(mode=0),
        for_s=0.5,
        after_s=1.0,
        see=(LetsGo(("VEHICLE_NOT_AUTONOMOUS", "NOT_ENGAGED", "DRIVER_OVERRIDE"), within_s=0.2), StaysOut()),
        then=Then.REARM,
        allow=DROPPED,
        needs=(Need.REARM,),
    ),
    Case(
        name="vehicle-reports-a-fault",
        fault="V2",
        tags=("driver", "engagement"),
        proves="A vehicle that reports a fault is not driven on until the device is armed again.",
        injected="fault code 5, and mode FAULT",
        inject=f.becomes(fault_code=5),
        for_s=0.5,
        after_s=1.2,
        see=(LetsGo(("VEHICLE_FAULT",), within_s=0.15), StaysOut()),
        then=Then.REARM,
        allow=ANY,
        needs=(Need.REARM,),
    ),
    Case(
        name="emergency-stop-button",
        fault="V2",
        tags=("driver", "engagement"),
        proves="An emergency stop of the vehicle's is not worked against.",
        injected="mode EMERGENCY_STOP",
        inject=f.becomes(mode=4),
        for_s=0.5,
        after_s=1.2,
        see=(LetsGo(("VEHICLE_FAULT", "VEHICLE_NOT_AUTONOMOUS"), within_s=0.15), StaysOut()),
        then=Then.REARM,
        allow=ANY,
        needs=(Need.REARM,),
    ),
    Case(
        name="not-armed",
        tags=("engagement", "quick"),
        proves="A device that is not armed sends nothing at all.",
        injected="the device is started without being armed, for 8 s",
        armed=False,
        at_mps=-1.0,
        for_s=8.0,
        see=(NeverEnables(at_all=True),),
        then=Then.NEVER,
        needs=(Need.START,),
        answers_in_time=False,
    ),
)


def _sideways(rig: Rig, utterance: Utterance) -> Frame:
    """The pose 30 m to either side, in turn."""
    told = rig.wire.intact(utterance.frame)
    if told is None or "POS_Y" not in told.signals:
        return utterance.frame
    values = {word: value for word, value in told.signals.items() if word != "COUNTER"}
    values["POS_Y"] += 30.0 if told.counter % 2 else -30.0
    return rig.wire.pack(told.name, told.counter, **values)


def _line(number: int, change: Callable[[list[str]], str]) -> Callable[[str], str]:
    """A change of one line of a trajectory, in its cells."""

    def spoil(text: str) -> str:
        lines = text.splitlines()
        lines[number] = change(lines[number].split(","))
        return "\n".join(lines) + "\n"

    return spoil


def _cell(line: int, column: int, text: str) -> Callable[[str], str]:
    return _line(line, lambda cells: ",".join([*cells[:column], text, *cells[column + 1 :]]))


def _refused(name: str, what: str, breaks: Callable[[str], str], fault: str = "T5") -> Case:
    return Case(
        name=f"trajectory-{name}",
        fault=fault,
        tags=("trajectory", "refusal"),
        proves=f"A trajectory {what} is refused before the first frame.",
        injected=f"the file that the device loads: {what}",
        breaks=breaks,
        at_mps=-1.0,
        for_s=0.1,
        see=(Refuses(2),),
        then=Then.ENDED,
        exit_status=(2,),
        needs=(Need.OWN_PROCESS,),
        answers_in_time=False,
    )


def _spoilt(name: str, what: str, fault: str, profile: Callable[[str, str], tuple[str, str]]) -> Case:
    return Case(
        name=f"profile-{name}",
        fault=fault,
        tags=("profile", "refusal"),
        proves=f"A profile {what} is refused before the first frame.",
        injected=f"what the device loads: a profile {what}",
        profile=profile,
        at_mps=-1.0,
        for_s=0.1,
        see=(Refuses(2),),
        then=Then.ENDED,
        exit_status=(2,),
        needs=(Need.OWN_PROCESS,),
        answers_in_time=False,
    )


def _without(text: str, start: str) -> str:
    return "\n".join(line for line in text.splitlines() if not line.startswith(start)) + "\n"


def _second_as_first(dbc: str) -> str:
    """The second message has the identifier of the first."""
    first, second = re.findall(r"^BO_ (\d+) ", dbc, re.MULTILINE)[:2]
    return dbc.replace(f"BO_ {second} ", f"BO_ {first} ", 1)


FILES = (
    _refused("with-text-in-a-cell", "with text in a cell", _cell(20, 1, "abc")),
    _refused("with-a-decimal-comma", "with a decimal comma", _cell(20, 1, "1,5")),
    _refused("without-a-column", "without a column", lambda text: text.replace(",heading_rad", "", 1)),
    _refused("empty-file", "that is an empty file", lambda text: ""),  # noqa: ARG005
    _refused("with-another-delimiter", "with semicolons", lambda text: text.replace(",", ";")),
    _refused("with-nan", "with a number that is none", _cell(20, 3, "nan"), "T2"),
    _refused("with-decreasing-time", "whose time goes back", _cell(20, 0, "0.001"), "T2"),
    _refused("too-fast", "that is faster than the vehicle may be driven", _cell(20, 4, "35.0"), "T2"),
    replace(
        _refused("too-sharp", "that turns sharper than the wheels can", lambda text: text, "T2"),
        route=lambda: routes.route("sharp", [(20.0, 0.0), (5.0, 0.6), (20.0, 0.0)], 3.0),
    ),
    _spoilt("without-a-limit", "that lacks a limit", "F8", lambda toml, dbc: (_without(toml, "accel_rate_mps3"), dbc)),
    _spoilt("with-nan", "with a limit that is no number", "F8", lambda t, d: (t.replace("= -6.0", "= nan"), d)),
    _spoilt(
        "with-a-misspelt-key", "with a misspelt key", "F8", lambda t, d: (t.replace("wheelbase_m", "wheelbas_m"), d)
    ),
    _spoilt("with-a-key-twice", "with a key twice", "F8", lambda t, d: (t.replace("[bus]\n", "[bus]\nfd = true\n"), d)),
    _spoilt(
        "with-a-word-for-a-number", "with a word for a number", "F8", lambda t, d: (t.replace("= 30.0", '= "much"'), d)
    ),
    _spoilt(
        "with-an-absent-signal",
        "with a signal that there is not",
        "F8",
        lambda t, d: (t.replace(".SPEED", ".SPEEED"), d),
    ),
    _spoilt("with-a-dbc-cut-short", "whose DBC is cut short", "F7", lambda t, d: (t, d[: len(d) // 2])),
    _spoilt("with-a-dbc-of-noise", "whose DBC is noise", "F7", lambda t, d: (t, d[::-1])),
    _spoilt(
        "with-overlapping-signals",
        "whose DBC has signals that overlap",
        "F7",
        lambda t, d: (t, d.replace(": 48|", ": 40|")),
    ),
    _spoilt(
        "with-a-factor-of-0", "whose DBC has a factor of 0", "F7", lambda t, d: (t, d.replace("(0.005,0)", "(0,0)"))
    ),
    _spoilt(
        "with-an-identifier-twice", "whose DBC has an identifier twice", "F7", lambda t, d: (t, _second_as_first(d))
    ),
)

TRAJECTORY = (
    Case(
        name="end-of-space",
        fault="T1",
        tags=("trajectory", "quick"),
        proves="At the end of the trajectory the vehicle is stopped and held, without hazard lights.",
        route=lambda: routes.route("short", [(12.0, 0.0)], 4.0),
        see=(ReachesEnd(),),
        then=Then.END_OF_ROUTE,
        most_path_error_m=0.3,
    ),
    Case(
        name="end-of-time",
        fault="T1",
        tags=("trajectory",),
        proves="When the trajectory's time is over the vehicle is stopped, wherever it is.",
        injected="a trajectory whose time is over long before the vehicle can be at its end",
        route=lambda: routes.route("hurried", [(60.0, 0.0)], 5.0, slack=0.4),
        setup={"drive_limit_mps2": 0.8},
        see=(ReachesEnd(("PAST_END_TIME",)),),
        then=Then.END_OF_ROUTE,
    ),
    Case(
        name="many-points",
        fault="T2",
        tags=("trajectory", "slow"),
        proves="A trajectory of two hundred thousand points is driven like any other.",
        route=lambda: routes.route("dense", [(400.0, 0.0)], 5.0, spacing_m=0.002),
        inject=f.nothing,
        injected="nothing but the number of points",
        for_s=2.0,
        see=(DrivesOn(),),
        most_path_error_m=0.3,
    ),
)

PROCESS = (
    *(
        Case(
            name=f"paused-{name}",
            fault=row,
            tags=("process",),
            proves=what,
            injected=f"SIGSTOP to the device, SIGCONT {seconds} s later",
            inject=f.paused(),
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
                "A pass that is 30 ms late does not end the drive.",
                (MomentaryAtMost((*STALE, "DEADLINE_MISSED"), 0.1),),
                Then.GOES_ON,
            ),
            (
                "2-s",
                "P1 B10",
                2.0,
                "After two seconds without the processor nothing is commanded from old state, and nothing in a burst.",
                (WatchdogActs(), StaysOut()),
                Then.REARM,
            ),
            (
                "5-s",
                "P1 B10",
                5.0,
                "After five seconds, too, with a receive queue that has overflowed.",
                (WatchdogActs(), StaysOut()),
                Then.REARM,
            ),
        )
    ),
    Case(
        name="paused-100-ms",
        fault="P5",
        tags=("process",),
        proves="After 0.1 s without the processor only young samples are answered, and the drive goes on.",
        injected="SIGSTOP to the device, SIGCONT 0.1 s later; the vehicle's watchdog is off",
        inject=f.both(f.attribute(watches=False), f.paused()),
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
            inject=f.signals(number),
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
        proves="A second signal cuts the stop short to one ENABLE = 0.",
        injected="SIGTERM twice within 0.3 s",
        inject=f.signals(signal.SIGTERM, signal.SIGTERM, apart_s=0.3),
        for_s=0.1,
        see=(LetsGo(("SHUTDOWN",), within_s=0.5), Ends((0,), 4.0)),
        then=Then.ENDED,
        allow=frozenset({"doubled", "command"}),
        needs=(Need.OWN_PROCESS,),
    ),
    Case(
        name="killed",
        fault="P3",
        tags=("process", "quick"),
        proves="Nothing of a killed device goes on sending: the vehicle's watchdog stops it.",
        injected="SIGKILL",
        inject=f.signals(signal.SIGKILL),
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
        proves="A device that has more than 1024 descriptors open drives like any other.",
        injected="1100 descriptors are open in the device before it begins",
        open_files=1100,
        inject=f.nothing,
        for_s=2.0,
        see=(DrivesOn(),),
        needs=(Need.OWN_PROCESS,),
    ),
    Case(
        name="no-more-memory",
        fault="P7",
        tags=("process",),
        proves="A device that gets no more memory than it has drives on.",
        injected="for 3 s the operating system gives the device no more memory (RLIMIT_AS, RLIMIT_DATA)",
        inject=f.without_memory,
        for_s=3.0,
        see=(DrivesOn(),),
        needs=(Need.OWN_PROCESS,),
    ),
    *(
        Case(
            name=f"wall-clock-{name}",
            fault="P4",
            tags=("process", "clock"),
            proves="A wall clock that steps changes nothing.",
            injected=f"the wall clock steps by {by_s:+.0f} s, and back",
            inject=f.wall_clock(by_s),
            for_s=0.5,
            see=(DrivesOn(),),
            needs=(Need.OWN_PROCESS, Need.ROOT),
        )
        for name, by_s in (("ahead-10-s", 10.0), ("back-10-s", -10.0), ("back-an-hour", -3600.0))
    ),
)


def _beside(name: str, fault: str, what: str, injected: str, inject: f.Injection, for_s: float, **more: Any) -> Case:
    """Something beside the loop is spoilt."""
    kind = name.partition("-")[0]
    return Case(
        name=name,
        fault=fault,
        tags=("beside", kind),
        proves=f"{what} costs the vehicle nothing: not one command less, and none late.",
        injected=injected,
        inject=inject,
        for_s=for_s,
        is_measured=True,
        see=(DrivesOn(),),
        **more,
    )


BESIDE = (
    *(
        _beside(name, "P6", what, injected, inject, for_s, recorded_mib=2, needs=(Need.OWN_PROCESS, Need.ROOT))
        for name, for_s, what, injected, inject in (
            (
                "recorder-disk-full",
                4.0,  # what is written meanwhile is little, and has to find no room
                "A disk that is full",
                "the disk that the drive is written to has no room left",
                f.full_disk,
            ),
            (
                "recorder-stopped",
                2.0,
                "A recorder that stands still",
                "SIGSTOP to the process that writes the drive down, SIGCONT 2 s later",
                f.recorder_gets(signal.SIGSTOP),
            ),
            (
                "recorder-killed",
                2.0,
                "A recorder that is gone",
                "SIGKILL to the process that writes the drive down",
                f.recorder_gets(signal.SIGKILL),
            ),
        )
    ),
    *(
        _beside(
            name,
            "W1",
            what,
            injected,
            f.viewer(change),
            3.0,
            viewed=True,
            route=lambda: routes.straight(600.0, 4.0),
            needs=(Need.OWN_PROCESS,),
        )
        for name, what, injected, change in (
            (
                "viewer-stopped",
                "A viewer that stands still",
                "SIGSTOP to the viewer, SIGCONT 3 s later",
                f.viewer_stopped,
            ),
            (
                "viewer-killed",
                "A viewer that is killed and begun anew",
                "SIGKILL to the viewer; then another",
                f.viewer_killed,
            ),
            (
                "viewer-flooded",
                "A viewer that is flooded",
                "twenty browsers that ask for everything, read nothing and send nonsense",
                f.many_pages,
            ),
        )
    ),
)


def _manoeuvre(name: str, proves: str, route: Callable[[], routes.Route], error_m: float, *tags: str) -> Case:
    return Case(
        name=f"drive-{name}",
        tags=("manoeuvre", *tags),
        proves=proves,
        route=route,
        see=(ReachesEnd(),),
        then=Then.END_OF_ROUTE,
        most_path_error_m=error_m,
    )


MANOEUVRES = (
    _manoeuvre("step", "A lane's width to the side, at 5 m/s.", routes.step, 0.5),
    _manoeuvre("slalom", "Bends to either side, at 5 m/s.", routes.slalom, 0.5),
    _manoeuvre("double-lane-change", "Around an obstacle and back, at 8 m/s.", routes.double_lane_change, 0.6),
    _manoeuvre("stop-and-go", "Three times to standstill and on.", routes.stop_and_go, 0.3),
    _manoeuvre("reverse-bay", "Past a bay, and backwards into it.", routes.reverse_bay, 0.5),
    _manoeuvre("u-turn", "Half a circle of 7 m, at 3 m/s.", routes.u_turn, 0.6, "quick"),
    _manoeuvre("circle", "Once round, 12 m, at 4 m/s.", routes.circle, 0.5),
    _manoeuvre("figure-eight", "A circle to the left and one to the right, at 4 m/s.", routes.figure_eight, 0.5),
    Case(
        name="drive-from-the-side",
        tags=("manoeuvre", "limits"),
        proves="Begun beside the path and turned away by 0.6 rad, the device steers hard, and never beyond a limit.",
        route=lambda: routes.straight(36.0, 4.0),
        setup={"y_m": 0.2, "heading_rad": 0.6},
        see=(ReachesEnd(),),
        then=Then.END_OF_ROUTE,
    ),
)

TIMING = (
    *(
        Case(
            name=f"latency-at-{round(share * 100)}-percent-load",
            tags=("timing", "load"),
            proves=f"State to command, and the regularity of commands, at {share:.0%} bus load.",
            injected=f"strangers' frames at {share:.0%} bus load for 8 s, every 23rd sample left out",
            route=lambda: routes.straight(600.0, 4.0),
            inject=f.both(f.load(share), f.left_out(23)) if share else f.left_out(23),
            for_s=8.0,
            is_measured=True,
            see=(DrivesOn(), FollowsGaps()),
            allow=DROPPED,
        )
        for share in (0.0, 0.3, 0.6, 0.9)
    ),
    Case(
        name="forty-thousand-samples",
        tags=("endurance",),
        proves="Of 40,000 samples not one is left unanswered.",
        injected="nothing; 400 s of driving",
        route=lambda: routes.route("rounds", [(8.0, 0.0), (120 * 75.4, 1.0 / 12.0)], 4.0, slack=3.0),
        inject=f.nothing,
        for_s=1.0,
        samples=40_000,
        is_measured=True,
        see=(DrivesOn(),),
        most_path_error_m=0.6,
    ),
)

CATALOGUE: tuple[Case, ...] = (
    *MANOEUVRES,
    *TRAJECTORY,
    *STATE,
    *FRAMES,
    *BUS,
    *DRIVER,
    *PROCESS,
    *BESIDE,
    *FILES,
    *TIMING,
)
