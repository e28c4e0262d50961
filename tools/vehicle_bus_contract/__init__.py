"""The reference vehicle's bus contract, written from its description alone.

It imports nothing of `vehicle_iface`, so that program and contract cannot be wrong together. Tests, the HIL bench and
the drive checks judge by it.
"""
