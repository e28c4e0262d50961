"""Names as several makers write them are the same words."""

import pytest

from vehicle_iface.drafting.words import split_words


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("VEH_SPD VehSpd VEHSPD VehicleSpeed vehicle_speed EgoVel", ("vehicle", "speed")),
        ("StrAng STEERANG SteeringAngle STEER_ANGLE SAS_Angle strAngle", ("steering", "angle")),
        ("YawRate YAW_RATE YAWRATE Yaw_Rt wz", ("yaw", "rate")),
        ("AccX ax acc_x ACCEL_X AccelerationX", ("accel", "x")),
        ("LongAcc LON_ACC LongitudinalAcceleration", ("long", "accel")),
        ("BrkPedal BRAKE_PEDAL BrkPdl brakepedal", ("brake", "pedal")),
        ("WhlSpdRearLft WHEEL_SPEED_RL WheelSpeedRL", ("wheel", "speed", "rear", "left")),
        ("EStop E_STOP ESTOP EmgyStop EmergencyStop", ("emergency", "stop")),
        ("ChkSum CheckSum CHECKSUM Check_Sum CRC", ("checksum",)),
        ("HDG Heading azimuth", ("heading",)),
        ("COG Course", ("course",)),  # over ground: not where the body points
    ],
)
def test_spellings_of_one_name_are_the_same_words(names: str, words: tuple[str, ...]) -> None:
    assert {name: split_words(name) for name in names.split()} == dict.fromkeys(names.split(), words)


def test_a_word_that_only_begins_like_a_known_one_stays_whole() -> None:
    assert split_words("ACCORD") == ("accord",)
    assert split_words("SPDRONE") == ("spdrone",)
