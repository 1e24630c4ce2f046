"""Fetching: from a real git server with a token, over links that break, and from a folder in place of all servers."""

import socket
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.build_git import (
    Git,
    configure,
    store_token,
)
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.build_plan import Repository
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.emulator.lab.stubs import interop

pytestmark = pytest.mark.slow

TOKEN = "CANARY-of-the-library"
HEADER = "c4i-asset-msgs/include/c4i_asset_msgs/stamped.hpp"


@contextmanager
def server(folder: Path, token: str | None = TOKEN) -> Iterator[interop.GitServer]:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        with interop.serve_git(folder, listener, token) as made:
            yield made


@dataclass
class Board:
    projects: interop.InteropProjects
    git: interop.GitServer
    folder: Path
    said: list[str] = field(default_factory=list)
    pauses: list[float] = field(default_factory=list)
    offline: str | None = None
    sleep: Callable[[float], None] | None = None

    @property
    def url(self) -> str:
        return f"{self.git.url}/{interop.LIBRARY}.git"

    def fetch(
        self, revision: str, token: str | None = TOKEN, *, into: str = "library", seed: Path | None = None
    ) -> str:
        home = self.folder / "home"
        home.mkdir(exist_ok=True)
        for old in home.iterdir():
            old.unlink()
        configure(str(home), self.offline, [self.url])
        if token is not None:
            store_token(str(home), "library", self.url, token)
        repository = Repository(self.url, revision)
        git = Git(
            repository,
            "library",
            str(self.folder / into),
            str(home),
            self.offline,
            self.said.append,
            self.sleep or self.pauses.append,
        )
        return git.fetch(str(seed) if seed is not None else None)


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    with server(tmp_path / "served") as git:
        yield Board(interop.make_interop(tmp_path / "served", "v1"), git, tmp_path)


@pytest.mark.smoke
def test_tag_and_commit_are_fetched_with_submodule_without_history(board: Board) -> None:
    first = board.fetch("v1")
    second = board.projects.release("v2")
    assert board.fetch(second, into="other") == second != first
    for name in ("library", "other"):
        assert (board.folder / name / HEADER).is_file()
        counted = subprocess.run(
            ["git", "-C", str(board.folder / name), "rev-list", "--count", "--all"], capture_output=True, check=True
        )
        assert counted.stdout in (b"1\n", b"0\n")


@pytest.mark.smoke
def test_token_goes_only_to_its_own_server_and_is_not_stored(board: Board, tmp_path: Path) -> None:
    with server(tmp_path / "served", None) as other:
        board.projects.release("v2", submodule_at=f"{other.url}/{interop.MESSAGES}.git")
        board.fetch("v2")
        assert other.requests
        assert not [one for one in other.requests if "with a token" in one]
        other.token = "another"
        with pytest.raises(ModuleError, match=r"a submodule of .* could not be fetched"):
            board.fetch("v2", into="again")
        assert not [one for one in other.requests if "with a token" in one]
    assert [one for one in board.git.requests if "with a token" in one]
    kept = [path for path in tmp_path.rglob("*") if path.is_file() and TOKEN.encode() in path.read_bytes()]
    assert kept == [tmp_path / "home/library"]
    assert kept[0].stat().st_mode & 0o777 == 0o600
    assert TOKEN not in "\n".join(board.said)


def test_deploy_token_is_sent_with_its_name(board: Board) -> None:
    board.fetch("v1", f"deployer:{TOKEN}")
    with pytest.raises(ModuleError, match="does not accept the inventory's token for"):
        board.fetch("v1", "deployer:wrong", into="again")


def test_ssh_submodule_on_the_same_server_uses_the_token(board: Board) -> None:
    board.projects.release("v2", submodule_at=f"git@127.0.0.1:{interop.MESSAGES}.git")
    board.fetch("v2")
    assert (board.folder / "library" / HEADER).is_file()
    board.projects.release("v3", submodule_at=f"git@gitlab.example.org:{interop.MESSAGES}.git")
    with pytest.raises(ModuleError, match=r"a submodule of .* has no https address"):
        board.fetch("v3", into="again")


