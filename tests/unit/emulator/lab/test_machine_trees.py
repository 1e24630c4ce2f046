"""Trees are built once, by one; what a killed build has left is never used. mmdebstrap is a script of the test's."""

import fcntl
import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import debian_trees
import pytest

from atlantis_netcfg import __version__
from atlantis_netcfg.emulator.lab import MachineError, TreeSpec, build_rootfs, rootfs
from atlantis_netcfg.emulator.lab.rootfs import KEPT_DAYS, in_use

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
def test_different_specs_have_different_keys(other: TreeSpec) -> None:
    assert TreeSpec(packages=("git", "curl")).key() != other.key()


def test_package_order_does_not_change_the_key() -> None:
    assert TreeSpec(packages=("git", "curl")).key() == TreeSpec(packages=("curl", "git", "systemd", "git")).key()


def test_tree_is_built_once(builds: Path, tmp_path: Path) -> None:
    spec = TreeSpec(packages=("git",), mirror="http://192.0.2.1/debian")
    made = build_rootfs(spec, tmp_path / "cache")
    assert build_rootfs(spec, tmp_path / "cache") == made
    assert builds.read_text() == "once\n"
    words = (made / "words").read_text()
    assert "--include=dbus,git,iproute2,openssh-server,python3,sudo,systemd,systemd-sysv,udev" in words
    assert words.endswith(f" bookworm {made}.half http://192.0.2.1/debian\n")


def build_at_once(specs: list[TreeSpec], cache: Path) -> list[Path]:
    with ThreadPoolExecutor(len(specs)) as pool:
        return list(pool.map(lambda spec: build_rootfs(spec, cache), specs))


def test_concurrent_requests_share_one_build(builds: Path, tmp_path: Path) -> None:
    assert len(build_at_once([TreeSpec()] * 4, tmp_path / "cache")) == 4
    assert builds.read_text() == "once\n"


def test_different_trees_are_built_one_after_another(builds: Path, tmp_path: Path) -> None:
    """mmdebstrap copies the shared packages with tar, which fails if another build changes them meanwhile."""
    script = f'#!/bin/sh\necho begin >> "$BUILDS"\nsleep 0.1\n{BUILT.removeprefix("#!/bin/sh")}'
    (tmp_path / "bin" / "mmdebstrap").write_text(script)
    build_at_once([TreeSpec(packages=(name,)) for name in ("git", "zip", "tar")], tmp_path / "cache")
    assert builds.read_text().split() == ["begin", "once"] * 3


def test_leftovers_of_a_killed_build_are_discarded(builds: Path, tmp_path: Path) -> None:
    half = tmp_path / "cache" / f"{TreeSpec().key()}.half"
    (half / "etc").mkdir(parents=True)
    made = build_rootfs(TreeSpec(), tmp_path / "cache")
    assert builds.read_text() == "once\n"
    assert not half.exists()
    assert [path.name for path in made.iterdir()] == ["words"]


def test_mmdebstrap_inherits_the_lock_of_its_caller(builds: Path, tmp_path: Path) -> None:
    script = tmp_path / "bin" / "mmdebstrap"
    script.write_text(f"{BUILT}\nls -l /proc/self/fd > $target/open\n")
    made = build_rootfs(TreeSpec(), tmp_path / "cache")
    assert str(made.with_suffix(".lock")) in (made / "open").read_text().split()
    with made.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    assert builds.read_text() == "once\n"


def test_build_failure_is_reported_with_its_last_lines(builds: Path, tmp_path: Path) -> None:
    (tmp_path / "bin" / "mmdebstrap").write_text(REFUSED)
    with pytest.raises(MachineError) as caught:
        build_rootfs(TreeSpec(packages=("no-such-package",)), tmp_path / "cache")
    assert str(caught.value) == (
        "no Debian bookworm for machines could be built: mmdebstrap ended with 25:\n"
        "  Get:3\n  Get:4\n  Get:5\n  Get:6\n  Get:7\n"
        "  E: Unable to locate package no-such-package"
    )
    assert caught.value.hint == "check that this computer reaches http://deb.debian.org/debian, then try again"
    assert not builds.exists()


@pytest.mark.usefixtures("builds")
def test_default_location_is_the_user_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert build_rootfs(TreeSpec()).parent == tmp_path / "xdg" / "atlantis" / "trees"


