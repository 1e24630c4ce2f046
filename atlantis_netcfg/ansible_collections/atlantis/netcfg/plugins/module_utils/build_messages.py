"""Error messages of git, colcon, cmake and compilers, translated for a technician."""

from __future__ import annotations

import re
from enum import Enum
from typing import Iterable

from atlantis_netcfg.core.messages import arg, msg

from .errors import ModuleError

_LINES = 6
_LONG = 240
_MEANINGFUL = re.compile(
    r"\berror\b|\bfatal\b|cannot|not found|undefined reference|No rule to make|No space left|Killed"
    r"|Could not find|failed",
    re.IGNORECASE,
)
_ECHOES = re.compile(r"^(make(\[\d+\])?: \*\*\*|gmake(\[\d+\])?: \*\*\*|Failed   <<<|Summary:|\s*\d+ packages? )")
"""Lines that only report an earlier failure."""


class CardFull(ModuleError):
    """Too little disk space for the build; its incomplete files take up space."""


class BuildTrouble(Enum):
    """Kinds of git failures, by what the user has to do about them."""

    CERTIFICATE = "certificate"
    TOKEN = "token"  # noqa: S105 - the name of a trouble
    NOT_FOUND = "gone"
    REVISION = "revision"
    SUBMODULE = "submodule"
    ACCOUNT = "account"
    SPACE = "space"
    CORRUPTION = "damaged"
    LINK = "link"
    OTHER = "other"


_SIGNS = (
    (BuildTrouble.SPACE, r"No space left on device|Disk quota exceeded"),
    (BuildTrouble.CERTIFICATE, r"certificate|SSL peer|self.signed|gnutls_handshake|SSL_ERROR"),
    (
        BuildTrouble.TOKEN,
        (
            r"Authentication failed|could not read (Username|Password)|terminal prompts disabled"
            r"|HTTP Basic: Access denied|returned error: 40[13]|unable to read askpass"
        ),
    ),
    (BuildTrouble.ACCOUNT, r"transport '\w+' not allowed"),
    (BuildTrouble.SUBMODULE, r"No url found for submodule path|no submodule mapping found"),
    (
        BuildTrouble.NOT_FOUND,
        r"repository '.*' not found|returned error: 404|does not appear to be a git repository|does not exist",
    ),
    (BuildTrouble.REVISION, r"couldn't find remote ref|not our ref|unadvertised object|no such remote ref"),
    (
        BuildTrouble.LINK,
        (
            r"Could not resolve|Failed to connect|Couldn't connect|timed out|too slow|early EOF|RPC failed|hung up"
            r"|unexpected disconnect|Empty reply|Connection (reset|refused|died)|Recv failure|returned error: 5\d\d"
            r"|transfer closed|unreachable"
        ),
    ),
    (
        BuildTrouble.CORRUPTION,
        (
            r"\bcorrupt|bad object|loose object|unable to read (tree|sha1)|missing blob|did not send all|inflate: "
            r"|bad (index|signature)|index file|invalid sha1 pointer|not a valid object|\.lock': File exists"
            r"|not a git repository"
        ),
    ),
)


def trouble(text: str) -> BuildTrouble:
    """Classify a git failure by its output."""
    return next((kind for kind, sign in _SIGNS if re.search(sign, text, re.IGNORECASE)), BuildTrouble.OTHER)


