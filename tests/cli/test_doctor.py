"""The doctor's judgement of every condition, and its words about this machine as it is."""

import json
import os
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from vehicle_iface import cli
from vehicle_iface.cli import doctor
from vehicle_iface.cli.doctor import can, system
from vehicle_iface.cli.doctor.findings import Diagnostic, Verdict, is_ready
from vehicle_iface.profile import Bus

ROOT = Path(__file__).resolve().parents[2]
CLASSICAL, FD = Bus(bitrate=500_000), Bus(bitrate=500_000, fd=True, data_bitrate=2_000_000)
OK, WARN, MISSING = Verdict.OK, Verdict.WARN, Verdict.MISSING


def can0(**data: Any) -> dict[str, Any]:
    """What `ip` shows of a real controller that is well set up; `data` is of the controller."""
    well: dict[str, Any] = {
        "state": "ERROR-ACTIVE",
        "berr_counter": {"tx": 0, "rx": 0},
        "restart_ms": 100,
        "bittiming": {"bitrate": 500_000},
    }
    return {
        "ifname": "can0",
        "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"],
        "mtu": 16,
        "qdisc": "pfifo_fast",
        "txqlen": 10,
        "link_type": "can",
        "linkinfo": {"info_kind": "can", "info_data": well | data},
    }


def by_subject(findings: Iterable[Diagnostic]) -> dict[str, Diagnostic]:
    return {finding.subject: finding for finding in findings}


def only(findings: Iterable[Diagnostic]) -> Diagnostic:
    (finding,) = findings
    return finding


def test_a_controller_that_is_well_set_up_is_all_right() -> None:
    assert {finding.verdict for finding in can.check_link(can0(), CLASSICAL)} == {OK}


@pytest.mark.parametrize(
    ("data", "subject", "verdict", "text", "fix"),
    [
        ({"bittiming": {}}, "bit rate", MISSING, "not set", "type can bitrate 500000"),
        ({"bittiming": {"bitrate": 250_000}}, "bit rate", MISSING, "250000, the profile has 500000", "500000"),
        ({"restart_ms": 0}, "restart-ms", WARN, "stays off", "restart-ms 100"),
        ({"state": "ERROR-WARNING"}, "errors", WARN, "error-warning", "ip -details -statistics link show can0"),
        (
            {"state": "ERROR-PASSIVE", "berr_counter": {"tx": 128, "rx": 3}},
            "errors",
            WARN,
            "sending 128",
            "ip -details",
        ),
        ({"state": "BUS-OFF"}, "errors", MISSING, "bus-off", "sudo ip link set can0 type can restart"),
        ({"ctrlmode": ["LISTEN-ONLY"]}, "mode", MISSING, "no command leaves", "listen-only off"),
        ({"ctrlmode": ["LOOPBACK"]}, "mode", MISSING, "nothing leaves", "loopback off"),
    ],
)
def test_a_controller_that_is_not_is_found_with_its_command(
    data: dict[str, Any], subject: str, verdict: Verdict, text: str, fix: str
) -> None:
    found = by_subject(can.check_link(can0(**data), CLASSICAL))
    assert found[subject].verdict is verdict
    assert text in found[subject].text
    assert fix in found[subject].fix
    assert {f.subject for f in found.values() if f.verdict is not OK} == {subject}


def test_a_controller_without_error_counters_is_judged_by_its_state() -> None:
    link = can0()
    del link["linkinfo"]["info_data"]["berr_counter"]
    assert by_subject(can.check_link(link, CLASSICAL))["errors"].text == "error-active"


def test_a_classical_controller_is_not_enough_for_fd_and_the_command_makes_it_so() -> None:
    mtu = by_subject(can.check_link(can0(), FD))["MTU"]
    assert mtu.verdict is MISSING
    assert "dbitrate 2000000 fd on" in mtu.fix
    assert by_subject(can.check_link(can0() | {"mtu": 72}, FD))["MTU"].verdict is OK


def test_a_controller_that_is_down_is_brought_up_with_the_bit_rate_of_the_profile() -> None:
    down = can0(state="STOPPED") | {"flags": ["NOARP", "ECHO"]}
    found = by_subject(can.check_link(down, Bus(bitrate=500_000)))
    assert found["can0"].fix == "sudo ip link set can0 up type can bitrate 500000 restart-ms 100"
    assert found["errors"].verdict is OK


def test_a_kind_that_hides_its_bit_rate_is_warned_of() -> None:
    serial = can0() | {"linkinfo": {}}
    assert by_subject(can.check_link(serial, CLASSICAL))["bit rate"].verdict is WARN


@pytest.mark.parametrize(
    ("frames", "bitrate", "verdict"),
    [
        (10, 500_000, OK),
        (4, 500_000, OK),
        (3, 500_000, WARN),
        (11, 500_000, WARN),
        (1000, 1_000_000, WARN),
        (9, 125_000, OK),
        (10, 125_000, WARN),
    ],
)
def test_a_queue_takes_a_pass_and_lets_no_command_grow_old(frames: int, bitrate: int, verdict: Verdict) -> None:
    link = can0(bittiming={"bitrate": bitrate}) | {"txqlen": frames}
    assert by_subject(can.check_link(link, Bus(bitrate=bitrate)))["txqueuelen"].verdict is verdict


