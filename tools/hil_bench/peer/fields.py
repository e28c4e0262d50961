"""Between fields of the vehicle's state and the signals that carry them, in both directions."""

import math
from collections.abc import Mapping
from typing import Any

from hil_bench.peer.conditions import Values
from hil_bench.peer.mode import Conditions
from hil_bench.peer.place import read_place
from hil_bench.peer.signals import PeerSignal, sources_of
from hil_bench.vocabulary import SIGNAL_NAMES

STATE_NAMES = SIGNAL_NAMES["state"]
PLACE_FIELDS = {"x_m", "y_m", "heading_rad", "latitude_deg", "longitude_deg"}


class Fields:
    """The fields of one profile's state and status."""

    def __init__(self, profile: Mapping[str, Any], signals: Mapping[str, PeerSignal]) -> None:
        self.place = read_place(profile)
        self.conditions = Conditions(profile, signals)
        self.forms: Mapping[str, object] = profile["state"]["signals"]
        self.status: Mapping[str, str] = profile.get("status", {}).get("signals", {})
        self._signals = signals
        self._override_nm = float(profile["limits"].get("driver_steer_torque_nm", math.inf))

    def read(self, key: str, values: Values) -> float | None:
        """A field by the newest values of all signals; None without one."""
        form = self.forms.get(key)
        sources = sources_of(form)
        if form is None or any(name not in values for name in sources):
            return None
        numbers = [values[name] for name in sources]
        if not isinstance(form, Mapping):
            return numbers[0]
        if "value" in form:
            is_negative = "negative_if" in form and self.conditions.holds(form["negative_if"], values)
            return -numbers[0] if is_negative else numbers[0]
        return sum(numbers) / (len(numbers) if "mean" in form else 1)

    def read_alone(self, message: str, values: Values) -> dict[str, float]:
        """The fields that one message carries alone, by the reference vehicle's names."""
        found = {}
        for key, form in self.forms.items():
            if key in STATE_NAMES and all(name.startswith(f"{message}.") for name in sources_of(form)):
                value = self.read(key, values)
                if value is not None:
                    found[STATE_NAMES[key]] = value
        return found

    def write(self, values: Values) -> dict[str, float]:
        """All signals that the vehicle sends, in fields' units, by the reference vehicle's names of fields."""
        fields = {key: values.get(name, 0.0) for key, name in STATE_NAMES.items() if key not in PLACE_FIELDS}
        fields |= self.place.measure(values.get("POS_X", 0.0), values.get("POS_Y", 0.0), values.get("HEADING", 0.0))
        given: dict[str, float] = {}
        for key, form in self.forms.items():
            given |= self._spread(key, form, fields[key])
        for key, dotted in self.status.items():
            given[dotted] = self._carried(dotted, values.get(SIGNAL_NAMES["status"][key], 0.0))
        return {**self._tell(values, fields, given), **given}

    def _tell(self, values: Values, fields: Values, given: Values) -> Values:
        """The signals of conditions, so that mode, driver, validity and signs are understood."""
        names = self.conditions.names
        if not names:
            return {}
        actions = (
            bool(values.get("DRIVER_BRAKE", 0.0)),
            bool(values.get("DRIVER_THROTTLE", 0.0)),
            abs(values.get("DRIVER_STEER_TORQUE", 0.0)) >= self._override_nm,
        )
        return self.conditions.choose(
            int(values.get("MODE", 0.0)),
            actions,
            is_valid=bool(values.get("POSE_VALID", 1.0)),
            signs=[fields.get(key, 0.0) < 0.0 for key, _ in self.conditions.signs],
            given={dotted: given[dotted] for dotted in names if dotted in given},
        )

    def _spread(self, key: str, form: object, value: float) -> dict[str, float]:
        """A field's value as the signals that carry it."""
        sources = sources_of(form)
        if isinstance(form, Mapping) and "sum" in form:
            found, rest = {}, value
            for dotted in sorted(sources, key=lambda name: -self._signals[name].count):
                found[dotted] = self._carried(dotted, rest)
                rest -= found[dotted]
            return found
        if isinstance(form, Mapping) and "negative_if" in form:
            value = abs(value)
        if key == "heading_rad":
            value = self._turned(sources[0], value)
        return {dotted: self._carried(dotted, value) for dotted in sources}

    def _turned(self, dotted: str, angle_rad: float) -> float:
        """The angle, turned by a whole circle into the signal's range if need be."""
        signal = self._signals[dotted]
        low, high = sorted((signal.to_field(signal.low), signal.to_field(signal.high)))
        turns = (angle_rad, angle_rad + math.tau, angle_rad - math.tau)
        return next((turned for turned in turns if low <= turned <= high), angle_rad)

    def _carried(self, dotted: str, value: float) -> float:
        """The nearest value that the signal can carry."""
        signal = self._signals[dotted]
        return value if signal.names else signal.to_field(signal.to_dbc(value))
