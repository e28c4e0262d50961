"""Messages with lights and with the controller's own state."""

from collections.abc import Mapping

from vehicle_iface.reason import Reason
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.cycle import ControlCycle
from vehicle_iface.runtime.publisher import TelemetryPublisher
from vehicle_iface.runtime.timer import PeriodicTimer
from vehicle_iface.runtime.transmitter import Transmitter
from vehicle_iface.safety.handover import Handover
from vehicle_iface.status import BodyRequest, ControllerReport

END_OF_TRAJECTORY = (Reason.PAST_END_SPACE, Reason.PAST_END_TIME)
"""Stops for these reasons do not turn on the hazard lights."""


class Reports:
    """Sends each report when it is due."""

    def __init__(
        self,
        transmitter: Transmitter,
        cycle: ControlCycle,
        publisher: TelemetryPublisher,
        handover: Handover,
        counters: Counters,
        *,
        body: tuple[str, PeriodicTimer] | None,
        report: tuple[str, PeriodicTimer] | None,
        ranges: Mapping[str, tuple[float, float]],
    ) -> None:
        """`body` and `report` are the messages of a `BodyRequest` and a `ControllerReport`, each with its timer; None
        where the vehicle has none. `ranges` are those of the report's bound fields."""
        self._transmitter, self._cycle, self._publisher = transmitter, cycle, publisher
        self._handover, self._counters = handover, counters
        self._body, self._report, self._ranges = body, report, ranges

    def send_due(self, now_ns: int) -> None:
        """Send the lights and the controller's report where they are due."""
        if self._body is not None and self._body[1].is_due(now_ns):
            hazard = self._cycle.is_stopping and self._cycle.reason not in END_OF_TRAJECTORY
            self._transmitter.send(self._body[0], BodyRequest(hazard_lights=hazard))
        if self._report is not None and self._report[1].is_due(now_ns):
            spatial, temporal = self._publisher.indices
            content = ControllerReport(
                state=self._cycle.wire_state,
                reason=self._cycle.reason,
                ref_spatial_index=self._saturate("ref_spatial_index", spatial),
                ref_temporal_index=self._saturate("ref_temporal_index", temporal),
                deadline_misses=self._saturate("deadline_misses", self._counters.deadline_misses),
                handover=self._handover.warns,
            )
            self._transmitter.send(self._report[0], content)

    def _saturate(self, field: str, count: int) -> int:
        """Return the value nearest to `count` that the report's signal can carry."""
        low, high = self._ranges.get(field, (count, count))
        return int(max(low, min(high, count)))
