"""The site is in the VPN: its router and its gateway computer have tunnels, through which the server responds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.ping import Echoes, odd_answers, read_ping
from atlantis_netcfg.checklist.probes.site_checks import parse
from atlantis_netcfg.core.messages import arg, conjunction, msg
from atlantis_netcfg.inventory.model import SshHost
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.report import Evidence

TUNNEL = "tun0"
"""Interface of the gateway computer (`templates/openvpn/client.conf.j2`)."""
_PINGS = 5
_REVOKED_HINT = "`provision vpn status` shows whether its identity is known; check its log for the server's reason"


def vpn_check(site: parse.OwnSite) -> base.Step:
    """Return the step on both tunnels, with five pings of the server from the gateway computer."""
    router = site.router is not None and site.device.vpn_client is not None
    gateway = site.gateway is not None and site.gateway.device.vpn_address is not None
    title = "The VPN is up"
    if router or gateway:
        return parse.step("vpn", title, _VpnCheck(site), site.hosts)
    members = {
        host.name: str(host.device.vpn_address)
        for host in site.inventory.site_hosts(site.name)
        if isinstance(host.device, SshHost) and host.device.vpn_address is not None
    }
    if not members:
        do = msg(f"The inventory has no device of {arg(site.name)} in the VPN: check how it reaches the other sites.")
        return parse.by_hand(
            "vpn", title, do, "Another site responds, over a path that is not open to the public.", site.hosts
        )
    return parse.by_hand(
        "vpn",
        title,
        msg(
            f"On {arg(conjunction(members))}, check the tunnel's address, and ping a member at another site through "
            "the tunnel. No router, gateway computer or control centre of this site is in the VPN, so no program can "
            "do it."
        ),
        msg(
            f"{arg(conjunction((msg(f'{arg(name)} has {arg(address)}') for name, address in members.items())))}, and "
            "the other site responds."
        ),
        tuple(members),
    )


@dataclass(frozen=True, slots=True)
class _VpnCheck:
    """Check that the VPN is up."""

    site: parse.OwnSite

    @property
    def _server(self) -> str | None:
        """Address of the server in the tunnel; None if it has none."""
        host = self.site.inventory.hosts.get(self.site.inventory.pilot.vpn.server)
        address = getattr(host.device, "vpn_address", None) if host is not None else None
        return None if address is None else str(address)

    @property
    def _is_gateway_in_vpn(self) -> bool:
        return self.site.gateway is not None and self.site.gateway.device.vpn_address is not None

    def asks(self) -> tuple[base.Question, ...]:
        request: tuple[base.Question, ...] = ()
        if self.site.router is not None and self.site.device.vpn_client is not None:
            request += parse.ask("clients", self.site, "/interface/ovpn-client", "name", "running", "disabled")
            request += parse.ask(
                "addresses", self.site, "/ip/address", "address", "interface", "disabled", "invalid", "dynamic"
            )
        if self._is_gateway_in_vpn:
            request += parse.run("gateway", self.site, "ip -j addr show")
            if self._server is not None:
                request += parse.run(
                    "ping", self.site, f"ping -n -c {_PINGS} -i 1 -W 10 -I {TUNNEL} {self._server}", within_s=40.0
                )
        return (*request, *parse.link_requests(self.site))

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        findings = list(self._judge_router(results))
        if self._is_gateway_in_vpn:
            findings += self._judge_gateway(results)
        return base.ProbeResult(tuple(findings), tuple(self._evidence(results)))

    def _judge_router(self, results: Mapping[str, base.Answer]) -> Iterator[LinkFinding]:
        if "clients" not in results or self.site.router is None or self.site.view is None:
            return
        name, client, tunnel = self.site.router.name, self.site.device.vpn_client, self.site.view.tunnel
        assert client is not None  # noqa: S101 - the question is asked for routers with one
        assert tunnel is not None  # noqa: S101 - the same
        result = parse.rows(results["clients"], name, "its tunnels", "name")
        if isinstance(result, LinkFinding):
            yield result
            return
        row = next((row for row in result if row.get("name") == tunnel.interface), None)
        if row is None:
            hint = msg(f"`provision vpn install device={arg(name)}`, then `provision site={arg(self.site.name)}`")
            yield parse.fail("router-no-tunnel", msg(f"{arg(name)} has no tunnel {arg(tunnel.interface)}"), hint)
        elif parse.yes(row, "disabled"):
            yield parse.fail(
                "router-tunnel-off",
                msg(f"{arg(tunnel.interface)} of {arg(name)} is disabled"),
                "apply the site's configuration to enable it",
            )
        elif not parse.yes(row, "running"):
            yield parse.fail(
                "router-tunnel-down",
                msg(f"{arg(tunnel.interface)} of {arg(name)} is not connected to the VPN server"),
                _REVOKED_HINT,
            )
        else:
            yield self._check_address(name, tunnel.interface, str(client.address), results["addresses"])

    def _check_address(self, name: str, interface: str, expected_address: str, answer: base.Answer) -> LinkFinding:
        current = parse.addresses(answer, name)
        if isinstance(current, LinkFinding):
            return current
        there = [str(item.address.ip) for item in current if item.interface == interface and not item.dead]
        return _compare_address("router", msg(f"{arg(interface)} of {arg(name)}"), expected_address, there)

    def _judge_gateway(self, results: Mapping[str, base.Answer]) -> Iterator[LinkFinding]:
        gateway = self.site.gateway
        assert gateway is not None  # noqa: S101 - the caller checks it
        current = parse.addresses(results["gateway"], gateway.name)
        if isinstance(current, LinkFinding):
            yield current
            return
        there = [str(item.address.ip) for item in current if item.interface == TUNNEL]
        if not there:
            hint = msg(
                f"on {arg(gateway.name)}: `systemctl status openvpn-client@atlantis`; its log shows what the server "
                "sent"
            )
            yield parse.fail(
                "gateway-no-tunnel", msg(f"{arg(gateway.name)} has no tunnel: {arg(TUNNEL)} is missing"), hint
            )
            return
        yield _compare_address(
            "gateway", msg(f"{arg(TUNNEL)} of {arg(gateway.name)}"), str(gateway.device.vpn_address), there
        )
        if "ping" in results:
            yield from self._judge_ping(gateway.name, results)
        else:
            hint = "set `vpn_address` of the VPN server, so that it can be pinged"
            yield parse.unknown(
                "server-not-asked",
                msg(f"the address at which {arg(gateway.name)} would ping the server is unknown"),
                hint,
            )

    def _judge_ping(self, name: str, results: Mapping[str, base.Answer]) -> Iterator[LinkFinding]:
        answer, server = results["ping"], self._server or ""
        if isinstance(answer, base.CommandResult) and answer.trouble is not None:
            yield parse.silent(name, answer.trouble, answer.words)
            return
        echoes = read_ping(answer.out, server) if isinstance(answer, base.CommandResult) else None
        if echoes is None or echoes.sent_count < _PINGS:
            yield parse.unreadable(name, "a ping")
            return
        strange = tuple(odd_answers(msg(f"the VPN server {arg(server)}"), echoes))
        yield from strange or (self._judge_echoes(echoes, server, results),)

    def _judge_echoes(self, echoes: Echoes, server: str, results: Mapping[str, base.Answer]) -> LinkFinding:
        sent_count, received_count = echoes.sent_count, echoes.received_count
        if not received_count and self._is_over_satellite(results):
            message = msg(
                f"the VPN server {arg(server)} replied to none of {arg(sent_count)} pings, over a satellite that may "
                "pause for 70 s"
            )
            return parse.unknown(
                "server-silent", message, "repeat the check; three rounds without a response are more than a pause"
            )
        if not received_count:
            hint = "check whether the VPN server is running: `provision vpn status` queries it"
            return parse.fail(
                "server-silent",
                msg(f"the VPN server {arg(server)} replied to none of {arg(sent_count)} pings through the tunnel"),
                hint,
            )
        took = msg("" if echoes.mean_ms is None else f", in {arg(echoes.mean_ms):g} ms")
        text = msg(
            f"the VPN server {arg(server)} replied to {arg(received_count)} of {arg(sent_count)} pings through the "
            f"tunnel{arg(took)}"
        )
        return (
            parse.good("server-answers", text)
            if received_count == sent_count
            else parse.warn("server-lossy", text, msg(f"check `provision links site={arg(self.site.name)}`"))
        )

    def _is_over_satellite(self, results: Mapping[str, base.Answer]) -> bool:
        link = parse.active_link(self.site, results)
        return link is not None and link.kind.traits.allow_list

    def _evidence(self, results: Mapping[str, base.Answer]) -> Iterator[Evidence]:
        ping = results.get("ping")
        line = (
            next((line for line in ping.out.splitlines() if " transmitted" in line), "")
            if isinstance(ping, base.CommandResult)
            else ""
        )
        if line:
            yield parse.measured_evidence(msg(f"pings of {arg(self._server)} through the tunnel"), line)
        clients = results.get("clients")
        result = parse.rows(clients, "", "", "name") if clients is not None else ()
        for row in () if isinstance(result, LinkFinding) else result:
            yield parse.read(
                msg(f"tunnel {arg(row.get('name', '?'))} of the router"), f"running={row.get('running', '?')}"
            )


def _compare_address(code: str, what: str, expected_address: str, there: list[str]) -> LinkFinding:
    if expected_address in there:
        return parse.good(
            f"{code}-tunnel", msg(f"{arg(what)} is up, with its address {arg(expected_address)} of the inventory")
        )
    has = there[0] if there else "no address"
    message = msg(f"{arg(what)} is up with {arg(has)}; the inventory says {arg(expected_address)}")
    return parse.fail(
        f"{code}-tunnel-address", message, "`provision vpn sync` makes the server assign each member its address"
    )
