"""The satellite link: the terminal's entry in the inventory, DNS names of targets, and probe results.

The terminal of the pilot (Thales VesseLINK) has no documented interface: no manual, API or code for one has been
published. So nothing here drives it, and its pages are not guessed. What a person has seen there is written in the
inventory, with evidence; probes from the router test whether the allow-list works.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from ipaddress import AddressValueError, IPv4Address, IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links.status import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from datetime import date

_NAT_NETWORKS = (
    (IPv4Network("100.64.0.0/10"), "the range for carriers' NAT, RFC 6598"),
    (IPv4Network("10.0.0.0/8"), "a private range, RFC 1918"),
    (IPv4Network("172.16.0.0/12"), "a private range, RFC 1918"),
    (IPv4Network("192.168.0.0/16"), "a private range, RFC 1918"),
)
FACTORY_ADDRESSES = ("192.168.1.1",)
"""Addresses of terminals with factory settings: as technicians report, and also Teltonika's default."""


def judge_carrier_nat(link: str, address: str | None, *, forwards: bool) -> tuple[LinkFinding, ...]:
    """Report that the network gave the link an address behind its own NAT; skip an address that is unreadable.

    `address`: of the SIM or the terminal towards the network, from a reader or from the evidence in the inventory.
    `forwards`: whether ports of the site's outer addresses are forwarded to inside hosts.
    """
    try:
        outer_address = None if address is None else IPv4Address(address)
    except AddressValueError:
        return ()
    why = next(
        (words for network, words in _NAT_NETWORKS if outer_address is not None and outer_address in network), None
    )
    if why is None:
        return ()
    message = msg(
        f"`{arg(link)}` is behind its carrier's NAT: it has {arg(address)} ({arg(why)}), so the site cannot be reached "
        "over it"
    )
    if forwards:
        hint = (
            "the forwarded ports of this router cannot be reached over this link: ask the provider for a public address"
        )
        return (LinkFinding(Verdict.FAIL, "carrier-nat-closes-forwards", message, hint),)
    hint = "nothing to do: the site opens the VPN itself; a public address would have to be ordered"
    return (LinkFinding(Verdict.WARN, "carrier-nat", message, hint),)


def judge_factory_address(
    host: str, port: str, declared_address: str, *, answers: bool, answers_at_factory: str | None
) -> tuple[LinkFinding, ...]:
    """Compare a device's expected address on a port with where it responds (ARP, which costs no airtime).

    `answers_at_factory`: the factory address that responds on that port, None if none does.
    """
    if answers_at_factory is None or answers_at_factory == declared_address:
        if answers:
            return ()
        message = msg(
            f"`{arg(host)}` does not respond at {arg(declared_address)} on {arg(port)}, nor at its factory address"
        )
        hint = "check that it is powered and plugged into that port; a terminal takes minutes to start"
        return (LinkFinding(Verdict.INCONCLUSIVE, "box-silent", message, hint),)
    if answers:
        message = msg(
            f"on {arg(port)} `{arg(host)}` responds at {arg(declared_address)}, and another device at "
            f"{arg(answers_at_factory)}"
        )
        return (LinkFinding(Verdict.WARN, "factory-address-answers", message, "check what else is plugged in there"),)
    message = msg(
        f"`{arg(host)}` is in the wrong subnet: on {arg(port)} it responds at {arg(answers_at_factory)}, the inventory "
        f"has {arg(declared_address)}"
    )
    hint = msg(
        f"set {arg(declared_address)} on its own page ({arg(answers_at_factory)} from a laptop), or correct the "
        "network in the inventory"
    )
    return (LinkFinding(Verdict.FAIL, "box-in-wrong-subnet", message, hint),)


STALE_AFTER_DAYS = 180
"""Length of a campaign, by our own judgement: no source says how often a terminal's settings change by themselves."""


@dataclass(frozen=True, slots=True)
class SatelliteEvidence:
    """One inspection of the terminal, as recorded in the inventory."""

    firmware: str
    allow_list: bool
    """Whether the terminal's filter has the declared destinations and nothing else."""
    by: str
    seen_on: date
    backup_file: str | None = None
    backup_sha256: str | None = None


@dataclass(frozen=True, slots=True)
class Backup:
    """A backup exported by the terminal and saved on this computer."""

    path: str
    """Path as a person would type it."""
    sha256: str


