"""Messages of apt and dpkg, translated for a technician. A new message is a row."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Iterable, Sequence

from atlantis_netcfg.core.messages import arg, msg

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
        "the computer's disk is full",
        "free some space, for example with `apt-get clean` and `journalctl --vacuum-size=50M`; `df -h` shows what "
        "is full",
    ),
    _MessageRow(
        r"Read-only file system",
        "the computer's disk is read-only",
        "`dmesg | tail -n 30` shows whether the card is failing; a reboot may help for a while",
    ),
    _MessageRow(
        r"Could not get lock (?P<lock>\S+?)\.? .*(?:held by process (?P<pid>\d+) \((?P<name>[^)]*)\))",
        "another program is installing packages: process {pid} ({name}) holds {lock}",
        "wait until it ends, then run the same command again",
    ),
    _MessageRow(
        r"Unable to (?:acquire|lock) .*(?:lock|directory).*?(?P<lock>/[^\s),]+).*another process",
        "another program is installing packages: it holds {lock}",
        "wait until it ends (`ps -ef | grep -e apt -e dpkg` shows it), then run the same command again",
    ),
    _MessageRow(
        r"(?:gpgv, gpgv2 or gpgv1|apt-key|sqv).*(?:required for verification|not.*installed|No such file)",
        "apt cannot check signatures: gpgv is not installed on the computer",
        "install gpgv from the system's installation medium",
    ),
    _MessageRow(
        r"Conflicting values set for option Signed-By regarding source (?P<url>\S+?)/? (?P<suite>[^:]+): "
        r"(?P<one>\S*) != (?P<other>\S*)",
        "two files in /etc/apt define the source {url} {suite} with different keys: apt refuses all sources",
        "find the other one with `grep -rl {url} /etc/apt/sources.list /etc/apt/sources.list.d` and remove it",
    ),
    _MessageRow(
        r"E: Malformed (?:entry|stanza|line) (?P<number>\d+) in (?:\S+ file |list file )?(?P<file>\S+)",
        "apt cannot read {file} on the computer (entry {number})",
        "correct or remove it: `apt-get update` shows what is wrong",
    ),
)
"""Failures of the computer itself, whatever source is concerned."""

_SOURCES = (
    _MessageRow(
        r"(?:GPG error: |signature verification.*: )" + _SOURCE + r": .*EXPKEYSIG (?P<key>[0-9A-F]+)",
        "the key {key} that signs {url} {suite} has expired",
        "put the renewed key into the inventory (`key_file`); if it is still valid for years, the clock is wrong",
    ),
    _MessageRow(
        r"(?:GPG error: |signature verification.*: )" + _SOURCE + r": .*(?:NO_PUBKEY|Missing key) (?P<key>[0-9A-F]+)",
        "{url} {suite} is signed with key {key}, which is not its key in the inventory",
        "ask the archive's maintainer whether it has a new key; put that one into the inventory (`key_file`)",
    ),
    _MessageRow(
        r"(?:GPG error: |signature verification.*: )" + _SOURCE + r": .*(?P<what>REVKEYSIG|BADSIG|invalid)",
        "the signature of {url} {suite} is not valid ({what})",
        "a proxy or mirror modifies the files, or the archive is being updated; try again, then ask its maintainer",
    ),
    _MessageRow(
        r"Release file for (?P<url>\S+) is not valid yet \(invalid for another (?P<time>[^)]*)\)",
        "the computer's clock is {time} behind: {url} has a later date",
        "set the clock: `date` shows it, `chronyc makestep` sets it where a time server can be reached",
    ),
    _MessageRow(
        r"Release file for (?P<url>\S+) is expired \(invalid since (?P<time>[^)]*)\)",
        "the list of {url} is too old (expired {time} ago), or the computer's clock is ahead",
        "compare `date` with a watch; an archive that is no longer updated must be used as a snapshot",
    ),
    _MessageRow(
        r"Conflicting distribution: " + _SOURCE + r" \(expected (?P<wanted>\S+) but got (?P<got>[^)\s]+)\)",
        "{url} provides {got} where {wanted} is requested",
        "use a source for {wanted}",
    ),
    _MessageRow(
        r"repository '" + _SOURCE + r"' doesn't support architecture '(?P<architecture>[^']+)'",
        "{url} {suite} has no packages for {architecture}, this computer's architecture",
        "use another source (`origin`, `mirror`) or another release",
    ),
    _MessageRow(
        r"repository '" + _SOURCE + r"' doesn't have the component '(?P<component>[^']+)'",
        "{url} {suite} has no component `{component}`",
        "use another source (`origin`, `mirror`)",
    ),
    _MessageRow(
        r"(?:Could not resolve|Temporary failure resolving|Unable to resolve) '?(?P<host>[^'\s]+)'?",
        "the computer cannot resolve {host}: it has no internet access or no name server",
        "check the site's link, and `ip route` on the computer; or bring the packages: `provision gateway bundle "
        "site=…`, then `--offline`",
    ),
    _MessageRow(
        r"repository '" + _SOURCE + r"' (?:does not have a Release file|no longer has a Release file)",
        "`{suite}` does not exist at {url}",
        "the release has moved or reached its end of life: for such releases set `origin: snapshot`; or set a `mirror`",
    ),
    _MessageRow(
        r"(?:Could not connect to|Unable to connect to|Connection timed out|Connection failed|Connection refused|"
        r"Network is unreachable|No route to host|Cannot initiate the connection to) ?(?P<host>[^\s:,]*)",
        "the computer cannot reach {host}",
        "check the site's link, and `ip route` on the computer; or bring the packages: `provision gateway bundle "
        "site=…`, then `--offline`",
    ),
    _MessageRow(
        r"Failed to fetch (?P<url>\S+) .*(?P<code>\b[45]\d\d) ",
        "{url} is not available: the server responds {code}",
        "the archive may be updating now: try again; a mirror may be behind",
    ),
    _MessageRow(
        r"(?:Hash Sum mismatch|unexpected size)",
        "the download does not match what the archive has signed",
        "the archive is being updated, or a proxy serves old files: try again in a few minutes",
    ),
)
"""Failures of a source, or of the route to it."""

_PACKAGES = (
    _MessageRow(
        r"E: Packages need to be removed but remove is disabled",
        "the installation would remove other packages of the computer, so it was refused",
        "`apt-get -s install {names}` on the computer lists them; remove them by hand if that is intended",
    ),
    _MessageRow(
        r"E: Held packages were changed",
        "packages on hold would have to change",
        "`apt-mark showhold` on the computer lists them; `apt-mark unhold NAME` releases one",
    ),
    _MessageRow(
        r"E: Packages were downgraded and -y was used without --allow-downgrades",
        "the installation would downgrade other packages",
        "`apt-get -s install {names}` on the computer lists them",
    ),
    _MessageRow(
        r"(?P<who>\S+) : (?:Pre)?Depends: (?P<what>.*?)(?: but (?P<why>.*))?$",
        "{who} needs {what}, which is not available",
        "the source does not belong to the computer's system, or another source has a newer version: `apt-cache "
        "policy` on the computer shows where each comes from",
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
        (_first_matching_error(_SOURCES, lines) or _raw_output_error("the package lists could not be updated", text))
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
            f"{arg(script['name'])} could not be set up: "
            f"{arg(script['why'].strip())}\n{arg(_lines_before(text, script.start()))}",
            "see the reason above; when it is fixed, run the same command again: it continues from there",
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
    return (
        [msg(f"the package lists of {arg(', '.join(hosts))} could not be updated; the previous ones are used")]
        if hosts
        else []
    )


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
                groups = {**more, **match.groupdict("")}
                values = dict(zip(groups, map(arg, groups.values())))
                return ModuleError(row.message.format(**values), row.hint.format(**values))
    return None


def _lines_before(text: str, at: int) -> str:
    lines = [line for line in text[:at].splitlines()[:-1] if line.strip()]
    return "\n".join(lines[-_LINES:])


def _raw_output_error(what: str, text: str) -> ModuleError:
    lines = [line.rstrip() for line in text.splitlines() if line.strip() and not _PROGRESS.search(line)]
    output = "\n".join(lines[-_LINES:])
    return ModuleError(f"{arg(what)}:\n{arg(output)}", "the text above is apt's output")
