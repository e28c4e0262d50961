"""The doctor before a real interface in every condition, and each command that it gives, run."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from .observer import CHANNEL

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Answer:
    """The doctor's output."""

    status: int
    findings: dict[str, dict[str, str]]

    def __getitem__(self, subject: str) -> dict[str, str]:
        return self.findings[subject]

    def verdict(self, subject: str) -> str:
        return self.findings[subject]["verdict"]


def doctor(*arguments: str) -> Answer:
    command = [sys.executable, "-m", "vehicle_iface", "doctor", "--json", *arguments]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert not done.stderr
    found = json.loads(done.stdout)
    assert found["is_ready"] == (done.returncode == 0)
    return Answer(done.returncode, {finding["subject"]: finding for finding in found["findings"]})


def run(line: str) -> None:
    """A command line of the doctor's; the tests have the rights for it."""
    subprocess.run(line.replace("sudo ", ""), shell=True, check=True, capture_output=True)


def ip(line: str) -> None:
    subprocess.run(["ip", *line.split()], check=True, capture_output=True)


@pytest.fixture
def interface(vcan0: None) -> Iterator[str]:  # noqa: ARG001
    """vcan0, put back as it was."""
    yield CHANNEL
    subprocess.run(["tc", "qdisc", "del", "dev", CHANNEL, "root"], check=False, capture_output=True)
    for line in ("down", "mtu 72", "txqueuelen 1000", "up"):
        ip(f"link set {CHANNEL} {line}")


def test_an_interface_that_is_up_has_no_findings(interface: str) -> None:
    answer = doctor("--channel", interface)
    assert answer.status == 0
    assert {answer.verdict(what) for what in ("SocketCAN", interface, "MTU", "bit rate", "txqueuelen")} == {"ok"}


def test_an_interface_that_is_down_is_reported_with_the_command_that_brings_it_up(interface: str) -> None:
    ip(f"link set {interface} down")
    answer = doctor("--channel", interface)
    assert answer.status == 2
    assert answer.verdict(interface) == "missing"
    run(answer[interface]["fix"])
    assert doctor("--channel", interface).status == 0


def test_an_absent_virtual_interface_is_reported_with_the_command_that_creates_it(vcan0: None) -> None:  # noqa: ARG001
    answer = doctor("--channel", "vcan7")
    assert answer.status == 2
    assert answer.verdict("vcan7") == "missing"
    assert answer.verdict("vcan") == "ok"
    try:
        # Where the tests run the module is there, though not always where modprobe looks for it.
        run(answer["vcan7"]["fix"].removeprefix("sudo modprobe vcan && "))
        assert doctor("--channel", "vcan7").status == 0
    finally:
        ip("link del vcan7")


def test_an_absent_hardware_interface_points_to_the_adapter(vcan0: None) -> None:  # noqa: ARG001
    answer = doctor("--channel", "can7")
    assert answer.status == 2
    run(answer["can7"]["fix"])


def test_an_interface_of_another_type_is_rejected(vcan0: None) -> None:  # noqa: ARG001
    answer = doctor("--channel", "lo")
    assert answer.status == 2
    assert "carries no CAN" in answer["lo"]["text"]


def test_a_classical_mtu_suffices_only_for_a_classical_vehicle(interface: str) -> None:
    ip(f"link set {interface} down")
    ip(f"link set {interface} mtu 16")
    ip(f"link set {interface} up")
    assert doctor("--channel", interface).status == 0
    answer = doctor("--channel", interface, "--profile", "reference_fd")
    assert answer.status == 2
    assert answer.verdict("MTU") == "missing"
    run(answer["MTU"]["fix"])
    assert doctor("--channel", interface, "--profile", "reference_fd").status == 0


def test_a_long_transmit_queue_is_a_warning_with_the_command_that_shortens_it(interface: str) -> None:
    subprocess.run(["tc", "qdisc", "add", "dev", interface, "root", "pfifo"], check=True)
    answer = doctor("--channel", interface)
    assert answer.status == 0
    assert answer.verdict("txqueuelen") == "warn"
    run(answer["txqueuelen"]["fix"])
    assert doctor("--channel", interface).verdict("txqueuelen") == "ok"
    ip(f"link set {interface} txqueuelen 2")
    assert "one pass sends up to" in doctor("--channel", interface)["txqueuelen"]["text"]


def test_a_small_receive_buffer_is_a_warning_with_the_command_that_enlarges_it(vcan0: None) -> None:  # noqa: ARG001
    limit = Path("/proc/sys/net/core/rmem_max")
    before = limit.read_text()
    try:
        limit.write_text("212992")
        answer = doctor()
        assert answer.verdict("rmem_max") == "warn"
        run(answer["rmem_max"]["fix"])
        assert doctor().verdict("rmem_max") == "ok"
    finally:
        limit.write_text(before)


def test_without_privileges_the_findings_about_the_bus_are_the_same(interface: str) -> None:
    # Once before, so that all is imported while there still is a right to read where Python may be installed.
    code = f"""
import contextlib, io, os, sys
from vehicle_iface import cli
with contextlib.redirect_stdout(io.StringIO()):
    cli.main(["doctor", "--channel", "{interface}"])
os.setgid(65534)
os.setuid(65534)
sys.exit(cli.main(["doctor", "--channel", "{interface}"]))
"""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "ok       vcan0          vcan, up" in done.stdout
    assert "warn     SCHED_FIFO     no permission for it" in done.stdout
