"""Checks a profile against a recorded drive: signs, units, delays, dimensions, periods and checksums.

Kinematics is the only assumption: yaw rate, heading, position, speed and acceleration follow from one another, and a
profile under which they do not is wrong. `series` decodes the log, `relations` measures, `explanations` and
`delays` find the fewest causes, `verdicts` puts them into words, `bus` and `checksum_search` look at the frames
themselves, `page` and `report` write the result.
"""
