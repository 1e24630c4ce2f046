"""Addresses that tell something about a link: behind a carrier's NAT, or left as the factory set it."""

from __future__ import annotations

from ipaddress import AddressValueError, IPv4Address, IPv4Network

from atlantis_netcfg.bearers.status import Finding
from atlantis_netcfg.core.verdicts import Verdict

__all__ = ["FACTORY_ADDRESSES", "judge_carrier_nat", "judge_factory_address"]

_SHARED = (
    (IPv4Network("100.64.0.0/10"), "the range for carriers' NAT, RFC 6598"),
    (IPv4Network("10.0.0.0/8"), "a private range, RFC 1918"),
    (IPv4Network("172.16.0.0/12"), "a private range, RFC 1918"),
    (IPv4Network("192.168.0.0/16"), "a private range, RFC 1918"),
)
FACTORY_ADDRESSES = ("192.168.1.1",)
"""Where terminals answer that nobody has set up: as technicians report it, and Teltonika's default as well."""


def judge_carrier_nat(bearer: str, address: str | None, *, forwards: bool) -> tuple[Finding, ...]:
    """Say that the network has given the link an address behind its own NAT; what is not readable is not judged.

    `address`: of the SIM or the terminal towards the network, as a reader or the declared evidence gives it.
    `forwards`: whether ports of the site's outer addresses are declared to lead inside.
    """
    try:
        found = None if address is None else IPv4Address(address)
    except AddressValueError:
        return ()
    why = next((words for network, words in _SHARED if found is not None and found in network), None)
    if why is None:
        return ()
    message = f"`{bearer}` is behind its carrier's NAT: it has {address} ({why}), so nothing reaches the site over it"
    if forwards:
        hint = "the forwarded ports of this router stay closed on this link: ask the provider for a public address"
        return (Finding(Verdict.FAIL, "carrier-nat-closes-forwards", message, hint),)
    hint = "nothing to do: the VPN is started from the site; a public address would have to be ordered"
    return (Finding(Verdict.WARN, "carrier-nat", message, hint),)


def judge_factory_address(
    host: str, port: str, declared: str, *, answers: bool, answers_at_factory: str | None
) -> tuple[Finding, ...]:
    """Compare where a box should answer on a port with where it does (ARP, which costs no airtime).

    `answers_at_factory`: the factory address at which something answers on that port, None if nothing does.
    """
    if answers_at_factory is None or answers_at_factory == declared:
        if answers:
            return ()
        message = f"`{host}` does not answer at {declared} on {port}, nor where its factory puts it"
        hint = "is it powered and plugged into that port? A terminal takes minutes to start"
        return (Finding(Verdict.INCONCLUSIVE, "box-silent", message, hint),)
    if answers:
        message = f"on {port} `{host}` answers at {declared}, and something else at {answers_at_factory}"
        return (Finding(Verdict.WARN, "factory-address-answers", message, "what else is plugged in there?"),)
    message = f"`{host}` is in the wrong subnet: on {port} it answers at {answers_at_factory}, declared is {declared}"
    hint = f"set {declared} on its own page ({answers_at_factory} from a laptop), or declare the network that it has"
    return (Finding(Verdict.FAIL, "box-in-wrong-subnet", message, hint),)
