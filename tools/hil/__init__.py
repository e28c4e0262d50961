"""The hardware-in-the-loop bench: plays a vehicle on the bus, breaks things on purpose, and judges from outside.

    profile ──▶ wire ──▶ vehicle ──▶ bus ◀──▶ device under test
                 │          ▲         │
                 │       faults       ▼
                 └──────────────▶ observer ──▶ judge ──▶ result ──▶ report
                                      ▲
                                    cases

`wire` takes frames apart and makes them by a profile's DBC (cantools, its own checksums); `vehicle` is the car that
answers; `device` starts and ends the controller; `faults` are what is injected, `cases` where and when; `judge` says
what of it was seen; `result` is what is kept, and `report` what a person reads.

It shares no code with the controller that it judges: nothing here imports `vehicle_iface`.
"""
