"""Declared addresses are there, have the declared mask, and will be there after a restart (BlueOS 3370, 3432)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from ipaddress import IPv4Interface
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.results import Ran, Trouble
from atlantis_netcfg.checklist.probes.site_checks._site import Computer, OwnSite, ask, run, step
from atlantis_netcfg.checklist.probes.site_checks.findings import (
    declared,
    fail,
    good,
    listed,
    read,
    silent,
    unknown,
    warn,
)
from atlantis_netcfg.checklist.probes.site_checks.parse import Held, addresses, rows
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.gateway.network import gateway_network

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.probes.requests import Question
    from atlantis_netcfg.checklist.probes.results import Answer
    from atlantis_netcfg.checklist.probes.step import Step

__all__ = ["FILES", "of"]

FILES = ("/etc/netplan/10-atlantis.yaml", "/etc/network/interfaces", "/etc/systemd/network/05-atlantis.network")
"""Where `provision` says how a gateway computer gets its address, one for each tool that configures networks."""
_LOOPBACK = "lo"
_RUN = "run the site, which puts the declared address back"


def of(site: OwnSite) -> Step:
    """The addresses that run beside the files that are read at the next start."""
    return step("static-addresses", "Static addresses survive a restart", _Static(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _Static:
    """Static addresses survive a restart."""

    site: OwnSite

    def asks(self) -> tuple[Question, ...]:
        return (
            *ask("router", self.site, "/ip/address", "address", "interface", "disabled", "invalid", "dynamic"),
            *ask("sockets", self.site, "/interface/ethernet", "name", "default-name"),
            *run("gateway", self.site, "ip -j addr show"),
            *(question for path in FILES for question in run(path, self.site, f"cat {path}")),
        )

    def judge(self, heard: Mapping[str, Answer]) -> Judged:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        held = _on_sockets(heard, self.site.router.name)
        found = [held] if isinstance(held, Finding) else list(self._of_router(self.site.router.name, held))
        evidence = [declared(f"address of {name}", address) for name, address in self._wanted()]
        gateway = self.site.gateway
        if gateway is not None:
            own = addresses(heard["gateway"], gateway.name)
            found += [own] if isinstance(own, Finding) else self._of_gateway(gateway, own, heard)
            if not isinstance(own, Finding):
                evidence += [read(f"{one.interface} of {gateway.name}", str(one.address)) for one in own]
        return Judged(tuple(found), tuple(evidence))

    def _wanted(self) -> Iterator[tuple[str, str]]:
        """Interface and address of everything that the router has by declaration."""
        view = self.site.view
        assert view is not None  # noqa: S101 - the check is made for sites with a router
        yield view.bridge, view.lan.address
        yield view.management.port, view.management.address
        for link in (*view.uplinks, *view.served):
            yield link.port, link.interface_address

    def _of_router(self, name: str, held: tuple[Held, ...]) -> Iterator[Finding]:
        wrong = list(_wrong(name, tuple(self._wanted()), held))
        yield from wrong
        if not wrong:
            count = len(tuple(self._wanted()))
            yield good("router-as-declared", f"{name} has its {count} declared addresses, none of them leased")

    def _of_gateway(self, gateway: Computer, own: tuple[Held, ...], heard: Mapping[str, Answer]) -> list[Finding]:
        wanted = IPv4Interface(f"{gateway.device.address}/{self.site.declared.lan.network.prefixlen}")
        there = next((one for one in own if one.address.ip == wanted.ip), None)
        wrong = _as_it_runs(gateway, wanted, there)
        if wrong is not None:
            return [wrong]
        kept = self._in_files(gateway, wanted, heard)
        fine = good("gateway-as-declared", f"{gateway.name} has {wanted}, and will have it after a restart")
        return [kept or fine]

    def _in_files(self, gateway: Computer, wanted: IPv4Interface, heard: Mapping[str, Answer]) -> Finding | None:
        """What is wrong with the files that the next start reads; None: they say what runs."""
        texts = {path: heard[path] for path in FILES}
        trouble = next((one for one in texts.values() if not isinstance(one, Ran) or one.trouble is not None), None)
        if trouble is not None:
            return silent(gateway.name, getattr(trouble, "trouble", None) or Trouble.SILENT, trouble.words)
        files = {path: one.out for path, one in texts.items() if isinstance(one, Ran) and one.rc == 0}
        host = self.site.declaration.hosts[gateway.name]
        promised = gateway_network(self.site.declaration, host)
        if promised is not None:
            return _promised(gateway.name, promised.path, files.get(promised.path), promised.content, wanted)
        if gateway.leased or any(_says(text, wanted) for text in files.values()):
            return None
        message = (
            f"{gateway.name} has {wanted}, but no file of ours says so: nobody knows whether it survives a restart"
        )
        hint = f"declare `network:` of {gateway.name} and run the site, or restart it once and repeat the check"
        return unknown("no-file", message, hint)


def _on_sockets(heard: Mapping[str, Answer], router: str) -> tuple[Held, ...] | Finding:
    """The router's addresses, each on the factory name of its port: what a port is called proves nothing."""
    held = addresses(heard["router"], router)
    ports = rows(heard["sockets"], router, "the names of its ports", "default-name")
    if isinstance(held, Finding):
        return held
    if isinstance(ports, Finding):
        return ports
    socket = {row.get("name", ""): row.get("default-name", "") for row in ports}
    return tuple(replace(one, interface=socket.get(one.interface, one.interface)) for one in held)


