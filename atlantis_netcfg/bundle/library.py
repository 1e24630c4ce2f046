"""The sources of a library for a place without internet: each repository, and whatever its submodules point to.

They stand as bare repositories below `git/SERVER/PATH`, where git on the board finds them in place of `https://SERVER/PATH`
(url.<base>.insteadOf of git-config(1)). One commit of each is there, without its history. A token reaches git by its
environment only (GIT_CONFIG_COUNT): it is in no argument, in no file, and in no message.
"""

from __future__ import annotations

import base64
import re
import shutil
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from urllib.parse import urljoin, urlsplit

from atlantis_netcfg.bundle.requirements import BundleRefused
from atlantis_netcfg.bundle.signing import run

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from atlantis_netcfg.bundle.requirements import Library

_USER = "oauth2"
"""GitLab takes any name beside an access token; NAME:TOKEN is for deploy tokens, which have one."""
_DEPTH = 10
"""Submodules within submodules."""


@dataclass(slots=True)
class Gathered:
    """The repositories of some libraries in a folder."""

    folder: Path
    commits: dict[tuple[str, str], str] = field(default_factory=dict)
    """URL and revision of each library -> its commit."""
    of: dict[tuple[str, str], set[str]] = field(default_factory=dict)
    """URL and revision of each library -> places of the repositories that it needs, below `folder`."""

    def files(self, library: Library) -> Iterator[tuple[str, Path]]:
        """What a board needs for a library: path below its folder of sources, and the file."""
        for place in sorted(self.of[library.url, library.revision]):
            root = self.folder / place
            for path in sorted(root.rglob("*")):
                if path.is_file():
                    yield f"git/{place}/{path.relative_to(root).as_posix()}", path


def gather(libraries: Iterable[Library], work: Path) -> Gathered:
    """Fetch them; `work` keeps what came for the next time. Raises BundleRefused."""
    shutil.rmtree(work / "bare", ignore_errors=True)
    gathered = Gathered(work / "bare")
    for library in libraries:
        key = (library.url, library.revision)
        if key not in gathered.commits:
            gathered.of[key] = set()
            gathered.commits[key] = _fetch(gathered, key, work, library, library.url, library.revision, 0)
    return gathered


def _fetch(  # noqa: PLR0913, PLR0917 - a step of a walk
    gathered: Gathered, key: tuple[str, str], work: Path, library: Library, url: str, revision: str, depth: int
) -> str:
    """Put one repository at one revision into place, then its submodules; give the commit."""
    place = _place(url)
    mirror, bare = work / "fetched" / place, gathered.folder / place
    environment = _access(library) if urlsplit(url)[:2] == urlsplit(library.url)[:2] else _SILENT
    commit = _bring(mirror, url, revision, environment)
    ref = f"refs/atlantis/{commit}"
    if not bare.exists():
        _git(bare, _SILENT, "init", "--quiet", "--bare", "--initial-branch=atlantis", str(bare))
        _plain(bare)
    desired = [f"+{ref}:{ref}", f"+{ref}:refs/heads/atlantis"]
    if not _is_commit(revision):
        desired.append(f"+refs/tags/{revision}:refs/tags/{revision}")
    words = ("fetch", "--quiet", "--depth", "1", "--no-tags", f"file://{mirror}", *desired)
    _git(bare, _SILENT, *_SMALL, *words)
    (bare / "FETCH_HEAD").unlink(missing_ok=True)
    gathered.of[key].add(place)
    for inner, inside in _submodules(mirror, url, commit, library.url):
        if depth == _DEPTH:
            raise BundleRefused(f"the submodules of {library.url} lead round in a circle", hint="ask its makers")
        _fetch(gathered, key, work, library, inner, inside, depth + 1)
    return commit


def _bring(mirror: Path, url: str, revision: str, environment: dict[str, str]) -> str:
    """Fetch a revision from its server, with its history only where the server gives no commit without it."""
    if not (mirror / "HEAD").exists():
        shutil.rmtree(mirror, ignore_errors=True)
        mirror.mkdir(parents=True)
        _git(mirror, _SILENT, "init", "--quiet", "--bare", str(mirror))
    if _is_commit(revision):
        ways = [[revision], ["+refs/heads/*:refs/heads/*", "+refs/tags/*:refs/tags/*"]]
        named = f"{revision}^{{commit}}"
    else:
        ways = [[f"+refs/tags/{revision}:refs/tags/{revision}"]]
        named = f"refs/tags/{revision}^{{commit}}"
    text = ""
    for way in ways:
        shallow = [] if way[0].startswith("+refs/heads/") else ["--depth", "1"]
        if _is_commit(revision) and _whole(mirror, revision):
            break
        done = run(
            ["git", "-C", str(mirror), "-c", "protocol.version=2", "fetch", "--quiet", *shallow, url, *way],
            environment,
        )
        text = done.stderr.decode(errors="replace")
        if done.returncode == 0:
            break
    found = run(["git", "-C", str(mirror), "rev-parse", "--verify", "--quiet", named], _SILENT)
    commit = found.stdout.decode().strip()
    if found.returncode != 0 or not _whole(mirror, commit):
        raise _refused(url, revision, text)
    _git(mirror, _SILENT, "update-ref", f"refs/atlantis/{commit}", commit)
    return commit


