"""Recordings for the control centre: both ends are in the VPN, and know each other by their host keys."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration.findings import Finding, meant
from atlantis_netcfg.declaration.model import ControlCentre, Gateway, ServerComputer

if TYPE_CHECKING:
    from collections.abc import Iterator

_PILOT = Part("pilot")
_HARDWARE = "sk-"
"""Kinds of keys whose private half is not on the computer."""


def ends_known(draft: Draft) -> Iterator[Finding]:
    """From gateways, to a control centre."""
    retrieval = draft.pilot.retrieval if draft.pilot is not None else None
    if retrieval is None:
        return
    yield from _end(draft, ("to",), retrieval.to, ControlCentre, "control centre")
    for index, source in enumerate(retrieval.sources):
        yield from _end(draft, ("sources", index, "host"), source.host, Gateway, "gateway")


def sources_once(draft: Draft) -> Iterator[Finding]:
    """A gateway has one folder of its own at the control centre."""
    retrieval = draft.pilot.retrieval if draft.pilot is not None else None
    names = [] if retrieval is None else [source.host for source in retrieval.sources]
    for index, name in enumerate(names):
        if name in names[:index]:
            path = ("retrieval", "sources", index, "host")
            yield draft.wrong(_PILOT, path, f"`{name}` stands twice in this list", "remove one")


def _end(
    draft: Draft, path: tuple[str | int, ...], name: str, kind: type[ServerComputer], words: str
) -> Iterator[Finding]:
    where = ("retrieval", *path)
    if name not in draft.layout.hosts:
        known = [host for host, _, _ in draft.boxes(kind)]
        hint = meant(name, known, none=f"declare the {words} first")
        yield draft.wrong(_PILOT, where, f"there is no host `{name}`", hint)
        return
    device = draft.devices.get(name)
    if device is None:
        return  # that is told
    if not isinstance(device, kind):
        hint = f"name a {words}: {', '.join(host for host, _, _ in draft.boxes(kind)) or 'none is declared'}"
        yield draft.wrong(_PILOT, where, f"`{name}` is no {words}", hint)
        return
    if device.vpn_address is None:
        message = f"recordings go through the VPN, and `{name}` has no address in it"
        yield draft.wrong(_PILOT, where, message, f"write `vpn_address:` of `{name}`")
    if device.ssh.host_key is None or device.ssh.host_key.startswith(_HARDWARE):
        message = f"the two ends of a transfer know each other by their SSH host keys, and that of `{name}` is missing"
        hint = f"write `ssh: {{host_key: …}}` in host_vars/{name}.yml: its /etc/ssh/ssh_host_ed25519_key.pub"
        yield draft.wrong(_PILOT, where, message, hint)


RULES: tuple[Rule, ...] = (ends_known, sources_once)
