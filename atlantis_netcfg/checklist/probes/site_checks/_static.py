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

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        current = _on_sockets(results, self.site.router.name)
        found = [current] if isinstance(current, Finding) else list(self._of_router(self.site.router.name, current))
        evidence = [declared(f"address of {name}", address) for name, address in self._wanted()]
        gateway = self.site.gateway
        if gateway is not None:
            local = addresses(results["gateway"], gateway.name)
            found += [local] if isinstance(local, Finding) else self._of_gateway(gateway, local, results)
            if not isinstance(local, Finding):
                evidence += [read(f"{item.interface} of {gateway.name}", str(item.address)) for item in local]
        return Judged(tuple(found), tuple(evidence))

    def _wanted(self) -> Iterator[tuple[str, str]]:
        """Interface and address of everything that the router has by declaration."""
        view = self.site.view
        assert view is not None  # noqa: S101 - the check is made for sites with a router
        yield view.bridge, view.lan.address
        yield view.management.port, view.management.address
        for link in (*view.uplinks, *view.served):
            yield link.port, link.interface_address

    def _of_router(self, name: str, current: tuple[Held, ...]) -> Iterator[Finding]:
        wrong = list(_wrong(name, tuple(self._wanted()), current))
        yield from wrong
        if not wrong:
            count = len(tuple(self._wanted()))
            yield good("router-as-declared", f"{name} has its {count} declared addresses, none of them leased")

    def _of_gateway(self, gateway: Computer, local: tuple[Held, ...], received: Mapping[str, Answer]) -> list[Finding]:
        interface = IPv4Interface(f"{gateway.device.address}/{self.site.declared.lan.network.prefixlen}")
        there = next((item for item in local if item.address.ip == interface.ip), None)
        wrong = _as_it_runs(gateway, interface, there)
        if wrong is not None:
            return [wrong]
        kept = self._in_files(gateway, interface, received)
        fine = good("gateway-as-declared", f"{gateway.name} has {interface}, and will have it after a restart")
        return [kept or fine]

    def _in_files(self, gateway: Computer, interface: IPv4Interface, received: Mapping[str, Answer]) -> Finding | None:
        """What is wrong with the files that the next start reads; None: they say what runs."""
        texts = {path: received[path] for path in FILES}
        trouble = next(
            (result for result in texts.values() if not isinstance(result, Ran) or result.trouble is not None), None
        )
        if trouble is not None:
            return silent(gateway.name, getattr(trouble, "trouble", None) or Trouble.SILENT, trouble.words)
        files = {path: answer.out for path, answer in texts.items() if isinstance(answer, Ran) and answer.rc == 0}
        host = self.site.declaration.hosts[gateway.name]
        promised = gateway_network(self.site.declaration, host)
        if promised is not None:
            return _promised(gateway.name, promised.path, files.get(promised.path), promised.content, interface)
        if gateway.leased or any(_says(text, interface) for text in files.values()):
            return None
        message = (
            f"{gateway.name} has {interface}, but no file of ours says so: nobody knows whether it survives a restart"
        )
        hint = f"declare `network:` of {gateway.name} and run the site, or restart it once and repeat the check"
        return unknown("no-file", message, hint)


def _on_sockets(results: Mapping[str, Answer], router: str) -> tuple[Held, ...] | Finding:
    """The router's addresses, each on the factory name of its port: what a port is called proves nothing."""
    current = addresses(results["router"], router)
    ports = rows(results["sockets"], router, "the names of its ports", "default-name")
    if isinstance(current, Finding):
        return current
    if isinstance(ports, Finding):
        return ports
    socket = {row.get("name", ""): row.get("default-name", "") for row in ports}
    return tuple(replace(item, interface=socket.get(item.interface, item.interface)) for item in current)


def _says(text: str, interface: IPv4Interface) -> bool:
    """A comment does not configure anything."""
    lines = (line for line in text.splitlines() if not line.lstrip().startswith("#"))
    return any(str(interface) in line for line in lines)


def _promised(name: str, path: str, text: str | None, content: str, interface: IPv4Interface) -> Finding | None:
    hint = f"run the site with `only={name}`: it writes {path} again, under a timer that takes a mistake back"
    if text is None:
        return fail(
            "no-file", f"{name} has {interface}, but {path} is not there: it will be gone after a restart", hint
        )
    if text.strip() != content.strip():
        return fail(
            "file-differs", f"{path} of {name} does not say what is declared: a restart changes its address", hint
        )
    return None


def _as_it_runs(gateway: Computer, interface: IPv4Interface, there: Held | None) -> Finding | None:
    if there is None:
        return fail("address-missing", f"{gateway.name} does not have its declared address {interface}", _RUN)
    if there.interface == _LOOPBACK:
        message = f"{gateway.name} has its declared address {interface} on {there.interface}, where nobody reaches it"
        return fail("wrong-interface", message, _RUN)
    if there.address != interface:
        message = f"{gateway.name} has {there.address}, and the declared mask is /{interface.network.prefixlen}"
        return fail("wrong-mask", message, _RUN)
    if there.leased and not gateway.leased:
        message = f"{gateway.name} has leased {interface}, which is declared static: it goes when the lease ends"
        return fail("address-leased", message, _RUN)
    if gateway.leased and not there.leased:
        message = f"{gateway.name} has {interface} by hand, while it is declared to get it by DHCP"
        return warn("address-by-hand", message, f"set {gateway.name} to DHCP, or declare `address_by: static`")
    return None


def _wrong(name: str, expected: tuple[tuple[str, str], ...], current: tuple[Held, ...]) -> Iterator[Finding]:
    for interface, text in expected:
        address = IPv4Interface(text)
        there = next((item for item in current if item.address.ip == address.ip), None)
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
