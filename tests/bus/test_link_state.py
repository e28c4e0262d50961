"""The table of link states."""

from itertools import product

import pytest

from vehicle_iface.bus.link_state import OPEN, TABLE, LinkEvent, LinkState

EXPECTED = {
    "UP": {"TROUBLE": "DEGRADED", "LOST": "DOWN", "GONE": "GONE"},
    "DEGRADED": {"CLEAN": "UP", "LOST": "DOWN", "GONE": "GONE"},
    "RECOVERING": {"CLEAN": "UP", "LOST": "DOWN", "GONE": "GONE"},
    "DOWN": {"OPENED": "RECOVERING", "GONE": "GONE"},
    "GONE": {"OPENED": "RECOVERING", "LOST": "DOWN"},
}


@pytest.mark.parametrize(("state", "event"), list(product(LinkState, LinkEvent)))
def test_every_pair_of_state_and_sign_leads_where_it_is_written(state: LinkState, event: LinkEvent) -> None:
    expected = EXPECTED[state.name].get(event.name, state.name)
    assert TABLE.get((state, event), state).name == expected


def test_only_a_link_that_is_open_can_lead_to_up() -> None:
    assert all(state in OPEN for (state, _), after in TABLE.items() if after is LinkState.UP)
