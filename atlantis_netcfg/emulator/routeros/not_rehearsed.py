"""What router twins do not stand for."""

from __future__ import annotations

NOT_REHEARSED = (
    "throughput, latency and load of the real board",
    "every enabled port has a link; of radio only the agreement of two ends and a free-space level are emulated",
    "4G: coverage and speed; the SIM is one of its network, with the declared PIN and access point",
    "PoE: the figures of a load are those of the rehearsal, and no power is fed",
    "gateways and neighbours: every gateway on a connected network answers, only the listed neighbours answer a ping",
    "failover: canaries answer, so no link is left; check-gateway and netwatch work as the manual says",
    "VPN tunnels, DHCP leases, DNS lookups, NTP: they come up where the rehearsal says so, and carry nothing",
    "traffic of the robots: firewall, NAT and queues are stored; only the management path is walked through them",
    "OpenVPN: what a real router says of an imported file, beside the options that MikroTik's manual names",
    "certificates: the twin signs and imports them, without revocation lists, SCEP or passphrases",
    "menus outside the site's templates: names are checked by RouterOS' own command tree, values hardly",
    "the console: no completion, no colours, no scripts beyond :if and :do; what print looks like is approximate",
    "what a package contains: names, versions and architectures only; the configuration is not converted",
    "button presses",
)
"""What a run against router twins says nothing about; the rehearsal's report prints it."""
