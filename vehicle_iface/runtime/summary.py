"""What a run came to: as JSON for programs, as a table for people."""

import json
from pathlib import Path
from typing import Any

from vehicle_iface.errors import ConfigError


def check_writable(path: str) -> None:
    """Make the file, empty where there is none, before anything drives; `ConfigError` when that fails."""
    try:
        with open(path, "a", encoding="utf-8"):
            pass
    except OSError as error:
        raise ConfigError(f"--summary {path}: cannot be written: {error.strerror}") from error


def save_summary(path: str, summary: dict[str, Any]) -> None:
    """Write the summary as JSON; `ConfigError` naming the file when that fails."""
    try:
        Path(path).write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"--summary {path}: cannot be written: {error.strerror}") from error


def table(summary: dict[str, Any]) -> str:
    """The summary for the terminal: one line for each thing that is not zero."""
    latency = summary["latency"]
    rows = [
        ("bus", summary["bus"]),
        ("link", _link(summary["link"])),
        ("ended", f"{summary['controller_state']}, {summary['reason']}"),
        *([("latched fault", summary["latched_fault"])] if summary["latched_fault"] else []),
        ("duration", f"{summary['duration_s']:.1f} s"),
        ("samples", f"{summary['samples']} complete, {summary['incomplete_samples']} incomplete"),
        ("commands", f"{summary['commands']} sent"),
        ("deadline misses", str(summary["deadline_misses"])),
    ]
    if latency["count"]:
        rows.append(("latency state→command", "  ".join(_quantiles(latency))))
    if summary.get("shadow", {}).get("takeovers"):
        rows += _shadow(summary["shadow"])
    for name in ("drops", "lost", "implausible", "limited", "deviations", "not_let_out"):
        rows += [(f"{name}: {cause}", str(count)) for cause, count in summary[name].items() if count]
    for name in (
        "samples_heard_only",
        "stale_stops",
        "commands_refused",
        "frames_not_sent",
        "foreign_commands",
        "controller_errors",
        "controller_too_slow",
        "link_losses",
    ):
        if summary["counts"][name]:
            rows.append((name.replace("_", " "), str(summary["counts"][name])))
    if "recorder" in summary:
        rows.append(("recorder", summary["recorder"]["text"]))
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"  {name:<{width}}  {value}" for name, value in rows)


def _link(link: dict[str, Any]) -> str:
    changes = f", changed {len(link['transitions'])} times" if link["transitions"] else ""
    if "load_percent" not in link:
        return f"{link['state']}{changes}"
    load = f"bus load {link['load_percent']} % (at most {link['highest_load_percent']} %)"
    return f"{link['state']}{changes}, {load}, {link['frames_per_s']:.0f} frames/s"


def _shadow(shadow: dict[str, Any]) -> list[tuple[str, str]]:
    apart = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in shadow["apart"].items())
    rows = [
        ("other commander", f"{shadow['compared']} commands compared, {shadow['without_a_sample']} without a sample")
    ]
    rows.append(("other commander: unlike ours", apart))
    for name, unit in (("accel_mps2", "m/s²"), ("front_wheel_angle_rad", "rad")):
        figures = "  ".join(f"{which} {value:.4f}" for which, value in shadow[name].items())
        rows.append((f"difference: {name.rpartition('_')[0].replace('_', ' ')}", f"{figures} {unit}"))
    return rows


def _quantiles(latency: dict[str, Any]) -> list[str]:
    return [f"{name} {latency[f'{name}_s'] * 1e3:.2f} ms" for name in ("p50", "p95", "p99", "max")]
