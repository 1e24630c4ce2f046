"""The token of a git server: told to git when it asks, for one server only, from files that live in memory.

A token stands in `TOKENS/NAME`, mode 0600, below /run; beside it a script that git calls as GIT_ASKPASS with a question
(gitcredentials(7)): it answers for the repository's own server, and fails for every other one. So a token is in no
command line, no environment, no .git/config and no log; a submodule on the same server is read with it, one elsewhere
is not. Both files are removed when everything is fetched, and with the unit of the build however that ends.
"""

# ruff: noqa: PTH110, PTH118

from __future__ import annotations

import os
import re
import shlex
from urllib.parse import urlsplit

from .refused import Refused

__all__ = ["askpass", "keep"]

_USER = "oauth2"
"""GitLab takes any name beside an access token; NAME:TOKEN is for deploy tokens, which have one."""


def keep(folder: str, name: str, url: str, token: str) -> None:
    """Keep the token of the repository `name` in `folder`, which is in memory. Raises Refused."""
    server = urlsplit(url).netloc
    if not re.fullmatch(r"[A-Za-z0-9.-]+(:[0-9]+)?", server) or not token.isprintable():
        raise Refused(f"no token can be used for {url}", "its address is like https://gitlab.example.org/group/project")
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
    """The script that answers for a repository, if a token is kept for it."""
    path = os.path.join(folder, f"{name}.askpass")
    return path if os.path.exists(path) else None


def _write(path: str, mode: int, text: str) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, mode)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