def _says(text: str, wanted: IPv4Interface) -> bool:
    """A comment does not configure anything."""
    lines = (line for line in text.splitlines() if not line.lstrip().startswith("#"))
    return any(str(wanted) in line for line in lines)


def _promised(name: str, path: str, text: str | None, content: str, wanted: IPv4Interface) -> Finding | None:
    hint = f"run the site with `only={name}`: it writes {path} again, under a timer that takes a mistake back"
    if text is None:
        return fail("no-file", f"{name} has {wanted}, but {path} is not there: it will be gone after a restart", hint)
    if text.strip() != content.strip():
        return fail(
            "file-differs", f"{path} of {name} does not say what is declared: a restart changes its address", hint
        )
    return None


def _as_it_runs(gateway: Computer, wanted: IPv4Interface, there: Held | None) -> Finding | None:
    if there is None:
        return fail("address-missing", f"{gateway.name} does not have its declared address {wanted}", _RUN)
    if there.interface == _LOOPBACK:
        message = f"{gateway.name} has its declared address {wanted} on {there.interface}, where nobody reaches it"
        return fail("wrong-interface", message, _RUN)
    if there.address != wanted:
        message = f"{gateway.name} has {there.address}, and the declared mask is /{wanted.network.prefixlen}"
        return fail("wrong-mask", message, _RUN)
    if there.leased and not gateway.leased:
        message = f"{gateway.name} has leased {wanted}, which is declared static: it goes when the lease ends"
        return fail("address-leased", message, _RUN)
    if gateway.leased and not there.leased:
        message = f"{gateway.name} has {wanted} by hand, while it is declared to get it by DHCP"
        return warn("address-by-hand", message, f"set {gateway.name} to DHCP, or declare `address_by: static`")
    return None


def _wrong(name: str, wanted: tuple[tuple[str, str], ...], held: tuple[Held, ...]) -> Iterator[Finding]:
    for interface, text in wanted:
        address = IPv4Interface(text)
        there = next((one for one in held if one.address.ip == address.ip), None)
        if there is None:
            yield fail("address-missing", f"{name} does not have its declared address {text} on {interface}", _RUN)
        elif there.address != address:
            message = f"{name} has {there.address} on {there.interface}, and the declared mask is"
            yield fail("wrong-mask", f"{message} /{address.network.prefixlen}", _RUN)
        elif there.interface != interface:
            message = f"{name} has its declared address {text} on {there.interface}, and not on {interface}"
            yield fail("wrong-interface", message, _RUN)
        elif there.flags:
            yield fail(
                "address-flagged", f"{text} of {name} is {listed(there.flags)}, and no declared address is", _RUN
            )
