"""The hardware-in-the-loop bench: plays the vehicle, injects faults, and judges from outside.

    profile ──▶ wire ──▶ vehicle ──▶ bus ◀──▶ device under test
                 │          ▲         │
                 │       faults       ▼
                 └──────────────▶ observer ──▶ judges ─▶ result ──▶ report
                                      ▲
                                    cases

`wire` decodes and encodes frames by a profile's DBC (cantools, its own checksums). `vehicle` is the simulated car.
`device` starts and ends the controller. `faults` are injected as `cases` define. `judges` check what `expect` and the
profile demand. `result` is what is stored, `report` what a person reads.

The bench shares no code with the controller that it judges: nothing here imports `vehicle_iface`.
"""
