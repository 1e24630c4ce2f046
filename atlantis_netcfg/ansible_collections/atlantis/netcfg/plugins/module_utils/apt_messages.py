"""Messages of apt and dpkg, translated for a technician. A new message is a row."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Iterable, Sequence

from .errors import ModuleError

_LINES = 8
_SOURCE = r"(?P<url>\S+) (?P<suite>\S+?)(?: (?:In)?Release)?"


@dataclass(frozen=True)
class _MessageRow:
    """A known message of apt: pattern, meaning and remedy. The texts may use the groups of the pattern."""

    pattern: str
    message: str
    hint: str = ""


_COMPUTER = (
    _MessageRow(
        r"No space left on device|You don't have enough free space in (?P<place>\S+)",
        "the disk of the computer is full",
        "make room, for example by `apt-get clean` and `journalctl --vacuum-size=50M`; `df -h` tells where it is full",
    ),
    _MessageRow(
        r"Read-only file system",
        "the disk of the computer can only be read",
        "`dmesg | tail -n 30` tells whether the card is failing; a reboot may bring it back for a while",
    ),
    _MessageRow(
        r"Could not get lock (?P<lock>\S+?)\.? .*(?:held by process (?P<pid>\d+) \((?P<name>[^)]*)\))",
        "another program is installing packages: process {pid} ({name}) holds {lock}",
        "let it come to its end, and type the same again",
    ),
    _MessageRow(
        r"Unable to (?:acquire|lock) .*(?:lock|directory).*?(?P<lock>/[^\s),]+).*another process",
        "another program is installing packages: it holds {lock}",
        "let it come to its end (`ps -ef | grep -e apt -e dpkg` shows it), and type the same again",
    ),
    _MessageRow(
        r"(?:gpgv, gpgv2 or gpgv1|apt-key|sqv).*(?:required for verification|not.*installed|No such file)",
        "apt cannot check signatures: gpgv is not on the computer",
        "install gpgv from the system's own medium",
    ),
    _MessageRow(
        r"Conflicting values set for option Signed-By regarding source (?P<url>\S+?)/? (?P<suite>[^:]+): "
        r"(?P<one>\S*) != (?P<other>\S*)",
        "two files below /etc/apt name the source {url} {suite}, with different keys: apt refuses all",
        "find the other one by `grep -rl {url} /etc/apt/sources.list /etc/apt/sources.list.d`, and remove it",
    ),
    _MessageRow(
        r"E: Malformed (?:entry|stanza|line) (?P<number>\d+) in (?:\S+ file |list file )?(?P<file>\S+)",
        "{file} on the computer cannot be read by apt (entry {number})",
        "correct or remove it: `apt-get update` shows what is wrong",
    ),
)
"""Failures of the computer itself, whatever source is concerned."""

_SOURCES = (
    _MessageRow(
        r"(?:GPG error: |signature verification.*: )" + _SOURCE + r": .*EXPKEYSIG (?P<key>[0-9A-F]+)",
        "the key {key} that signs {url} {suite} has expired",
        "put the renewed key into the declaration (`key_file`); if it is good for years yet, the clock is wrong",
    ),
    _MessageRow(
        r"(?:GPG error: |signature verification.*: )" + _SOURCE + r": .*(?:NO_PUBKEY|Missing key) (?P<key>[0-9A-F]+)",
        "{url} {suite} is signed by the key {key}, and that is not the key that is declared for it",
        "ask who keeps the archive whether it has a new key; put that one into the declaration (`key_file`)",
    ),
    _MessageRow(
        r"(?:GPG error: |signature verification.*: )" + _SOURCE + r": .*(?P<what>REVKEYSIG|BADSIG|invalid)",
        "the signature of {url} {suite} is not good ({what})",
        "a proxy or a mirror changes what it hands on, or the archive is being changed now; try again, then ask",
    ),
    _MessageRow(
        r"Release file for (?P<url>\S+) is not valid yet \(invalid for another (?P<time>[^)]*)\)",
        "the clock of the computer is {time} behind: {url} was made later than it says that it is now",
        "set the clock: `date` shows it, `chronyc makestep` sets it where a time server is reached",
    ),
    _MessageRow(
        r"Release file for (?P<url>\S+) is expired \(invalid since (?P<time>[^)]*)\)",
        "the list of {url} is too old (good until {time} ago), or the clock of the computer is ahead",
        "compare `date` with a watch; an archive that nobody renews has to be taken as a snapshot",
    ),
    _MessageRow(
        r"Conflicting distribution: " + _SOURCE + r" \(expected (?P<wanted>\S+) but got (?P<got>[^)\s]+)\)",
        "{url} gives {got} where {wanted} is asked for",
        "take a source that is made for {wanted}",
    ),
    _MessageRow(
        r"repository '" + _SOURCE + r"' doesn't support architecture '(?P<architecture>[^']+)'",
        "{url} {suite} has nothing for {architecture}, the architecture of this computer",
        "take another source (`origin`, `mirror`), or another release",
    ),
    _MessageRow(
        r"repository '" + _SOURCE + r"' doesn't have the component '(?P<component>[^']+)'",
        "{url} {suite} has no part `{component}`",
        "take another source (`origin`, `mirror`)",
    ),
    _MessageRow(
        r"(?:Could not resolve|Temporary failure resolving|Unable to resolve) '?(?P<host>[^'\s]+)'?",
        "the computer cannot find the name {host}: it has no internet, or no name server",
        "look at the link of the site, and at `ip route` on the computer; or bring the packages: "
        "`provision gateway bundle site=…`, then `--offline`",
    ),
    _MessageRow(
        r"repository '" + _SOURCE + r"' (?:does not have a Release file|no longer has a Release file)",
        "there is no `{suite}` at {url}",
        "the release was moved or has ended there: `origin: snapshot` is for ended releases; or declare a `mirror`",
    ),
    _MessageRow(
        r"(?:Could not connect to|Unable to connect to|Connection timed out|Connection failed|Connection refused|"
        r"Network is unreachable|No route to host|Cannot initiate the connection to) ?(?P<host>[^\s:,]*)",
        "the computer does not reach {host}",
        "look at the link of the site, and at `ip route` on the computer; or bring the packages: "
        "`provision gateway bundle site=…`, then `--offline`",
    ),
    _MessageRow(
        r"Failed to fetch (?P<url>\S+) .*(?P<code>\b[45]\d\d) ",
        "{url} is not to be had: the server answers {code}",
        "the archive may be changing now: try again; a mirror may be behind",
    ),
    _MessageRow(
        r"(?:Hash Sum mismatch|unexpected size)",
        "what was downloaded is not what the archive has signed",
        "the archive is changing now, or a proxy hands on old files: try again in some minutes",
    ),
)
"""Failures of a source, or of the route to it."""

_PACKAGES = (
    _MessageRow(
        r"E: Packages need to be removed but remove is disabled",
        "installing would remove other packages of the computer, and that is not done unasked",
        "`apt-get -s install {names}` on the computer shows which; remove them by hand if that is meant",
    ),
    _MessageRow(
        r"E: Held packages were changed",
        "packages that somebody holds at their version would have to change",
        "`apt-mark showhold` on the computer shows them; `apt-mark unhold NAME` lets one go",
    ),
    _MessageRow(
        r"E: Packages were downgraded and -y was used without --allow-downgrades",
        "installing would take other packages back to an older version",
        "`apt-get -s install {names}` on the computer shows which",
    ),
    _MessageRow(
        r"(?P<who>\S+) : (?:Pre)?Depends: (?P<what>.*?)(?: but (?P<why>.*))?$",
        "{who} needs {what}, and that cannot be had",
        "the source does not belong to the system on the computer, or another source has a newer version of it: "
        "`apt-cache policy` on the computer shows where each comes from",
    ),
)
_SCRIPT = re.compile(r"error processing package (?P<name>\S+) \(--(?P<act>\w+)\):\n(?P<why>.*)")
_PROGRESS = re.compile(r"\d%")
_SAYS = re.compile(r"^(?:[EWN]|Err:\d+):? ")


def explain_update_failure(text: str, code: int, urls: Sequence[str], architecture: str) -> ModuleError | None:
    """Return why an update of package lists from `urls` failed; None if they succeeded for `architecture`."""
    missing = f"doesn't support architecture '{architecture}'"
    lines = [line for line in problems(text) if "doesn't support architecture" not in line or missing in line]
    result = _first_matching_error(_COMPUTER, lines)
    if result is not None:
        return result
    result = _first_matching_error(_SOURCES, [line for line in lines if any(url.rstrip("/") in line for url in urls)])
    if result is not None or (code == 0 and urls):
        return result
    return (
        (
            _first_matching_error(_SOURCES, lines)
            or _raw_output_error("the lists of packages could not be updated", text)
        )
        if code
        else None
    )


def explain_install_failure(text: str, names: Iterable[str]) -> ModuleError:
    """Return the error that explains why apt or dpkg could not install."""
    script = _SCRIPT.search(text)
    lines = text.splitlines()
    full = _first_matching_error(_COMPUTER, lines)
    if full is not None:
        return full
    if script is not None:
        return ModuleError(
            f"{script['name']} could not be set up: {script['why'].strip()}\n{_lines_before(text, script.start())}",
            "what it says above is the reason; after it is mended type the same again: it goes on from there",
        )
    error = _first_matching_error(_PACKAGES, lines, names=" ".join(names)) or _first_matching_error(
        _SOURCES, problems(text)
    )
    return error or _raw_output_error("the packages could not be installed", text)


def other_source_notes(text: str, urls: Sequence[str]) -> list[str]:
    """Return a note about sources other than `urls` that could not be updated; this is not an error."""
    failed_lines = [
        line for line in problems(text) if line[0] in "EW" and not any(url.rstrip("/") in line for url in urls)
    ]
    hosts = dict.fromkeys(match for line in failed_lines for match in re.findall(r"https?://([^/\s]+)", line))
    return [f"the lists of {', '.join(hosts)} could not be updated, those from before are used"] if hosts else []


def problems(text: str) -> list[str]:
    """Return apt's errors, warnings and notes, each as one line with its indented continuation."""
    result: list[str] = []
    for line in text.splitlines():
        if _SAYS.match(line):
            result.append(line)
        elif line.startswith("  ") and result:
            result[-1] += " " + line.strip()
    return result


def _first_matching_error(rows: Iterable[_MessageRow], lines: Sequence[str], **more: str) -> ModuleError | None:
    for row in rows:
        for line in lines:
            match = re.search(row.pattern, line)
            if match is not None:
                groups = {**more, **{name: text or "" for name, text in match.groupdict().items()}}
                return ModuleError(row.message.format(**groups), row.hint.format(**groups))
    return None


def _lines_before(text: str, at: int) -> str:
    lines = [line for line in text[:at].splitlines()[:-1] if line.strip()]
    return "\n".join(lines[-_LINES:])


def _raw_output_error(what: str, text: str) -> ModuleError:
    lines = [line.rstrip() for line in text.splitlines() if line.strip() and not _PROGRESS.search(line)]
    return ModuleError(f"{what}:\n" + "\n".join(lines[-_LINES:]), "the words above are those of apt")
