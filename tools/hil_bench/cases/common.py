"""What several kinds of cases share: stop reasons, needs, and what is allowed during an injection."""

from hil_bench.case import Need

STALE = ("STATE_STALE",)
INVALID = ("STATE_INVALID",)
LINK = (Need.OWN_PROCESS, Need.VIRTUAL, Need.ROOT, Need.REARM)
CABLE = (Need.OWN_PROCESS, Need.VXCAN, Need.ROOT)
DROPPED = frozenset({"unanswered"})
BAD_CABLE = frozenset({"unanswered", "doubled", "counter", "damaged", "burst", "periods", "report"})
ANY = frozenset({"silence", "unanswered", "doubled"})
BROKEN_LINK = ANY | {"counter"}
"""A command that was in flight when the link failed was never on the bus."""
STANDSTILL_S = 2.5
"""From some 3 m/s by the safe deceleration, with the actuators' lag."""