OTHER = TreeSpec(packages=("git",))


def _last_used(cache: Path, spec: TreeSpec, version: str, days: float = 0.0) -> Path:
    """Let a tree have been used by that release, so long ago."""
    lock = cache / f"{spec.key()}.lock"
    lock.write_text(version)
    os.utime(lock, (time.time() - days * 86_400,) * 2)
    return cache / spec.key()


@pytest.mark.usefixtures("builds")
@pytest.mark.parametrize(
    ("version", "days", "kept"),
    [
        (__version__, 0.0, True),
        (__version__, KEPT_DAYS - 1, True),
        (__version__, KEPT_DAYS + 1, False),
        ("0.0.9", 0.0, False),
        ("", 0.0, False),  # of a release that did not note it
        ("9.10.0", 0.0, True),
    ],
)
def test_the_tree_of_an_old_release_is_removed(tmp_path: Path, version: str, days: float, kept: bool) -> None:  # noqa: FBT001 - a case
    made = build_rootfs(OTHER, tmp_path)
    _last_used(tmp_path, OTHER, version, days)
    build_rootfs(TreeSpec(), tmp_path)
    assert made.is_dir() is kept
    assert list(tmp_path.glob("*.half")) == []


@pytest.mark.usefixtures("builds")
def test_a_tree_that_is_used_again_is_kept(tmp_path: Path) -> None:
    made = build_rootfs(OTHER, tmp_path)
    _last_used(tmp_path, OTHER, "0.0.9", KEPT_DAYS + 1)
    build_rootfs(OTHER, tmp_path)
    build_rootfs(TreeSpec(), tmp_path)
    assert made.is_dir()


@pytest.mark.usefixtures("builds")
def test_old_tree_is_kept_while_a_machine_uses_it(tmp_path: Path) -> None:
    made = build_rootfs(OTHER, tmp_path)
    _last_used(tmp_path, OTHER, "0.0.9")
    with in_use(made):
        build_rootfs(TreeSpec(), tmp_path)
        assert made.is_dir()
    build_rootfs(TreeSpec(), tmp_path)
    assert not made.exists()


@pytest.mark.usefixtures("builds")
def test_old_tree_is_kept_while_a_leftover_mount_uses_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = build_rootfs(OTHER, tmp_path / "cache")
    _last_used(tmp_path / "cache", OTHER, "0.0.9")
    (tmp_path / "mounts").write_text(
        f"1 2 0:3 / /run/x rw - overlay atlantis rw,lowerdir={made},upperdir=/u,workdir=/w\n"
    )
    monkeypatch.setattr(rootfs, "_MOUNTS", tmp_path / "mounts")
    build_rootfs(TreeSpec(), tmp_path / "cache")
    assert made.is_dir()


@pytest.mark.usefixtures("builds")
def test_old_tree_is_kept_while_another_process_locks_it(tmp_path: Path) -> None:
    made = build_rootfs(OTHER, tmp_path)
    lock = _last_used(tmp_path, OTHER, "0.0.9").with_suffix(".lock")
    with lock.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        build_rootfs(TreeSpec(), tmp_path)
    assert made.is_dir()


@pytest.mark.usefixtures("builds")
def test_leftovers_of_another_killed_build_are_removed(tmp_path: Path) -> None:
    build_rootfs(TreeSpec(), tmp_path)
    (tmp_path / f"{OTHER.key()}.lock").touch()
    (tmp_path / f"{OTHER.key()}.half" / "etc").mkdir(parents=True)
    build_rootfs(TreeSpec(), tmp_path)
    assert list(tmp_path.glob("*.half")) == []


def test_trees_of_integration_tests_are_declared_in_one_list() -> None:
    tests = Path(__file__).parents[3]
    elsewhere = [path.name for path in (tests / "integration").rglob("*.py") if "TreeSpec(" in path.read_text()]
    specs = {spec for spec in vars(debian_trees).values() if isinstance(spec, TreeSpec)}
    assert elsewhere == []
    assert specs == {*debian_trees.TREES["campaign"]}


def test_the_builder_says_why_no_tree_is_needed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_NO_MACHINES", "test")
    assert debian_trees.main([]) == 0
    assert capsys.readouterr().out == "      tests of machines are skipped: ATLANTIS_NO_MACHINES is set\n"
