"""Options and commands of the last version are accepted with a warning, and shown nowhere."""

import re

import pytest

from vehicle_iface import cli


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("run --trajectory-post .", "run --trajectory-mailbox ."),
        ("run --trajectory-post=.", "run --trajectory-mailbox=."),
        ("pedals no-such status", "driver no-such status"),
        ("sim --interface embedded --pedals=x", "sim --interface embedded --driver-socket=x"),
    ],
)
def test_a_renamed_option_is_accepted_with_a_warning(capsys: pytest.CaptureFixture[str], old: str, new: str) -> None:
    assert cli.main(new.split()) == 2
    expected = capsys.readouterr()
    assert cli.main(old.split()) == 2
    said = capsys.readouterr()
    warning, _, rest = said.err.partition("\n")
    assert (said.out, rest) == (expected.out, expected.err)
    words = {word.partition("=")[0] for word in (*old.split(), *new.split())}
    changed = words - ({*old.split()} & {*new.split()})
    assert all(word in warning for word in changed)


def test_renamed_options_are_neither_shown_nor_suggested(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["--help"], ["run", "--help"], ["sim", "--help"], ["pedal"]):
        with pytest.raises(SystemExit):
            cli.main(arguments)
    shown = capsys.readouterr()
    assert not re.search(r"^ +pedals|--pedals|--trajectory-post", shown.out + shown.err, re.MULTILINE)
    assert "must be one of demo, run, sim, driver, doctor" in shown.err
