"""Trees are built once, by one; what a killed build has left is never used. mmdebstrap is a script of the test's."""

from __future__ import annotations

import fcntl
import os
import threading
from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.machine import MachineFailed, TreeSpec, tree

if TYPE_CHECKING:
    from pathlib import Path

BUILT = """\
#!/bin/sh
for target; do case $target in */*.half) break;; esac; done
mkdir "$target" && echo "$@" > "$target/words" && echo once >> "$BUILDS"
"""
REFUSED = """\
#!/bin/sh
for line in 1 2 3 4 5 6 7; do echo "I: step $line" >&2; echo "Get:$line" >&2; done
echo "E: Unable to locate package no-such-package" >&2
exit 25
"""


@pytest.fixture
def builds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One line for each time that mmdebstrap has run."""
    script = tmp_path / "bin" / "mmdebstrap"
    script.parent.mkdir()
    script.write_text(BUILT)
    script.chmod(0o755)
    monkeypatch.setenv("PATH", f"{script.parent}:{os.environ['PATH']}")
    monkeypatch.setenv("BUILDS", str(tmp_path / "builds"))
    return tmp_path / "builds"


@pytest.mark.parametrize(
    "other",
    [
        TreeSpec(packages=("git",)),
        TreeSpec(packages=("git", "curl", "make")),
        TreeSpec(packages=("git", "curl"), release="trixie"),
        TreeSpec(packages=("git", "curl"), mirror="http://192.0.2.1/debian"),
    ],
)
def test_another_tree_has_another_name(other: TreeSpec) -> None:
    assert TreeSpec(packages=("git", "curl")).key() != other.key()


def test_the_order_of_packages_makes_no_other_tree() -> None:
    assert TreeSpec(packages=("git", "curl")).key() == TreeSpec(packages=("curl", "git", "systemd", "git")).key()


def test_it_is_built_once(builds: Path, tmp_path: Path) -> None:
    spec = TreeSpec(packages=("git",), mirror="http://192.0.2.1/debian")
    made = tree(spec, tmp_path / "cache")
    assert tree(spec, tmp_path / "cache") == made
    assert builds.read_text() == "once\n"
    words = (made / "words").read_text()
    assert "--include=dbus,git,iproute2,openssh-server,python3,sudo,systemd,systemd-sysv,udev" in words
    assert words.endswith(f" bookworm {made}.half http://192.0.2.1/debian\n")


def test_many_who_want_it_at_once_wait_for_one(builds: Path, tmp_path: Path) -> None:
    made: list[Path] = []
    threads = [threading.Thread(target=lambda: made.append(tree(TreeSpec(), tmp_path / "cache"))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 4
    assert builds.read_text() == "once\n"


def test_what_a_killed_build_has_left_is_thrown_away(builds: Path, tmp_path: Path) -> None:
    half = tmp_path / "cache" / f"{TreeSpec().key()}.half"
    (half / "etc").mkdir(parents=True)
    made = tree(TreeSpec(), tmp_path / "cache")
    assert builds.read_text() == "once\n"
    assert not half.exists()
    assert [path.name for path in made.iterdir()] == ["words"]


def test_mmdebstrap_holds_the_lock_beyond_the_life_of_its_caller(builds: Path, tmp_path: Path) -> None:
    script = tmp_path / "bin" / "mmdebstrap"
    script.write_text(f"{BUILT}\nls -l /proc/self/fd > $target/open\n")
    made = tree(TreeSpec(), tmp_path / "cache")
    assert str(made.with_suffix(".lock")) in (made / "open").read_text().split()
    with made.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    assert builds.read_text() == "once\n"


def test_its_failure_is_told_with_its_last_lines(builds: Path, tmp_path: Path) -> None:
    (tmp_path / "bin" / "mmdebstrap").write_text(REFUSED)
    with pytest.raises(MachineFailed) as caught:
        tree(TreeSpec(packages=("no-such-package",)), tmp_path / "cache")
    assert str(caught.value) == (
        "no Debian bookworm for machines could be built: mmdebstrap ended with 25:\n"
        "  Get:3\n  Get:4\n  Get:5\n  Get:6\n  Get:7\n"
        "  E: Unable to locate package no-such-package"
    )
    assert caught.value.hint == "check that this computer reaches http://deb.debian.org/debian, then try again"
    assert not builds.exists()


@pytest.mark.usefixtures("builds")
def test_by_default_it_is_kept_in_the_cache_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert tree(TreeSpec()).parent == tmp_path / "xdg" / "atlantis" / "trees"