def _submodules(mirror: Path, url: str, commit: str, home: str) -> Iterator[tuple[str, str]]:
    """Address and commit of each submodule; those by SSH on the server of `home` are there by HTTPS as well.

    Raises BundleRefused where a repository does not say where one is.
    """
    tree = _git(mirror, _SILENT, "ls-tree", "-r", "-z", commit)
    commits = {row.split("\t", 1)[1]: row.split()[2] for row in tree.split("\0") if row.startswith("160000 ")}
    if not commits:
        return
    text = run(
        [
            "git",
            "-C",
            str(mirror),
            "config",
            "-z",
            "--blob",
            f"{commit}:.gitmodules",
            "--get-regexp",
            r"^submodule\..*",
        ],
        _SILENT,
    ).stdout.decode(errors="replace")
    settings = dict(row.split("\n", 1) for row in text.split("\0") if "\n" in row)
    places = {
        path: settings.get(f"{name.removesuffix('.path')}.url", "")
        for name, path in settings.items()
        if name.endswith(".path")
    }
    for path, inside in sorted(commits.items()):
        inner = places.get(path, "")
        if inner.startswith(("./", "../")):
            inner = urljoin(f"{url}/", inner).rstrip("/")
        inner = _by_https(inner, home)
        if urlsplit(inner).scheme not in {"http", "https"}:
            where = f"is at `{inner}`, which needs an account" if inner else "has no address in .gitmodules"
            raise BundleRefused(
                f"the submodule {path} of {url} {where}", hint="the partner has to give it an https address"
            )
        yield inner, inside


def _by_https(url: str, home: str) -> str:
    """What git on the board makes of an address, by insteadOf."""
    server = urlsplit(home)
    for start in (f"git@{server.hostname}:", f"ssh://git@{server.hostname}/"):
        if url.startswith(start):
            return f"{server.scheme}://{server.netloc}/{url.removeprefix(start)}"
    return url


def _place(url: str) -> str:
    """Below `git`, as insteadOf makes it of the address."""
    place = url.partition("://")[2].rstrip("/")
    if not re.fullmatch(r"[A-Za-z0-9._+~@:/-]+", place) or ".." in place.split("/") or "/" not in place:
        raise BundleRefused(f"`{url}` is no address of a repository that a bundle can hold")
    return place


_SILENT = {"GIT_TERMINAL_PROMPT": "0", "GIT_ASKPASS": "/bin/false", "GIT_CONFIG_COUNT": "0"}
_SMALL = (
    "-c",
    "protocol.version=2",
    "-c",
    "fetch.unpackLimit=1",
    "-c",
    "pack.threads=1",
    "-c",
    "protocol.file.allow=always",
)
"""One pack, the same each time."""


def _access(library: Library) -> dict[str, str]:
    """What git's environment holds: the token for the library's own server, and for no other."""
    if library.token is None:
        return _SILENT
    user, colon, password = library.token.partition(":")
    text = f"{user}:{password}" if colon else f"{_USER}:{library.token}"
    server = "://".join(urlsplit(library.url)[:2])
    return {
        **_SILENT,
        "GIT_CONFIG_COUNT": "1",
        "GIT_CONFIG_KEY_0": f"http.{server}/.extraHeader",
        "GIT_CONFIG_VALUE_0": f"Authorization: Basic {base64.b64encode(text.encode()).decode()}",
    }


def _is_commit(revision: str) -> bool:
    return re.fullmatch(r"[0-9a-f]{40}|[0-9a-f]{64}", revision) is not None


def _whole(mirror: Path, commit: str) -> bool:
    return run(["git", "-C", str(mirror), "rev-list", "--objects", "--max-count=1", commit], _SILENT).returncode == 0


def _plain(bare: Path) -> None:
    """Leave nothing in a repository but what is fetched from it."""
    shutil.rmtree(bare / "hooks", ignore_errors=True)
    shutil.rmtree(bare / "info", ignore_errors=True)
    (bare / "description").unlink(missing_ok=True)


def _git(folder: Path, environment: dict[str, str], *words: str) -> str:
    """Run git in a repository of ours, away from every server."""
    folder.mkdir(parents=True, exist_ok=True)
    done = run(["git", "-C", str(folder), *words], environment)
    if done.returncode != 0:
        raise BundleRefused(f"git {words[0]}: {_last(done.stderr.decode(errors='replace'))}")
    return done.stdout.decode(errors="replace")


def _refused(url: str, revision: str, text: str) -> BundleRefused:
    if re.search(r"Authentication failed|could not read|terminal prompts|returned error: 40[13]|Access denied", text):
        return BundleRefused(
            f"{url} is not given to us: {_last(text)}",
            hint="declare a `token` that may read it, or ask whether the one that is declared is still good",
        )
    if not text or re.search(r"couldn't find remote ref|not our ref|no such remote ref", text):
        return BundleRefused(f"{url} has no revision {revision}", hint="a tag, or a commit of 40 hex digits")
    return BundleRefused(f"{url} cannot be fetched: {_last(text)}", hint="type the same again: what came is kept")


def _last(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    messages = [line for line in lines if line.startswith(("fatal:", "error:", "remote:"))]
    return (messages or lines or ["it says nothing"])[-1]
