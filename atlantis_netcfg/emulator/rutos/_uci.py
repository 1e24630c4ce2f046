"""The `uci` of the twin: the sections that a 4G unit has, and the words in which OpenWrt's own program refuses.

Behaviour after OpenWrt's uci [memory]: an unknown section is `uci: Entry not found`, a malformed line
`uci: Invalid argument`; `uci batch` goes on after an error and ends with 0. Which options RutOS has in these sections
is taken from its own published network scripts (`modem`, `sim`, `apn`, `auth`, `username`, `password`, `pdp`,
`deny_roaming`, `position`), or [inferred] (`auto_apn`, `pincode`): options outside this list are refused here, where
the real program would take any.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, field

__all__ = ["Uci", "UciRefused", "factory"]

_OPTIONS = {
    "network": frozenset(
        (
            *("proto", "modem", "sim", "apn", "auto_apn", "auth", "username", "password"),
            *("pdp", "pdptype", "dhcpv6", "metric", "delay", "mtu", "area_type"),
        )
    ),
    "simcard": frozenset(["modem", "position", "primary", "deny_roaming", "pincode", "volte", "service"]),
}
_NAME = re.compile(r"(\w+)\.(@\w+\[\d+\]|\w+)(?:\.(\w+))?")
NOT_FOUND = "uci: Entry not found"
INVALID = "uci: Invalid argument"


class UciRefused(Exception):
    """`str()` is what uci prints on standard error."""


@dataclass(slots=True)
class Section:
    """A section: its type, its options, and the name under which `uci show` prints it."""

    shown: str
    kind: str
    options: dict[str, str] = field(default_factory=dict)


class Uci:
    """Packages with sections; changes lie beside them until they are committed."""

    def __init__(self, packages: dict[str, list[Section]]) -> None:
        self._saved = packages
        self._staged: dict[str, list[Section]] = _copy(packages)
        self.commits = 0

    def show(self, package: str) -> str:
        """As `uci show PACKAGE` prints it, with what is not committed yet. Raises UciRefused."""
        if package not in self._staged:
            raise UciRefused(NOT_FOUND)
        lines = []
        for section in self._staged[package]:
            lines.append(f"{package}.{section.shown}={section.kind}")
            lines += [f"{package}.{section.shown}.{name}={_quoted(value)}" for name, value in section.options.items()]
        return "".join(f"{line}\n" for line in lines)

    def saved(self, package: str, kind: str) -> list[dict[str, str]]:
        """Committed options of the sections of a type, as a service reads them."""
        return [dict(one.options) for one in self._saved.get(package, ()) if one.kind == kind]

    def batch(self, text: str) -> str:
        """Run the lines of `uci batch`; give what went to standard error."""
        said = []
        for line in text.splitlines():
            if not line.strip():
                continue
            try:
                self._line(line)
            except UciRefused as refused:
                said.append(str(refused))
        return "".join(f"{one}\n" for one in said)

    def _line(self, line: str) -> None:
        try:
            words = shlex.split(line)
        except ValueError as error:
            raise UciRefused("uci: Parse error (unterminated quoted string)") from error
        verb, *rest = words
        if verb == "commit" and len(rest) == 1:
            self._commit(rest[0])
        elif verb == "set" and len(rest) == 1 and "=" in rest[0]:
            name, _, value = rest[0].partition("=")
            section, option = self._find(name)
            section.options[option] = value
        elif verb == "delete" and len(rest) == 1:
            section, option = self._find(rest[0])
            if option not in section.options:
                raise UciRefused(NOT_FOUND)
            del section.options[option]
        else:
            raise UciRefused("Unknown command" if verb not in {"commit", "set", "delete"} else INVALID)

    def _find(self, name: str) -> tuple[Section, str]:
        match = _NAME.fullmatch(name)
        if match is None or match[3] is None:
            raise UciRefused(INVALID)
        package, shown, option = match.groups()
        found = next((one for one in self._staged.get(package, ()) if one.shown == shown), None)
        if found is None:
            raise UciRefused(NOT_FOUND)
        if option not in _OPTIONS.get(package, ()):
            raise UciRefused(INVALID)
        return found, option

    def _commit(self, package: str) -> None:
        if package not in self._staged:
            raise UciRefused(NOT_FOUND)
        self._saved[package] = _copy({package: self._staged[package]})[package]
        self.commits += 1


def factory(*, mobile: bool) -> Uci:
    """The sections of a unit with one modem and two slots, as they are before anybody has set anything."""
    network = [
        Section("loopback", "interface", {"proto": "static"}),
        Section("lan", "interface", {"proto": "static", "area_type": "lan"}),
    ]
    if mobile:
        for slot in ("1", "2"):
            options = {"proto": "wwan", "modem": "1-1", "sim": slot, "pdp": "1", "auto_apn": "1", "auth": "none"}
            network.append(Section(f"mob1s{slot}a1", "interface", options))
    slots = [
        Section(
            f"@sim[{place}]",
            "sim",
            {"modem": "1-1", "position": str(place + 1)} | ({"primary": "1"} if not place else {}),
        )
        for place in range(2)
    ]
    return Uci({"network": network, "simcard": slots})


def _quoted(value: str) -> str:
    return "'" + value.replace("'", "'\\''") + "'"


def _copy(packages: dict[str, list[Section]]) -> dict[str, list[Section]]:
    return {
        name: [Section(one.shown, one.kind, dict(one.options)) for one in sections]
        for name, sections in packages.items()
    }
