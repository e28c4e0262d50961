"""The faults that the minimal controller can be given, one at a time: what a judge of controllers has to find."""

DEFECTS = {
    "timeout_removed": "samples that stay away are not noticed: neither a stop after 50 ms nor a latch after 500 ms",
    "crc_unchecked": "frames with a wrong CRC are believed",
    "steer_sign_swapped": "the wheels are turned the other way",
    "nan_path": "from 3 s after engaging on its steering is NaN, unchecked, and clamped by min and max to a full lock",
    "limit_off_by_10_percent": "the wheels are led to 0.66 rad where the path demands it; 0.6 rad is their end",
    "jerk_unlimited": "the acceleration that is wanted is asked for at once, and so is the brake of a stop",
    "stop_swerves": "a stop turns the wheels straight as fast as they can, at any speed",
    "counter_repeated_with_fresh_crc": "every 50th pair is sent with the counters of the one before, and good CRCs",
    "stop_without_brake": "a stop asks for SAFE_STOP and for no deceleration",
    "stop_without_reason": "every stop says NOMINAL",
    "late_by_30_ms": "each sample is answered 30 ms after it came",
    "commands_after_override": "ENABLE stays 1 when the driver takes over",
    "diary_blocks": "the drive is written down by the loop: whoever does not take the lines holds the vehicle up",
    "diary_matters": "the drive ends where it cannot be written down",
    "view_blocks": "the drive is shown by the loop: a page that does not take it holds the vehicle up",
    "view_matters": "the drive ends where nobody can be shown it any more",
    "frame_ignored": "poses in another frame of reference are taken for those of the trajectory's",
}
"""Name for `--defect`, and what it breaks."""
