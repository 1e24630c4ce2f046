"""Where what can be made again is kept."""

from pathlib import Path

import pytest

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.paths import cache_dir, private_cache


@pytest.mark.parametrize(
    ("variables", "place"),
    [
        ({"XDG_CACHE_HOME": "{tmp}/xdg", "HOME": "{tmp}"}, "xdg/atlantis"),
        ({"XDG_CACHE_HOME": "relative", "HOME": "{tmp}"}, ".cache/atlantis"),
        ({"HOME": "{tmp}"}, ".cache/atlantis"),
    ],
)
def test_cache_directory_is_created(variables: dict[str, str], place: str, tmp_path: Path) -> None:
    made = cache_dir({name: value.format(tmp=tmp_path) for name, value in variables.items()})
    assert made == tmp_path / place
    assert made.is_dir()


def test_missing_home_is_an_error_with_a_hint(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"cannot store the cache: the home directory .*missing does not") as caught:
        cache_dir({"HOME": str(tmp_path / "missing")})
    assert "XDG_CACHE_HOME=" in str(caught.value.hint)


def test_a_file_in_the_way_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot store the cache"):
        cache_dir({"XDG_CACHE_HOME": str(tmp_path / "file")})


def test_private_cache_is_writable_only_by_its_owner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = private_cache("templates")
    assert folder == tmp_path / "atlantis" / "templates"
    assert [place.stat().st_mode & 0o777 for place in (folder.parent, folder)] == [0o700, 0o700]


@pytest.mark.parametrize("writable", ["atlantis", "atlantis/templates"])
def test_no_private_cache_where_others_can_write(
    writable: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "atlantis/templates").mkdir(parents=True)
    (tmp_path / writable).chmod(0o777)
    assert private_cache("templates") is None


def test_no_private_cache_owned_by_another_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("os.geteuid", lambda: 12345)
    assert private_cache("templates") is None


@pytest.mark.parametrize("way", ["link", "file"])
def test_no_private_cache_at_a_link_or_file(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "atlantis").mkdir()
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    place = tmp_path / "atlantis" / "templates"
    if way == "link":
        place.symlink_to(tmp_path / "elsewhere")
    else:
        place.write_text("")
    assert private_cache("templates") is None


def test_no_private_cache_without_a_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "missing"))
    assert private_cache("templates") is None
