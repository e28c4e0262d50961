"""What the command ends with."""

DONE, BAD_USAGE, NO_BUS, LATCHED_FAULT = 0, 2, 3, 4
