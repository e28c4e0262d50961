"""How much of the shipped profiles a draft from their DBC finds: the measured numbers, so that they only rise."""

from pathlib import Path

import pytest

from tests.drafting.bindings import bindings_of, compare

DBC = Path(__file__).parents[2] / "dbc"
MEASURED = {
    # right, of, bound wrongly
    "agilex_hunter": (4, 9, 5),  # conditions instead of a mode; a speed that is a heading's rate as well
    "fs_ai_ads_dv": (4, 8, 1),  # four torques and pressures that fit equally well; an emergency stop for a safe stop
    "j1939_truck": (4, 12, 6),  # the wheels' speed of another group; a brake that is taken for an acceleration
    "mqb_by_wire": (8, 14, 3),  # signs in other signals; flags that are conditions
    "new_eagle_raptor": (6, 15, 7),  # its own speed and its request by speed would do as well
    "pacmod3": (7, 14, 3),  # one fault and one enable of several; nothing says that an output is an angle or a gear
    "toyota_rav4": (3, 7, 4),  # one signal of two; feet and hands as flags, not as conditions
    "vbox_kart": (12, 15, 1),  # latitude and longitude are there twice: pose and heading are left open
}
"""Flags and modes of one vehicle each, and torques instead of pedals, are what a draft does not know."""


@pytest.mark.parametrize("name", sorted(MEASURED))
def test_a_draft_binds_as_many_signals_of_a_shipped_vehicle_as_was_measured(name: str) -> None:
    path = DBC / f"{name}.toml"
    score = compare(path)
    assert (score.right, len(bindings_of(path)), len(score.wrong)) == MEASURED[name], score
