"""Fetch a git repository at a revision, with its submodules, over a link that is slow, expensive and unreliable.

It fetches one commit without its history. Data that an earlier attempt has fetched is kept, and a new build starts from
the sources of the build in use, so that only the difference is transferred.

A token is kept in `TOKENS/NAME`, mode 0600, below /run, beside a script that git calls as GIT_ASKPASS with a prompt
(gitcredentials(7)). The script answers for the repository's own server and fails for any other. So the token is in no
command line, environment, .git/config or log. A submodule on the same server is read with it, one elsewhere is not.
Both files are removed when everything is fetched, and when the unit of the build ends, for whatever reason.
"""

# ruff: noqa: PTH103, PTH108, PTH110, PTH112, PTH113, PTH118, PTH123
# Paths are text on the gateways' side, where all modules share it.

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import time
from dataclasses import dataclass
from typing import Callable, Iterable
from urllib.parse import urlsplit

from atlantis_netcfg.core.messages import arg

from .build_messages import BuildTrouble, about_git, error_lines, trouble
from .build_plan import Repository, is_commit
from .errors import ModuleError

_USER = "oauth2"
"""GitLab accepts any user name with an access token; NAME:TOKEN is for deploy tokens, which have a name."""


def store_token(folder: str, name: str, url: str, token: str) -> None:
    """Keep the token of the repository `name` in `folder`, which is in memory. Raises ModuleError."""
    server = urlsplit(url).netloc
    if not re.fullmatch(r"[A-Za-z0-9.-]+(:[0-9]+)?", server) or not token.isprintable():
        raise ModuleError(
            f"no token can be used for {arg(url)}", "use an address like https://gitlab.example.org/group/project"
        )
    user, colon, password = token.partition(":")
    if not colon:
        user, password = _USER, token
    scheme = urlsplit(url).scheme
    secret = os.path.join(folder, name)
    _write(secret, 0o600, f"{user}\n{password}\n")
    where, file = f"{scheme}://", shlex.quote(secret)
    script = (
        "#!/bin/sh",
        f"user=$(sed -n 1p {file})",
        'case "$1" in',
        f"\"Username for '{where}{server}': \") sed -n 1p {file} ;;",
        # The name before the server is the one that the first answer gave.
        f"\"Password for '{where}$user@{server}': \") sed -n 2p {file} ;;",
        "*) exit 1 ;;",
        "esac",
        "",
    )
    _write(f"{secret}.askpass", 0o700, "\n".join(script))


def askpass(folder: str, name: str) -> str | None:
    """Return the path of the askpass script of a repository, if a token is stored for it."""
    path = os.path.join(folder, f"{name}.askpass")
    return path if os.path.exists(path) else None


def _write(path: str, mode: int, text: str) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, mode)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)


_PAUSES_S = (10.0, 30.0, 60.0, 120.0)
"""Pauses between attempts over a failing link; together longer than three gaps of a satellite link."""


def configure(home: str, offline: str | None, urls: Iterable[str]) -> None:
    """Write git's settings to the folder that is its home during a build.

    `protocol.version=2` lets a client request a commit by its hash; a transfer that stalls for 300 s is aborted.
    Submodules with an SSH address on a server of `urls` are read from it like the repositories: by HTTPS, with their
    token. With `offline` every server is a folder below it.
    """
    text = (
        "[protocol]\n\tversion = 2\n"
        '[protocol "ext"]\n\tallow = never\n'
        '[protocol "ssh"]\n\tallow = never\n'
        "[credential]\n\thelper =\n"
        "[http]\n\tlowSpeedLimit = 1\n\tlowSpeedTime = 300\n"
        "[safe]\n\tdirectory = *\n"
        "[advice]\n\tdetachedHead = false\n"
        "[gc]\n\tauto = 0\n"
    )
    mirrors = f"file://{offline.rstrip('/')}/git/" if offline is not None else None
    if mirrors is not None:
        text += '[protocol "file"]\n\tallow = always\n' + _url_rewrite(mirrors, "https://", "http://")
    for scheme, server in sorted({urlsplit(url)[:2] for url in urls}):
        host = server.partition(":")[0]
        text += _url_rewrite(f"{mirrors or scheme + '://'}{server}/", f"git@{host}:", f"ssh://git@{host}/")
    with open(os.path.join(home, ".gitconfig"), "w", encoding="utf-8") as file:
        file.write(text)


