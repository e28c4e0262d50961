"""Old names of keys are accepted with a warning; a key by both names is refused."""

from pathlib import Path

import msgspec
import pytest

from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile

from .conftest import REFERENCE, Edit

RENAMED = {
    "[limits.while_engaging]": "[limits.engaging]",
    "max_command_age_s": "answer_age_s",
    "engage_settle_s": "engage_fresh_s",
    "engage_timeout_s": "engage_give_up_s",
    "stop_release_time_constant_s": "stop_ease_s",
    "hold_until_warned": "holds",
    "speed_tolerance_mps": "speed_apart_mps",
    "position_tolerance_m": "position_apart_m",
    "heading_tolerance_rad": "heading_apart_rad",
    "yaw_rate_tolerance_radps": "yaw_rate_apart_radps",
    "frozen_distance_m": "frozen_m",
    "frozen_time_s": "frozen_s",
    "frozen_min_speed_mps": "frozen_above_mps",
}
"""New and old text of each renamed key."""


@pytest.mark.parametrize("name", ["reference", "reference_fd"])
def test_a_profile_with_old_keys_only_is_the_same_profile(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str
) -> None:
    new = load_profile(name)
    assert caplog.messages == []
    text = Path(new.file).read_text(encoding="utf-8")
    for ours, theirs in RENAMED.items():
        assert text.count(ours) == 1
        text = text.replace(ours, theirs)
    path = tmp_path / "old.toml"
    path.write_text(text, encoding="utf-8")
    old = load_profile(path)
    assert msgspec.structs.replace(old, dbc=new.dbc, file=new.file) == new
    assert len(caplog.messages) == len(RENAMED)


@pytest.mark.parametrize(("new", "old"), RENAMED.items())
def test_an_old_key_is_taken_with_a_warning(edited: Edit, caplog: pytest.LogCaptureFixture, new: str, old: str) -> None:
    assert load_profile(edited(new, old)).name == "reference"
    (warning,) = caplog.messages
    assert warning.startswith("reference.toml: $.")
    old_key, new_key = (key.strip("[]").rpartition(".")[2] for key in (old, new))
    assert f".{old_key}: renamed to {new_key};" in warning


@pytest.mark.parametrize(("new", "old"), RENAMED.items())
def test_old_and_new_key_together_are_refused_with_both_names(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, new: str, old: str
) -> None:
    lines = REFERENCE.splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith(new))
    end = start + 3 if new.startswith("[") else start + 1  # a table with two keys
    lines[end:end] = [lines[start].replace(new, old), *lines[start + 1 : end]]
    path = tmp_path / "both.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        load_profile(path)
    old_key, new_key = (key.strip("[]").rpartition(".")[2] for key in (old, new))
    text = str(refused.value)
    assert text.startswith("both.toml: $.")
    assert f".{old_key}: is the old name of {new_key}, and {new_key} is there as well" in text
    assert "\n" not in text
    assert caplog.messages == []


@pytest.mark.parametrize(
    ("new", "old", "fault"),
    [
        ("stop_release_time_constant_s = 0.2", "stop_ease_s = -0.2", "$.behavior.stop_ease_s: Expected float > 0"),
        ("frozen_distance_m = 0.5", "frozen_m = nan", "$.plausibility.frozen_m: nan: must be finite"),
        ("[limits.while_engaging]", "[limits.engaging]\nx = 1", "$.limits.engaging.x: unknown key; must be one of"),
    ],
)
def test_a_fault_below_an_old_key_is_placed_where_the_file_has_it(edited: Edit, new: str, old: str, fault: str) -> None:
    with pytest.raises(ConfigError) as refused:
        load_profile(edited(new, old))
    assert str(refused.value).startswith(f"reference.toml: {fault}")
