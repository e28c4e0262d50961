"""What a recorded drive says about a profile: signs, units, delays, dimensions, periods and checksums.

Nothing is taken on trust but kinematics: turn rate, heading, position, speed and acceleration follow from one another,
and a profile under which they do not is wrong. `series` decodes the log, `relations` measures, `explanations` and
`delays` find the fewest causes, `verdicts` puts them into words, `bus` and `checksum_search` look at the frames
themselves, `page` and `report` write the result.
"""
