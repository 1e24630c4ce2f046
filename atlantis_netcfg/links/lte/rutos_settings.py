"""Settings to change on a RutOS unit: the difference between the inventory and `uci show`. No I/O.

Sections and options: `network.mob1s1a1` (interface of protocol `wwan`, for a slot: `sim`) with `apn`, `auth`,
`username` and `password`, and `simcard` (a section `sim` for each slot: `position`) with `deny_roaming`; RutOS' own
published network scripts read these names. For `auto_apn`, which lets the unit choose the APN, and `reload_config`,
which activates everything: Assumption: rutos-settings. A unit without the expected section is refused and left
unchanged. In which option a unit keeps its bands is not known: bands in the inventory are compared with the band in
use, and never set.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.core.secret import MASK, Secret
from atlantis_netcfg.links.lte.judge import LteReading, Registration

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


SHOW = "uci show network && uci show simcard"
"""Reads both packages in one round trip."""
WRITE = "uci batch"
"""Reads commands from standard input, continues after an error and exits with 0: verify by reading back."""
PIN = "pincode"
"""The option in which a unit stores the PIN that it enters. Assumption: rutos-pin"""
RELOAD = "reload_config"
"""OpenWrt's command that reloads the services whose configuration has changed."""
_LINE = re.compile(r"(\w+)\.(@?\w+(?:\[\d+\])?)(?:\.(\w+))?=(.*)")
_MOBILE = ("wwan", "qmi", "mbim", "ncm", "mobile")
"""Protocols of a mobile interface; `wwan` is that of RutOS 7."""

_A_PERSONS = 2
"""With fewer PIN attempts left the program tries none: the last one before the PUK is left to a person."""

Sections = dict[tuple[str, str], dict[str, str]]
"""Options by package and section; the section's type has the empty name as its key."""


