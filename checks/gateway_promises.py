"""What the roles promise of a computer, read from the same parts of the declaration that the roles get."""

from __future__ import annotations

import base64
import hashlib
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules.env_conflicts import (
    OF_ALL,
    OF_AN_ACCOUNT,
    OF_SYSTEMD,
)
from atlantis_netcfg.computers.interop import PREFIX
from atlantis_netcfg.computers.services import ENVIRONMENT, VPN_INTERFACE, secret_placeholder
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.inventory.model import Gateway, ServerComputer
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.operations.computers.parts import ACCESS, PARTS, concerns
from atlantis_netcfg.vpn.client import IDENTITY, SERVICE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.inventory import Host, Inventory

__all__ = ["BUILT", "ENVIRONMENT", "JOURNAL", "LOCALE", "SSHD", "FileThere", "Promises", "UnitThere", "promises"]

SSHD = "/etc/ssh/sshd_config.d/"
JOURNAL = "/etc/systemd/journald.conf.d/"
FIREWALL = "/etc/nftables.conf"
LOCALE = "/etc/default/locale"
BUILT = f"{PREFIX}/current/build.json"


@dataclass(frozen=True, slots=True)
class FileThere:
    """A file; None is not promised."""

    path: str
    content: bytes | None
    """None: it holds a secret that is vaulted, and nothing is opened here."""
    mode: str | None = None
    owner: str | None = None
    group: str | None = None

    @property
    def sha256(self) -> str | None:
        return None if self.content is None else hashlib.sha256(self.content).hexdigest()


@dataclass(frozen=True, slots=True)
class UnitThere:
    """A unit; None is not promised."""

    name: str
    enabled: bool | None
    active: bool | None


@dataclass(slots=True, repr=False)
class Promises:
    """Of one computer."""

    host: Host
    lacking: dict[str, str] = field(default_factory=dict)
    """Part to what the declaration lacks for it: of such a part nothing can be checked."""
    files: dict[str, FileThere] = field(default_factory=dict)
    links: dict[str, str] = field(default_factory=dict)
    absent: list[str] = field(default_factory=list)
    folders: list[str] = field(default_factory=list)
    """Nothing may stand in them but the files."""
    units: dict[str, UnitThere] = field(default_factory=dict)
    readers: list[str] = field(default_factory=list)
    """Units that take the environment of ROS 2 when they start."""
    packages: dict[str, str | None] = field(default_factory=dict)
    """Name to version, which may end in `*`; None: any."""
    tunnel: str | None = None
    """Address in the VPN; None: it is no member."""
    build: Mapping[str, Any] | None = None
    alone: Mapping[str, str] = field(default_factory=dict)
    """Variables that nothing else on the computer may set otherwise."""
    ours: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        """Short: pytest prints it with every failure."""
        return f"the promises of {self.host.name}"

    def text(self, path: str) -> str:
        """What a promised file says; empty where none is promised."""
        content = self.files[path].content if path in self.files else None
        return "" if content is None else content.decode()

    def settings(self, folder: str) -> dict[str, str]:
        """`Key value` and `Key=value` lines of the promised files in a folder, without comments and sections."""
        lines = [line for path in self.files if path.startswith(folder) for line in self.text(path).splitlines()]
        pairs = (re.match(r"(\w+)\s*[=\s]\s*(.+)", line) for line in lines if not line.startswith("#"))
        return {pair[1]: pair[2].strip() for pair in pairs if pair is not None}

    @property
    def table(self) -> str:
        """Family and name of the firewall's table."""
        found = re.search(r"^table (\w+ \w+) \{", self.text(FIREWALL), re.MULTILINE)
        return found[1] if found else "inet atlantis"

    def questions(self) -> dict[str, Any]:
        """All that the computer is asked, for `gateway_probe`."""
        account = self.host.device.account if isinstance(self.host.device, ServerComputer) else "root"
        accounts = [f"{home}/{name}" for home in ("/root", "/home/*") for name in OF_AN_ACCOUNT]
        places = " ".join((*OF_ALL, *OF_SYSTEMD, *accounts))
        table = f"nft -s list table {self.table}"
        return {
            "files": [*self.files, *self.links, *self.absent],
            "folders": self.folders,
            "texts": [BUILT],
            "units": [*self.units],
            "environments": self.readers,
            "packages": [*self.packages],
            "room": ["/", "/var"],
            "said": {
                "sshd": ("sshd", "-T", "-C", f"user={account},host=localhost,addr=127.0.0.1"),
                "journal": ("systemd-analyze", "cat-config", "systemd/journald.conf"),
                "journal_usage": ("journalctl", "--disk-usage"),
                "locales": ("locale", "-a"),
                "tracking": ("chronyc", "-n", "-c", "tracking"),
                "firewall": ("sh", "-c", table),
                # What the file means, in a network namespace that is gone a moment later.
                "firewall_meant": ("unshare", "-n", "sh", "-c", f"nft -f {FIREWALL} && {table}"),
                "tunnel": ("ip", "-4", "-oneline", "address", "show", "dev", VPN_INTERFACE),
                # Of its identity the certificate alone, for the key leaves the computer for nobody.
                "vpn_certificate": ("sed", "-n", "/^<cert>$/,/^<.cert>$/p", IDENTITY),
                "login": ("env", "-i", "HOME=/root", "sh", "-lc", "env"),
                "elsewhere": ("sh", "-c", f"grep -HnsE '{'|'.join(self.alone) or '^$'}' {places} || true"),
            },
        }


