"""The defects that the minimal controller can be given, one at a time, for the bench to find."""

DEFECTS = {
    "timeout_removed": "missing samples are not detected: no stop after 50 ms, and no latch after 500 ms",
    "crc_unchecked": "frames with a wrong CRC are accepted",
    "steer_sign_swapped": "the wheels are steered in the opposite direction",
    "nan_path": "from 3 s after engaging on its steering is NaN, unchecked, and clamped by min and max to a full lock",
    "limit_off_by_10_percent": "the wheels are steered to 0.66 rad where the path requires it; the limit is 0.6 rad",
    "jerk_unlimited": "acceleration and the brake of a stop are requested in one step, without a jerk limit",
    "stop_swerves": "a stop turns the wheels straight at their maximum rate, at any speed",
    "counter_repeated_with_fresh_crc": "every 50th pair is sent with the counters of the one before, and good CRCs",
    "stop_without_brake": "a stop requests SAFE_STOP without a deceleration",
    "stop_without_reason": "every stop has the reason NOMINAL",
    "late_by_30_ms": "each sample is answered 30 ms late",
    "commands_after_override": "ENABLE stays 1 when the driver takes over",
    "recorder_blocks": "the loop waits for the recorder: a recorder that does not read delays the commands",
    "recorder_required": "the drive ends when it cannot be recorded",
    "view_blocks": "the loop waits for the page: a page that does not read delays the commands",
    "view_required": "the drive ends when the page has ended",
    "frame_ignored": "poses in another frame of reference are used as if they were in the trajectory's",
}
"""Maps each name for `--defect` to its effect."""
