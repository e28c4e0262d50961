"""The recorder: a process beside the loop that writes down a drive.

It hears the bus on a socket of its own and follows the telemetry like any other reader, so that no disk can make the
loop wait. `files` is what a recording consists of.
"""
