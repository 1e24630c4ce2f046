"""The library's sources in a bundle: fetched by token with their submodules, and found by the board's own git."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from bundle_stand import HOST, Laptop

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.build_git import Git, configure
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.build_plan import Repository
from atlantis_netcfg.computers.bundle.manifest import Manifest
from atlantis_netcfg.computers.bundle.open import open_bundle
from atlantis_netcfg.computers.bundle.requirements import BundleError, Library
from atlantis_netcfg.emulator.lab.stubs.interop import (
    EXAMPLES,
    LIBRARY,
    GitServer,
    InteropProjects,
    make_interop,
    serve_git,
)

pytestmark = pytest.mark.slow

TOKEN = "glpat-not-to-be-seen"


@pytest.fixture
def projects(tmp_path: Path) -> InteropProjects:
    return make_interop(tmp_path / "served" / "c4i", "v1.0.0")


@pytest.fixture
def server(tmp_path: Path, projects: InteropProjects) -> Iterator[GitServer]:
    assert projects.folder.is_dir()
    with serve_git(tmp_path / "served", socket.create_server(("127.0.0.1", 0)), TOKEN) as made:
        yield made


@pytest.fixture
def laptop(tmp_path: Path) -> Laptop:
    return Laptop(tmp_path)


def library(server: GitServer, revision: str = "v1.0.0", name: str = LIBRARY, token: str | None = TOKEN) -> Library:
    return Library(f"{server.url}/c4i/{name}.git", revision, token)


def bundle(laptop: Laptop, *libraries: Library) -> Manifest:
    archive = laptop.archive(())
    return laptop.make(laptop.wish(archive, libraries=libraries))


def board(laptop: Laptop, manifest: Manifest) -> Path:
    """What stands on the board then."""
    place = laptop.folder / "board"
    for path, file in manifest.of(HOST).items():
        (place / path).parent.mkdir(parents=True, exist_ok=True)
        (place / path).write_bytes((laptop.place / file.path).read_bytes())
    return place / "sources"


def fetched(laptop: Laptop, sources: Path, wanted: Library) -> tuple[str, Path]:
    """The commit that the module `build` finds there, and its files; it has no network but files."""
    home = laptop.folder / "home"
    home.mkdir(exist_ok=True)
    configure(str(home), str(sources), [wanted.url])
    said: list[str] = []
    folder = laptop.folder / "checkout"
    repository = Repository(wanted.url, wanted.revision)
    git = Git(repository, "library", str(folder), str(home), str(sources), said.append, lambda _s: None)
    return git.fetch(None), folder


@pytest.mark.smoke("tag")
@pytest.mark.parametrize("by", ["tag", "commit"])
def test_the_board_builds_from_the_bundle_without_any_server(
    laptop: Laptop, server: GitServer, projects: InteropProjects, by: str
) -> None:
    commit = projects.release("v1.1.0", "another text")
    wanted = library(server, "v1.1.0" if by == "tag" else commit)
    manifest = bundle(laptop, wanted, library(server, name=EXAMPLES))
    assert [(one.revision, one.commit == commit) for one in manifest.hosts[HOST].libraries] == [
        (wanted.revision, True),
        ("v1.0.0", False),
    ]
    sources = board(laptop, manifest)
    asked = len(server.requests)
    found, folder = fetched(laptop, sources, wanted)
    assert found == commit
    assert "another text" in (folder / "uv_interoperability/src/asset.cpp").read_text()
    assert (folder / "c4i-asset-msgs/include/c4i_asset_msgs/stamped.hpp").is_file()
    assert len(server.requests) == asked


@pytest.mark.smoke
def test_the_token_is_in_no_file_of_the_bundle(laptop: Laptop, server: GitServer) -> None:
    bundle(laptop, library(server))
    assert any(line.startswith("with a token ") for line in server.requests)
    for path in laptop.folder.rglob("*"):
        if path.is_file():
            assert TOKEN.encode() not in path.read_bytes(), path
    assert TOKEN not in repr(library(server))


def test_same_sources_give_the_same_bundle(laptop: Laptop, server: GitServer) -> None:
    first, second = (
        bundle(laptop, library(server)),
        laptop.make(laptop.wish(laptop.archive((), "again"), libraries=[library(server)])),
    )
    assert first.id == second.id


@pytest.mark.parametrize(
    ("token", "revision", "words"),
    [
        ("wrong", "v1.0.0", "is not given to us"),
        (None, "v1.0.0", "is not given to us"),
        (TOKEN, "v9", "has no revision v9"),
        (TOKEN, "0" * 40, f"has no revision {'0' * 40}"),
    ],
)
def test_server_errors_are_reported(
    laptop: Laptop, server: GitServer, token: str | None, revision: str, words: str
) -> None:
    with pytest.raises(BundleError) as caught:
        bundle(laptop, library(server, revision, token=token))
    assert words in str(caught.value)
    assert "wrong" not in str(caught.value)


def test_ssh_submodule_on_the_same_server_is_fetched_over_http(
    laptop: Laptop, server: GitServer, projects: InteropProjects
) -> None:
    projects.release("v3.0.0", "ssh, same server", submodule_at="git@127.0.0.1:c4i/c4i-asset-msgs.git")
    wanted = library(server, "v3.0.0")
    _, folder = fetched(laptop, board(laptop, bundle(laptop, wanted)), wanted)
    assert (folder / "c4i-asset-msgs/include/c4i_asset_msgs/stamped.hpp").is_file()


def test_a_submodule_that_needs_an_account_is_named(
    laptop: Laptop, server: GitServer, projects: InteropProjects
) -> None:
    projects.release("v2.0.0", "ssh", submodule_at="git@git.example.org:c4i/msgs.git")
    with pytest.raises(BundleError, match=r"the submodule c4i-asset-msgs of .* which needs an account"):
        bundle(laptop, library(server, "v2.0.0"))


def test_bundle_with_another_revision_is_refused(laptop: Laptop, server: GitServer) -> None:
    bundle(laptop, library(server))
    wish = laptop.wish(laptop.archive((), "again"), libraries=[library(server, "v2.0.0")])
    with pytest.raises(BundleError) as caught:
        open_bundle(laptop.place, laptop.keys, [wish])
    assert str(caught.value) == f"{HOST}: {library(server).url} at v2.0.0: the bundle has v1.0.0"
