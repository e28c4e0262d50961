"""Decode the log of a bus with a DBC into NumPy arrays: one for each signal, in the units of the DBC.

    candump -L vcan0 > drive.log
    python docs/examples/05_decode_log.py drive.log

Logs of other programs (.asc, .trc, .blf, .csv) are read too. `vehicle-iface decode drive.log --out drive.npz` does the
same and saves the arrays.
"""

import sys
from pathlib import Path

from vehicle_iface.codec.dbc_file import read_dbc
from vehicle_iface.logs.columns import decode_log
from vehicle_iface.profile import load_profile


def main(path: Path) -> None:
    """Print the number of frames, and for each signal the least and the greatest value."""
    messages = read_dbc(Path(load_profile("reference").dbc)).select_messages([])
    log = decode_log(path, messages)
    print(f"{log.decoded} of {log.lines} lines decoded, {len(log.refused)} refused")
    for name, columns in log.messages.items():
        for signal, values in columns.values.items():
            if len(values):
                print(f"{name}.{signal}: {len(values)} values from {values.min():g} to {values.max():g}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
