"""Rules to recognise the signal of each field of a profile: words, kind of value and range."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Literal, NamedTuple

from vehicle_iface.drafting.words import word_set
from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState

Section = Literal["state", "status", "command", "body", "report"]
SENT_SECTIONS: tuple[Section, ...] = ("command", "body", "report")


class Kind(Enum):
    """Kinds of values of a field."""

    NUMBER = "a number with a unit"
    SHARE = "a number of a pedal"
    FLAG = "yes or no"
    NAMES = "one of several names"
    CODE = "a whole number"


class Phrase(NamedTuple):
    """Words that a name must all contain."""

    text: str
    words: frozenset[str]
    weight: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FieldRule:
    """How the signal of one field is recognised."""

    section: Section
    field: str
    kind: Kind
    phrases: tuple[Phrase, ...]
    """Phrases; the matching one of greatest weight counts."""
    neutral: frozenset[str]
    """Words without an effect on the score."""
    excluded: frozenset[str]
    """Words that rule out a signal, or its message."""
    typical: tuple[float, float] = (0.0, 0.0)
    """Least and greatest plausible end of the range, in SI; 0, 0 where any is."""
    vocabulary: tuple[frozenset[str], ...] = ()
    """For NAMES: the table has one name of each of these sets."""
    is_vocabulary_needed: bool = False
    """Whether a table without them, or no table, rules the signal out."""
    is_exact: bool = False
    """Whether the names must be written as in `vocabulary`: no table of a profile translates them."""


_ALWAYS_NEUTRAL = "vehicle actual quantity body chassis sensor global inertial local ground driving motion dynamics"
_NEVER_A_MEASUREMENT = "object lane radar relative max accuracy wind checksum counter roll pitch temp temperature not"

FOREIGN_OBJECTS = frozenset({"object", "lane", "radar"})
SUBSYSTEMS = word_set("brake steering throttle gear light wiper horn window door fan charge battery")

AUTONOMOUS_NAMES = word_set(
    "AUTONOMOUS AUTO AUTOMATIC AUTOMATED AUTONOMY ENGAGED AUTOPILOT COMPUTER DRIVERLESS "
    "AUTONOMOUS_DRIVING SELF_DRIVING AUTO_DRIVE REMOTE_PC AUTO_CONTROL AD"
)
MANUAL_NAMES = word_set(
    "MANUAL HUMAN DRIVER REMOTE TELEOP MANUAL_DRIVE MANUAL_DRIVING MANUAL_CONTROL RC JOYSTICK "
    "DISENGAGED OVERRIDE DRIVER_CONTROL TELEOPERATION OFF DISABLED"
)
READY_NAMES = word_set("READY STANDBY STAND_BY IDLE WAITING ARMED AVAILABLE AUTO_READY PREPARED")
FAULT_NAMES = word_set("FAULT ERROR FAILURE FAILED FAIL FAULTED ERR SYSTEM_FAULT")
EMERGENCY_NAMES = word_set("EMERGENCY_STOP ESTOP E_STOP EMERGENCY EMERGENCY_STOPPED EMG_STOP")
GEAR_NAMES: Mapping[str, frozenset[str]] = {
    "PARK": frozenset(("PARK", "P", "PARKING", "GEAR_P")),
    "REVERSE": frozenset(("REVERSE", "R", "REAR", "BACKWARD", "BACKWARDS", "GEAR_R", "REV")),
    "NEUTRAL": frozenset(("NEUTRAL", "N", "GEAR_N", "NEUT")),
    "DRIVE": frozenset(("DRIVE", "D", "FORWARD", "FORWARDS", "GEAR_D", "FWD")),
    "NO_REQUEST": frozenset(("NO_REQUEST", "NOREQUEST", "NO_REQ")),
}
MAP_FRAMES = frozenset(("MAP", "UTM", "WORLD", "ENU", "GLOBAL"))
ODOMETRY_FRAMES = frozenset(("ODOM", "ODOMETRY", "LOCAL"))
_LIGHTS = ("OFF", "LOW", "HIGH")
_TURNS = ("OFF", "LEFT", "RIGHT")


def _names_of(*names: str) -> tuple[frozenset[str], ...]:
    return tuple(frozenset((name,)) for name in names)


def _rule(
    section: Section,
    field: str,
    kind: Kind,
    phrases: str,
    *,
    neutral: str = "",
    excluded: str = "",
    typical: tuple[float, float] = (0.0, 0.0),
    vocabulary: tuple[frozenset[str], ...] = (),
    is_vocabulary_needed: bool = False,
) -> FieldRule:
    """Phrases are written as `words of the name=weight`, with commas in between."""
    pairs = (one.strip().partition("=") for one in phrases.split(","))
    known = tuple(Phrase(text, word_set(text), float(weight)) for text, _, weight in pairs)
    named = {word for phrase in known for word in phrase.words}
    sent = "request control" if section in SENT_SECTIONS else "report"
    wrong_way = "report" if section in SENT_SECTIONS else "request"
    return FieldRule(
        section=section,
        field=field,
        kind=kind,
        phrases=known,
        neutral=word_set(f"{neutral} {_ALWAYS_NEUTRAL} {sent}"),
        excluded=word_set(f"{excluded} {_NEVER_A_MEASUREMENT} {wrong_way}") - named,
        typical=typical,
        vocabulary=vocabulary,
        is_vocabulary_needed=is_vocabulary_needed,
        is_exact=is_vocabulary_needed and section in SENT_SECTIONS,
    )


_NO_POSITION = "speed accel rate yaw steering brake throttle gear wheel force heading"
_NO_SPEED = (
    "engine accel front fan pump cruise steering yaw angle lat y z rear left right transmission up down vertical "
    "east north rate display"
)
_NO_ACCEL = "lat y z vertical up down pedal throttle yaw rate steering left right angle decel wheel east north"
_NO_ANGLE = "rate speed torque brake throttle left pedal right yaw slip lat long"
_NO_PEDAL = "released parking fault enable hold light temp abs position autonomous steering override"
RULES: tuple[FieldRule, ...] = (
    # state
    _rule("state", "x_m", Kind.NUMBER, "position x=5,x=3.5,e=3.5,east=5,position east=5.5,utm x=5,utm east=5.5",
          neutral="position utm local map long", excluded=f"{_NO_POSITION} y z north lat"),
    _rule("state", "y_m", Kind.NUMBER, "position y=5,y=3.5,n=3.5,north=5,position north=5.5,utm y=5,utm north=5.5",
          neutral="position utm local map lat", excluded=f"{_NO_POSITION} x z east long"),
    _rule("state", "heading_rad", Kind.NUMBER, "heading=5,yaw=4,yaw angle=5,heading angle=5,course=4",
          neutral="angle position map true", excluded="rate speed accel steering wheel fault magnetic",
          typical=(3.0, 7.0)),
    _rule("state", "latitude_deg", Kind.NUMBER, "latitude=5,lat=3,position lat=4", neutral="position",
          excluded="accel speed yaw", typical=(1.5, 4.0)),
    _rule("state", "longitude_deg", Kind.NUMBER, "longitude=5,long=3,position long=4", neutral="position",
          excluded="accel speed yaw", typical=(3.0, 7.0)),
    _rule("state", "speed_mps", Kind.NUMBER, "speed=4,vehicle speed=5,long speed=5,speed x=5,forward speed=5",
          neutral="long forward abs horizontal x linear", excluded=_NO_SPEED, typical=(2.0, 350.0)),
    _rule("state", "accel_mps2", Kind.NUMBER, "accel=3,long accel=5,accel x=5,vehicle accel=4",
          neutral="long forward x", excluded=_NO_ACCEL, typical=(2.0, 200.0)),
    _rule("state", "yaw_rate_radps", Kind.NUMBER, "yaw rate=5,rate z=4,yaw speed=4,turn rate=4,"
          "angular speed=4,angle speed=3.5,yaw=2",
          neutral="z angle angular", excluded="x y steering wheel accel brake throttle", typical=(0.3, 20.0)),
    _rule("state", "lateral_speed_mps", Kind.NUMBER, "lat speed=5,speed y=5",
          excluded="accel engine wheel x z east north", typical=(1.0, 180.0)),
    _rule("state", "front_wheel_angle_rad", Kind.NUMBER,
          "front wheel angle=5.5,wheel angle=4,road wheel angle=5,steering angle=5,steering wheel angle=5,steering=3,"
          "front steering angle=5.5,steering wheel position=4",
          neutral="front wheel angle position road", excluded=f"rear {_NO_ANGLE}", typical=(0.2, 20.0)),
    _rule("state", "rear_wheel_angle_rad", Kind.NUMBER, "rear wheel angle=6,rear steering angle=6,rear steering=4",
          neutral="angle wheel", excluded=_NO_ANGLE, typical=(0.05, 20.0)),
    _rule("state", "pose_frame", Kind.NAMES, "position frame=5,frame=3,reference frame=4", neutral="reference",
          vocabulary=(MAP_FRAMES | ODOMETRY_FRAMES,), is_vocabulary_needed=True),
    _rule("state", "pose_valid", Kind.FLAG, "position valid=5,fix valid=5,fix=3,inertial valid=5",
          neutral="valid fix", excluded="heading speed time lat steering yaw accel rate"),
    # status
    _rule("status", "mode", Kind.NAMES,
          "autonomous mode=5,drive mode=5,control mode=5,autonomous state=5,mode=3.5,state=2,"
          "drive state=3,control state=4",
          neutral="state drive autonomous control mode",
          excluded="throttle gear light wiper inertial window fan charge door position hold report fault battery brake",
          vocabulary=(AUTONOMOUS_NAMES, MANUAL_NAMES | READY_NAMES)),
    _rule("status", "gear", Kind.NAMES, "gear=4,gear position=4.5,gear state=4.5,gear lever=4.5,transmission state=2.5",
          neutral="position state lever selector transmission", excluded="fault enable override mode",
          vocabulary=(GEAR_NAMES["REVERSE"], GEAR_NAMES["DRIVE"])),
    _rule("status", "driver_brake", Kind.FLAG,
          "driver brake=5,brake pedal pressed=5.5,brake pedal=4,brake pressed=5,brake switch=4,brake override=4,"
          "brake=3,driver brake override=5.5,driver brake pressed=5.5",
          neutral="driver pedal pressed state switch", excluded=_NO_PEDAL),
    _rule("status", "driver_throttle", Kind.FLAG,
          "driver throttle=5,throttle pedal pressed=5.5,accel pedal pressed=5.5,throttle pedal=4,accel pedal=4,"
          "throttle pressed=5,throttle override=4,accel override=4,throttle=3,"
          "driver throttle pressed=5.5",
          neutral="driver pedal pressed state switch", excluded=f"{_NO_PEDAL} brake"),
    _rule("status", "driver_steer_torque_nm", Kind.NUMBER,
          "driver steering torque=5.5,steering torque=4,driver torque=4.5,steering wheel torque=5,torsion bar torque=5",
          neutral="driver wheel", excluded="engine assist brake throttle actuator", typical=(1.0, 200.0)),
    _rule("status", "fault_code", Kind.CODE, "fault code=5,fault=3,vehicle fault=4",
          neutral="state code", excluded="frame enable brake steering throttle gear light battery override"),
    # command
    _rule("command", "enable", Kind.FLAG,
          "enable=4,autonomous enable=5,control enable=5,enable request=5,mode control=3.5,"
          "autonomous mode=3.5,autonomous=3,steering request=3,accel request=3",
          neutral="steering brake throttle accel speed drive autonomous mode gear",
          excluded="light horn wiper clear ignore override indicator"),
    _rule("command", "safe_stop", Kind.FLAG, "safe stop=5,emergency stop=5,emergency brake=4,stop=3.5",
          neutral="safe emergency", excluded="light horn clear ignore"),
    _rule("command", "accel_mps2", Kind.NUMBER, "accel=4,long accel=5,accel x=5", neutral="long x",
          excluded=_NO_ACCEL, typical=(0.5, 200.0)),
    _rule("command", "speed_mps", Kind.NUMBER, "speed=4,vehicle speed=4.5,long speed=4.5",
          neutral="long x forward linear",
          excluded=f"{_NO_SPEED} angular", typical=(0.5, 180.0)),
    _rule("command", "drive_mps2", Kind.NUMBER, "drive=3,drive accel=4,throttle=3,throttle accel=4",
          excluded="brake decel mode lat", typical=(0.5, 50.0)),
    _rule("command", "brake_mps2", Kind.NUMBER, "decel=5,brake=4,brake decel=5,brake accel=4",
          excluded="drive mode lat parking", typical=(0.5, 50.0)),
    _rule("command", "throttle", Kind.SHARE,
          "throttle=4,accel pedal=4,throttle pedal=4,drive torque=3,torque=2.2,accel=2.2",
          neutral="pedal position torque", excluded="brake enable fault speed steering eps"),
    _rule("command", "brake", Kind.SHARE, "brake=4,brake pedal=4,brake torque=4,brake pressure=4",
          neutral="pedal position pressure torque", excluded="parking throttle enable fault light steering"),
    _rule("command", "front_wheel_angle_rad", Kind.NUMBER,
          "front wheel angle=5.5,wheel angle=4,road wheel angle=5,steering angle=5,steering wheel angle=5,steering=3.5,"
          "front steering angle=5.5,steering position=4",
          neutral="front wheel angle position road", excluded=f"rear curvature {_NO_ANGLE}", typical=(0.2, 20.0)),
    _rule("command", "curvature_per_m", Kind.NUMBER, "curvature=5,steering curvature=5", neutral="steering",
          excluded="rate"),
    _rule("command", "yaw_rate_radps", Kind.NUMBER,
          "yaw rate=5,angular speed=4,angle speed=3.5,turn rate=4,angular rate=4,rate z=4",
          neutral="z", excluded="steering wheel accel x y"),
    _rule("command", "rear_wheel_angle_rad", Kind.NUMBER, "rear wheel angle=6,rear steering angle=6,rear steering=4",
          neutral="angle wheel", excluded=_NO_ANGLE),
    _rule("command", "gear_request", Kind.NAMES, "gear=4,gear position=4,transmission=2.5",
          neutral="position lever selector transmission", excluded="fault enable clear ignore override",
          vocabulary=(GEAR_NAMES["REVERSE"], GEAR_NAMES["DRIVE"])),
    _rule("command", "reason", Kind.NAMES, "reason=4", vocabulary=_names_of(*(one.name for one in Reason)),
          is_vocabulary_needed=True),
    # body
    _rule("body", "hazard_lights", Kind.FLAG, "hazard light=5,hazard=4", neutral="light indicator enable"),
    _rule("body", "headlights", Kind.NAMES, "head light=5", vocabulary=_names_of(*_LIGHTS), is_vocabulary_needed=True),
    _rule("body", "turn_indicator", Kind.NAMES, "turn indicator=5,indicator=4,turn=3", neutral="light",
          vocabulary=_names_of(*_TURNS), is_vocabulary_needed=True),
    _rule("body", "horn", Kind.FLAG, "horn=5", neutral="enable"),
    # report
    _rule("report", "state", Kind.NAMES, "state=4,controller state=5", neutral="controller",
          vocabulary=_names_of(*(one.name for one in ControllerState)), is_vocabulary_needed=True),
    _rule("report", "reason", Kind.NAMES, "reason=4", vocabulary=_names_of(*(one.name for one in Reason)),
          is_vocabulary_needed=True),
    _rule("report", "ref_spatial_index", Kind.CODE, "spatial index=5", neutral="reference trajectory"),
    _rule("report", "ref_temporal_index", Kind.CODE, "temporal index=5", neutral="reference trajectory"),
    _rule("report", "deadline_misses", Kind.CODE, "deadline miss=5", neutral="counter"),
    _rule("report", "handover", Kind.FLAG, "handover=5,take over=5", neutral="driver request pending"),
)  # fmt: skip
RULE_OF: Mapping[tuple[Section, str], FieldRule] = {(rule.section, rule.field): rule for rule in RULES}
