"""Exit statuses of the commands."""

DONE, BAD_USAGE, NO_BUS, LATCHED_FAULT = 0, 2, 3, 4
CONTRADICTED = 1
"""`review` and `commission`: the vehicle contradicts its profile."""
DIFFERENT = 1
"""`rerun`: a command differs from the recorded one."""
NOT_SEEN = 5
"""`commission`: nothing contradicts the profile, but not everything was observed."""
