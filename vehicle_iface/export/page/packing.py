"""Numbers as text that is short and exact to a stated number of decimals.

The values are rounded to integers, their differences are 32-bit little-endian, deflated and written in base64. The
least integer means that nothing is known. `page/data.js` reads it.
"""

import base64
import zlib

import numpy as np

from vehicle_iface.export.page.model import Packed
from vehicle_iface.trajectory import FloatArray

UNKNOWN = -(2**31)
_LARGEST = 2**31 - 1


def pack(values: FloatArray, decimals: int, *, offset: float = 0.0) -> Packed:
    """Pack an array (n,). NaN, and numbers that are too great for their decimals, are unknown in the page."""
    with np.errstate(invalid="ignore"):
        counts = np.rint((np.asarray(values, np.float64) - offset) * 10.0**decimals)
        is_known = np.abs(counts) <= _LARGEST
    integers = np.where(is_known, counts, UNKNOWN).astype(np.int64)
    steps = np.diff(integers, prepend=0).astype("<i4")  # modulo 2³², as the page adds them
    data = base64.b64encode(zlib.compress(steps.tobytes())).decode()
    return Packed(decimals=decimals, offset=offset, data=data)
