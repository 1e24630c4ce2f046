"""Start of an emulated router: factory configuration, adoption, scheduler jobs.

Assumption: factory-cpe
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros import menus
from atlantis_netcfg.emulator.routeros.access import is_allowed
from atlantis_netcfg.emulator.routeros.answers import Caller
from atlantis_netcfg.emulator.routeros.commands._checks import mac_of
from atlantis_netcfg.emulator.routeros.commands.write import QUEUES, queue_row
from atlantis_netcfg.emulator.routeros.console.run import run_file, run_script
from atlantis_netcfg.emulator.routeros.store import StoredItem
from atlantis_netcfg.emulator.routeros.values import reference, seconds, spell
from atlantis_netcfg.routeros.rsc import quote

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.spec import RouterSpec


ADDRESS = "192.168.88.1"
_NETWORK = "192.168.88.0/24"
_STATES = "established,related,untracked"
_BAD_IPV6 = {
    "::/128": "unspecified address",
    "::1/128": "lo",
    "fec0::/10": "site-local",
    "::ffff:0.0.0.0/96": "ipv4-mapped",
    "::/96": "ipv4 compat",
    "100::/64": "discard only ",
    "2001:db8::/32": "documentation",
    "2001:10::/28": "ORCHID",
    "3ffe::/16": "6bone",
}


def default_configuration(spec: RouterSpec) -> str:
    """Return the factory configuration of this board as an export-style text.

    Manual, Default configurations: "RouterMode": the first port is WAN with a DHCP client behind a firewall, all others
    are bridged, with 192.168.88.1/24 and a DHCP server. The rows are those of public exports of RB5009UPr+S+ with
    7.16.2 and 7.20.6; rows for disks and radios of a board are left out.

    A device with one port and a radio comes as "CPE Router": the radio is the WAN, a station that looks for its access
    point, and the port has the address and the DHCP server itself, without a bridge. A few models for bridges
    (DynaDish) come with both in a bridge instead, and are not emulated.
    """
    return "".join(f"{line}\n" for line in (*_lan(spec), *_firewall(), *_firewall6(), *_tools()))


def _is_cpe(spec: RouterSpec) -> bool:
    return len(spec.ports) == 1 and bool(spec.radios)


def _lan(spec: RouterSpec) -> Iterator[str]:
    if _is_cpe(spec):
        station = _station(spec)
        yield from station
        yield from _services(inside=spec.ports[0], outside=spec.radios[0].name if station else None)
        return
    wan, *lan = spec.ports
    yield "/interface bridge add comment=defconf name=bridge"
    for port in lan:
        yield f"/interface bridge port add bridge=bridge comment=defconf interface={port}"
    yield from _services(inside="bridge", outside=wan)


def _station(spec: RouterSpec) -> tuple[str, ...]:
    """Enable the radio if its driver package is installed; otherwise the interface does not exist."""
    radio = spec.radios[0].name
    if "wireless" in spec.packages:
        return (f"/interface wireless set [ find default-name={radio} ] disabled=no mode=station ssid=MikroTik",)
    if any(package.startswith("wifi-") for package in spec.packages):
        return (f"/interface wifi set [ find default-name={radio} ] configuration.mode=station disabled=no",)
    return ()


def _services(inside: str, outside: str | None) -> Iterator[str]:
    """Yield the factory services on the inside, and the clients on the outside, if any."""
    yield "/interface list add comment=defconf name=WAN"
    yield "/interface list add comment=defconf name=LAN"
    yield "/ip pool add name=default-dhcp ranges=192.168.88.10-192.168.88.254"
    yield f"/ip dhcp-server add address-pool=default-dhcp interface={inside} name=defconf"
    yield "/ip neighbor discovery-settings set discover-interface-list=LAN"
    yield f"/interface list member add comment=defconf interface={inside} list=LAN"
    if outside is not None:
        yield f"/interface list member add comment=defconf interface={outside} list=WAN"
    yield f"/ip address add address={ADDRESS}/24 comment=defconf interface={inside}"
    if outside is not None:
        yield f"/ip dhcp-client add comment=defconf interface={outside}"
    yield f"/ip dhcp-server network add address={_NETWORK} comment=defconf dns-server={ADDRESS} gateway={ADDRESS}"
    yield "/ip dns set allow-remote-requests=yes"
    yield f"/ip dns static add address={ADDRESS} comment=defconf name=router.lan"


def _firewall() -> Iterator[str]:
    rules = (
        ("input", "accept", "accept established,related,untracked", f"connection-state={_STATES}"),
        ("input", "drop", "drop invalid", "connection-state=invalid"),
        ("input", "accept", "accept ICMP", "protocol=icmp"),
        ("input", "accept", "accept to local loopback (for CAPsMAN)", "dst-address=127.0.0.1"),
        ("input", "drop", "drop all not coming from LAN", "in-interface-list=!LAN"),
        ("forward", "accept", "accept in ipsec policy", "ipsec-policy=in,ipsec"),
        ("forward", "accept", "accept out ipsec policy", "ipsec-policy=out,ipsec"),
        ("forward", "fasttrack-connection", "fasttrack", "connection-state=established,related"),
        ("forward", "accept", "accept established,related, untracked", f"connection-state={_STATES}"),
        ("forward", "drop", "drop invalid", "connection-state=invalid"),
        (
            "forward",
            "drop",
            "drop all from WAN not DSTNATed",
            "connection-nat-state=!dstnat connection-state=new in-interface-list=WAN",
        ),
    )
    for chain, action, comment, rest in rules:
        yield f"/ip firewall filter add action={action} chain={chain} comment={_comment(comment)} {rest}"
    rest = "ipsec-policy=out,none out-interface-list=WAN"
    yield f"/ip firewall nat add action=masquerade chain=srcnat comment={_comment('masquerade')} {rest}"


def _firewall6() -> Iterator[str]:
    for address, comment in _BAD_IPV6.items():
        yield f"/ipv6 firewall address-list add address={address} comment={_comment(comment)} list=bad_ipv6"
    rules = (
        ("input", "accept", "accept established,related,untracked", f"connection-state={_STATES}"),
        ("input", "drop", "drop invalid", "connection-state=invalid"),
        ("input", "accept", "accept ICMPv6", "protocol=icmpv6"),
        ("input", "drop", "drop everything else not coming from LAN", "in-interface-list=!LAN"),
        ("forward", "accept", "accept established,related,untracked", f"connection-state={_STATES}"),
        ("forward", "drop", "drop invalid", "connection-state=invalid"),
        ("forward", "drop", "drop packets with bad src ipv6", "src-address-list=bad_ipv6"),
        ("forward", "drop", "drop packets with bad dst ipv6", "dst-address-list=bad_ipv6"),
        ("forward", "accept", "accept ICMPv6", "protocol=icmpv6"),
        ("forward", "drop", "drop everything else not coming from LAN", "in-interface-list=!LAN"),
    )
    for chain, action, comment, rest in rules:
        yield f"/ipv6 firewall filter add action={action} chain={chain} comment={_comment(comment)} {rest}"


def _tools() -> Iterator[str]:
    yield "/tool mac-server set allowed-interface-list=LAN"
    yield "/tool mac-server mac-winbox set allowed-interface-list=LAN"


def _comment(text: str) -> str:
    return quote(f"defconf: {text}")


SYSTEM = Caller(0, "*sys", "full", "local", "", 0.0)
"""Caller that seeds the router and runs its scheduled scripts."""
_MARK = "atlantis: management"
_LOOPBACK_ID = 0x1000000
"""Outside the range of the other interfaces; the real id is not published."""
_BUILTIN_USER = "system default user"


class SeedError(ValueError):
    """The seed of a spec is invalid for this router."""


def boot(core: Core) -> None:
    """Fill the tables: factory rows, the spec's users, certificates and management address, then the seed."""
    for path in menus.INTERFACES:
        core.store.table(path)
    for path in (*menus.MODELLED_MENUS, *menus.BUILT_IN):
        if core.schema.has_menu(path):
            _add_factory_rows(core, core.store.table(path).menu)
    _add_ports(core)
    _radios(core)
    _modem(core)
    _loopback(core)
    _add_queues(core)
    _add_users(core)
    if core.spec.factory:
        _seed(core, default_configuration(core.spec) + core.spec.seed)
    else:
        _add_certificates(core)
        _adopt(core)
    core.store.changes.clear()
    core.history.clear()
    core.log.clear()


