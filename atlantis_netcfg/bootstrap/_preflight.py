"""What makes first contact pointless before it begins, each with what a person has to do about it.

Packages: Manual, Packages, and changelog of 7.13 (`wireless` became an extra package). Device-mode: its page there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.versions import Version

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.bootstrap.target import Facts, Wish
    from atlantis_netcfg.rsc import Export

__all__ = ["ACTIVATION_MINUTES", "OLDEST", "Objection", "features_of", "objections"]

OLDEST = Version(6, 49)
_SPLIT = Version(7, 13)
_RADIO_PACKAGES = ("wireless", "wifi-qcom", "wifi-qcom-ac", "wifi-mediatek", "wifi")
ACTIVATION_MINUTES = 5
"""`activation-timeout` of `/system/device-mode/update`: within it the button has to be pressed."""

_ROWS = {
    "/system/scheduler": "scheduler",
    "/ip/hotspot": "hotspot",
    "/ip/ipsec/peer": "ipsec",
    "/interface/l2tp-client": "l2tp",
    "/interface/pptp-client": "pptp",
    "/container": "container",
    "/zerotier/interface": "zerotier",
}
_SERVICES = {
    "/ip/proxy": "proxy",
    "/ip/socks": "socks",
    "/ip/smb": "smb",
    "/tool/romon": "romon",
    "/tool/bandwidth-server": "bandwidth-test",
    "/interface/l2tp-server/server": "l2tp",
    "/interface/pptp-server/server": "pptp",
}


@dataclass(frozen=True, slots=True)
class Objection:
    """Why not, and what a person does about it."""

    message: str
    hint: str


def features_of(desired: Export) -> dict[str, str]:
    """Features of device-mode that a declared text needs, each with the menu that needs it."""
    needed: dict[str, str] = {}
    for statement in desired.statements:
        values = dict(statement.values)
        if statement.verb == "add" and statement.menu in _ROWS and values.get("disabled") != "yes":
            needed.setdefault(_ROWS[statement.menu], statement.menu)
        if statement.menu in _SERVICES and values.get("enabled") == "yes":
            needed.setdefault(_SERVICES[statement.menu], statement.menu)
    return needed


def objections(facts: Facts, wish: Wish) -> tuple[Objection, ...]:
    """Everything at once, so that a person goes to the device one time."""
    return (*_box(facts, wish), *_software(facts, wish), *_device_mode(facts, wish))


def _box(facts: Facts, wish: Wish) -> Iterator[Objection]:
    said, found = (wish.model or "").lower(), facts.board.lower()
    if said and found and said not in found and found not in said:
        yield Objection(
            f"{wish.name} is declared as {wish.model}, but this is a {facts.board} ({facts.architecture})",
            "plug into the right box, or correct `model` in its host_vars file",
        )
    ports = {row.get("default-name") or row.get("name", "") for row in facts.ethernets}
    missing = [port for port in wish.ports if port not in ports]
    if missing:
        yield Objection(
            f"{wish.name} is declared with ports that this {facts.board or 'box'} does not have: {', '.join(missing)}",
            f"it has {', '.join(sorted(ports))}; correct `ports` in its host_vars file, or take the right box",
        )


def _software(facts: Facts, wish: Wish) -> Iterator[Objection]:
    if facts.version < OLDEST:
        yield Objection(
            f"RouterOS {facts.version} is too old: {OLDEST} is the oldest that can be adopted",
            f"upgrade it in Winbox (System > Packages) with the {facts.architecture} files of a newer version first",
        )
    if wish.radio and facts.version >= _SPLIT and not set(_RADIO_PACKAGES) & set(facts.packages):
        yield Objection(
            f"RouterOS {facts.version} on this {facts.board} has no package for its radio: since 7.13 `wireless` "
            "is a package of its own",
            f"put wireless-{facts.version}-{facts.architecture}.npk (or wifi-qcom, as its radio needs) on it in Winbox "
            "(Files), reboot it, then run this command again",
        )


def _device_mode(facts: Facts, wish: Wish) -> Iterator[Objection]:
    mode = facts.device_mode
    if mode is None:
        return
    called = mode.get("mode", "unknown")
    forbidden = [name for name in wish.features if mode.get(name) in ("false", "no")]
    if mode.get("flagged") in ("true", "yes"):
        yield Objection(
            "device-mode has flagged this router: it suspects that somebody has tampered with its configuration",
            f"look through its configuration; then {_press('flagged=no')}",
        )
    if forbidden:
        menus = ", ".join(f"{name} (for {wish.features[name]})" for name in forbidden)
        yield Objection(
            f"device-mode `{called}` of this router forbids what {wish.name} needs: {menus}",
            _press(" ".join(f"{name}=yes" for name in forbidden)),
        )


def _press(change: str) -> str:
    return (
        f"type on its console:  /system device-mode update {change} activation-timeout={ACTIVATION_MINUTES}m\n"
        f"within {ACTIVATION_MINUTES} minutes press its reset or mode button once, shortly, or pull its power plug "
        "and put it back\n"
        "the router restarts with the new mode; then run this command again"
    )
