"""The panel beside the scene. Text from a DBC, a bus, a file or the telemetry is escaped with `text.plain`."""
