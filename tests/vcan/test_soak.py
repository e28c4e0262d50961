"""tools/soak in short: a drive over a bad cable whose link goes down twice, judged by what was seen at both ends."""

import json
import signal

import pytest

from .conftest import Programs

SOAK = ("-P", "-m", "drive_checks.soak")
FLAPS = 2


@pytest.mark.timeout(180)
def test_a_drive_with_a_bad_cable_and_two_link_losses_has_no_findings(programs: Programs) -> None:
    path = programs.folder / "soak.json"
    timing = ["--duration", "37", "--flap-every", "13"]  # the last flap well before the last ten seconds
    soak = programs.start_python(*SOAK, *timing, "--json", str(path), name="soak")
    assert soak.wait_for_end(120.0) == 0, soak.text
    found = json.loads(path.read_text())
    assert found["wrong"] == []
    assert found["flaps"] == FLAPS
    assert found["armed_again"] >= FLAPS
    assert found["stale_commands"] == found["repeated_commands"] == found["counter_gaps"] == 0
    assert found["pairs"] > 2000
    for way in ("to_loop", "to_vehicle"):
        assert min(found[way][cause] for cause in ("lost", "repeated", "bad CRC", "wrong sequence")) > 0
    assert found["run_commands"] == pytest.approx(found["pairs"], abs=FLAPS + 1)
    assert set(found["memory_mib"]) == {"begin", "middle", "end"}
    assert "nothing is wrong" in soak.text


def test_an_interrupted_soak_stops_the_vehicle_and_does_not_pass(programs: Programs) -> None:
    soak = programs.start_python(*SOAK, "--duration", "600", name="soak")
    soak.wait_for_line("soaking circle for 600 s: loss 1%")
    soak.send_signal(signal.SIGINT)
    assert soak.wait_for_end(60.0) == 130
    assert "interrupted: this soak proves nothing" in soak.text
