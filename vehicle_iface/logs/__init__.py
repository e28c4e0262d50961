"""Logs of a bus as arrays: offline tools, not part of the control process."""

import vehicle_iface.codec  # noqa: F401  (before whatever imports cantools)
