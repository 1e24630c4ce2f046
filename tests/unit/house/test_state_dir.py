"""Where the state lives, and what is said when there is no place for it."""

import os
import pwd
from pathlib import Path
from types import SimpleNamespace

import pytest

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.paths import cache_place, checkout, state_dir, state_place


@pytest.mark.parametrize(
    ("variables", "place"),
    [
        ({"ATLANTIS_STATE": "{tmp}/own", "XDG_STATE_HOME": "{tmp}/xdg", "HOME": "{tmp}"}, "own"),
        ({"XDG_STATE_HOME": "{tmp}/xdg", "HOME": "{tmp}"}, "xdg/atlantis"),
        ({"XDG_STATE_HOME": "relative", "HOME": "{tmp}"}, ".local/state/atlantis"),
        ({"ATLANTIS_STATE": "", "XDG_STATE_HOME": "", "HOME": "{tmp}"}, ".local/state/atlantis"),
    ],
)
def test_location_and_mode(variables: dict[str, str], place: str, tmp_path: Path) -> None:
    made = state_dir({name: value.format(tmp=tmp_path) for name, value in variables.items()})
    assert made == tmp_path / place
    assert made.stat().st_mode & 0o777 == 0o700


def test_readable_directory_is_made_private(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    assert state_dir({"ATLANTIS_STATE": str(tmp_path)}).stat().st_mode & 0o777 == 0o700


def test_relative_path_is_made_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert state_dir({"ATLANTIS_STATE": "here"}) == tmp_path / "here"


def test_home_from_the_user_database_is_the_fallback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pwd, "getpwuid", lambda _uid: SimpleNamespace(pw_dir=str(tmp_path), pw_name="anyone"))
    assert state_dir({}) == tmp_path / ".local" / "state" / "atlantis"


def test_missing_home_is_an_error_with_a_hint(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"missing does not exist") as caught:
        state_dir({"HOME": str(tmp_path / "missing")})
    assert "ATLANTIS_STATE=" in str(caught.value.hint)


def test_no_home_anywhere_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(_uid: int) -> None:
        raise KeyError(_uid)

    monkeypatch.setattr(pwd, "getpwuid", unknown)
    with pytest.raises(UsageError, match="no home directory found"):
        state_dir({})


def test_a_file_in_the_way_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot store the journal"):
        state_dir({"ATLANTIS_STATE": str(tmp_path / "file" / "below")})


def test_unwritable_directory_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_arguments: False)
    with pytest.raises(UsageError, match="is not writable by"):
        state_dir({"ATLANTIS_STATE": str(tmp_path)})


def test_the_checkout_holds_the_launcher() -> None:
    assert (checkout() / "provision").is_file()


def test_directory_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder that waited there, made by another user of the computer: its owner can exchange what is kept in it."""
    folder = tmp_path / "own"
    folder.mkdir(mode=0o700)
    monkeypatch.setattr(os, "geteuid", lambda: 4_000_001)
    with pytest.raises(UsageError, match=r"own belongs to .*, who could change its contents, not to user 4000001"):
        state_dir({"ATLANTIS_STATE": str(folder)})


@pytest.mark.skipif(os.geteuid() != 0, reason="a folder is given to somebody else")
@pytest.mark.parametrize("owner", ["folder", "link"])
def test_root_refuses_directory_or_link_of_another_user(owner: str, tmp_path: Path) -> None:
    folder, link = tmp_path / "own", tmp_path / "link"
    folder.mkdir(mode=0o700)
    link.symlink_to(folder)
    os.chown(link if owner == "link" else folder, 4_000_001, -1, follow_symlinks=False)
    with pytest.raises(UsageError, match="belongs to user 4000001") as caught:
        state_dir({"ATLANTIS_STATE": str(link)})
    assert "ATLANTIS_STATE=" in str(caught.value.hint)
    assert folder.stat().st_mode & 0o777 == 0o700


def test_computing_the_path_creates_nothing(tmp_path: Path) -> None:
    assert state_place({"ATLANTIS_STATE": str(tmp_path / "own")}) == tmp_path / "own"
    assert cache_place({"XDG_CACHE_HOME": str(tmp_path / "cache")}) == tmp_path / "cache" / "atlantis"
    assert list(tmp_path.iterdir()) == []