def judge_evidence(
    name: str, evidence: SatelliteEvidence | None, backup: Backup | None, confirmed_firmware: str | None, today: date
) -> tuple[LinkFinding, ...]:
    """Return all findings about a terminal's evidence; empty if it is complete, recent and good.

    `backup`: the backup file, None if there is none; `confirmed_firmware`: the evidence's firmware when a run last
    recorded it, None before the first one.
    """
    if evidence is None:
        return (
            LinkFinding(
                Verdict.WARN,
                "terminal-not-looked-at",
                msg(f"terminal {arg(name)} not inspected yet: its firmware and its own allow-list are unknown"),
                msg(f"open its pages and record what they show under `evidence:` in host_vars/{arg(name)}.yml"),
            ),
        )
    return (
        *_check_evidence_age(name, evidence, today),
        *_check_allow_list(name, evidence),
        *_check_backup(name, evidence, backup),
        *_check_firmware(name, evidence, confirmed_firmware),
    )


def _check_evidence_age(name: str, evidence: SatelliteEvidence, today: date) -> Iterator[LinkFinding]:
    days = (today - evidence.seen_on).days
    text = msg(f"{arg(evidence.by)} inspected terminal {arg(name)} on {arg(evidence.seen_on.isoformat())}")
    if days > STALE_AFTER_DAYS:
        hint = msg(f"inspect it again, and record who and when under `evidence:` in host_vars/{arg(name)}.yml")
        yield LinkFinding(Verdict.WARN, "terminal-evidence-old", msg(f"{arg(text)}, {arg(days)} days ago"), hint)
    elif days < 0:
        hint = msg(f"correct `seen_on:` in host_vars/{arg(name)}.yml, or this computer's clock")
        yield LinkFinding(
            Verdict.INCONCLUSIVE, "terminal-evidence-from-the-future", msg(f"{arg(text)}, which is in the future"), hint
        )


def _check_allow_list(name: str, evidence: SatelliteEvidence) -> Iterator[LinkFinding]:
    if not evidence.allow_list:
        message = msg(
            f"terminal {arg(name)} has no allow-list of its own, or a different one: only the router limits its traffic"
        )
        hint = (
            "enter the inventory's destinations on the terminal's page; `provision measure satellite site=…` "
            "lists and tests them"
        )
        yield LinkFinding(Verdict.WARN, "terminal-without-allow-list", message, hint)


def _check_backup(name: str, evidence: SatelliteEvidence, backup: Backup | None) -> Iterator[LinkFinding]:
    declared_sha256 = evidence.backup_sha256
    if declared_sha256 is None:
        message = msg(f"the inventory has no backup of terminal {arg(name)}, so a changed setting would not be noticed")
        hint = "export one on its page and write `backup_file:` and `backup_sha256:` (sha256sum FILE)"
        yield LinkFinding(Verdict.WARN, "terminal-without-backup", message, hint)
    elif backup is None:
        message = msg(f"the backup of terminal {arg(name)} in the inventory is not on this computer")
        file = evidence.backup_file or "the file"
        hint = msg(
            f"put {arg(file)} into inventory/evidence/, or pass its path: `provision measure satellite site=… "
            "backup=FILE`"
        )
        yield LinkFinding(Verdict.INCONCLUSIVE, "terminal-backup-not-here", message, hint)
    elif backup.sha256 != declared_sha256:
        message = msg(
            f"the backup {arg(backup.path)} of terminal {arg(name)} is not the one in the inventory: SHA-256 "
            f"{arg(backup.sha256[:16])}…, expected {arg(declared_sha256[:16])}…"
        )
        hint = "its settings have changed, or this is another file: check its pages, then correct the inventory"
        yield LinkFinding(Verdict.FAIL, "terminal-backup-differs", message, hint)


def _check_firmware(name: str, evidence: SatelliteEvidence, confirmed_firmware: str | None) -> Iterator[LinkFinding]:
    if confirmed_firmware is not None and confirmed_firmware != evidence.firmware:
        message = msg(
            f"terminal {arg(name)} had firmware {arg(confirmed_firmware)} when a run last recorded it, and now has "
            f"{arg(evidence.firmware)}"
        )
        hint = "new firmware may have other defaults: check its allow-list again, and test it"
        yield LinkFinding(Verdict.WARN, "terminal-firmware-changed", message, hint)


