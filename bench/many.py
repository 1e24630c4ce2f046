"""An inventory of hundreds of sites, made from the shipped one: copies of the vessel with addresses of their own.

The copies have no VPN tunnel: with one, every router would route to every other site, and hundreds of sites would be
another task than one site hundreds of times.
"""

from __future__ import annotations

import re
import shutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["many", "name"]

_MODEL = "te4sea"
_HOSTS = ("router", "4g", "sat")
_KINDS = {"router": "routers", "4g": "lte_routers", "sat": "satellite_terminals"}
_PER_BLOCK = 250
"""Sites whose networks differ in the third octet only."""


def name(number: int) -> str:
    """The name of a copy; its router is called `<name>-router`."""
    return f"ship{number:03}"


def many(shipped: Path, folder: Path, number: int) -> Path:
    """Write an inventory into `folder`: the shipped pilot, and so many ships more."""
    shutil.copytree(shipped, folder)
    for ship in range(number):
        _write(shipped, folder, ship, f"group_vars/{_MODEL}.yml")
        for host in _HOSTS:
            _write(shipped, folder, ship, f"host_vars/{_MODEL}-{host}.yml")
    hosts = folder / "hosts.yml"
    hosts.write_text(_listed(hosts.read_text(encoding="utf-8"), number), encoding="utf-8")
    return folder


def _write(shipped: Path, folder: Path, ship: int, path: str) -> None:
    text = _own_settings((shipped / path).read_text(encoding="utf-8"), ship)
    (folder / path.replace(_MODEL, name(ship))).write_text(text, encoding="utf-8")


def _own_settings(text: str, ship: int) -> str:
    """Give a file of the model names and addresses of its own, and leave out tunnel, gateway and robots."""
    block, place = divmod(ship, _PER_BLOCK)
    for network, octet in (("10.64.2.", 100), ("10.64.102.", 110), ("10.10.9.", 120), ("10.10.10.", 130)):
        text = text.replace(network, f"10.{octet + block}.{place}.")
    text = re.sub(r"198\.51\.100\.3([12])", rf"10.{140 + block}.{place}.\1", text)
    text = re.sub(r"    reservations:\n(      - .*\n)+", "    reservations: []\n", text)
    text = re.sub(r"    vehicles: \[.*\]", "    vehicles: []", text)
    text = re.sub(r"  vpn_client:\n(    .*\n)+", "", text)
    return text.replace(_MODEL, name(ship))


def _listed(text: str, number: int) -> str:
    """Name the copies in `hosts.yml`: under their sites, and under what they are."""
    sites = "".join(
        f"        {name(ship)}:\n          hosts:\n" + "".join(f"            {name(ship)}-{host}:\n" for host in _HOSTS)
        for ship in range(number)
    )
    text = text.replace("    sites:\n      children:\n", "    sites:\n      children:\n" + sites)
    for host, kind in _KINDS.items():
        rows = "".join(f"        {name(ship)}-{host}:\n" for ship in range(number))
        text = text.replace(f"    {kind}:\n      hosts:\n", f"    {kind}:\n      hosts:\n{rows}")
    return text
