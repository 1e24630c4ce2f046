"""The shipped pilot, and what a profile says when it is read as XML."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

from atlantis_netcfg.computers.dds import ProfileView, profile_views, profiles
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Dds

SHIPPED = Path(__file__).parents[4] / "inventory"


def pilot(dds: Dds | None = None) -> Inventory:
    """The shipped declaration, with another `dds` in place of its own."""
    declaration = load(SHIPPED)
    if dds is None:
        return declaration
    return replace(declaration, pilot=declaration.pilot.model_copy(update={"dds": dds}))


def view(host: str, bearer: str, release: str | None = None, dds: Dds | None = None) -> ProfileView:
    declaration = pilot(dds)
    views = profile_views(declaration, declaration.hosts[host], release)
    return next(one for one in views if one.link == bearer)


def leaves(one: ProfileView, name: str) -> list[tuple[str, str]]:
    """Path and value of every leaf and attribute of a profile, in order; paths without namespaces."""
    text = profiles(one)[f"{one.link}/{name}"]
    return list(_leaves(ET.fromstring(text), ""))  # noqa: S314 - our own text


def _leaves(element: ET.Element, above: str) -> list[tuple[str, str]]:
    path = f"{above}/{element.tag.rpartition('}')[2]}".removeprefix("/")
    found = [(f"{path}@{key}", value) for key, value in element.attrib.items()]
    below = [leaf for child in element for leaf in _leaves(child, path)]
    text = (element.text or "").strip()
    return [*found, *below] if below or found else [(path, text)]