def about_git(text: str, url: str, revision: str, *, has_token: bool) -> ModuleError:  # noqa: PLR0911 - one for each trouble
    """Return the error for a git failure; `has_token`: the inventory has a token for this repository."""
    kind = trouble(text)
    host = url.split("/")[2] if "://" in url else url
    at = msg(f"{arg(url)}, revision {arg(revision)}")
    last = error_lines(text)
    if kind is BuildTrouble.CERTIFICATE:
        return ModuleError(
            f"the certificate of {arg(host)} is not accepted:\n{arg(last)}",
            "check the gateway's clock first: `date`. If it is right, and the server's certificate is from a "
            "private authority, copy that authority's file to /usr/local/share/ca-certificates/NAME.crt on the "
            "gateway and run `update-ca-certificates` there",
        )
    if kind is BuildTrouble.TOKEN and not has_token:
        return ModuleError(
            f"{arg(host)} requires a token for {arg(url)}, and the inventory has none",
            "ask the partner for a token that may read the repository, and set it as `token:` (ansible-vault)",
        )
    if kind is BuildTrouble.TOKEN:
        return ModuleError(
            f"{arg(host)} does not accept the inventory's token for {arg(url)}",
            "it may have expired or lack the scope `read_repository`: ask the partner for a new one; a GitLab "
            "deploy token has a name and is written as NAME:TOKEN",
        )
    if kind is BuildTrouble.NOT_FOUND:
        visibility = (
            "the token may lack access to it"
            if has_token
            else "it is visible only with a token, and the inventory has none"
        )
        return ModuleError(
            f"there is no repository at {arg(url)}, or {arg(visibility)}", "open the address in a browser and compare"
        )
    if kind is BuildTrouble.REVISION:
        return ModuleError(
            f"revision {arg(revision)} does not exist in {arg(url)}",
            "`git ls-remote --tags URL` lists its tags; a commit needs all of its 40 hex digits",
        )
    if kind is BuildTrouble.SUBMODULE:
        return ModuleError(
            f"a submodule of {arg(at)} cannot be downloaded: the repository does not contain its address:\n{arg(last)}",
            "the partner must complete .gitmodules in the repository",
        )
    if kind is BuildTrouble.ACCOUNT:
        return ModuleError(
            f"a submodule of {arg(at)} has no https address and would need an account for the gateway:\n{arg(last)}",
            "the partner must give it an https address in .gitmodules",
        )
    if kind is BuildTrouble.SPACE:
        return _card_full_error(msg(f"while {arg(at)} was being downloaded"))
    if kind is BuildTrouble.LINK:
        return ModuleError(
            f"{arg(host)} could not be reached, or the connection was lost, while {arg(at)} was being "
            f"downloaded:\n{arg(last)}",
            "check the site's links, then run the same command again: what was downloaded is kept",
        )
    return ModuleError(f"git could not download {arg(at)}:\n{arg(last)}", "")


def about_building(what: str, text: str) -> ModuleError:
    """Return the error for a failure of colcon, cmake, make or a compiler."""
    last = error_lines(text)
    if re.search(r"No space left on device|Disk quota exceeded", text):
        return _card_full_error(msg(f"while {arg(what)} was being built"))
    if re.search(r"Killed signal|virtual memory exhausted|Cannot allocate memory|out of memory|\bKilled\b", text):
        return ModuleError(
            f"the gateway does not have enough memory to build {arg(what)}:\n{arg(last)}",
            "stop other programs there, or add swap, then run the same command again",
        )
    if missing := re.search(r"package configuration file provided by\s+\"([^\"]+)\"", text):
        return ModuleError(
            f"to build {arg(what)}, cmake needs `{arg(missing.group(1))}`, which is not installed on the gateway",
            "find its package (`apt-file search NAMEConfig.cmake`) and add it to `interop.packages`",
        )
    if missing := re.search(r"fatal error: (\S+): No such file or directory", text):
        return ModuleError(
            f"to build {arg(what)}, the header {arg(missing.group(1))} is needed, which is missing:\n{arg(last)}",
            "find its package (`apt-file search HEADER`) and add it to `interop.packages`",
        )
    return ModuleError(f"{arg(what)} could not be built:\n{arg(last)}", "send this to the partner who made it")


def error_lines(text: str) -> str:
    """Return the last lines that contain an error; if there are none, the last lines."""
    lines = [line.rstrip()[:_LONG] for line in text.splitlines() if line.strip()]
    messages = [line for line in lines if _MEANINGFUL.search(line) and not _ECHOES.search(line)]
    return "\n".join(_unique_lines(messages)[-_LINES:] or lines[-_LINES:])


def _unique_lines(lines: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(lines))


def _card_full_error(when: str) -> ModuleError:
    return CardFull(
        f"the gateway's card became full {arg(when)}",
        "free some space, for example with `apt-get clean` and `journalctl --vacuum-size=50M`; `df -h; df -i` shows "
        "what is full. The unfinished build has been removed",
    )
