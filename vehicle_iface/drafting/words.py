"""The words in the names of a DBC: `VehSpd`, `VEHICLE_SPEED` and `VEHSPD` are the same two words."""

import itertools
import re
from collections.abc import Sequence
from functools import cache

_TOKEN = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
_JOINED = (
    (re.compile(r"(?<![A-Za-z])[Ee][-_ ]?(?=(?i:stop))"), "Emergency_"),
    (re.compile(r"(?i:ch(?:ec)?k[-_ ]?sum)"), "Checksum"),
)
"""Compound words that may be written in two parts."""
_LEAST_PIECE = 3
"""Minimum letters of a word within an unseparated longer one."""
_ABBREVIATIONS = {
    # quantities
    "speed": "speed spd vel velocity velo v geschwindigkeit",
    "accel": "accel acc accl acceleration acel accelerator",
    "decel": "decel dec deceleration",
    "rate": "rate rt gyro gyr gyroscope omega",
    "angle": "angle ang agl",
    "torque": "torque trq tq torq",
    "curvature": "curvature curv kappa",
    "position": "position pos posn pose location loc localization localisation",
    "heading": "heading theta hdg azimuth bearing",
    "course": "course cog",
    "yaw": "yaw psi gier",
    "latitude": "latitude",
    "longitude": "longitude",
    "lat": "lat lateral ltrl latrl",
    "long": "long longi longitudinal lgt lon lng longit lngt",
    "east": "east easting",
    "north": "north northing",
    "speed x": "vx",
    "speed y": "vy",
    "accel x": "ax",
    "accel y": "ay",
    "yaw rate": "wz yawr",
    # parts of the vehicle
    "vehicle": "vehicle veh ego car vhcl truck rover",
    "wheel": "wheel whl wheels",
    "steering": "steering steer str strg stg steerg sas lenk",
    "steering wheel angle": "swa",
    "brake": "brake brk braking brakes brks",
    "throttle": "throttle thr thrtl thrott gas",
    "pedal": "pedal ped pdl pedals",
    "throttle pedal": "app apps",
    "gear": "gear prnd prndl shift shifter gearbox gears",
    "transmission": "transmission trans trm trns",
    "front left": "fl lf",
    "front right": "fr rf",
    "rear left": "rl lr",
    "rear right": "rr",
    "front": "front frt",
    "forward": "forward fwd forwards",
    "rear": "rear back",
    "left": "left lft",
    "right": "right rght rgt",
    "engine": "engine eng motor mot",
    "light": "light lights lamp lamps",
    "head light": "headlight headlights headlamp headlamps",
    "indicator": "indicator indicators blinker blinkers winker",
    "hazard": "hazard hazards",
    "parking": "parking park epb handbrake pbrk",
    # who and why
    "drive": "drive drv",
    "cruise": "cruise crz",
    "relative": "relative rel",
    "released": "released release",
    "not": "not no non inactive disable disabled off",
    "driver": "driver drvr drivers hand hands human operator",
    "autonomous": "autonomous autonomy auto automated automatic automation autopilot",
    "mode": "mode mod modus",
    "state": "state status sts stat st stt",
    "request": "request req rq rqst rqt command cmd cmnd target tgt trgt desired des dsrd set setpoint sp demand dmd",
    "report": "report rpt feedback fb fbk fdbk fdb measured meas response resp",
    "actual": "actual act real current cur crnt",
    "enable": "enable en ena enabled enbl engage engaged engagement active activate activated actv activation",
    "control": "control ctrl ctl cntl cntrl",
    "override": "override ovrd ovr overridden intervention interv takeover",
    "pressed": "pressed prsd press depressed applied",
    "switch": "switch sw swt",
    "emergency": "emergency emcy emg emer emgy emergcy",
    "emergency stop": "estop",
    "fault": "fault flt faults err error errors fail failure failed malfunction dtc alarm",
    "valid": "valid vld validity ok good",
    "checksum": "checksum chksum cksum chk cs csum crc chks",
    "counter": "counter cnt cntr ctr count alive rolling rc cntrs",
    "index": "index idx",
    "reference": "reference ref",
    "miss": "miss misses missed",
    "max": "max maximum limit lim limits min minimum lmt",
    "accuracy": "accuracy std sigma uncertainty deviation dev stddev cov covariance variance hdop quality bias offset",
    "trajectory": "trajectory traj path",
    "object": "object obj obstacle trailer",
    "inertial": "ins imu gps gnss rtk inertial odom odometry",
    "computer": "computer pc ipc host xavier orin adcu planner pilot adas ads adc upper",
    "quantity": "value val signal sig info data msg",
}  # fmt: skip
"""Words that mean the same here: each of the second becomes the first."""
_WORDS = {short: words.split() for words, shorts in _ABBREVIATIONS.items() for short in shorts.split()}
_KNOWN = (
    "stop safe safety driving wheel road actuator handover take over reason frame spatial temporal deadline fix "
    "horn turn x y z roll pitch wind fan pump lane radar temp temperature pressure level tire tyre battery hold "
    "slip torsion bar assist utm local global map ground body chassis motion dynamics clear ignore vertical down up "
    "controller sensor code abs esp eps bcm vcu ecu dbw gateway display hmi rotation distance lever selector side "
    "power charge door window seat belt wiper key ignition button jerk force ready manual"
)
_VOCABULARY = {**{word: [word] for word in _KNOWN.split()}, **_WORDS}


def word_set(text: str) -> frozenset[str]:
    """Return the words of a text with blanks between them."""
    return frozenset(text.split())


@cache
def split_words(name: str) -> tuple[str, ...]:
    """Split a name into its words in order, abbreviations written out; numbers are words as well."""
    for pattern, whole in _JOINED:
        name = pattern.sub(whole, name)
    words: list[str] = []
    for token in _TOKEN.findall(name):
        words += _expand(token.lower())
    return tuple(words)


def common_beginning(names: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the words with which all names begin; nothing for a single name."""
    if len(names) < 2:
        return ()
    same = itertools.takewhile(lambda words: len(set(words)) == 1, zip(*names, strict=False))
    return tuple(words[0] for words in same)


def _expand(token: str) -> list[str]:
    known = _VOCABULARY.get(token)
    if known is None and token.endswith("s"):
        known = _VOCABULARY.get(token[:-1])
    if known is not None:
        return known
    return [word for piece in _split_glued(token) or [token] for word in _VOCABULARY.get(piece, [piece])]


def _split_glued(token: str) -> list[str] | None:
    """Return the fewest known words that together are the token: `yawrate` → yaw, rate; None where there are none."""
    best: list[list[str] | None] = [[], *[None] * len(token)]
    for end in range(_LEAST_PIECE, len(token) + 1):
        for begin in range(end - _LEAST_PIECE + 1):
            before, piece = best[begin], token[begin:end]
            if before is not None and piece in _VOCABULARY:
                pieces, known = [*before, piece], best[end]
                if known is None or len(pieces) < len(known):
                    best[end] = pieces
    return best[-1]
