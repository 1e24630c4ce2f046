"""Data reach the control centre and come back: messages over the active link and the VPN, with route and delay.

Each message contains a new random token, and is sent like the data of any program, by the computer's regular route. A
small program of ours at the other end (`computers/reflector.py`) returns the token, and reports on which interface and
from which address the message arrived. A gateway probes the control centres; a control centre probes all gateways of
the pilot.

It does not show that a partner's program works there, or that large data arrive.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.site_checks import parse
from atlantis_netcfg.checklist.probes.site_checks.vpn import TUNNEL
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.report import Evidence
    from atlantis_netcfg.inventory import Inventory

NAME = "data-reaches-scc"


@dataclass(frozen=True, slots=True)
class FarComputer:
    """A computer at the remote end."""

    name: str
    address: str
    """Address in the VPN."""
    site: str


def far_computers(inventory: Inventory, asking: model.ServerComputer) -> tuple[FarComputer, ...]:
    """Return a computer's targets: for a control centre the gateways, for all others the control centres."""
    kind = model.Gateway if isinstance(asking, model.ControlCentre) else model.ControlCentre
    return tuple(
        FarComputer(name, str(host.device.vpn_address), host.site)
        for name, host in inventory.hosts.items()
        if isinstance(host.device, kind) and host.device.vpn_address is not None
    )


def data_reaches_check(site: parse.OwnSite) -> base.Step:
    """Return the step; it applies at every site, so a person does it if a computer is not in the VPN."""
    computer = site.gateway
    far = () if computer is None else far_computers(site.inventory, computer.device)
    if computer is not None and computer.device.vpn_address is not None and far:
        centre = isinstance(computer.device, model.ControlCentre)
        title = "Data reach every gateway and come back" if centre else "Data reach the control centre and come back"
        return parse.step(NAME, title, _DataReaches(site, far), (computer.name, *(item.name for item in far)))
    do = f"No program can send data through the VPN from {site.name} to the control centre: send some yourself."
    return parse.by_hand(
        NAME, "Data reach the control centre and come back", do, "It arrives, and a response comes back.", site.hosts
    )


@dataclass(frozen=True, slots=True)
class _DataReaches:
    """Check that data reach the control centre and come back."""

    site: parse.OwnSite
    far: tuple[FarComputer, ...]

    @property
    def _asking(self) -> tuple[str, str]:
        """Name and VPN address of the probing computer."""
        assert self.site.gateway is not None  # noqa: S101 - the step is a person's without one
        return self.site.gateway.name, str(self.site.gateway.device.vpn_address)

    def asks(self) -> tuple[base.Question, ...]:
        far = (question for item in self.far for question in self._questions(item))
        return (*parse.run("addresses", self.site, "ip -j addr show"), *far, *parse.link_requests(self.site))

    def _questions(self, far: FarComputer) -> tuple[base.Question, ...]:
        way = parse.run(f"way {far.name}", self.site, f"ip -j route get {far.address}")
        return (
            *way,
            base.ReflectRequest(
                f"data {far.name}", base.Place.GATEWAY, self._asking[1], far.address, model.REFLECTOR_PORT
            ),
        )

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        name, address = self._asking
        current = parse.addresses(results["addresses"], name)
        if isinstance(current, LinkFinding):
            return base.ProbeResult((current,))
        if address not in {str(item.address.ip) for item in current if item.interface == TUNNEL}:
            hint = f"on {name}: `systemctl status openvpn-client@atlantis`; its log shows what the server sent"
            message = (
                f"{name} is not in the VPN: {TUNNEL} does not have {address}, so that nothing can be sent through it"
            )
            return base.ProbeResult((parse.fail("no-vpn", message, hint),))
        findings = [self._of(item, results) for item in self.far]
        evidence = [each for item in self.far for each in self._evidence(item, results)]
        return base.ProbeResult(tuple(findings), tuple(evidence))

    def _of(self, far: FarComputer, results: Mapping[str, base.Answer]) -> LinkFinding:
        """Judge the route to a computer and its responses."""
        name = self._asking[0]
        wrong = _wrong_way(name, far, results[f"way {far.name}"])
        if wrong is not None:
            return wrong
        answer = results[f"data {far.name}"]
        if not isinstance(answer, base.ReflectResult):
            return parse.unreadable(name, "what came back")
        if answer.trouble is not None:
            return _not_sent(name, far, answer)
        if not answer.answers:
            return self._silence(far, len(answer.tokens), results)
        strange = next(filter(None, (_strange(far, self._asking[1], item, answer) for item in answer.answers)), None)
        return strange or self._judge_delays(far, answer, results)

    def _silence(self, far: FarComputer, message_count: int, results: Mapping[str, base.Answer]) -> LinkFinding:
        """Return the finding for silence; over a satellite, or from an unattended gateway, it proves nothing."""
        link, over = parse.active_link(self.site, results), self._over(results)
        if link is not None and link.kind.traits.allow_list:
            return parse.unknown(
                "far-end-silent-satellite",
                f"{far.name} responded to none of {message_count} messages, over a satellite that may pause for 70 s",
                "repeat the check; three rounds without a response are more than a satellite pause",
            )
        if isinstance(getattr(self.site.gateway, "device", None), model.ControlCentre):
            return parse.unknown(
                "gateway-silent",
                f"{far.name} responded to none of {message_count} messages: it may be off",
                f"check that {far.name} is switched on; the checklist of {far.site} tests from its end",
            )
        return parse.fail(
            "far-end-silent",
            f"{far.name} responded to none of {message_count} messages {over}; the item `vpn` shows whether its "
            "server responds",
            f"check that {far.name} is switched on; the checklist of {far.site} tests from its end",
        )

    def _judge_delays(
        self, far: FarComputer, answer: base.ReflectResult, results: Mapping[str, base.Answer]
    ) -> LinkFinding:
        delays = {_row(item)["token"]: item.delay_s for item in answer.answers}
        worst, limit = max(delays.values()), self.site.site_config.checklist.answer_within_s
        emulation_note = ", emulated" if any(_row(item).get("emulated") for item in answer.answers) else ""
        text = (
            f"{far.name} responded to {len(delays)} of {len(answer.tokens)} messages {self._over(results)}, the "
            f"slowest in {worst * 1000:.0f} ms{emulation_note}"
        )
        if limit is not None and worst > limit:
            message = f"{text}, but `answer_within_s` is {limit:g}"
            return parse.fail("late", message, f"check `provision links site={self.site.name}`")
        if len(delays) < len(answer.tokens):
            return parse.warn("data-lost", text, f"check `provision links site={self.site.name}`")
        return parse.good("data-reaches", text)

    def _over(self, results: Mapping[str, base.Answer]) -> str:
        """Describe the route; the router reports which link carries the tunnel."""
        link = parse.active_link(self.site, results)
        over = "an unknown link" if link is None else link.name
        return f"through the VPN over {over}"

    def _evidence(self, far: FarComputer, results: Mapping[str, base.Answer]) -> Iterator[Evidence]:
        name, address = self._asking
        answer = results[f"data {far.name}"]
        way = parse.parse_json_list(results[f"way {far.name}"], name, "its route")
        if not isinstance(way, LinkFinding) and way:
            yield parse.read(f"route from {name} to {far.name}", f"{way[0].get('dev', '?')}, {self._over(results)}")
        for item in answer.answers if isinstance(answer, base.ReflectResult) else ():
            row = _row(item)
            there = f"there from {row.get('from', '?')} by {row.get('by', '?')}, back by {item.interface}"
            yield parse.measured_evidence(
                f"message from {address} to {far.address} and back", f"{item.delay_s * 1000:.0f} ms, {there}"
            )


