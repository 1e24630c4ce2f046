"""The route to a neighbour (`ip -j`) and its echo replies (`ping`), parsed and judged.

`ip -j route get ADDRESS`, `ip -j addr show dev INTERFACE` and `ip -j neigh show to ADDRESS` (iproute2) return the
interface and the network card that responds. `ping` is iputils' (Debian, Ubuntu), run as `ping -n -c 20 -i 0.2 -W 2
ADDRESS`: 20 packets in 4 s, so that one lost packet is 5 %. Intervals shorter than 0.2 s need root (ping(8)).
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator


_LOOPBACK = "lo"


@dataclass(frozen=True, slots=True)
class NeighbourRoute:
    """Route of packets to an address: interface and gateway."""

    interface: str
    by: str | None = None
    """Next hop; None: the address is in a network of that interface."""


@dataclass(frozen=True, slots=True)
class NetworkCard:
    """State of a network interface."""

    up: bool
    """Whether it is switched on."""
    carrier: bool
    """Whether it has a link; of Wi-Fi: whether it is associated."""
    master: str | None = None
    """Bridge that it is a port of."""


def route_request(place: base.Place, address: str) -> base.RunProgram:
    """Return the request named `route`: the route to an address."""
    return base.RunProgram("route", place, ("ip", "-j", "route", "get", address))


def card_request(place: base.Place, interface: str) -> base.RunProgram:
    """Return the request named `addr`: the state of an interface."""
    return base.RunProgram("addr", place, ("ip", "-j", "addr", "show", "dev", interface))


def neighbour_request(place: base.Place, address: str) -> base.RunProgram:
    """Return the request named `neigh`, which runs after an earlier ping of the address."""
    return base.RunProgram("neigh", place, ("ip", "-j", "neigh", "show", "to", address), turn=address)


def read_route(answer: base.Answer | None, address: str) -> NeighbourRoute | None:
    """Parse a route; None if there is none, or it cannot be parsed."""
    for row in _rows(answer):
        if isinstance(row.get("dev"), str) and row.get("dst") == address:
            by = row.get("gateway")
            return NeighbourRoute(row["dev"], by if isinstance(by, str) else None)
    return None


def read_card(answer: base.Answer | None) -> NetworkCard | None:
    """Parse an interface; None if there is none, or it cannot be parsed."""
    for row in _rows(answer):
        flags = row.get("flags")
        if isinstance(flags, list):
            master = row.get("master")
            return NetworkCard("UP" in flags, "LOWER_UP" in flags, master if isinstance(master, str) else None)
    return None


def read_neighbour(answer: base.Answer | None, address: str) -> str | None:
    """Return the MAC address that responded for an address, in upper case; None, if none did lately, proves nothing."""
    for row in _rows(answer):
        is_match = isinstance(row.get("lladdr"), str) and row.get("dst") == address
        if is_match and "FAILED" not in (row.get("state") or ()):
            return str(row["lladdr"]).upper()
    return None


def own_address(place: base.Place, name: str, address: str, way: NeighbourRoute | None) -> Iterator[LinkFinding]:
    """Yield a finding if the address belongs to the probing computer, whose own replies prove nothing."""
    if way is not None and way.interface == _LOOPBACK:
        message = msg(
            f"{arg(base.PLACES[place])} itself has the address of {arg(name)}, {arg(address)}: its pings never leave "
            "the computer"
        )
        hint = "remove the address there, or correct it in the inventory: `ip -br addr` shows the addresses"
        yield LinkFinding(Verdict.FAIL, "own-address", message, hint)


def _rows(answer: base.Answer | None) -> list[dict[str, Any]]:
    if not isinstance(answer, base.CommandResult) or answer.trouble is not None or answer.rc:
        return []
    try:
        result = json.loads(answer.out or "[]")
    except (ValueError, RecursionError):
        return []
    return [row for row in result if isinstance(row, dict)] if isinstance(result, list) else []


COUNT = 20
SLOW_MS = 100.0
"""One hop in a local network takes some milliseconds; from here on packets are held back. Our own judgement."""
_SUMS = re.compile(
    r"(\d+) packets transmitted, (\d+) (?:packets )?received(?:, \+?(\d+) duplicates)?.*?([\d.]+)% packet loss"
)
_TIMES = re.compile(r"(?:rtt|round-trip) min/avg/max(?:/mdev)? = ([\d.]+)/([\d.]+)/([\d.]+)")
_REFUSAL = re.compile(r"^From (\S+) icmp_seq=\d+ (.+)$", re.MULTILINE)
_HEAD = re.compile(r"^PING (\S+) ")
_ANSWER = re.compile(r"^\d+ bytes from ([\d.]+).*?\b(?:icmp_)?seq=(\d+)", re.MULTILINE)
_DAMAGE_WORDS = ("wrong data byte", "BAD CHECKSUM", "(truncated)")
MANY_TWICE = 0.1
"""Share of duplicate responses: a radio sends one now and then, two devices or a loop most. Our judgement."""


@dataclass(frozen=True, slots=True)
class Echoes:
    """Echo replies of an address."""

    sent_count: int
    received_count: int
    """Requests that the address itself answered, each counted once."""
    twice: int = 0
    """Duplicate responses."""
    others: tuple[str, ...] = ()
    """Addresses that responded in place of the target."""
    has_damage: bool = False
    mean_ms: float | None = None
    worst_ms: float | None = None
    refusal: str | None = None
    """Who rejected the packets on the way, and with which message."""

    @property
    def loss_percent(self) -> float:
        """Share of sent packets without a reply."""
        return 100 * (self.sent_count - self.received_count) / self.sent_count


@dataclass(frozen=True, slots=True)
class NeighbourPing:
    """The neighbour to ping, and its limits."""

    name: str
    address: str
    place: base.Place
    loss_percent: float
    """Up to this loss it passes."""
    fail_percent: float
    """From this loss on it fails."""


def ping_request(place: base.Place, address: str) -> base.RunProgram:
    """Return the request named `ping`: echo requests to an address."""
    return base.RunProgram(
        "ping", place, ("ping", "-n", "-c", str(COUNT), "-i", "0.2", "-W", "2", address), turn=address
    )


def read_ping(out: str, address: str) -> Echoes | None:
    """Parse the output of `ping`; None if it sent nothing, had another target, or has an unknown format."""
    sums, times, refusal = _SUMS.search(out), _TIMES.search(out), _REFUSAL.search(out)
    head = _HEAD.match(out)
    if sums is None or not int(sums[1]) or head is None or head[1] != address:
        return None
    answers = _ANSWER.findall(out)
    local = {number for who, number in answers if who == address}
    duplicates = sum(who == address for who, _ in answers) - len(local)
    return Echoes(
        sent_count=int(sums[1]),
        received_count=min(int(sums[2]), int(sums[1]), len(local)),
        twice=max(int(sums[3] or 0), duplicates),
        others=tuple(dict.fromkeys(who for who, _ in answers if who != address)),
        has_damage=any(word in out for word in _DAMAGE_WORDS),
        mean_ms=float(times[2]) if times else None,
        worst_ms=float(times[3]) if times else None,
        refusal=msg(f"{arg(refusal[1])} reports: {arg(refusal[2])}") if refusal else None,
    )


def judge_ping(target: NeighbourPing, answer: base.Answer | None) -> base.ProbeResult:
    """Judge loss and round trip; a ping that did not run proves nothing."""
    if troubles := tuple(base.not_run(target.place, "ping", answer)):
        return base.ProbeResult(troubles)
    assert isinstance(answer, base.CommandResult)  # noqa: S101 - `not_run` speaks of anything else
    echoes = read_ping(answer.out, target.address)
    if echoes is None:
        lines = (answer.err or answer.out).strip().splitlines()
        why = msg(f": {arg(lines[0][:120])}" if lines else "")
        message = msg(
            f"no ping was sent to {arg(target.name)} ({arg(target.address)}) from "
            f"{arg(base.PLACES[target.place])}{arg(why)}"
        )
        hint = msg(f"ping it manually from there: ping {arg(target.address)}")
        return base.ProbeResult((LinkFinding(Verdict.INCONCLUSIVE, "ping-not-understood", message, hint),))
    where = msg(f"{arg(target.name)} from {arg(base.PLACES[target.place])}")
    evidence = [
        base.measured_evidence(
            msg(f"ping replies from {arg(where)}"), msg(f"{arg(echoes.received_count)} of {arg(echoes.sent_count)}")
        )
    ]
    if echoes.mean_ms is not None and echoes.worst_ms is not None:
        evidence.append(base.measured_evidence(msg(f"mean round trip to {arg(where)}"), echoes.mean_ms, "ms"))
        evidence.append(base.measured_evidence(msg(f"longest round trip to {arg(where)}"), echoes.worst_ms, "ms"))
    who = msg(f"{arg(target.name)} ({arg(target.address)})")
    strange = tuple(odd_answers(who, echoes))
    if echoes.sent_count < COUNT:
        message = msg(
            f"only {arg(echoes.sent_count)} of {arg(COUNT)} pings were sent to {arg(who)}; "
            f"{arg(echoes.received_count)} got a reply"
        )
        hint = msg(
            f"repeat the check; if nothing changes, find out what ends `ping` on {arg(base.PLACES[target.place])}"
        )
        cut = LinkFinding(Verdict.INCONCLUSIVE, "ping-cut-short", message, hint)
        return base.ProbeResult((cut, *strange), tuple(evidence))
    findings = (_loss(target, echoes), *_slow_findings(target, echoes))
    remaining_findings = tuple(finding for finding in findings if not strange or finding.verdict is not Verdict.PASS)
    return base.ProbeResult((*strange, *remaining_findings), tuple(evidence))


def odd_answers(who: str, echoes: Echoes) -> Iterator[LinkFinding]:
    """Yield findings about suspicious replies, however many there are."""
    if echoes.others:
        message = msg(f"{arg(echoes.others[0])} responds in place of {arg(who)}")
        hint = "something on the path responds for others: check for a proxy, a captive portal, or a redirect rule"
        yield LinkFinding(Verdict.FAIL, "another-answers", message, hint)
    if echoes.has_damage:
        message = msg(f"replies from {arg(who)} came back corrupted")
        hint = "something on the path changes packets: check cables, cards and drivers, then repeat the check"
        yield LinkFinding(Verdict.FAIL, "answers-damaged", message, hint)
    if echoes.twice:
        many = echoes.twice > MANY_TWICE * max(echoes.received_count, 1)
        message = msg(
            f"{arg(who)} replied to {arg(echoes.received_count)} of {arg(echoes.sent_count)} pings, and "
            f"{arg(echoes.twice)} replies came twice"
        )
        hint = "two devices have this address, or the network has a loop: unplug it and ping again"
        yield LinkFinding(Verdict.FAIL if many else Verdict.WARN, "answered-twice", message, hint)


def _loss(target: NeighbourPing, echoes: Echoes) -> LinkFinding:
    who = msg(f"{arg(target.name)} ({arg(target.address)})")
    if not echoes.received_count:
        refusal_text = msg(f"; {arg(echoes.refusal)}" if echoes.refusal else "")
        hint = "check that it is switched on, has this address, and is allowed to reply to pings"
        return LinkFinding(
            Verdict.FAIL,
            "silent",
            msg(f"{arg(who)} replied to none of {arg(echoes.sent_count)} pings{arg(refusal_text)}"),
            hint,
        )
    message = msg(f"{arg(who)} replied to {arg(echoes.received_count)} of {arg(echoes.sent_count)} pings")
    loss = echoes.loss_percent
    if loss <= target.loss_percent:
        after = msg("" if echoes.mean_ms is None else f", in {arg(echoes.mean_ms):g} ms")
        return LinkFinding(Verdict.PASS, "answers", message + after)
    verdict = Verdict.FAIL if loss >= target.fail_percent else Verdict.WARN
    hint = "check for a bad connector, a weak signal, other users of the channel, or two devices with this address"
    return LinkFinding(
        verdict,
        "loss",
        msg(f"{arg(message)}: the loss of {arg(loss):g} % exceeds {arg(target.loss_percent):g} %"),
        hint,
    )


def _slow_findings(target: NeighbourPing, echoes: Echoes) -> tuple[LinkFinding, ...]:
    if echoes.mean_ms is None or echoes.mean_ms <= SLOW_MS:
        return ()
    message = msg(f"{arg(target.name)} replies after {arg(echoes.mean_ms):g} ms on average, above {arg(SLOW_MS):g} ms")
    hint = "stop large transfers and check again; Wi-Fi power saving or retransmissions also cause this"
    return (LinkFinding(Verdict.WARN, "slow", message, hint),)
