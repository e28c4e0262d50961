"""The browser viewer: it watches a loop through its telemetry and has no way to answer it."""