def _add_factory_rows(core: Core, menu: menus.EmulatedMenu) -> None:
    table = core.store.table(menu.path)
    if menu.shape is menus.Shape.SETTINGS:
        table.items.append(StoredItem(menu.first_id, {}, dict(menu.factory[0]) if menu.factory else {}))
    for row in menu.factory if menu.shape is not menus.Shape.SETTINGS else ():
        number = int(row[".id"][1:], 16) if ".id" in row else core.store.new_id(menu.path)
        table.items.append(StoredItem(number, {}, dict(row), dynamic=menu.factory_dynamic))
    for item in table.items:
        defaults = {name: value for name, value in (item.factory or {}).items() if name in {*table.args, "name"}}
        item.values = {name: _parse(core, menu, name, value) for name, value in defaults.items()}
        item.factory = {name: spell(value, core.store) for name, value in item.values.items()}


def _parse(core: Core, menu: menus.EmulatedMenu, name: str, value: str) -> str:
    return menu.by_name[name].kind.parse(value, core.store)


def _add_ports(core: Core) -> None:
    menu = menus.MODELLED_MENUS["/interface/ethernet"]
    table = core.store.table(menu.path)
    for number, port in enumerate(core.spec.ports, start=1):
        mac = mac_of(core.spec.name, number)
        factory = {"name": port, "mac-address": mac, "orig-mac-address": mac}
        table.items.append(StoredItem(core.store.new_id(menu.path), dict(factory), factory))


