"""Reads a page of a drive back, as its JavaScript does."""

import base64
import re
import zlib
from pathlib import Path

import msgspec
import numpy as np

from vehicle_iface.export.page.model import Packed, Page
from vehicle_iface.export.page.packing import UNKNOWN
from vehicle_iface.trajectory import FloatArray


def read_page(path: Path) -> Page:
    (text,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', path.read_text(), re.DOTALL)
    return msgspec.json.decode(text, type=Page)


def unpack(packed: Packed) -> FloatArray:
    steps = np.frombuffer(zlib.decompress(base64.b64decode(packed.data)), "<i4")
    counts = np.cumsum(steps, dtype=np.int32)
    values = packed.offset + counts.astype(np.float64) / 10**packed.decimals
    return np.where(counts == UNKNOWN, np.nan, values)


def curve(page: Page, key: str, drive: int = 0) -> FloatArray:
    (found,) = [one for plot in page.plots for one in plot.curves if (one.key, one.drive) == (key, drive)]
    return unpack(found.values)
