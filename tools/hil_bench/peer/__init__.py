"""The bench's vehicle for any profile: read by the bench's own code, from the profile's TOML and the DBC.

    profile + DBC ──▶ signals, conditions, protection ──▶ wire ──▶ vehicle
                                                            └────▶ examine ──▶ judge

Fields have the reference vehicle's names and SI units, so that cases, faults and expectations are the same for every
vehicle. A command that has no signal for ENABLE, SAFE_STOP or the acceleration is given one by what it asks for.
"""