@pytest.mark.parametrize(
    ("runtime_us", "period_us", "verdict"),
    [
        (950_000, 1_000_000, OK),
        (-1, 1_000_000, WARN),
        (0, 1_000_000, WARN),
        (100_000, 1_000_000, WARN),
        (None, None, OK),
    ],
)
def test_throttling_is_there_and_is_not_felt(runtime_us: int | None, period_us: int | None, verdict: Verdict) -> None:
    assert only(system.check_throttling(runtime_us, period_us)).verdict is verdict


@pytest.mark.parametrize(
    ("governors", "verdict"),
    [([], OK), (["performance\n"] * 4, OK), (["powersave\n", "performance\n"], WARN), (["schedutil\n"], WARN)],
)
def test_a_governor_that_lets_processors_doze_is_warned_of(governors: list[str], verdict: Verdict) -> None:
    assert only(system.check_governor(governors)).verdict is verdict


@pytest.mark.parametrize(
    ("current", "available", "verdict", "fix"),
    [
        (["tsc"], ["tsc", "hpet"], OK, ""),
        (["kvm-clock"], ["kvm-clock"], OK, ""),
        (["hpet"], ["tsc", "hpet"], WARN, "echo tsc | sudo tee"),
        (["acpi_pm"], ["acpi_pm"], WARN, "dmesg"),
        ([], [], OK, ""),
    ],
)
def test_a_slow_clock_is_warned_of(current: list[str], available: list[str], verdict: Verdict, fix: str) -> None:
    finding = only(system.check_clock(current, available))
    assert finding.verdict is verdict
    assert finding.fix.startswith(fix)


def test_a_receive_buffer_that_is_cut_is_warned_of() -> None:
    assert only(can.check_receive_buffer(212_992)).verdict is WARN
    assert only(can.check_receive_buffer(1 << 20)).verdict is OK


def test_a_file_on_a_disk_is_warned_of(tmp_path: Path) -> None:
    finding = only(system.check_memory_files(tmp_path))
    assert finding.verdict is WARN
    assert str(tmp_path) in finding.text


@pytest.mark.parametrize(("version", "verdict"), [("1.1.1", OK), ("1.1.2", WARN), ("", MISSING)])
def test_a_package_is_there_and_as_tested(version: str, verdict: Verdict) -> None:
    finding = system.check_package("viser", version, "1.1.1")
    assert finding.verdict is verdict
    assert finding.fix == ("" if verdict is OK else f"{sys.executable} -m pip install viser==1.1.1")


def test_the_tested_versions_are_those_of_the_lock() -> None:
    locked = re.findall(r"^([\w.-]+)==(\S+)", (ROOT / "requirements.txt").read_text(), re.MULTILINE)
    assert set(system.TESTED.items()) <= set(locked)


def test_a_missing_module_is_reported_as_absent() -> None:
    assert not can.has_module("can_there_be_none")


def test_on_another_system_inapplicable_checks_are_named_and_nothing_is_required() -> None:
    findings = doctor.examine({"vcan0": CLASSICAL}, system="darwin")
    assert is_ready(findings)
    assert [f.subject for f in findings if "does not apply to darwin" in f.text] == ["SocketCAN", "real time"]


def test_every_finding_about_this_machine_is_one_line_and_has_a_command_unless_it_is_well() -> None:
    findings = doctor.examine({"vcan0": CLASSICAL})
    assert {"SocketCAN", "SCHED_FIFO", "memory lock", "clock source", "Python", "viser"} <= set(by_subject(findings))
    for finding in findings:
        assert "\n" not in str(finding)
        assert bool(finding.fix) == (finding.verdict is not OK)
        assert str(finding).endswith("`") == bool(finding.fix)


def test_the_command_ends_with_2_when_something_needed_is_missing(capsys: pytest.CaptureFixture[str]) -> None:
    status = cli.main(["doctor", "--channel", "can99"])
    shown = capsys.readouterr().out
    assert status == 2
    errors = sum(line.startswith("missing") for line in shown.splitlines())
    assert errors >= 1
    assert shown.splitlines()[-1].startswith(f"{errors} error{'s' if errors > 1 else ''}, ")
    # Without SocketCAN that is said, and not that an interface is missing that no command could make.
    assert ("missing  can99" in shown) != ("missing  SocketCAN" in shown)


def test_the_same_for_a_program(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", "--channel", "can99", "--json"]) == 2
    said = json.loads(capsys.readouterr().out)
    assert said["is_ready"] is False
    assert {frozenset(finding) for finding in said["findings"]} == {frozenset(("subject", "verdict", "text", "fix"))}
    assert {finding["verdict"] for finding in said["findings"]} <= {"ok", "warn", "missing"}


def test_an_unknown_profile_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", "--profile", "nobody"]) == 2
    assert "nobody" in capsys.readouterr().err


def test_looking_changes_nothing() -> None:
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, _locked()
    doctor.examine({"vcan0": CLASSICAL})
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, _locked()) == before


def _locked() -> str:
    return next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmLck"))
