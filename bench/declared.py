"""The desired state that all contenders are given: the shipped inventory with real-looking values, rendered once."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ansible.parsing.vault import VaultLib, VaultSecret

from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import Router
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.routeros.desired import read
from atlantis_netcfg.routeros.menus import MENUS
from atlantis_netcfg.routeros.render import router

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros import EmulatorSpec
    from atlantis_netcfg.inventory import Inventory

__all__ = ["CHECKOUT", "ROUTER", "SITE", "Declared"]

CHECKOUT = Path(__file__).resolve().parents[1]
SITE, ROUTER = "coastal", "coastal-router"
_VAULT_PASSWORD = b"the word of the bench"
_VAULT = VaultLib([("default", VaultSecret(_VAULT_PASSWORD))])
_DOCUMENTATION = (("203.0.113.", "10.99.3."), ("198.51.100.", "10.99.2."), ("192.0.2.", "10.99.1."))


@dataclass(frozen=True, slots=True)
class Declared:
    """An inventory on disk, and what it declares for the router."""

    inventory: Path
    vault_password: Path
    declaration: Inventory

    @classmethod
    def make(cls, folder: Path) -> Declared:
        """Write a copy of the shipped inventory in which nothing is an example, and secrets are vaulted.

        Without the router's access point: community.routeros has no name for one of its fields.
        """
        root, word = folder / "inventory", folder / "vault-password"
        word.write_bytes(_VAULT_PASSWORD)
        shutil.copytree(CHECKOUT / "inventory", root)
        for path in root.rglob("*.yml"):
            path.write_text(_real(path.read_text(encoding="utf-8")), encoding="utf-8")
        device = root / "host_vars" / f"{ROUTER}.yml"
        text = device.read_text(encoding="utf-8")
        device.write_text(re.sub(r"^  access_point:.*\n(?:    .*\n)+", "", text, flags=re.MULTILINE), encoding="utf-8")
        return cls(root, word, load(root, decrypt=lambda text: str(_VAULT.decrypt(text.encode()).decode())))

    @property
    def text(self) -> str:
        """The desired state in the device's own language."""
        return router(self.declaration, self.declaration.hosts[ROUTER])

    @property
    def twin(self) -> EmulatorSpec:
        """The router as `provision device adopt` leaves it: our user, a certificate, the management address."""
        (twin,) = site_spec(self.declaration, [self.declaration.hosts[ROUTER]]).emulators
        return twin

    @property
    def access(self) -> tuple[str, str, str]:
        """Address, user and password."""
        device = self.declaration.hosts[ROUTER].device
        assert isinstance(device, Router)  # noqa: S101 - the shipped inventory says so
        return str(device.access.address), device.access.user, device.access.password.reveal()

    def menus(self) -> list[dict[str, Any]]:
        """The same state as rows of menus, for peers that take data instead of text."""
        desired = read(self.text)
        return [
            {
                "path": path,
                "shape": MENUS[path].shape.name.lower(),
                "ordered": MENUS[path].is_ordered,
                "entire": path in desired.entire,
                "keys": list(MENUS[path].keys),
                "rows": [dict(item.values) for item in items],
            }
            for path, items in desired.items.items()
        ]


def _real(text: str) -> str:
    for documentation, real in _DOCUMENTATION:
        text = text.replace(documentation, real)
    text = re.sub(r" #.*\bEXAMPLE\b(?!-).*", "", text)
    text = text.replace("example_values: true", "example_values: false").replace("example.org", "atlantis.internal")
    text = text.replace("ssid: EXAMPLE-", "ssid: ").replace("internet.example", "internet.atlantis.internal")
    text = text.replace("{name: EXAMPLE-", "{name: ")
    text = text.replace(" EXAMPLE technician", " technician").replace("revision: EXAMPLE-", "revision: ")
    return re.sub(r"EXAMPLE-([a-z0-9-]+)", lambda found: _vaulted(f"a-real-{found[1]}"), text)


@cache
def _vaulted(secret: str) -> str:
    """As `ansible-vault encrypt_string` has it, on one line."""
    return f"!vault {json.dumps(_VAULT.encrypt(secret.encode()).decode())}"