def _radios(core: Core) -> None:
    """Add radios whose driver is installed; others do not exist (Manual, Packages)."""
    newer = any(package.startswith("wifi-") for package in core.spec.packages)
    path = "/interface/wifi" if newer else "/interface/wireless"
    if not core.schema.has_menu(path):
        return
    table = core.store.table(path)
    for number, radio in enumerate(core.spec.radios, start=len(core.spec.ports) + 1):
        mac = mac_of(core.spec.name, number)
        factory = {"name": radio.name, "mac-address": mac}
        if not newer:
            factory |= {"radio-name": mac.replace(":", ""), "ssid": "MikroTik", "band": "5ghz-a/n", "frequency": "5180"}
        table.items.append(StoredItem(core.store.new_id(path), dict(factory), factory))


def _modem(core: Core) -> None:
    """Add the single row of a board with a modem; roaming is off from the factory."""
    if core.spec.modem is None or not core.schema.has_menu("/interface/lte"):
        return
    factory = {"name": core.spec.modem.name, "allow-roaming": "no"}
    core.store.table("/interface/lte").items.append(
        StoredItem(core.store.new_id("/interface/lte"), dict(factory), factory)
    )


def _loopback(core: Core) -> None:
    """The interface `lo`: exports of 7.16 are the oldest that name it."""
    if core.schema.at_least("7.16"):
        row = {"name": "lo"}
        core.store.table("/interface").items.append(StoredItem(_LOOPBACK_ID, dict(row), row, dynamic=True))


def _add_queues(core: Core) -> None:
    for path in (*menus.INTERFACES, "/interface"):
        for item in core.store.table(path).items:
            queue_row(core, core.store.table(QUEUES), item.values["name"])


def _add_users(core: Core) -> None:
    spec, path = core.spec, "/user"
    names = {user.name for user in spec.users}
    if "admin" not in names:
        everyone = core.store.refer("group", "full")
        admin = {"name": "admin", "group": everyone, "disabled": "yes", "comment": _BUILTIN_USER}
        core.store.insert(path, admin)
    for user in spec.users:
        values = {"name": user.name, "group": core.store.refer("group", user.group), "password": user.password}
        values |= {"disabled": "yes"} if user.is_disabled else {}
        values |= {"address": user.address} if user.address else {}
        values |= {"comment": _BUILTIN_USER} if user.name == "admin" else {}
        core.store.insert(path, values)


