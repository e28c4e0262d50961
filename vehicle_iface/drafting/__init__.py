"""A first draft of a profile from a DBC: the command `new-profile`."""

from vehicle_iface.drafting.draft import Draft, FieldDraft, FieldValue, ModeFlags
from vehicle_iface.drafting.forms import draft_profile
from vehicle_iface.drafting.writer import write_draft

__all__ = ["Draft", "FieldDraft", "FieldValue", "ModeFlags", "draft_profile", "write_draft"]
