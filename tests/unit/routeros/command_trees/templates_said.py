"""Everything that the templates can say: rendered with every branch taken, and read off their sources."""

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

from spoken import Said, lines
from trees import ROOT, TREES, Tree

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import Cpe, LteDriver, LteRouter, PtpProtocol, RouterAccessPoint, Switch
from atlantis_netcfg.routeros.render import (
    CpeView,
    LteView,
    RouterView,
    cpe_view,
    environment,
    lte_view,
    router_view,
    template_folder,
)
from atlantis_netcfg.routeros.render._cpe import access_point
from atlantis_netcfg.routeros.render._switch import SwitchView, switch_view
from atlantis_netcfg.routeros.render.view import ClassView, NamedAddress

NEWER = {("/interface/wifi", "configuration.installation"): "7.17"}
"""Menu and argument to the first tree that has it: the claim of 7.16 is for names that every version has, but these."""
_ACCESS_POINT = {
    "ssid": "EXAMPLE",
    "standard": "802.11ac",
    "band": "5ghz",
    "frequency_mhz": 5580,
    "country": "portugal",
    "key": "EXAMPLE-key",
}
_INCLUDE = re.compile(r"\{% include \"([^\"]+)\" %\}")
_STATEMENT = re.compile(r"\{%-?.*?-?%\}", re.DOTALL)
_COMMENT = re.compile(r"\{#.*?#\}", re.DOTALL)
_SCRIPT = re.compile(r'-script="((?:[^"\\]|\\.)*)"')
_ESCAPED = re.compile(r"\\(.)")
_VALUE = re.compile(r"\{\{.*?\}\}", re.DOTALL)


def routers() -> Iterator[RouterView]:
    """Yield the views of all routers of the shipped inventory, and each with single things left out or added."""
    declaration = load(ROOT / "inventory")
    for host in declaration.hosts.values():
        if host.device.kind == "router":
            view = router_view(declaration, host)
            yield view
            yield from _variants(view)


def _variants(view: RouterView) -> Iterator[RouterView]:
    yield replace(view, tunnel=None)
    yield replace(view, remotes=(), forwards=(), served_links=(), uplinks=view.uplinks[:1])
    yield replace(view, uplinks=tuple(replace(link, probe_targets=(), targets=()) for link in view.uplinks))
    for menus in ("wifi", "wireless"):
        for isolated, power in ((True, 10), (False, None)):
            radio = RouterAccessPoint.model_validate(
                {
                    **_ACCESS_POINT,
                    "menus": menus,
                    "isolated": isolated,
                    "tx_power_dbm": power,
                    "antenna_gain_dbi": power,
                }
            )
            yield replace(view, access_point=access_point(radio))
    yield replace(view, server_in_lan=not view.server_in_lan)
    yield replace(view, switches=(NamedAddress("coastal-switch", "10.64.1.5"),))
    yield replace(view, classes=(ClassView("images", 5, 10, (NamedAddress("zarco", "10.64.1.23"),)),))
    yield replace(view, ports=tuple(replace(port, poe_out=None, poe_priority=None) for port in view.ports))
    yield replace(view, ports=tuple(replace(port, poe_out="auto-on", poe_priority=10) for port in view.ports))


def cpes() -> Iterator[CpeView]:
    """Yield the views of all ends of bridges of the shipped inventory, for both families of radio menus."""
    declaration = load(ROOT / "inventory")
    for host in declaration.hosts.values():
        if not isinstance(host.device, Cpe):
            continue
        for family, protocol in (("wireless", "nv2"), ("wireless", "802.11"), ("wifi", "802.11")):
            ptp = host.device.ptp.model_copy(update={"protocol": PtpProtocol(protocol)})
            view = cpe_view(declaration, replace(host, device=host.device.model_copy(update={"ptp": ptp})), family)
            yield view
            for is_ap in (True, False):
                radio = replace(view.radio, is_ap=is_ap)
                yield replace(view, radio=replace(radio, tx_power_dbm=10, antenna_gain_dbi=16, distance_km=3))
                yield replace(view, radio=replace(radio, tx_power_dbm=None, antenna_gain_dbi=None, distance_km=None))


