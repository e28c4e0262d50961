"""Renamed keys of version 0.1: accepted in this version with a warning, not in the next one."""

from typing import NamedTuple

_RENAMED = (
    ("behavior", "stop_ease_s", "stop_release_time_constant_s"),
    ("handover", "holds", "hold_until_warned"),
    ("limits", "engaging", "while_engaging"),
    ("plausibility", "frozen_above_mps", "frozen_min_speed_mps"),
    ("plausibility", "frozen_m", "frozen_distance_m"),
    ("plausibility", "frozen_s", "frozen_time_s"),
    ("plausibility", "heading_apart_rad", "heading_tolerance_rad"),
    ("plausibility", "position_apart_m", "position_tolerance_m"),
    ("plausibility", "speed_apart_mps", "speed_tolerance_mps"),
    ("plausibility", "yaw_rate_apart_radps", "yaw_rate_tolerance_radps"),
    ("timing", "answer_age_s", "max_command_age_s"),
    ("timing", "engage_fresh_s", "engage_settle_s"),
    ("timing", "engage_give_up_s", "engage_timeout_s"),
)
"""Table, old key, new key."""


class RenamedKeys(NamedTuple):
    """The old keys that a profile has."""

    warnings: list[str]
    faults: list[str]
    """Keys that are present by both names."""
    old_places: dict[str, str]
    """Place by the new name: place in the file."""

    def place_in_file(self, fault: str) -> str:
        """Return the fault with its place as in the file."""
        for new, old in self.old_places.items():
            if fault.startswith((f"{new}:", f"{new}.", f"{new}[")):
                return old + fault.removeprefix(new)
        return fault


def rename_old_keys(document: dict[str, object]) -> RenamedKeys:
    """Give the old keys in `document` their new names."""
    found = RenamedKeys([], [], {})
    for name, old, new in _RENAMED:
        table = document.get(name)
        if not isinstance(table, dict) or old not in table:
            continue
        value = table.pop(old)
        place = f"$.{name}.{old}"
        if new in table:
            found.faults.append(f"{place}: is the old name of {new}, and {new} is there as well; remove {old}")
            continue
        table[new] = value
        found.warnings.append(f"{place}: renamed to {new}; the next version accepts the new name only")
        found.old_places[f"$.{name}.{new}"] = place
    return found