@dataclass(frozen=True, slots=True)
class NamedTarget:
    """An allow-list entry that has a DNS name."""

    what: str
    """Purpose of the target: `VPN server`."""
    dns_name: str
    address: str
    """Address in the inventory."""
    where: str
    """Location of the entry, for the hint: `pilot.vpn in group_vars/all/pilot.yml`."""


def judge_names(
    targets: Iterable[NamedTarget], addresses_by_name: Mapping[str, frozenset[str] | None], by: str
) -> tuple[LinkFinding, ...]:
    """Compare addresses in the inventory with the DNS result; `by` names the resolver: `this computer`, `the router`.

    `addresses_by_name`: the IPv4 addresses of each name, an empty set if it does not exist, None if the lookup failed:
    that proves nothing.
    """
    return tuple(
        finding for target in targets for finding in _judge_name(target, addresses_by_name.get(target.dns_name), by)
    )


def _judge_name(target: NamedTarget, addresses: frozenset[str] | None, by: str) -> Iterator[LinkFinding]:
    name = msg(f"{arg(target.dns_name)} ({arg(target.what)})")
    if addresses is None:
        message = msg(
            f"{arg(by)} could not resolve {arg(name)}: it is unknown whether its address is still {arg(target.address)}"
        )
        yield LinkFinding(Verdict.INCONCLUSIVE, "allow-list-name-not-asked", message, "try again where DNS works")
    elif not addresses:
        message = msg(f"{arg(by)} finds no address for {arg(name)}; the allow-list permits {arg(target.address)}")
        hint = msg(f"correct `dns_name`, or the name itself ({arg(target.where)})")
        yield LinkFinding(Verdict.WARN, "allow-list-name-unknown", message, hint)
    elif target.address not in addresses:
        address_list = join(", ", sorted(addresses))
        message = msg(
            f"the address of {arg(name)} has changed: {arg(by)} resolves it to {arg(address_list)}, the allow-list "
            f"permits {arg(target.address)}"
        )
        hint = msg(
            f"correct the address ({arg(target.where)}) and provision the site before the satellite is its only link"
        )
        yield LinkFinding(Verdict.FAIL, "allow-list-name-moved", message, hint)
    elif len(addresses) > 1:
        others = join(", ", sorted(addresses - {target.address}))
        message = msg(
            f"{arg(name)} has more addresses than the allow-list permits: {arg(target.address)}, but also {arg(others)}"
        )
        hint = "traffic to the others is dropped over the satellite: add them to `allow:` if they are needed"
        yield LinkFinding(Verdict.WARN, "allow-list-name-has-more", message, hint)


WINDOW_S = 90.0
"""Minimum silence in seconds after which a target counts as not reached."""


class ExpectedOutcome(StrEnum):
    """The outcome that the inventory expects for a target."""

    REACHED = "reached"
    REFUSED = "refused"


class ProbeOutcome(StrEnum):
    """The observed outcome of a probe."""

    ANSWERED = "answered"
    SILENT = "silent"
    """No response within the window."""
    REFUSED_HERE = "refused here"
    """The router itself refused the packet, so nothing was sent."""
    NOT_TRIED = "not tested"
    """The target cannot be probed from the router; `note` gives the reason."""


class SatelliteProbe(StrEnum):
    """The protocol used to probe a target."""

    ICMP = "icmp"
    TCP = "tcp"
    UDP_COUNTER = "udp, responses counted by the filter"
    TUNNEL = "openvpn, responses counted by the filter"
    """While the tunnel is down its client retries continuously, so silence counts as evidence."""
    TIME = "ntp, responses counted by the filter"
    """The time client was made to send a request; its server answers everybody, so silence counts as evidence."""
    VPN = "openvpn, requested by this computer"
    """First packet of a session, routed over the link; the server answers every member, so silence is evidence."""
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Attempt:
    """One probe of one target."""

    name: str
    target: str
    """Readable target: `203.0.113.2 udp 1194`."""
    expected_outcome: ExpectedOutcome
    probe: SatelliteProbe
    outcome: ProbeOutcome
    after_s: float | None = None
    """Seconds until the first response."""
    window_s: float = 0.0
    """Duration of the attempt in seconds."""
    filter_open: bool = False
    """Whether the router's filter was opened for this target, so only the terminal's filter decided."""
    note: str = ""
    hint: str = ""
    """What would make the probe possible, if it was not tried."""


