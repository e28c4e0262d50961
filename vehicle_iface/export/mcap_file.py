"""A recording as MCAP (https://mcap.dev): samples with JSON schemas, which Foxglove and PlotJuggler plot.

| topic | message |
|---|---|
| `/snapshot` | each snapshot; states and reasons also as names |
| `/event` | each event |
| `/counters` | all counters, twice a second |
| `/trajectory` | each trajectory as drawn |

Times are those of the wall clock.
"""

import heapq
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from vehicle_iface.errors import ConfigError
from vehicle_iface.export.csv_file import NAMES, name_of
from vehicle_iface.export.recording import RecordedDrive
from vehicle_iface.recorder.files import CountersLine, TrajectoryLine
from vehicle_iface.telemetry import Snapshot
from vehicle_iface.telemetry.events import LoopEvent

CHUNK_BYTES = 16 << 10
_JSON_TYPES = {"int": "integer", "bool": "boolean", "float": "number", "str": "string"}


class _Message(NamedTuple):
    at_ns: int
    topic: str
    body: bytes


def require_mcap() -> None:
    """Raise `ConfigError` unless the library is installed."""
    if find_spec("mcap") is None:
        raise ConfigError("--mcap needs the library mcap: pip install 'vehicle-iface[mcap]'")


def write_mcap(drive: RecordedDrive, path: Path) -> dict[str, int]:
    """Write the file, its messages in the order of time; return their number by topic. Raises `OSError`."""
    from mcap.writer import Writer

    schemas = {
        "snapshot": _snapshot_schema(),
        "event": _schema(LoopEvent),
        "counters": _schema(CountersLine),
        "trajectory": _schema(TrajectoryLine),
    }
    counts = dict.fromkeys(schemas, 0)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES)
        writer.start(library="vehicle-iface")
        channels: dict[str, int] = {}
        for topic, schema in schemas.items():
            schema_id = writer.register_schema(f"vehicle_iface.{topic}", "jsonschema", schema)
            channels[topic] = writer.register_channel(f"/{topic}", "json", schema_id)
        for at_ns, topic, body in heapq.merge(*_read(drive), key=lambda message: message.at_ns):
            counts[topic] += 1
            wall_ns = max(0, drive.wall_ns(at_ns))
            writer.add_message(channels[topic], wall_ns, body, publish_time=wall_ns, sequence=counts[topic])
        writer.add_metadata("recording", {"profile": drive.meta.session.profile, "route": drive.meta.session.route})
        writer.finish()  # type: ignore[no-untyped-call]
    return counts


def _read(drive: RecordedDrive) -> Iterator[Iterator[_Message]]:
    """The messages of each topic."""
    encode = msgspec.json.encode
    yield (_Message(one.published_ns, "snapshot", encode(_values(one))) for one in drive.snapshots())
    yield (_Message(one.at_ns, "event", encode(one)) for one in drive.events())
    yield (_Message(one.at_ns, "counters", encode(one)) for one in drive.counters())
    yield (_Message(one.stamp_ns, "trajectory", encode(one)) for one in drive.trajectories())


def _values(snapshot: Snapshot) -> dict[str, object]:
    values: dict[str, object] = dict(zip(Snapshot._fields, snapshot, strict=True))
    return values | {f"{field}_name": name_of(field, getattr(snapshot, field)) for field in NAMES}


def _snapshot_schema() -> bytes:
    kinds = {name: str(getattr(kind, "__forward_arg__", kind)) for name, kind in Snapshot.__annotations__.items()}
    properties = {name: {"type": _JSON_TYPES[kind]} for name, kind in kinds.items()}
    properties |= {f"{field}_name": {"type": "string"} for field in NAMES}
    return msgspec.json.encode({"type": "object", "title": "vehicle_iface.snapshot", "properties": properties})


def _schema(kind: type[msgspec.Struct]) -> bytes:
    """The JSON schema of a struct, with its own properties at the top: Foxglove wants an object there."""
    schema: dict[str, Any] = msgspec.json.schema(kind)
    definitions: dict[str, Any] = schema["$defs"]
    top: dict[str, Any] = definitions.pop(kind.__name__)
    return msgspec.json.encode(top | ({"$defs": definitions} if definitions else {}))