@pytest.mark.parametrize(
    ("revision", "words"),
    [
        ("v9", "revision v9 does not exist"),
        ("f" * 40, f"revision {'f' * 40} does not exist"),
        ("daily", "`daily` is a branch"),
    ],
)
def test_invalid_revision_is_refused(board: Board, revision: str, words: str) -> None:
    board.projects.branch("daily")
    with pytest.raises(ModuleError, match=words):
        board.fetch(revision)


def test_missing_submodule_or_token_is_reported(board: Board) -> None:
    board.projects.release("v2", submodule_at="../gone.git")
    with pytest.raises(ModuleError, match=r"a submodule of .*there is no repository"):
        board.fetch("v2")
    with pytest.raises(ModuleError, match=r"requires a token for .*, and the inventory has none"):
        board.fetch("v1", None, into="again")


def test_only_the_difference_to_the_current_build_is_fetched(board: Board) -> None:
    board.fetch("v1")
    whole = board.git.sent_bytes
    board.projects.release("v2")
    board.fetch("v2", into="seeded", seed=board.folder / "library")
    assert board.git.sent_bytes - whole < whole / 2
    assert (board.folder / "seeded" / HEADER).is_file()


@pytest.mark.smoke
def test_interrupted_fetch_is_resumed(board: Board) -> None:
    commit = board.fetch("v1")
    library = board.folder / "library"
    (library / ".git/index.lock").touch()
    (library / "uv_interoperability/CMakeLists.txt").write_text("")  # an empty file of a power cut
    (library / "install").mkdir()
    asked = len(board.git.requests)
    assert board.fetch(commit) == commit
    assert len(board.git.requests) == asked  # a commit that is here is not asked for
    assert (library / "uv_interoperability/CMakeLists.txt").stat().st_size > 0
    assert not (library / "install").exists()


def test_damaged_sources_are_fetched_again(board: Board) -> None:
    commit = board.fetch("v1")
    for path in (board.folder / "library/.git/objects").rglob("*"):
        if path.is_file():
            path.chmod(0o644)
            path.write_bytes(b"")
    assert board.fetch("v1") == commit
    assert (board.folder / "library" / HEADER).is_file()


def test_broken_link_is_retried(board: Board) -> None:
    with socket.socket() as listener, ExitStack() as later:
        listener.bind(("127.0.0.1", 0))
        port = listener.getsockname()[1]
        board.git.url = f"http://127.0.0.1:{port}"

        def back(pause: float) -> None:
            board.pauses.append(pause)
            if len(board.pauses) == 2:
                listener.listen()
                later.enter_context(interop.serve_git(board.projects.folder, listener, TOKEN))

        board.sleep = back
        assert board.fetch("v1")
    assert board.pauses == [10.0, 30.0]


def test_permanently_broken_link_is_reported(board: Board) -> None:
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        board.git.url = f"http://127.0.0.1:{nobody.getsockname()[1]}"
        with pytest.raises(ModuleError, match="could not be reached"):
            board.fetch("v1")
    assert sum(board.pauses) > 3 * 70


def test_bundle_folder_replaces_all_git_servers(board: Board, tmp_path: Path) -> None:
    place = board.url.partition("://")[2].partition("/")[0]
    (tmp_path / "bundle/git").mkdir(parents=True)
    (tmp_path / "served").rename(tmp_path / "bundle/git" / place)
    board.offline = str(tmp_path / "bundle")
    asked = len(board.git.requests)
    board.fetch("v1")
    assert (board.folder / "library" / HEADER).is_file()
    assert len(board.git.requests) == asked
    with pytest.raises(ModuleError, match=r"does not contain http.*, revision v9"):
        board.fetch("v9")