def judge_attempt(attempt: Attempt, *, link_seen: bool) -> LinkFinding:
    """Judge one attempt: PASS, FAIL, or INCONCLUSIVE if silence or a missing route proves nothing.

    `link_seen`: another target was reached over the satellite in the same run; over a dead link everything looks
    refused.
    """
    if attempt.outcome is ProbeOutcome.NOT_TRIED:
        message = msg(f"{arg(attempt.name)} ({arg(attempt.target)}) could not be tested: {arg(attempt.note)}")
        return LinkFinding(Verdict.INCONCLUSIVE, "not-tried", message, attempt.hint or None)
    if attempt.expected_outcome is ExpectedOutcome.REACHED:
        return _judge_allowed(attempt)
    if attempt.outcome is ProbeOutcome.SILENT and not link_seen:
        message = msg(
            f"{arg(attempt.name)} ({arg(attempt.target)}) did not respond, but nothing else was reached over the "
            "satellite either"
        )
        return LinkFinding(
            Verdict.INCONCLUSIVE, "link-not-seen", message, "check that the terminal is connected, then try again"
        )
    return _judge_forbidden(attempt)


def _judge_allowed(attempt: Attempt) -> LinkFinding:
    who = msg(f"{arg(attempt.name)} ({arg(attempt.target)})")
    if attempt.outcome is ProbeOutcome.ANSWERED:
        after = msg("" if attempt.after_s is None else f" after {arg(attempt.after_s):.0f} s")
        return LinkFinding(Verdict.PASS, "reached", msg(f"{arg(who)} was reached{arg(after)} over the satellite"))
    if attempt.outcome is ProbeOutcome.REFUSED_HERE:
        hint = "provision the site first: its filter differs from the inventory"
        return LinkFinding(
            Verdict.FAIL, "refused-by-the-router", msg(f"{arg(who)} is allowed, but the router refuses it"), hint
        )
    if attempt.window_s < WINDOW_S or attempt.probe is SatelliteProbe.UDP_COUNTER:
        why = attempt.note or msg(f"{arg(attempt.window_s):.0f} s without a response are a normal gap of this link")
        return LinkFinding(
            Verdict.INCONCLUSIVE,
            "silent",
            msg(f"{arg(who)} did not respond: {arg(why)}"),
            "try again later, or with a longer window",
        )
    message = msg(f"{arg(who)} did not respond within {arg(attempt.window_s):.0f} s over the satellite")
    hint = "check that the terminal is connected and that its own allow-list contains this target"
    return LinkFinding(Verdict.FAIL, "not-reached", message, hint)


def _judge_forbidden(attempt: Attempt) -> LinkFinding:
    who = msg(f"{arg(attempt.name)} ({arg(attempt.target)})")
    if attempt.outcome is ProbeOutcome.ANSWERED:
        if attempt.filter_open:
            message = msg(
                f"{arg(who)} was reached with the router's filter open: only the router enforces the allow-list"
            )
            hint = "enter the inventory's destinations on the terminal's page"
            return LinkFinding(Verdict.WARN, "only-the-router-enforces", message, hint)
        hint = "`provision site=…` restores the filter; `provision report drift site=…` first shows what has changed"
        return LinkFinding(
            Verdict.FAIL, "leak", msg(f"{arg(who)} is not allowed, but was reached over the satellite"), hint
        )
    if attempt.outcome is ProbeOutcome.REFUSED_HERE:
        return LinkFinding(Verdict.PASS, "refused", msg(f"{arg(who)} is refused by the router; nothing was sent"))
    if attempt.filter_open and attempt.window_s < WINDOW_S:
        message = msg(
            f"{arg(who)} did not respond within {arg(attempt.window_s):.0f} s: too short to tell a refusal from a gap"
        )
        return LinkFinding(Verdict.INCONCLUSIVE, "silent", message, "try again with a longer window")
    if attempt.filter_open:
        message = msg(f"{arg(who)} did not respond within {arg(attempt.window_s):.0f} s with the router's filter open")
        return LinkFinding(
            Verdict.PASS, "refused-beyond", msg(f"{arg(message)}: the terminal or the network blocks it")
        )
    return LinkFinding(Verdict.PASS, "refused", msg(f"{arg(who)} was not reached within {arg(attempt.window_s):.0f} s"))