def promises(declaration: Inventory, host: Host) -> Promises:
    """Put together what all parts say of a computer."""
    made = Promises(host)
    for name, part in PARTS.items():
        if name == ACCESS or not concerns(name, host):
            continue
        try:
            values = part(declaration, host, Request())
            _take(made, values, _secrets(declaration, host, values))
        except NetcfgError as error:
            made.lacking[name] = f"{error}; {error.hint}" if error.hint else str(error)
    if isinstance(host.device, ServerComputer) and host.device.vpn_address is not None:
        # Whether or not its identity is on this computer: the computer has one.
        made.tunnel = str(host.device.vpn_address)
        made.units[SERVICE] = UnitThere(SERVICE, enabled=True, active=True)
    return made


def _secrets(declaration: Inventory, host: Host, values: Mapping[str, Any]) -> dict[str, Secret | None]:
    """Word in a file to the secret that stands there on the computer."""
    wifi = {word: declaration.vehicles[key].endpoints.wifi for word, key in (values.get("secrets") or {}).items()}
    found = {word: None if item is None else item.key for word, item in wifi.items()}
    opened = host.device.access_point if isinstance(host.device, Gateway) else None
    if opened is not None and values.get("own_secret"):
        found[values["own_secret"]] = opened.key
    qualify = declaration.pilot.qualify
    if qualify is not None and values.get("qualify_secret"):
        found[values["qualify_secret"]] = qualify.key
    declared = host.device.services if isinstance(host.device, ServerComputer) else ()
    boxes = [(each.name, each.container.environment) for each in declared if each.container is not None]
    found |= {secret_placeholder(name, each.name): each.secret for name, rows in boxes for each in rows if each.secret}
    return found


def _filled(text: str, secrets: Mapping[str, Secret | None]) -> bytes | None:
    """A text with its secrets; None where one of them is still sealed."""
    for word, secret in secrets.items():
        if word not in text:
            continue
        try:
            text = text.replace(word, "" if secret is None else secret.reveal())
        except NetcfgError:
            return None
    return text.encode()


def _take(made: Promises, values: Mapping[str, Any], secrets: Mapping[str, Secret | None]) -> None:
    configure, packages = values.get("configure") or {}, values.get("packages") or {}
    for file in _files(values, secrets):
        made.files[file.path] = file
    made.links |= {link["path"]: link["target"] for link in configure.get("links") or ()}
    made.absent += [*(configure.get("absent") or ()), *(packages.get("absent") or ())]
    made.folders += configure.get("only") or ()
    for unit in configure.get("units") or ():
        if ENVIRONMENT in (unit.get("after") or ()):
            made.readers.append(unit["name"])
        if unit.get("enabled") is not None or unit.get("active") is not None:
            made.units[unit["name"]] = UnitThere(unit["name"], unit.get("enabled"), unit.get("active"))
    made.packages |= {package["name"]: package.get("version") for package in packages.get("packages") or ()}
    made.build = values.get("build") or made.build
    elsewhere = values.get("elsewhere") or {}
    made.alone = {**made.alone, **elsewhere.get("variables", {})}
    made.ours += elsewhere.get("ours", ())


def _files(values: Mapping[str, Any], secrets: Mapping[str, Secret | None]) -> Iterator[FileThere]:
    """Of whatever module lays it down."""
    packages, network = values.get("packages") or {}, values.get("network") or {}
    for row in (values.get("configure") or {}).get("files") or ():
        kept = {key: row.get(key, usual) for key, usual in (("mode", "0644"), ("owner", "root"), ("group", "root"))}
        yield FileThere(row["path"], _filled(row["content"], secrets), **kept)
    for row in (*(packages.get("sources") or ()), *(packages.get("pins") or ())):
        yield FileThere(row["path"], row["content"].encode())
    for row in packages.get("keys") or ():
        yield FileThere(row["path"], base64.b64decode(row["content_base64"]))
    if network:
        yield FileThere(network["path"], network["content"].encode(), network["mode"])
