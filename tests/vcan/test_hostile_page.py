"""Everything that can be done to the viewer at once, looked at from the bus: nothing of it is to be seen there."""

import signal
import urllib.request

from .conftest import ROOT, Programs
from .driving import driven, line_file, wait_until_driven
from .observer import Observer, decided
from .peer import Vehicle
from .verdict import breaches

VCAN = ROOT / "tests" / "vcan"
TOKEN = "sixteen-characters-and-more"
SECOND_VIEWERS = """
import sys
from vehicle_iface_viewer.__main__ import main
assert main(["--port", sys.argv[1]]) == main(["--port", "0", "--host", "0.0.0.0"]) == 2
"""


def test_attacks_floods_and_invalid_input_to_the_page_change_nothing_on_the_bus(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    connected = ("view", "--connect", programs.telemetry)
    token_file = programs.folder / "token"
    token_file.touch(mode=0o600)
    token_file.write_text(TOKEN)
    viewer = programs.start(*connected, "--port", "0", "--token-file", str(token_file))
    port = viewer.wait_for_line(r"viewer: http://127\.0\.0\.1:(\d+)").group(1)
    second = programs.start_python("-c", SECOND_VIEWERS, port, name="view")
    assert second.wait_for_end() == 0
    taken, remote = second.lines
    assert f"--port {port} on 127.0.0.1" in taken
    assert "--allow-remote and --token-file" in remote
    posted = programs.folder / "<img src=x onerror=alert(1)>"
    programs.start_python(str(VCAN / "poster.py"), str(posted), "far", name="poster")
    loop, moving = driven(programs, bus, "--trajectory-mailbox", str(posted))

    attacker = programs.start_python(str(VCAN / "hostile_client.py"), port, TOKEN, name="hostile")
    assert attacker.wait_for_end(60.0) == 0
    assert attacker.lines == ["another host name: 403", "a foreign Origin: 403", "no token: 401", "done"]
    attacked = bus.wait_samples(10)
    loop.kill()
    bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=3, since=attacked)
    vehicle.make_ready()
    again = bus.now()
    assert breaches(bus.frames[:again]) == []
    again_ns = bus.frames[again - 1].stamp_ns
    bus.is_foreign = lambda frame: frame.stamp_ns <= again_ns  # the next loop counts from 0
    loop = programs.run("--arm", "--trajectory", line_file(programs.folder))
    driving = wait_until_driven(bus, since=again)
    end = bus.wait_samples(50, since=driving)
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/?token={TOKEN}", timeout=20.0) as page:
        assert page.status == 200
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    for record in (bus.record(moving, attacked), bus.record(driving, end)):
        assert decided(record) == ["NOMINAL"]
        assert record.faults() == []
