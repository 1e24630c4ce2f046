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
from atlantis_netcfg.core.messages import arg, msg
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
    do = msg(
        f"No program can send data through the VPN from {arg(site.name)} to the control centre: send some yourself."
    )
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
        way = parse.run(msg(f"way {arg(far.name)}"), self.site, f"ip -j route get {far.address}")
        return (
            *way,
            base.ReflectRequest(
                msg(f"data {arg(far.name)}"), base.Place.GATEWAY, self._asking[1], far.address, model.REFLECTOR_PORT
            ),
        )

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        name, address = self._asking
        current = parse.addresses(results["addresses"], name)
        if isinstance(current, LinkFinding):
            return base.ProbeResult((current,))
        if address not in {str(item.address.ip) for item in current if item.interface == TUNNEL}:
            hint = msg(
                f"on {arg(name)}: `systemctl status openvpn-client@atlantis`; its log shows what the server sent"
            )
            message = msg(
                f"{arg(name)} is not in the VPN: {arg(TUNNEL)} does not have {arg(address)}, so that nothing can be "
                "sent through it"
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
                msg(
                    f"{arg(far.name)} responded to none of {arg(message_count)} messages, over a satellite that may "
                    "pause for 70 s"
                ),
                "repeat the check; three rounds without a response are more than a satellite pause",
            )
        if isinstance(getattr(self.site.gateway, "device", None), model.ControlCentre):
            return parse.unknown(
                "gateway-silent",
                msg(f"{arg(far.name)} responded to none of {arg(message_count)} messages: it may be off"),
                msg(f"check that {arg(far.name)} is switched on; the checklist of {arg(far.site)} tests from its end"),
            )
        return parse.fail(
            "far-end-silent",
            msg(
                f"{arg(far.name)} responded to none of {arg(message_count)} messages {arg(over)}; the item `vpn` shows "
                "whether its server responds"
            ),
            msg(f"check that {arg(far.name)} is switched on; the checklist of {arg(far.site)} tests from its end"),
        )

    def _judge_delays(
        self, far: FarComputer, answer: base.ReflectResult, results: Mapping[str, base.Answer]
    ) -> LinkFinding:
        delays = {_row(item)["token"]: item.delay_s for item in answer.answers}
        worst, limit = max(delays.values()), self.site.site_config.checklist.answer_within_s
        emulation_note = msg(", emulated" if any(_row(item).get("emulated") for item in answer.answers) else "")
        text = msg(
            f"{arg(far.name)} responded to {arg(len(delays))} of {arg(len(answer.tokens))} messages "
            f"{arg(self._over(results))}, the slowest in {arg(worst * 1000):.0f} ms{arg(emulation_note)}"
        )
        if limit is not None and worst > limit:
            message = msg(f"{arg(text)}, but `answer_within_s` is {arg(limit):g}")
            return parse.fail("late", message, msg(f"check `provision links site={arg(self.site.name)}`"))
        if len(delays) < len(answer.tokens):
            return parse.warn("data-lost", text, msg(f"check `provision links site={arg(self.site.name)}`"))
        return parse.good("data-reaches", text)

    def _over(self, results: Mapping[str, base.Answer]) -> str:
        """Describe the route; the router reports which link carries the tunnel."""
        link = parse.active_link(self.site, results)
        over = "an unknown link" if link is None else link.name
        return msg(f"through the VPN over {arg(over)}")

    def _evidence(self, far: FarComputer, results: Mapping[str, base.Answer]) -> Iterator[Evidence]:
        name, address = self._asking
        answer = results[f"data {far.name}"]
        way = parse.parse_json_list(results[f"way {far.name}"], name, "its route")
        if not isinstance(way, LinkFinding) and way:
            yield parse.read(
                msg(f"route from {arg(name)} to {arg(far.name)}"),
                msg(f"{arg(way[0].get('dev', '?'))}, {arg(self._over(results))}"),
            )
        for item in answer.answers if isinstance(answer, base.ReflectResult) else ():
            row = _row(item)
            there = msg(
                f"there from {arg(row.get('from', '?'))} by {arg(row.get('by', '?'))}, back by {arg(item.interface)}"
            )
            yield parse.measured_evidence(
                msg(f"message from {arg(address)} to {arg(far.address)} and back"),
                msg(f"{arg(item.delay_s * 1000):.0f} ms, {arg(there)}"),
            )


def _wrong_way(name: str, far: FarComputer, answer: base.Answer) -> LinkFinding | None:
    """Return why data would not go through the VPN; None if they would."""
    if getattr(answer, "trouble", None) is None and "unreachable" in getattr(answer, "err", "").lower():
        return parse.fail(
            "no-way",
            msg(f"{arg(name)} has no route to {arg(far.name)} at {arg(far.address)}"),
            msg(f"on {arg(name)}: `systemctl restart openvpn-client@atlantis` restores the tunnel's routes"),
        )
    way = parse.parse_json_list(answer, name, "its route to the other end")
    if isinstance(way, LinkFinding):
        return way
    device = str(way[0].get("dev")) if way else "another path"
    if device == TUNNEL:
        return None
    return parse.fail(
        "way-outside-vpn",
        msg(f"data for {arg(far.name)} would leave {arg(name)} by {arg(device)} instead of the VPN"),
        msg(
            f"on {arg(name)}: `ip route get {arg(far.address)}` shows the route; remove the one that was added manually"
        ),
    )


def _not_sent(name: str, far: FarComputer, answer: base.ReflectResult) -> LinkFinding:
    if answer.trouble is base.Trouble.REFUSED:
        return parse.fail(
            "nobody-answers-data",
            msg(f"{arg(far.name)} is reachable, but nothing there responds to messages"),
            msg(
                f"on {arg(far.name)}: `systemctl status atlantis-reflector`; applying the configuration of "
                f"{arg(far.site)} starts it"
            ),
        )
    if answer.trouble is base.Trouble.UNREACHABLE:
        return parse.fail(
            "data-not-sent",
            msg(f"{arg(name)} could not send to {arg(far.name)}: {arg(answer.words)}"),
            msg(f"on {arg(name)}: `ip route get {arg(far.address)}`; the item `vpn` shows whether the tunnel is up"),
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
            msg(f"{arg(item.sender)} responds with other data than was sent"),
            msg(
                f"find out what responds at {arg(far.address)}: apply the configuration of the site of "
                f"{arg(far.name)}, then repeat the check"
            ),
        )
    if item.sender != far.address or row.get("to") != far.address:
        return parse.fail(
            "answered-elsewhere",
            msg(f"{arg(item.sender)} responds to data sent to {arg(far.address)}"),
            msg(
                f"addresses must not be translated inside the VPN: check the NAT rules between here and {arg(far.name)}"
            ),
        )
    if row.get("host") != far.name:
        return parse.fail(
            "other-computer",
            msg(f"{arg(row.get('host'))} responds at {arg(far.address)}, the address of {arg(far.name)}"),
            "each VPN address belongs to one member: `provision vpn status` shows who has it",
        )
    if item.interface != TUNNEL or row.get("by") != TUNNEL or row.get("from") != asking:
        return parse.fail(
            "answered-outside-vpn",
            msg(
                f"a message left the VPN: it reached {arg(far.name)} from {arg(row.get('from'))} by "
                f"{arg(row.get('by'))}, and its response came back by {arg(item.interface)}"
            ),
            msg(
                f"check the routes of both computers: `ip route get {arg(far.address)}` here, `ip route get "
                f"{arg(asking)}` there"
            ),
        )
    return None