def _add_certificates(core: Core) -> None:
    for name in core.spec.certificates:
        core.store.insert("/certificate", {"name": name, "common-name": core.spec.name, "trusted": "yes"})


def _adopt(core: Core) -> None:
    management = core.spec.management
    store, service = core.store, core.store.table("/ip/service")
    port = store.id_of("interface", management.port)
    if port is not None:
        address = _parse(core, menus.MODELLED_MENUS["/ip/address"], "address", management.address)
        network = str(management.network)
        values = {"address": address, "interface": reference("interface", port), "network": network, "comment": _MARK}
        store.insert("/ip/address", values)
    for item in service.items:
        if store.text(service, item, "name") == "api-ssl" and core.spec.certificates:
            item.values = item.values | {"certificate": store.refer("certificate", core.spec.certificates[0])}
    _seed(core, core.spec.seed)


def _seed(core: Core, text: str) -> None:
    error = run_file(core, SYSTEM, text).error if text else None
    if error is not None:
        raise SeedError(f"{core.spec.name}: the seed was refused: {error}")


_PATH = "/system/scheduler"
_AFTER_BOOT_S = 3.0


def next_run(core: Core) -> float | None:
    """Return when the next scheduled job runs, on the core's `now`; None if none will.

    Rows of `/system/scheduler`: Manual, Scheduler; in a device-mode without `scheduler` none runs.
    """
    return min((when for _, when in _scheduled_jobs(core)), default=None)


def run_due(core: Core) -> None:
    """Run each due job once; its output is discarded, errors go to the log."""
    now = core.now()
    for item, when in list(_scheduled_jobs(core)):
        if when > now:
            continue
        core.ran[item.id] = now
        core.run_counts[item.id] = core.run_counts.get(item.id, 0) + 1
        script = item.values.get("on-event", "")
        error = run_script(core, SYSTEM, script).error
        if error is not None:
            core.note("script,error", error)


def _scheduled_jobs(core: Core) -> Iterator[tuple[StoredItem, float]]:
    if not is_allowed(core.spec, "scheduler"):
        return
    table = core.store.table(_PATH)
    for item in table.items:
        if core.store.text(table, item, "disabled") == "yes":
            continue
        when = _when(core, item)
        if when is not None:
            yield item, when


def _when(core: Core, item: StoredItem) -> float | None:
    """Return a job's next run: `interval` 0 means once; `start-time=startup` is 3 s after boot, then periodic."""
    period = seconds(item.values.get("interval", "0s")) or 0.0
    first = _first_run_time(core, item)
    ran = core.ran.get(item.id)
    if ran is None:
        since = core.scheduled_since.setdefault(item.id, core.now())
        # A job that is given no start has the time of its adding there, and with an interval has not run by then
        # (manual, Scheduler: its example shows `run-count` 0).
        if first >= core.started and (first > since or (first == since and not period)):
            return first
        return _later(first, period, core.scheduled_since[item.id]) if period else None
    return _later(first, period, ran) if period else None


def _first_run_time(core: Core, item: StoredItem) -> float:
    if item.values.get("start-time") == "startup":
        return core.started + _AFTER_BOOT_S
    date = item.values.get("start-date", "1970-01-01")
    form = "%b/%d/%Y" if "/" in date else "%Y-%m-%d"
    text = f"{date} {item.values.get('start-time', '00:00:00')}"
    moment = datetime.strptime(text, f"{form} %H:%M:%S").replace(tzinfo=UTC)
    return core.started + (moment - core.boot_clock).total_seconds()


def _later(first: float, period: float, after: float) -> float:
    """Return the first time after `after` in the schedule."""
    return first + period * (max(0, int((after - first) // period)) + 1)
