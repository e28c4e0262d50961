"""The checksums of TSC1 (SPN 4207) and XBR (SPN 3188), SAE J1939 Digital Annex.

Both fold a sum over the payload (the counter in, the checksum's own bits out) and the four bytes of the identifier.
"""


def tsc1(can_id: int, data: bytes) -> int:
    """3 bits."""
    total = _sum_bytes(can_id, data)
    return (total >> 6 & 0x3) + (total >> 3) + total & 0x7


def xbr(can_id: int, data: bytes) -> int:
    """4 bits."""
    total = _sum_bytes(can_id, data)
    return (total >> 4) + total & 0xF


def _sum_bytes(can_id: int, data: bytes) -> int:
    return sum(data) + sum((can_id & 0x1FFFFFFF).to_bytes(4, "little"))
