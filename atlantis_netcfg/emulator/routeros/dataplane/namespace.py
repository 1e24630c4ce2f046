"""One router's namespace: brought to the state of its rows, again after each change of them."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.emulator.lab import hosts

if TYPE_CHECKING:
    from collections.abc import Iterable

    from atlantis_netcfg.emulator.routeros.dataplane.rows import NetworkState

_QUIET: Final = ("net.ipv4.icmp_ratelimit=0", "net.ipv4.conf.default.rp_filter=0", "net.ipv6.conf.all.disable_ipv6=1")
_BRIDGE: Final = ("net.bridge.bridge-nf-call-iptables=0",)
"""What a bridge carries does not pass the firewall: RouterOS' default `use-ip-firewall=no`."""


def plug_of(port: str) -> str:
    """Return the device at the other end of a port's cable, as long as nobody has taken it."""
    return f"{port[:11]}-far"


@dataclass
class RouterNamespace:
    """The namespace `name`, which exists already; `apply` brings it to a state."""

    name: str
    _state: NetworkState | None = None
    _devices: set[str] = field(default_factory=set)

    def apply(self, state: NetworkState) -> bool:
        """Bring the namespace to a state; return whether its firewall was loaded. Raises MachineError."""
        old = self._state
        if state == old:
            return False
        if old is None:
            self._set([*_QUIET, *(_BRIDGE if Path("/proc/sys/net/bridge").exists() else ())])
            self._take_over(state)
        self._add_devices(state)
        # What hangs on a device that went down or on an address that is gone, Linux has removed already.
        self._ip(_removals(old, state) if old is not None else (), force=True)
        self._ip(_additions(old, state))
        if old is None or old.settings != state.settings:
            self._set(state.settings)
        is_loaded = old is None or (old.firewall, old.counters) != (state.firewall, state.counters)
        if is_loaded:
            self.run("nft", "-f", "-", text=state.firewall)
        self._state = state
        return is_loaded

    @property
    def ports(self) -> tuple[str, ...]:
        """Devices with a plug, those that are up."""
        return () if self._state is None else tuple(name for name in self._state.ports if name in self._state.up)

    @property
    def tunnels(self) -> tuple[str, ...]:
        """Devices of VPN clients, those that are up."""
        return () if self._state is None else tuple(name for name in self._state.tunnels if name in self._state.up)

    def run(self, *words: str, text: str | None = None) -> str:
        """Run a program in the namespace and return its output. Raises MachineError."""
        return hosts.run_in_namespace(self.name, *words, text=text)

    def _take_over(self, state: NetworkState) -> None:
        """Keep devices of an earlier router with their cables, without what hangs on them."""
        links = {link["ifname"] for link in json.loads(self.run("ip", "-j", "link"))}
        self._devices |= links & {*state.bridges, *state.tunnels, *state.ports}
        if self._devices:
            self._ip(line for name in self._devices for line in (f"link set {name} down", f"address flush dev {name}"))
            self._ip(("rule flush", "rule add priority 32766 table main"))

    def _add_devices(self, state: NetworkState) -> None:
        lines = {
            **{name: f"link add {name} type bridge" for name in state.bridges},
            **{name: f"tuntap add dev {name} mode tun" for name in state.tunnels},
            **{name: f"link add {name} type veth peer name {plug_of(name)}" for name in state.ports},
        }
        new = {name: line for name, line in lines.items() if name not in self._devices}
        self._ip([*new.values(), *(f"link set {plug_of(name)} up" for name in state.ports if name in new)])
        self._devices |= set(lines)

    def _set(self, settings: Iterable[str]) -> None:
        self.run("sysctl", "-qw", *settings)

    def _ip(self, lines: Iterable[str], *, force: bool = False) -> None:
        hosts.ip_batch(self.name, lines, force=force)


def _removals(old: NetworkState, new: NetworkState) -> list[str]:
    return [
        *(f"rule del {line}" for line in old.rules if line not in new.rules),
        *(f"route del {line}" for line in old.routes if line not in new.routes),
        *(f"address del {line}" for line in old.addresses if line not in new.addresses),
        *(f"link set {port} nomaster" for port, bridge in old.masters if (port, bridge) not in new.masters),
        *(f"link set {name} down" for name in old.up if name not in new.up),
        *(f"link del {name}" for name in old.bridges if name not in new.bridges),
    ]


def _additions(old: NetworkState | None, new: NetworkState) -> list[str]:
    masters, up, addresses, rules = (
        (old.masters, old.up, old.addresses, old.rules) if old is not None else ((), (), (), ())
    )
    return [
        *(f"link set {port} master {bridge}" for port, bridge in new.masters if (port, bridge) not in masters),
        *(f"link set {name} up" for name in new.up if name not in up),
        *(f"address replace {line}" for line in new.addresses if line not in addresses),
        *(f"rule add {line}" for line in new.rules if line not in rules),
        *(f"route replace {line}" for line in new.routes),
    ]
