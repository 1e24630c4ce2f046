"""Rules for link measurements: the far end is a control centre, its port is free, its key is long enough."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _draft, findings
from atlantis_netcfg.inventory._yaml import SealedSecret
from atlantis_netcfg.inventory.model import KEY_OCTETS, Transport
from atlantis_netcfg.inventory.rules.networks import claims

if TYPE_CHECKING:
    from collections.abc import Iterator

_PILOT = _draft.Part("pilot")


def reflector(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require a control centre as far end: only that is reachable from outside over every link."""
    if draft.pilot is None or draft.pilot.qualify is None:
        return
    host = draft.pilot.qualify.reflector
    centres = [name for name in draft.layout.hosts if draft.kind_of(name) == "control_centre"]
    kind = draft.kind_of(host)
    path = ("qualify", "reflector")
    if host not in draft.layout.hosts:
        hint = findings.suggest(host, centres, none="add a host of group control_centres")
        yield draft.finding_at(_PILOT, path, msg(f"host `{arg(host)}` does not exist"), hint)
    elif kind not in {None, "control_centre"}:
        hint = msg(f"name a control_centre: {arg(findings.choices(centres) or 'none available')}")
        yield draft.finding_at(_PILOT, path, msg(f"`{arg(host)}` is a {arg(kind)}"), hint)


def port_is_free(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Report a `forwards` row with the measuring port: the router already forwards that port to the far end."""
    if draft.pilot is None or draft.pilot.qualify is None:
        return
    qualify = draft.pilot.qualify
    site_router = draft.router_of(draft.layout.hosts.get(qualify.reflector, ""))
    if site_router is None:
        return
    host, router = site_router
    for index, forward in enumerate(router.forwards):
        if (forward.transport, forward.port) == (Transport.UDP, qualify.port):
            where = draft.where(_draft.Part("device", host), "forwards", index, "port")
            message = msg(f"udp port {arg(qualify.port)} is already forwarded to `{arg(forward.to)}` ({arg(where)})")
            hint = msg(f"choose another `port:`, or remove that row: `{arg(host)}` forwards this port itself")
            yield draft.finding_at(_PILOT, ("qualify", "port"), message, hint)


def key_is_long(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require a measuring key of sufficient length: whoever guesses it can use the far end."""
    if draft.pilot is None or draft.pilot.qualify is None or isinstance(draft.pilot.qualify.key, SealedSecret):
        return
    length = len(draft.pilot.qualify.key.reveal().encode())
    if length < KEY_OCTETS:
        message = msg(f"the key has {arg(length)} octets, but {arg(KEY_OCTETS)} are needed")
        yield draft.finding_at(_PILOT, ("qualify", "key"), message, "`openssl rand -base64 24` creates one")


def address_outside(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require a public address for the far end, so that each link can be measured without the VPN."""
    if draft.pilot is None or draft.pilot.qualify is None or draft.pilot.qualify.address is None:
        return
    address = draft.pilot.qualify.address
    for claim in claims(draft):
        if claim.path[0] in {"vpn", "lan", "management", "served_links"} and address in claim.network:
            where = draft.where(claim.part, *claim.path)
            message = msg(
                f"the far end {arg(address)} is inside {arg(claim.what)}, {arg(claim.network)} ({arg(where)})"
            )
            hint = "set the public address of the control centre, or remove `address:` to use `vpn.endpoint`"
            yield draft.finding_at(_PILOT, ("qualify", "address"), message, hint)


RULES: tuple[_draft.Rule, ...] = (reflector, port_is_free, key_is_long, address_outside)
