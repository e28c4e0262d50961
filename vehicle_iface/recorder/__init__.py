"""The recorder: a separate process that records a drive.

It receives the bus on a socket of its own and reads the telemetry like any other reader, so no disk can make the loop
wait. `files` defines the files of a recording.
"""
