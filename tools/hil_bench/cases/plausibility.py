"""Cases of state that contradicts itself or the vehicle's motion."""

from hil_bench import routes
from hil_bench.case import Case, Need, Then
from hil_bench.cases.common import ANY, DROPPED, INVALID, STALE
from hil_bench.expect import DrivesOn, HazardLights, Stops
from hil_bench.faults import signals
from hil_bench.parts import Part

PLACED = (Part.POSITION,)

PLAUSIBILITY = (
    Case(
        name="position-jumps-once",
        fault="S3",
        tags=("state", "plausibility"),
        proves="One implausible position is dropped.",
        injected="one sample is 30 m to the side",
        inject=signals.offset_signals(1, POS_Y=30.0),
        about=(Part.POSITION,),
        see=(DrivesOn(),),
        allow=DROPPED,
    ),
    Case(
        name="position-jumps",
        fault="S3",
        tags=("state", "plausibility"),
        proves="Repeated implausible positions stop the vehicle.",
        injected="samples 30 m to the left and to the right in turn, for 0.4 s",
        inject=signals.swing_signals(POS_Y=30.0),
        for_s=0.4,
        about=(Part.POSITION,),
        see=(Stops((*INVALID, *STALE), until_end=False),),
        then=Then.GOES_ON_IF_MOVING,
        allow=ANY,
    ),
    Case(
        name="state-frozen",
        fault="S4",
        tags=("state", "plausibility"),
        proves="Frozen values under a live counter, while the vehicle moves, stop it.",
        injected="all values are frozen, with a live counter, for 1 s at 4 m/s",
        at_mps=4.0,
        inject=signals.freeze_sample(),
        for_s=1.0,
        about=(Part.POSITION,),
        see=(Stops((*INVALID, *STALE), within_s=0.2, until_end=False),),
        after_s=1.2,
        then=Then.REARM,
        allow=ANY,
        needs=(Need.REARM,),
    ),
    Case(
        name="sensor-speed-frozen",
        fault="S7",
        tags=("state", "plausibility"),
        proves="A frozen speed stops the vehicle before it is too fast.",
        injected="SPEED is frozen at 1.5 m/s for 3 s while the vehicle accelerates",
        route=routes.straight,
        at_mps=1.5,
        inject=signals.freeze_signal("SPEED"),
        for_s=3.0,
        about=(Part.POSITION,),
        see=(Stops(INVALID, within_s=2.5, until_end=False),),
        after_s=1.2,
        then=Then.REARM,
        allow=frozenset({*ANY, "command", "dynamics", "brakes", "stop_steering", "report"}),
        needs=(Need.REARM,),
    ),
    *(
        Case(
            name=f"sensor-{name}",
            fault="S7",
            tags=("state", "plausibility"),
            proves="A sensor that contradicts the others stops the vehicle before it is too fast or off its path.",
            injected=injected,
            route=routes.straight,
            at_mps=at_mps,
            inject=inject,
            for_s=3.0,
            about=about,
            see=(Stops(INVALID, within_s=2.5, until_end=False),),
            after_s=0.5,
            then=Then.HOLDS,
            may_fall_silent=name == "speed-low",  # at rest it is a position that is frozen, with no end (S4)
            exit_status=(4,),
            allow=frozenset({*ANY, "command", "dynamics", "brakes", "stop_steering", "report"}),
        )
        for name, injected, at_mps, about, inject in (
            ("speed-low", "SPEED is 0.7 m/s too low", 4.0, PLACED, signals.offset_signals(SPEED=-0.68)),
            (
                "yaw-rate-off",
                "YAW_RATE is off by 0.3 rad/s",
                4.0,
                (Part.YAW_RATE, Part.WHEELS),
                signals.offset_signals(YAW_RATE=0.3),
            ),
            (
                "acceleration-off",
                "ACCEL is off by 3 m/s²",
                4.0,
                (Part.ACCEL,),
                signals.offset_signals(ACCEL=3.0),
            ),
            (
                "wheel-off",
                "FRONT_WHEEL_ANGLE is off by 0.25 rad",
                4.0,
                (Part.WHEELS, Part.YAW_RATE),
                signals.offset_signals(FRONT_WHEEL_ANGLE=0.25),
            ),
        )
    ),
    *(
        Case(
            name=f"{name}-in-one-of-{every}",
            fault="S8",
            tags=("state",),
            proves="An input that alternates between valid and invalid brakes as hard as one that stays invalid.",
            injected=f"{injected} in one sample of {every} for 1 s",
            inject=signals.alternate_signals(every, **changed),
            for_s=1.0,
            about=(part,),
            see=(Stops(reasons), HazardLights()),
            after_s=1.0,
            allow=DROPPED,
        )
        for name, injected, reasons, part, changed in (
            ("pose-invalid", "POSE_VALID = 0", INVALID, Part.POSE_VALID, {"POSE_VALID": 0.0}),
            ("other-frame", "POSE_FRAME = ODOM", ("FRAME_MISMATCH",), Part.POSE_FRAME, {"POSE_FRAME": 0.0}),
        )
        for every in (2, 3)
    ),
    Case(
        name="gear-contradicts",
        fault="S9",
        tags=("state", "driver"),
        proves="A gear that contradicts the direction of travel stops the vehicle.",
        injected="GEAR = REVERSE while the vehicle drives forwards",
        inject=signals.name_value("GEAR", "REVERSE"),
        for_s=1.0,
        about=(Part.GEAR,),
        see=(Stops(INVALID, within_s=0.35),),
        then=Then.HOLDS,
        exit_status=(4,),
        allow=DROPPED,
    ),
)
