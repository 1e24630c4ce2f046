"""User authentication of an emulated router (Manual, User; Manual, API: Login).

Also the features that the device-mode permits (Manual, Device-mode; from 7.17 set at the factory).
"""

from __future__ import annotations

import base64
import binascii
import hashlib
from dataclasses import dataclass
from ipaddress import ip_address, ip_network
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Caller, Trap
from atlantis_netcfg.emulator.routeros.schema import version_key
from atlantis_netcfg.emulator.routeros.spec import DeviceModeName, RouterSpec

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from atlantis_netcfg.emulator.routeros.core import Core


_LENGTH = 4
_FIELDS = {"ssh-ed25519": 2, "ssh-rsa": 3}
"""Number of strings in a key, including its type (RFC 8709, RFC 4253)."""
_ED25519_BITS = 256

_LOGIN_REFUSAL = "invalid user name or password (6)"
_POLICIES = {"api-ssl": "api", "console": "local"}


def admit(core: Core, user: str, right: Callable[[str], bool], via: str, address: str) -> Caller:
    """Return a new session. Raises Trap, with the same text for a wrong name, password or address."""
    table = core.store.table("/user")
    for item in table.items:
        if core.store.text(table, item, "name") != user or core.store.text(table, item, "disabled") == "yes":
            continue
        if not right(core.store.text(table, item, "password") or "") or not _is_allowed_address(item.values, address):
            break
        group = core.store.text(table, item, "group") or ""
        caller = Caller(core.number(), user, group, via, address, core.now())
        if _POLICIES.get(via, via) not in core.policies(caller):
            break
        core.note("system,info,account", f"user {user} logged in{_source_text(address)} via {via}")
        return caller
    core.note("system,error,critical", f"login failure for user {user}{_source_text(address)} via {via}")
    raise Trap(_LOGIN_REFUSAL)


@dataclass(frozen=True, slots=True)
class SshPublicKey:
    """A public key in the text form of OpenSSH: `ssh-ed25519 AAAA... comment`."""

    algorithm: str
    bits: int
    blob: bytes
    comment: str

    @property
    def fingerprint(self) -> str:
        """Fingerprint as printed by `ssh-keygen -l`."""
        return "SHA256:" + base64.b64encode(hashlib.sha256(self.blob).digest()).decode().rstrip("=")


def public_key(core: Core, text: str) -> SshPublicKey | None:
    """Parse a key that this version supports: RSA, and Ed25519 from 7.12 (tikoci/quickchr, test/lab/ssh-keys)."""
    kind, encoded_key, comment = [*text.split(maxsplit=2), "", "", ""][:3]
    if kind not in _FIELDS or (kind == "ssh-ed25519" and not core.schema.at_least("7.12")):
        return None
    try:
        blob = base64.b64decode(encoded_key, validate=True)
    except (binascii.Error, ValueError):
        return None
    fields = list(_fields(blob))
    if len(fields) != _FIELDS[kind] or fields[0] != kind.encode():
        return None
    bits = _ED25519_BITS if kind == "ssh-ed25519" else int.from_bytes(fields[-1], "big").bit_length()
    return SshPublicKey(kind.removeprefix("ssh-"), bits, blob, comment)


def _fields(blob: bytes) -> Iterator[bytes]:
    """Yield the strings of a key; a truncated last one is omitted (RFC 4251, section 5)."""
    at = 0
    while at + _LENGTH <= len(blob):
        end = at + _LENGTH + int.from_bytes(blob[at : at + _LENGTH], "big")
        if end > len(blob):
            return
        yield blob[at + _LENGTH : end]
        at = end


def _keys(core: Core, user: str) -> Iterator[SshPublicKey]:
    table = core.store.table("/user/ssh-keys")
    for item in table.items if core.schema.has_menu("/user/ssh-keys") else ():
        key = public_key(core, core.store.text(table, item, "key") or "")
        if key is not None and core.store.text(table, item, "user") == user:
            yield key


def has_authorized_key(core: Core, user: str, blob: bytes) -> bool:
    """Return whether a user may log in over SSH with this key."""
    return any(key.blob == blob for key in _keys(core, user))


def by_password(core: Core, user: str) -> bool:
    """Return whether a user may log in over SSH by password; not with a key, unless the settings allow it."""
    table = core.store.table("/ip/ssh")
    always = core.store.text(table, table.items[0], "always-allow-password-login")
    policy = core.store.text(table, table.items[0], "password-authentication")
    if policy == "no":
        return False
    return "yes" in (always, policy) or not any(_keys(core, user))


def _source_text(address: str) -> str:
    return f" from {address}" if address else ""


def _is_allowed_address(values: dict[str, str], address: str) -> bool:
    allowed_networks = values.get("address", "")
    if not address:
        return True  # a local console
    caller = ip_address(address)
    return not allowed_networks or any(caller in ip_network(part) for part in allowed_networks.split(","))


NOT_ALLOWED = "failure: not allowed by device-mode"
INACTIVE = "inactivated, not allowed by device-mode"
FLAGGED_MESSAGE = (
    "failure: configuration flagged, check all router configuration for unauthorized changes and update device-mode"
)
SUSPICIOUS = ("scheduler", "pptp", "l2tp", "ipsec", "socks", "proxy", "smb")
"""Features for which a flagged router rejects new or enabled entries."""

_EVERY = frozenset(DeviceModeName)
_NOT_HOME = _EVERY - {DeviceModeName.HOME}
_UPPER = frozenset({DeviceModeName.ADVANCED, DeviceModeName.ROSE})
_NOBODY: frozenset[DeviceModeName] = frozenset()

FEATURES: dict[str, frozenset[DeviceModeName]] = {
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
    "container": frozenset({DeviceModeName.ROSE}),
    "install-any-version": _NOBODY,
    "partitions": _NOBODY,
    "routerboard": _NOBODY,
}
"""Feature to the modes in which it is allowed."""


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
"""Commands that are rejected where their feature is not allowed."""


def is_allowed(spec: RouterSpec, feature: str) -> bool:
    """Return whether the device-mode permits a feature; before 7.17 all were permitted."""
    if version_key(spec.version) < version_key("7.17"):
        return True
    return spec.device_mode.features.get(feature, spec.device_mode.mode in FEATURES[feature])