def _wrong_way(name: str, far: FarComputer, answer: base.Answer) -> LinkFinding | None:
    """Return why data would not go through the VPN; None if they would."""
    if getattr(answer, "trouble", None) is None and "unreachable" in getattr(answer, "err", "").lower():
        return parse.fail(
            "no-way",
            f"{name} has no route to {far.name} at {far.address}",
            f"on {name}: `systemctl restart openvpn-client@atlantis` restores the tunnel's routes",
        )
    way = parse.parse_json_list(answer, name, "its route to the other end")
    if isinstance(way, LinkFinding):
        return way
    device = str(way[0].get("dev")) if way else "another path"
    if device == TUNNEL:
        return None
    return parse.fail(
        "way-outside-vpn",
        f"data for {far.name} would leave {name} by {device} instead of the VPN",
        f"on {name}: `ip route get {far.address}` shows the route; remove the one that was added manually",
    )


def _not_sent(name: str, far: FarComputer, answer: base.ReflectResult) -> LinkFinding:
    if answer.trouble is base.Trouble.REFUSED:
        return parse.fail(
            "nobody-answers-data",
            f"{far.name} is reachable, but nothing there responds to messages",
            f"on {far.name}: `systemctl status atlantis-reflector`; applying the configuration of {far.site} starts it",
        )
    if answer.trouble is base.Trouble.UNREACHABLE:
        return parse.fail(
            "data-not-sent",
            f"{name} could not send to {far.name}: {answer.words}",
            f"on {name}: `ip route get {far.address}`; the item `vpn` shows whether the tunnel is up",
        )
    return parse.silent(name, answer.trouble or base.Trouble.SILENT, answer.words)


def _row(item: base.ReflectReply) -> dict[str, Any]:
    """Return the content of a response; empty if it is invalid."""
    try:
        row = json.loads(item.data)
    except (ValueError, RecursionError):
        return {}
    return row if isinstance(row, dict) else {}


def _strange(far: FarComputer, asking: str, item: base.ReflectReply, result: base.ReflectResult) -> LinkFinding | None:
    """Return why a response does not count; None if the same token came back, through the VPN both ways."""
    row = _row(item)
    if row.get("token") not in result.tokens:
        return parse.fail(
            "other-data",
            f"{item.sender} responds with other data than was sent",
            f"find out what responds at {far.address}: apply the configuration of the site of {far.name}, then "
            "repeat the check",
        )
    if item.sender != far.address or row.get("to") != far.address:
        return parse.fail(
            "answered-elsewhere",
            f"{item.sender} responds to data sent to {far.address}",
            f"addresses must not be translated inside the VPN: check the NAT rules between here and {far.name}",
        )
    if row.get("host") != far.name:
        return parse.fail(
            "other-computer",
            f"{row.get('host')} responds at {far.address}, the address of {far.name}",
            "each VPN address belongs to one member: `provision vpn status` shows who has it",
        )
    if item.interface != TUNNEL or row.get("by") != TUNNEL or row.get("from") != asking:
        return parse.fail(
            "answered-outside-vpn",
            f"a message left the VPN: it reached {far.name} from {row.get('from')} by {row.get('by')}, and its "
            f"response came back by {item.interface}",
            f"check the routes of both computers: `ip route get {far.address}` here, `ip route get {asking}` there",
        )
    return None
