"""The whole inventory as immutable models, and the selection of hosts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NoMatchError, nearest
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import findings, model

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory._yaml import Decrypt
    from atlantis_netcfg.inventory.examples import Example

ALL = "all"
"""Name for all sites."""


@dataclass(frozen=True, slots=True)
class Host:
    """A device and its site."""

    name: str
    site: str
    device: model.Device


@dataclass(frozen=True, slots=True)
class Inventory:
    """A valid inventory; every mapping is in the files' order."""

    root: Path
    pilot: model.Pilot
    partners: Mapping[str, model.Partner]
    vehicles: Mapping[str, model.Vehicle]
    sites: Mapping[str, model.Site]
    hosts: Mapping[str, Host]
    revision: str
    """SHA-256 of the names and contents of its files."""
    examples: tuple[Example, ...] = ()
    """Example values not replaced yet, by place."""
    warnings: tuple[findings.Finding, ...] = ()
    """Findings on values that are allowed but not recommended, by place."""
    places: Mapping[tuple[str, str], findings.Mark] = field(default_factory=dict)
    """Site and link to the place of the link in the inventory, for findings on derived values."""
    decrypt: Decrypt | None = field(default=None, compare=False, repr=False)
    """Function that decrypted its vault values, for related files that have some too; None: not available."""

    def site_hosts(self, site: str) -> tuple[Host, ...]:
        """Return the hosts of a site, in the order of hosts.yml."""
        return tuple(host for host in self.hosts.values() if host.site == site)

    def router_of(self, site: str) -> Host | None:
        """Return the router of a site, or None."""
        return next((host for host in self.site_hosts(site) if isinstance(host.device, model.Router)), None)

    def computer_of(self, site: str) -> Host | None:
        """Return the computer from which a site is probed: its gateway, else its control centre."""
        here = self.site_hosts(site)
        computers = [
            host for kind in (model.Gateway, model.ServerComputer) for host in here if isinstance(host.device, kind)
        ]
        return computers[0] if computers else None


def choose(inventory: Inventory, site: str, only: Sequence[str] = ()) -> tuple[Host, ...]:
    """Select the hosts of a site (`all`: every site), limited to `only`. Raises NoMatchError with the known names."""
    if site != ALL and site not in inventory.sites:
        raise NoMatchError(f"site `{arg(site)}` does not exist", hint=_suggest(site, "sites", [*inventory.sites, ALL]))
    here = tuple(host for host in inventory.hosts.values() if site in {ALL, host.site})
    names = [host.name for host in here]
    for name in only:
        if name not in names:
            raise _no_such_host(inventory, site, name, names)
    selection = tuple(host for host in here if not only or host.name in only)
    if not selection:
        raise NoMatchError(f"site `{arg(site)}` has no hosts", hint="add them to hosts.yml")
    return selection


def _no_such_host(inventory: Inventory, site: str, name: str, here: Sequence[str]) -> NoMatchError:
    elsewhere = inventory.hosts.get(name)
    if elsewhere is not None:
        return NoMatchError(
            f"`{arg(name)}` is not at site `{arg(site)}`", hint=f"type site={arg(elsewhere.site)} device={arg(name)}"
        )
    where = msg("in the inventory" if site == ALL else f"at site `{arg(site)}`")
    return NoMatchError(f"host `{arg(name)}` does not exist {arg(where)}", hint=_suggest(name, "hosts", here))


def _suggest(word: str, what: str, names: Iterable[str]) -> str:
    every = list(names)
    near = nearest(word, every)
    choices_text = msg(f"the {arg(what)} are: {arg(findings.choices(every))}")
    return msg(f"did you mean `{arg(near)}`? {arg(choices_text)}") if near else choices_text
