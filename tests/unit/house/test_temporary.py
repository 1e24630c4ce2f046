"""What a killed process has left is removed by the next one, and nothing else is."""

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from atlantis_netcfg.core import temporary

ROOT = Path(__file__).parents[3]
OWNER = """\
import signal, sys
from pathlib import Path
from atlantis_netcfg.core import temporary
with temporary.folder("image", Path(sys.argv[1])) as folder:
    (folder / "deep").mkdir()
    (folder / "deep" / "image").write_bytes(b"gigabytes")
    print(folder, flush=True)
    signal.pause()
"""
MARK = "atlantis-image-abcdefgh.tmp"


@contextmanager
def owner(place: Path, *before: str) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """A living process that has a folder there."""
    words = (*before, sys.executable, "-c", OWNER, str(place))
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        assert process.stdout is not None
        try:
            yield process, place / process.stdout.readline().strip().rpartition("/")[2]
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Instead of /tmp and /var/tmp, where others work."""
    monkeypatch.setattr(temporary, "_SMALL", tmp_path / "small")
    monkeypatch.setattr(temporary, "_LARGE", tmp_path / "large")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.delenv("TMPDIR", raising=False)
    monkeypatch.setenv("ANSIBLE_SSH_CONTROL_PATH_DIR", str(tmp_path / "cp"))
    return tmp_path


def test_folder_is_removed_with_its_context(place: Path) -> None:
    with temporary.folder("run") as folder:
        assert folder.parent == place
        assert folder.stat().st_mode & 0o777 == 0o700
        (folder / "file").touch()
    assert not folder.exists()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_the_folder_of_a_killed_owner_is_removed_by_the_next_one(place: Path, number: signal.Signals) -> None:
    with owner(place) as (process, folder):
        process.send_signal(number)
        process.wait()
        assert (folder / "deep" / "image").exists()
        with temporary.folder("run"):
            assert not folder.exists()


def test_folder_of_a_running_owner_is_kept(place: Path) -> None:
    with owner(place) as (_, folder):
        assert temporary.remove_orphans() == ()
        assert (folder / "deep" / "image").read_bytes() == b"gigabytes"


@pytest.mark.skipif(os.geteuid() != 0, reason="making a PID namespace needs root")
@pytest.mark.namespace
def test_owner_in_another_pid_namespace_counts_as_running(place: Path) -> None:
    with owner(place, "unshare", "--pid", "--fork", "--kill-child") as (_, folder):
        assert temporary.remove_orphans() == ()
        assert (folder / "deep" / "image").exists()
    with subprocess.Popen(["flock", str(folder), "true"]) as waiting:  # until the kernel has ended it there
        assert waiting.wait() == 0
    assert temporary.remove_orphans() == (folder,)


def test_stopped_owner_counts_as_running(place: Path) -> None:
    with owner(place) as (process, folder):
        process.send_signal(signal.SIGSTOP)
        os.waitpid(process.pid, os.WUNTRACED)
        assert temporary.remove_orphans() == ()
        assert folder.exists()


def test_a_fork_that_leaves_the_block_removes_nothing(place: Path) -> None:
    def leave() -> None:
        with temporary.folder("run", place) as folder:
            forks.append(os.fork())
            folders.append(folder)
            if forks[-1]:
                os.waitpid(forks[-1], 0)
                assert folder.exists()

    forks: list[int] = []
    folders: list[Path] = []
    leave()
    if forks[0] == 0:
        os._exit(0)
    assert not folders[0].exists()


@pytest.mark.parametrize(
    "name",
    ["atlantis-image-abcdefgh", "atlantis-.tmp", "image.tmp", "provision-abcdefgh", "atlantis-image-abcdefgh.tmpx"],
)
def test_folder_without_the_marker_is_kept(place: Path, name: str) -> None:
    (place / name).mkdir()
    assert temporary.remove_orphans() == ()
    assert (place / name).is_dir()


def test_symlink_is_not_followed(place: Path) -> None:
    ours = place / "ours"
    ours.mkdir()
    (ours / "kept").touch()
    (place / MARK).symlink_to(ours)
    assert temporary.remove_orphans() == ()
    assert (ours / "kept").exists()


def test_symlink_inside_a_folder_is_not_followed(place: Path) -> None:
    (place / "kept").touch()
    (place / MARK).mkdir()
    (place / MARK / "link").symlink_to(place)
    assert temporary.remove_orphans() == (place / MARK,)
    assert (place / "kept").exists()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can mount")
@pytest.mark.namespace
def test_mounts_in_an_orphan_are_not_removed(place: Path) -> None:
    ours, inside = place / "ours", place / MARK / "here"
    ours.mkdir()
    inside.mkdir(parents=True)
    (ours / "kept").touch()
    subprocess.run(["mount", "--bind", ours, inside], check=True)
    try:
        assert temporary.remove_orphans() == ()
        assert (ours / "kept").exists()
    finally:
        subprocess.run(["umount", inside], check=True)
    assert temporary.remove_orphans() == (place / MARK,)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_the_folder_of_another_user_stays(place: Path) -> None:
    (place / MARK).mkdir()
    os.chown(place / MARK, 65534, 65534)
    assert temporary.remove_orphans() == ()
    assert (place / MARK).is_dir()


def test_concurrent_cleanup_loses_nothing(place: Path) -> None:
    lost = []

    def work() -> None:
        for _ in range(50):
            with temporary.folder("run", place) as folder:
                (folder / "file").touch()
                temporary.remove_orphans()
                if not (folder / "file").exists():
                    lost.append(folder)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert lost == []
    assert list(place.iterdir()) == []


def test_unused_control_socket_is_removed(place: Path) -> None:
    (place / "cp").mkdir()
    names = ("0123456789", "abcdef0123", "abcdef0123.A1b2C3d4E5f6G7h8", "other")
    sockets = [socket.socket(socket.AF_UNIX) for _ in names]
    for name, made in zip(names, sockets, strict=True):
        made.bind(str(place / "cp" / name))
    (place / "cp" / "ffffffffff").touch()
    sockets[0].listen()
    for made in sockets[1:]:
        made.close()
    assert temporary.remove_orphans() == (place / "cp" / "abcdef0123",)
    sockets[0].close()
    assert temporary.remove_orphans() == (place / "cp" / "0123456789",)


def test_tmpdir_overrides_the_large_temp_dir(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert temporary.large_temp_dir() == place / "large"
    monkeypatch.setenv("TMPDIR", str(place / "mine"))
    assert temporary.large_temp_dir() == place / "mine"


ELSEWHERE = {
    "atlantis_netcfg/core/temporary.py",
    # A file without a name ends with its process.
    "atlantis_netcfg/operations/computers/remote_session.py",
    "atlantis_netcfg/core/processes/remote_process.py",
    # Programs that run on a board, in Python's standard library alone; install.py removes its own leftovers.
    "atlantis_netcfg/ansible_collections/atlantis/netcfg/plugins/plugin_utils/board/install.py",
    "atlantis_netcfg/ansible_collections/atlantis/netcfg/plugins/module_utils/file_transaction.py",
    "atlantis_netcfg/ansible_collections/atlantis/netcfg/plugins/module_utils/network_desired.py",
}


def test_only_listed_modules_use_tempfile() -> None:
    files = (ROOT / "atlantis_netcfg").glob("**/*.py")
    found = {
        str(path.relative_to(ROOT))
        for path in files
        if re.search(r"^import tempfile|^from tempfile", path.read_text(), re.MULTILINE)
    }
    assert found == ELSEWHERE


def test_orphaned_folders_are_listed_without_being_removed(place: Path) -> None:
    dead = place / MARK
    with owner(place) as (_, living):
        dead.mkdir()
        assert temporary.orphaned_folders() == (dead,)
        assert (dead.is_dir(), living.is_dir()) == (True, True), "looking removes nothing"