def lte_boxes() -> Iterator[LteView]:
    """Yield the views of all MikroTik LTE boxes of the shipped inventory, with all that a SIM can need and without."""
    declaration = load(ROOT / "inventory")
    for host in declaration.hosts.values():
        if isinstance(host.device, LteRouter) and host.device.driver is LteDriver.ROUTEROS:
            view = lte_view(declaration, host)
            yield view
            subscribed = replace(view, apn="umts", user="user", password=Secret("EXAMPLE-apn"))
            yield replace(subscribed, pin=Secret("1234"), roaming=True, bands=(3,))
            yield replace(view, apn=None, user=None, password=None, pin=None, bands=())


def switches() -> Iterator[SwitchView]:
    """Yield the views of a switch at the coastal site, with a radio of either family and without."""
    declaration = load(ROOT / "inventory")
    router = declaration.hosts["coastal-router"]
    for menus in (None, "wifi", "wireless"):
        device = {
            "kind": "switch",
            "access": {"address": "10.64.1.5", "password": "EXAMPLE-switch"},
            "ports": [
                {"name": "ether1", "use": "uplink"},
                {"name": "ether2", "use": "lan", "isolated": True, "poe": {}},
                {"name": "ether3", "use": "off"},
            ],
            "access_point": menus and {**_ACCESS_POINT, "menus": menus},
        }
        yield switch_view(declaration, replace(router, name="coastal-switch", device=Switch.model_validate(device)))


@cache
def rendered() -> tuple[str, ...]:
    """Every text that can come out; a new kind of template has to be rendered here."""
    template = environment().get_template("routeros/router.rsc.j2")
    radio = environment().get_template("routeros/cpe.rsc.j2")
    box = environment().get_template("routeros/lte.rsc.j2")
    switch = environment().get_template("routeros/switch.rsc.j2")
    routed = [template.render(router=view) for view in routers()]
    return (
        *routed,
        *dict.fromkeys(script for text in routed for script in scripts(text)),
        *(radio.render(cpe=view) for view in cpes()),
        *(box.render(lte=view) for view in lte_boxes()),
        *(switch.render(switch=view) for view in switches()),
    )


def scripts(text: str) -> Iterator[str]:
    """Yield the scripts that stand in quotes in a text."""
    for found in _SCRIPT.findall(text.replace("\\\n", "")):
        yield _ESCAPED.sub(r"\1", found)


def sources() -> dict[str, str]:
    """Return every template that is rendered by itself, with what it includes in its place."""
    tops = sorted((template_folder() / "routeros").glob("*.j2"))
    return {path.name: _whole(path.read_text("utf-8")) for path in tops}


def left_out() -> set[str]:
    """Return the names of parts that no template includes."""
    folder = template_folder()
    named = {name for path in folder.rglob("*.j2") for name in _INCLUDE.findall(path.read_text("utf-8"))}
    parts = {path.relative_to(folder).as_posix() for path in (folder / "routeros").glob("*/**/*.j2")}
    return parts - named


def _whole(source: str) -> str:
    return _INCLUDE.sub(lambda found: _whole((template_folder() / found[1]).read_text("utf-8")), source)


def bare(source: str) -> str:
    """Return a template as if every branch were taken once, with a word in place of every value."""
    text = _COMMENT.sub("", source)
    return _VALUE.sub("X", _STATEMENT.sub("", text))


def words(texts: tuple[str, ...]) -> frozenset[tuple[str, str, str]]:
    """Return menu, command and argument of everything in the texts, as the newest tree reads them."""
    return frozenset(cell for text in texts for said in lines(text, TREES[-1]) for cell in cells(said))


def unknown(said: Said, tree: Tree) -> frozenset[str]:
    """Return the names of a line that a tree lacks and should have."""
    return frozenset(
        name
        for name in said.unknown(tree)
        if Version.parse(NEWER.get((said.menu, name), "0.0")) <= Version.parse(tree.version)
    )


def cells(said: Said) -> Iterator[tuple[str, str, str]]:
    yield said.menu, said.command, ""
    for name in said.names:
        yield said.menu, said.command, name
