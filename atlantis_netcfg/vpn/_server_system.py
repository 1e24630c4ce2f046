"""What stands around the VPN's server on its computer: units, the firewall's loading, who was last seen, the kernel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.gateway.parts import File, Step, Unit
from atlantis_netcfg.render import environment, template_folder
from atlantis_netcfg.vpn.firewall import TABLE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

__all__ = [
    "CONF",
    "FIREWALL",
    "FLOOR",
    "FOLDER",
    "KERNEL_STEPS",
    "NO_CONF",
    "SEEN",
    "SERVICE",
    "system_files",
    "system_units",
]

FOLDER = "/etc/openvpn/atlantis"
CONF = "/etc/openvpn/server/atlantis.conf"
SERVICE = "openvpn-server@atlantis.service"
FIREWALL = "/etc/atlantis/vpn.nft"
SEEN = "/var/lib/atlantis/vpn/seen.json"
"""`{"format": 1, "seen": {common name: {"last": seconds since 1970, "real": address:port, "address": …}}}`."""

FLOOR: Mapping[str, Any] = {
    "package": "openvpn",
    "program": "/usr/sbin/openvpn",
    "branches": [
        {"branch": "2.6", "upstream": "2.6.21", "packages": ["2.6.14-0+deb12u2"]},
        {"branch": "2.7", "upstream": "2.7.5", "packages": []},
    ],
}
"""Facts 11: below it an authenticated client keeps its session although it is told to go, or stops the server."""

NO_CONF = "this openvpn does not know an option of it: `openvpn --version` on the server tells which one it is"

_UNITS = "/etc/systemd/system"
_DROP_IN = f"{_UNITS}/{SERVICE}.d/atlantis.conf"
_FIREWALL_UNIT = "atlantis-vpn-firewall.service"
_SEEN_TIMER = "atlantis-vpn-seen.timer"
_SEEN_SERVICE = "atlantis-vpn-seen.service"
_GUARD = f"{_UNITS}/atlantis-vpn-guard.service"
_SEEN_PROGRAM = "/usr/local/lib/atlantis/vpn_seen.py"
_SYSCTL = "/etc/sysctl.d/60-atlantis-vpn.conf"

_NO_REDIRECTS = 'for interface in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 0 > "$interface" || exit; done'
KERNEL_STEPS = (
    Step("let the kernel forward for the VPN", ("sysctl", "-q", "-p", _SYSCTL), (_SYSCTL,)),
    Step("send members no ICMP redirects", ("sh", "-c", _NO_REDIRECTS), (_SYSCTL,)),
)


def system_files() -> Iterator[File]:
    """All of it but the configuration of OpenVPN itself; the same for every pilot."""
    yield File(
        _SYSCTL,
        "# The VPN server routes between its members, as far as its firewall lets it.\nnet.ipv4.ip_forward = 1\n"
        "# Nobody is told of a way past it: an ICMP redirect would send members to each other.\n"
        "net.ipv4.conf.all.send_redirects = 0\nnet.ipv4.conf.default.send_redirects = 0\n"
        "# Of interfaces that are there before this is read; a program that knows no pattern leaves it out.\n"
        "-net.ipv4.conf.*.send_redirects = 0\n",
    )
    yield File(_DROP_IN, _render("hardening.conf.j2"))
    yield File(f"{_UNITS}/{_FIREWALL_UNIT}", _render("firewall.service.j2", firewall=FIREWALL))
    program = (template_folder() / "openvpn" / "vpn_seen.py").read_text(encoding="utf-8")
    yield File(_SEEN_PROGRAM, program, mode="0755")
    yield File(f"{_UNITS}/nftables.service.d/atlantis-vpn.conf", _render("nftables.conf.j2", firewall=FIREWALL))
    yield File(_GUARD, _render("guard.service.j2", firewall=FIREWALL, table=TABLE))
    yield File(f"{_UNITS}/{_SEEN_SERVICE}", _render("seen.service.j2", program=_SEEN_PROGRAM))
    yield File(f"{_UNITS}/{_SEEN_TIMER}", _render("seen.timer.j2"))


def system_units(keys: tuple[str, ...]) -> tuple[Unit, ...]:
    """The firewall before the tunnel, which a change of `keys` or of the configuration starts anew, and no other."""
    firewall = Unit(_FIREWALL_UNIT, enabled=True, active=True, after=(FIREWALL,), reload=True)
    tunnel = Unit(SERVICE, enabled=True, active=True, after=(CONF, _DROP_IN, *keys))
    seen = Unit(_SEEN_TIMER, enabled=True, active=True, after=(f"{_UNITS}/{_SEEN_TIMER}",))
    return firewall, tunnel, seen


def _render(template: str, **values: object) -> str:
    return environment().get_template(f"openvpn/{template}").render(**values)
