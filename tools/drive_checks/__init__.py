"""Drives on a virtual bus, and judges of what was recorded there."""