def _url_rewrite(address: str, *of: str) -> str:
    return f'[url "{address}"]\n' + "".join(f"\tinsteadOf = {item}\n" for item in of)


class _GitError(Exception):
    """Failure of git, with its output."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.output = text


@dataclass(frozen=True)
class Git:
    """git in one repository; `say` takes lines for the log, tests replace `sleep`."""

    repository: Repository
    name: str
    folder: str
    home: str
    """Folder that `configure` has written to; tokens are below it."""
    offline: str | None
    """Folder that replaces all servers; None: the servers themselves are used."""
    say: Callable[[str], None]
    sleep: Callable[[float], None] = time.sleep

    def fetch(self, seed: str | None) -> str:
        """Fetch the sources of the revision; return its commit. `seed`: a folder to start from. Raises ModuleError."""
        try:
            return self._fetch(seed)
        except _GitError as failed:
            if trouble(failed.output) is not BuildTrouble.CORRUPTION:
                raise self._build_refusal(failed) from None
        self.say("the earlier download is damaged: downloading everything again")
        shutil.rmtree(self.folder)
        try:
            return self._fetch(None)
        except _GitError as failed:
            raise self._build_refusal(failed) from None

    def _fetch(self, seed: str | None) -> str:
        if not os.path.isdir(os.path.join(self.folder, ".git")):
            shutil.rmtree(self.folder, ignore_errors=True)
            if seed is not None and os.path.isdir(os.path.join(seed, ".git")):
                shutil.copytree(os.path.join(seed, ".git"), os.path.join(self.folder, ".git"), symlinks=True)
            else:
                os.makedirs(self.folder)
                self._git("init", "--quiet")
        self._unlock()
        self._git("config", "remote.origin.url", self.repository.url)
        commit = self._commit()
        self._git("checkout", "--quiet", "--force", "--detach", commit)
        self._git("clean", "-ffdxq")
        self._submodules()
        return commit

    def _commit(self) -> str:
        """Fetch the revision; fetch its history only if the server refuses a commit without it."""
        revision = self.repository.revision
        if is_commit(revision):
            if self._has(revision):
                return revision
            try:
                self._online("fetch", "--depth", "1", "--no-tags", "--quiet", "origin", revision)
            except _GitError as failed:
                if trouble(failed.output) is not BuildTrouble.REVISION and "shallow" not in failed.output:
                    raise
                self._online("fetch", "--tags", "--quiet", "origin", "+refs/heads/*:refs/remotes/origin/*")
                if not self._has(revision):
                    raise
            return revision
        tag_refspec = f"+refs/tags/{revision}:refs/tags/{revision}"
        try:
            self._online("fetch", "--depth", "1", "--no-tags", "--quiet", "origin", tag_refspec)
        except _GitError as failed:
            if trouble(failed.output) is BuildTrouble.REVISION:
                self._refuse_branch()
            if "shallow" not in failed.output:
                raise
            self._online("fetch", "--no-tags", "--quiet", "origin", tag_refspec)
        return self._git("rev-parse", f"refs/tags/{revision}^{{commit}}").strip()

    def _has(self, commit: str) -> bool:
        """Return whether a commit is present with all of its files, also after an interrupted attempt."""
        try:
            self._git("rev-list", "--objects", "--max-count=1", commit)
        except _GitError:
            return False
        return True

    def _refuse_branch(self) -> None:
        revision = self.repository.revision
        if self._online("ls-remote", "--heads", "origin", f"refs/heads/{revision}").strip():
            raise ModuleError(
                f"`{arg(revision)}` is a branch of {arg(self.repository.url)}, whose content changes",
                "use a tag or a commit in the inventory: `git ls-remote URL` lists both",
            )

    def _submodules(self) -> None:
        modules = os.path.join(self.folder, ".gitmodules")
        if os.path.isfile(modules):
            self._git("submodule", "--quiet", "sync", "--recursive")
            update = ("submodule", "--quiet", "update", "--init", "--recursive", "--force")
            try:
                self._online(*update, "--depth", "1")
            except _GitError as failed:
                if trouble(failed.output) not in (BuildTrouble.REVISION, BuildTrouble.OTHER):
                    raise self._of_submodule(failed) from None
                self.say("a submodule is not available without its history: downloading it with its history")
                try:
                    self._online(*update)
                except _GitError as again:
                    raise self._of_submodule(again) from None
        lines = self._git("submodule", "status", "--recursive").splitlines()
        absent = [line[1:].split()[1] for line in lines if line[0] in "-U"]
        if absent:
            raise ModuleError(
                f"the submodule {arg(absent[0])} of {arg(self.repository.url)}, revision "
                f"{arg(self.repository.revision)}, is missing",
                "the partner must complete .gitmodules in the repository",
            )

    def _of_submodule(self, error: _GitError) -> Exception:
        """Return the error of a submodule, with its name, because the repository itself is in order."""
        if trouble(error.output) in (
            BuildTrouble.CORRUPTION,
            BuildTrouble.SPACE,
            BuildTrouble.SUBMODULE,
            BuildTrouble.ACCOUNT,
        ):
            return error
        refusal = self._build_refusal(error)
        return ModuleError(
            f"a submodule of {arg(self.repository.url)} could not be fetched: {arg(refusal.message)}", refusal.hint
        )

    def _online(self, *words: str) -> str:
        """Run a git command that needs the link; retry after a pause while the link is down."""
        for pause in _PAUSES_S:
            try:
                return self._git(*words)
            except _GitError as failed:  # noqa: PERF203 - attempts are few
                if trouble(failed.output) is not BuildTrouble.LINK:
                    raise
                self.say(f"connection lost; next attempt in {pause:.0f} s")
                self.sleep(pause)
        return self._git(*words)

    def _git(self, *words: str) -> str:
        process = subprocess.run(  # noqa: S603
            ["git", *words],  # noqa: S607
            cwd=self.folder,
            env=self._environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
        )
        text = process.stdout.decode(errors="replace")
        if process.returncode != 0:
            self.say(text.rstrip())
            raise _GitError(text)
        return text

    def _environment(self) -> dict[str, str]:
        answers = askpass(self.home, self.name)
        environment = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")}
        environment.update(
            HOME=self.home, GIT_TERMINAL_PROMPT="0", GIT_ASKPASS=answers or "/bin/false", LC_ALL="C", LANGUAGE=""
        )
        environment.pop("XDG_CONFIG_HOME", None)
        return environment

    def _unlock(self) -> None:
        """Remove the lock files of an interrupted git; no other build works in this folder."""
        for folder, _, files in os.walk(os.path.join(self.folder, ".git")):
            for file in files:
                if file.endswith(".lock"):
                    os.unlink(os.path.join(folder, file))

    def _build_refusal(self, error: _GitError) -> ModuleError:
        repository = self.repository
        if self.offline is not None and trouble(error.output) in (BuildTrouble.NOT_FOUND, BuildTrouble.REVISION):
            return ModuleError(
                f"{arg(self.offline)} does not contain {arg(repository.url)}, revision "
                f"{arg(repository.revision)}:\n{arg(error_lines(error.output))}",
                "build the bundle again where there is internet, after the last change of the inventory",
            )
        return about_git(
            error.output, repository.url, repository.revision, has_token=askpass(self.home, self.name) is not None
        )
