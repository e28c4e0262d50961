"""The secret of a page: from a file or the environment, and never in a command line."""

import os
from pathlib import Path

import pytest

from vehicle_iface.errors import ConfigError
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.access_token import TOKEN_VARIABLE, read_token

TOKEN = "0123456789abcdef"


def write_token(path: Path, text: str = f"{TOKEN}\n", mode: int = 0o600) -> Path:
    path.write_text(text)
    path.chmod(mode)
    return path


@pytest.mark.parametrize("mode", [0o600, 0o400])
def test_a_private_file_gives_its_only_line(tmp_path: Path, mode: int) -> None:
    assert read_token(write_token(tmp_path / "token", mode=mode)) == TOKEN


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o620, 0o602])
def test_a_file_that_other_users_can_use_is_refused_with_its_mode(tmp_path: Path, mode: int) -> None:
    path = write_token(tmp_path / "token", mode=mode)
    with pytest.raises(ConfigError, match=rf"--token-file {path}: mode {mode:04o} lets other users in; `chmod 600` it"):
        read_token(path)


def test_a_file_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_token(tmp_path / "token")
    owner = path.stat().st_uid or 1000
    os.chown(path, owner, -1)
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    with pytest.raises(ConfigError, match=f"belongs to user {owner}; it must be yours, or root's"):
        read_token(path)


def test_a_pipe_gives_a_token_as_a_password_manager_writes_it() -> None:
    reader, writer = os.pipe()
    os.write(writer, f"{TOKEN}\n".encode())
    os.close(writer)
    assert read_token(Path(f"/dev/fd/{reader}")) == TOKEN
    os.close(reader)


def test_a_file_that_cannot_be_read_is_refused_with_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"No such file or directory; `\(umask 077; openssl rand"):
        read_token(tmp_path / "missing")
    with pytest.raises(ConfigError, match="Is a directory"):
        read_token(tmp_path)
    with pytest.raises(ConfigError, match="more than 4096 bytes"):
        read_token(write_token(tmp_path / "token", "x" * 5000))


def test_without_a_file_the_environment_gives_the_token(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(TOKEN_VARIABLE, raising=False)
    assert read_token(None) is None
    monkeypatch.setenv(TOKEN_VARIABLE, "from the environment")
    assert read_token(None) == "from the environment"
    assert read_token(write_token(tmp_path / "token")) == TOKEN


@pytest.mark.parametrize("unfit", [" ", ";", '"', ",", "\\", "\n", "\r", "é", "\x7f"])
def test_a_token_that_a_cookie_cannot_hold_is_refused_without_showing_it(unfit: str) -> None:
    with pytest.raises(ConfigError, match=r"token with '.*': only ASCII letters") as refused:
        Access(token=f"{TOKEN}{unfit}")
    assert TOKEN not in str(refused.value)


def test_an_empty_file_or_variable_opens_no_page_to_everybody(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="token of 0 characters: at least 16"):
        Access(token=read_token(write_token(tmp_path / "token", "\n")))
