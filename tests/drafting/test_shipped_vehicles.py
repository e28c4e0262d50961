"""How much of the shipped profiles a draft from their DBC finds: the measured numbers, so that they only rise."""

from pathlib import Path

import pytest

from tests.drafting.bindings import compare

DBC = Path(__file__).parents[2] / "dbc"
MEASURED = {
    # right, of, bound wrongly
    "agilex_hunter": (4, 9, 5),  # conditions instead of a mode; a speed that is a heading's rate as well
    "fs_ai_ads_dv": (4, 8, 1),  # four torques and pressures that fit alike; an emergency stop for a safe stop
}
"""Flags and modes of one vehicle each, and torques instead of pedals, are what a draft does not know."""


@pytest.mark.parametrize("name", sorted(MEASURED))
def test_a_draft_binds_as_many_signals_of_a_shipped_vehicle_as_was_measured(name: str) -> None:
    score = compare(DBC / f"{name}.toml")
    found = len(set(score.wrong) - set(score.missing))
    assert (score.right, score.right + len(score.missing), found) == MEASURED[name], score
