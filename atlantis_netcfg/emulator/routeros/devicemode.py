"""Which features the device-mode lets a router use (Manual, Device-mode; from 7.17 set at the factory)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.schema import version_key
from atlantis_netcfg.emulator.routeros.spec import Mode

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.spec import RouterSpec

NOT_ALLOWED = "failure: not allowed by device-mode"
INACTIVE = "inactivated, not allowed by device-mode"
FLAGGED = (
    "failure: configuration flagged, check all router configuration for unauthorized changes and update device-mode"
)
SUSPICIOUS = ("scheduler", "pptp", "l2tp", "ipsec", "socks", "proxy", "smb")
"""Features of which a flagged router refuses new or enabled entries."""

_EVERY = frozenset(Mode)
_NOT_HOME = _EVERY - {Mode.HOME}
_UPPER = frozenset({Mode.ADVANCED, Mode.ROSE})
_NOBODY: frozenset[Mode] = frozenset()

FEATURES: dict[str, frozenset[Mode]] = {
    "scheduler": _NOT_HOME,
    "socks": _UPPER,
    "fetch": _NOT_HOME,
    "pptp": _EVERY,
    "l2tp": _EVERY,
    "bandwidth-test": _UPPER,
    "traffic-gen": _NOBODY,
    "sniffer": _NOT_HOME,
    "ipsec": _EVERY,
    "romon": _NOT_HOME,
    "proxy": _UPPER,
    "hotspot": _UPPER,
    "smb": _EVERY,
    "email": _NOT_HOME,
    "zerotier": _UPPER,
    "container": frozenset({Mode.ROSE}),
    "install-any-version": _NOBODY,
    "partitions": _NOBODY,
    "routerboard": _NOBODY,
}
"""Modes in which a feature is allowed."""


COMMANDS = {
    "/system/package/downgrade": "install-any-version",
    "/tool/bandwidth-test": "bandwidth-test",
    "/tool/e-mail/send": "email",
    "/tool/fetch": "fetch",
    "/tool/romon/ping": "romon",
    "/tool/sniffer/quick": "sniffer",
    "/tool/sniffer/start": "sniffer",
    "/tool/traffic-generator/quick": "traffic-gen",
    "/tool/traffic-generator/start": "traffic-gen",
}
"""Commands that are refused where their feature is not allowed."""


def allowed(spec: RouterSpec, feature: str) -> bool:
    """Tell whether the router may use a feature; before 7.17 nothing was restricted."""
    if version_key(spec.version) < version_key("7.17"):
        return True
    return spec.device_mode.features.get(feature, spec.device_mode.mode in FEATURES[feature])
