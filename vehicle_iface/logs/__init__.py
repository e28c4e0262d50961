"""Logs of a bus as arrays: offline tools, not part of the control process."""
