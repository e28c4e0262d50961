"""Builds the state assembler from a profile and its DBC."""

from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.pose import Locator
from vehicle_iface.state_assembler import Freshness, StateAssembler
from vehicle_iface.units import ns_from_s


def build_state_assembler(database: VehicleDatabase) -> StateAssembler:
    """Build a state assembler for the profile's sample."""
    return StateAssembler(
        database.row,
        Locator(database.profile),
        sample=[message.name for message in database.sample],
        window_ns=_window_ns(database),
        stale_ns=ns_from_s(database.profile.timing.status_stale_s),
        counter_states=min(
            (message.protection.counter_states for message in database.sample if message.protection is not None),
            default=1,
        ),
        freshness=_freshness(database),
    )


def _freshness(database: VehicleDatabase) -> Freshness | None:
    """Return how old the parts of a sample may be; None if they belong together by their counter."""
    state, names = database.profile.state, [message.name for message in database.sample]
    if database.is_counted:
        return None
    stale_s = database.profile.timing.state_stale_s
    ages_s = state.max_age_s if isinstance(state.max_age_s, dict) else {}
    default_s = state.max_age_s if isinstance(state.max_age_s, float) else stale_s
    ages_ns = {name: ns_from_s(ages_s.get(name, default_s)) for name in names}
    return Freshness(state.trigger or names[0], ages_ns)


def _window_ns(database: VehicleDatabase) -> int:
    """Return the time in which all messages of one sample arrive: less than half a cycle of their counter, so that
    cycles never mix."""
    timing = database.profile.timing
    half_rounds_s = (
        0.5 * message.protection.counter_states * timing.sample_period_s
        for message in database.sample
        if message.protection is not None and message.protection.has_counter
    )
    return ns_from_s(min((timing.state_stale_s, *half_rounds_s)))
