"""Where what can be made again is kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.errors import UsageError
from atlantis_netcfg.paths import cache_dir

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("variables", "place"),
    [
        ({"XDG_CACHE_HOME": "{tmp}/xdg", "HOME": "{tmp}"}, "xdg/atlantis"),
        ({"XDG_CACHE_HOME": "relative", "HOME": "{tmp}"}, ".cache/atlantis"),
        ({"HOME": "{tmp}"}, ".cache/atlantis"),
    ],
)
def test_the_place_is_made(variables: dict[str, str], place: str, tmp_path: Path) -> None:
    made = cache_dir({name: value.format(tmp=tmp_path) for name, value in variables.items()})
    assert made == tmp_path / place
    assert made.is_dir()


def test_a_missing_home_is_an_error_with_the_way_out(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError, match=r"no place to keep the cache: the home directory .*missing does not"
    ) as caught:
        cache_dir({"HOME": str(tmp_path / "missing")})
    assert "XDG_CACHE_HOME=" in str(caught.value.hint)


def test_a_file_in_the_way_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="no place to keep the cache"):
        cache_dir({"XDG_CACHE_HOME": str(tmp_path / "file")})