class SettingError(DeviceError):
    """The unit cannot be set as the inventory requires; nothing was sent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LteSettings:
    """The SIM settings in the inventory."""

    apn: str | None = None
    user: str | None = None
    password: Secret | None = None
    pin: Secret | None = None
    roaming: bool = False


@dataclass(frozen=True, slots=True)
class SettingChange:
    """One `uci` option that differs from the inventory."""

    package: str
    section: str
    option: str
    value: str
    before: str | None
    secret: bool = False

    @property
    def line(self) -> str:
        """The change as a readable `set` line, secrets masked."""
        return f"set {self.package}.{self.section}.{self.option}='{MASK if self.secret else self.value}'"

    @property
    def previous_line(self) -> str | None:
        """The previous value as a readable `set` line, secrets masked; None if the option was not set."""
        if self.before is None:
            return None
        return f"set {self.package}.{self.section}.{self.option}='{MASK if self.secret else self.before}'"


def parse_show(text: str) -> Sections:
    """Parse the output of `uci show`; the values of a list are joined by blanks."""
    sections: Sections = {}
    for line in text.splitlines():
        match = _LINE.fullmatch(line.strip())
        if match is None:
            continue
        package, section, option, value = match.groups()
        try:
            words = " ".join(shlex.split(value))
        except ValueError:
            continue
        sections.setdefault((package, section), {})[option or ""] = words
    return sections


def why_pin_blocks(reading: LteReading, settings: LteSettings, sections: Sections, *, pin_refusal: str) -> str | None:
    """Return why nothing may be set while the SIM asks for a PIN: a reload may try the PIN saved in the unit.

    `pin_refusal`: why a PIN must not be tried, from earlier runs. None: the SIM asks for no PIN, or the PIN of the
    inventory was never tried and is the one that the reload will try.
    """
    if reading.state is Registration.SIM_PUK_REQUIRED:
        return "the SIM is locked after too many wrong PINs and asks for its PUK"
    if reading.state is not Registration.SIM_PIN_REQUIRED:
        return None
    pin = None if settings.pin is None else settings.pin.reveal()
    saved_pin = _slot(sections, _place(reading))[1].get(PIN)
    reasons = (
        (pin is None, "the SIM asks for a PIN, but the inventory has none"),
        (pin_refusal, pin_refusal),
        (reading.pin_refused, "the SIM refused the PIN"),
        (saved_pin == pin, "the unit has the inventory's PIN stored, and the SIM still asks for one: the PIN is wrong"),
        ((reading.pin_tries_left or 3) < _A_PERSONS, "the SIM has one PIN try left, which is reserved for a person"),
    )
    return next((reason for holds, reason in reasons if holds), None)


def removal(change: SettingChange) -> str:
    """Return the `uci batch` input that deletes one option."""
    return f"delete {change.package}.{change.section}.{change.option}\ncommit {change.package}\n"


def changes(reading: LteReading, settings: LteSettings, sections: Sections) -> tuple[SettingChange, ...]:
    """Return the changes in order; empty if the unit matches the inventory. Raise SettingError.

    A PIN is set only while the SIM asks for one.
    """
    place = _place(reading)
    setting_changes = [*_interface(sections, place, settings), *_card(sections, place, settings, reading)]
    for change in setting_changes:
        if not change.value.isprintable() or "'" in change.value or "\\" in change.value:
            name = "the value" if change.secret else f"`{change.value}`"
            raise SettingError(
                f"{arg(name)} of {arg(change.package)}.{arg(change.section)}.{arg(change.option)} contains a quote, a "
                "backslash or a control character",
                hint="set it on the unit's own page",
            )
    return tuple(setting_changes)


def batch(setting_changes: tuple[SettingChange, ...]) -> str:
    """Return the `uci batch` input, with secrets in clear text: it must go nowhere else."""
    lines = [f"set {change.package}.{change.section}.{change.option}='{change.value}'" for change in setting_changes]
    return "".join(f"{line}\n" for line in (*lines, *(f"commit {name}" for name in _packages(setting_changes))))


def _packages(setting_changes: tuple[SettingChange, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(change.package for change in setting_changes))


def _place(reading: LteReading) -> str:
    """Return the SIM slot in use; 1 if the unit does not report it."""
    return str(reading.sim_slot or 1)


def _interface(sections: Sections, place: str, settings: LteSettings) -> Iterator[SettingChange]:
    if settings.apn is None and settings.user is None and settings.password is None:
        return
    name, options = _mobile(sections, place)
    declared_options: dict[str, tuple[str | None, bool]] = {
        "auto_apn": (None if settings.apn is None else "0", False),
        "apn": (settings.apn, False),
        "auth": (_authentication(settings, options), False),
        "username": (settings.user, False),
        "password": (None if settings.password is None else settings.password.reveal(), True),
    }
    yield from _option_changes("network", name, options, declared_options)


def _authentication(settings: LteSettings, options: Mapping[str, str]) -> str | None:
    """Return the method for user and password (current one, else `pap`), else None. Assumption: rutos-settings."""
    if settings.user is None and settings.password is None:
        return None
    there = options.get("auth", "none")
    return there if there != "none" else "pap"


def _card(sections: Sections, place: str, settings: LteSettings, reading: LteReading) -> Iterator[SettingChange]:
    name, options = _slot(sections, place)
    if not name:
        raise SettingError(
            f"the unit has no section `sim` for slot {arg(place)} in its configuration `simcard`",
            hint=(
                "its firmware stores this elsewhere: set it on the unit's own page, and remove `admin_user` from "
                "`access`, so that it is only checked"
            ),
        )
    deny_roaming = "0" if settings.roaming else "1"
    if (options.get("deny_roaming") or "0") != deny_roaming:
        yield SettingChange("simcard", name, "deny_roaming", deny_roaming, options.get("deny_roaming"))
    if settings.pin is not None and reading.state is Registration.SIM_PIN_REQUIRED:
        yield from _option_changes("simcard", name, options, {PIN: (settings.pin.reveal(), True)})


def _option_changes(
    package: str, section: str, options: Mapping[str, str], declared_options: Mapping[str, tuple[str | None, bool]]
) -> Iterator[SettingChange]:
    for option, (value, secret) in declared_options.items():
        if value is not None and options.get(option) != value:
            yield SettingChange(package, section, option, value, options.get(option), secret)


def _mobile(sections: Sections, place: str) -> tuple[str, Mapping[str, str]]:
    """Return the first mobile interface of a SIM slot; further ones are for further APNs."""
    for (package, name), options in sections.items():
        mobile = options.get("proto") in _MOBILE and options.get("sim", "1") == place
        if package == "network" and options.get("") == "interface" and mobile:
            return name, options
    raise SettingError(
        f"the unit has no mobile interface for slot {arg(place)} in its configuration `network`",
        hint=(
            "its firmware stores this elsewhere: set it on the unit's own page, and remove `admin_user` from "
            "`access`, so that it is only checked"
        ),
    )


def _slot(sections: Sections, place: str) -> tuple[str, Mapping[str, str]]:
    for (package, name), options in sections.items():
        if package == "simcard" and options.get("") == "sim" and options.get("position") == place:
            return name, options
    return "", {}
