"""Converts command arguments to requests for the authority; all is checked before anything is opened.

Everything in the inventory is checked here (partner, pool, vehicle, host), so that a refused name needs no passphrase
and leaves no file. Errors are collected and shown together. What only the record knows (a name or an address in use) is
refused by the authority.
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, fields, replace
from datetime import UTC, date, datetime, time, timedelta
from enum import StrEnum
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, TypeVar
from zoneinfo import ZoneInfo

from atlantis_netcfg.core.errors import NetcfgError, UsageError, nearest
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import Guest, OpenVpnVersion, RosDistribution, Router
from atlantis_netcfg.vpn import identity, names, systems
from atlantis_netcfg.vpn.authority.model import CLIENT_DAYS, EnrolmentRequest, RenewalRequest
from atlantis_netcfg.vpn.client import site_link

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from atlantis_netcfg.inventory import Host, Inventory


_Word = TypeVar("_Word", bound=StrEnum)
_MOST_DAYS = 1825
"""Maximum validity of a member's certificate: it must expire well before the authority does."""


class InvalidRequest(UsageError):
    """Several errors in a request; `errors` lists them. Nothing was opened or written."""

    def __init__(self, errors: Sequence[NetcfgError]) -> None:
        super().__init__(join("\n", errors))
        self.errors = tuple(errors)


class RequestCheck:
    """Checks the arguments of one request and collects the errors; `words` are the arguments as typed."""

    def __init__(self, words: Mapping[str, str | None]) -> None:
        self.words = words
        self.errors: list[UsageError] = []

    def close(self) -> None:
        """Raise the collected errors: UsageError for one, InvalidRequest for several."""
        if len(self.errors) > 1:
            raise InvalidRequest(self.errors)
        if self.errors:
            raise self.errors[0]

    def wrong(self, message: str, hint: str | None = None) -> None:
        """Add an error, with a hint on what to type instead."""
        self.errors.append(UsageError(message, hint=hint))

    def run_check(self, check: Callable[[], str]) -> str | None:
        """Return the result of `check`; None if it raises UsageError, which is collected."""
        try:
            return check()
        except UsageError as error:
            self.errors.append(error)
            return None

    def choice(self, word: str, choices: Sequence[_Word]) -> _Word | None:
        """Return the typed choice; None if it is missing, or unknown, which is collected as an error."""
        value = self.words[word]
        if value is None:
            return None
        for item in choices:
            if item.value == value:
                return item
        near = None if value[:1].isdecimal() else nearest(value, choices)  # another version is not what was meant
        hint = msg(f"did you mean `{arg(word)}={arg(near)}`?" if near else f"choose one of: {arg(join(', ', choices))}")
        self.wrong(msg(f"`{arg(word)}=`: unknown value {arg(quote(value))}"), hint)
        return None

    def days(self) -> int | None:
        """Return the typed validity in days; None if it is missing or wrong."""
        value = self.words["days"]
        if value is None:
            return None
        if re.fullmatch(r"[0-9]{1,5}", value) is None or not 1 <= int(value) <= _MOST_DAYS:
            self.wrong(
                msg(f"`days=`: {arg(quote(value))} is not a number from 1 to {arg(_MOST_DAYS)}"),
                msg(f"for example `days={arg(CLIENT_DAYS)}`"),
            )
            return None
        return int(value)


def quote(value: str) -> str:
    """Quote typed text, escaped and shortened, so that it cannot harm a terminal."""
    text = ascii(value)[1:-1]
    return f"`{text[:60]}…`" if len(text) > 60 else f"`{text}`"  # noqa: PLR2004 - of a line


def request_of_host(inventory: Inventory, check: RequestCheck) -> EnrolmentRequest | None:
    """Return the request for an inventory host; None on errors, which are in `check`."""
    for word in ("partner", "kind", "vehicle", "address", "system", "distribution", "openvpn"):
        if check.words[word] is not None:
            check.wrong(
                msg(f"`{arg(word)}=` cannot be used with a computer in the inventory"),
                "leave it out: the inventory sets it",
            )
    host = _find_declared_host(inventory, check)
    link, wrap = check.choice("link", list(identity.MemberLink)), check.choice("wrap", list(identity.Wrap))
    key, days = check.choice("key", list(identity.KeyType)), check.days()
    if host is None or check.run_check(lambda: names.check_name(host.name, "host")) is None:
        return None
    router = isinstance(host.device, Router)
    return EnrolmentRequest(
        name=host.name,
        kind=identity.MemberKind.ROUTER if router else identity.MemberKind.HOST,
        partner=None,
        device=host.name,
        address=computers(inventory)[host.name],
        link=link or site_link(inventory, host.site),
        wrap=wrap or systems.wrap_of_host(inventory, host),
        key=key or (identity.KeyType.RSA if router else identity.KeyType.EC),
        days=days or CLIENT_DAYS,
    )


def _find_declared_host(inventory: Inventory, check: RequestCheck) -> Host | None:
    host_name, inside = str(check.words["device"]), computers(inventory)
    if host_name in inside:
        return inventory.hosts[host_name]
    there = msg(f"in the VPN: {arg(join(', ', inside))}")
    if host_name in inventory.hosts:
        check.wrong(
            msg(f"`{arg(host_name)}` is not a VPN client: it has no tunnel address, or it is the server"), there
        )
        return None
    near = nearest(host_name, inside)
    otherwise = msg(f"add `partner=` if it is a partner's device; {arg(there)}")
    check.wrong(
        msg(f"there is no host {arg(quote(host_name))} in the inventory"),
        msg(f"did you mean `device={arg(near)}`?") if near else otherwise,
    )
    return None


def computers(inventory: Inventory) -> dict[str, IPv4Address]:
    """Return the inventory's VPN clients (computers and routers) with their tunnel addresses."""
    address_by_name = {name: _tunnel_address(host) for name, host in inventory.hosts.items()}
    server = inventory.pilot.vpn.server
    return {name: address for name, address in address_by_name.items() if address is not None and name != server}


def _tunnel_address(host: Host) -> IPv4Address | None:
    if isinstance(host.device, Router):
        return host.device.vpn_client.address if host.device.vpn_client is not None else None
    return getattr(host.device, "vpn_address", None)


_KINDS = tuple(kind for kind in identity.MemberKind if kind is not identity.MemberKind.HOST)


def request_of_device(inventory: Inventory, check: RequestCheck) -> EnrolmentRequest | None:
    """Return the request for a partner's device; None on errors, which are in `check`."""
    partner, device, kind = _partner(inventory, check), _device(check), _kind(check)
    link, client = check.choice("link", list(identity.MemberLink)), _client_words(check, kind)
    key, days = _key(check, kind), check.days()
    if partner is None or device is None or kind is None:
        return None
    name = _member(inventory, check, partner, device)
    vehicle = _vehicle(inventory, check, partner, device, kind)
    address = _address(inventory, check, partner)
    if name is None:
        return None
    return EnrolmentRequest(
        name=name,
        kind=kind,
        partner=partner,
        device=device,
        address=address,
        pool=inventory.partners[partner].vpn_pool,
        link=link or identity.MemberLink.FIBRE,
        vehicle=vehicle,
        wrap=_wrap(inventory, check, client, kind, vehicle),
        key=key,
        days=_days_of(inventory, check, vehicle, days),
        system=client.system,
        distribution=client.distribution,
    )


def days_left(inventory: Inventory, guest: Guest, now: datetime) -> int:
    """Return the maximum validity in whole days, so that a certificate expires by the guest's last day."""
    zone = ZoneInfo(inventory.pilot.time_zone)
    end = datetime.combine(date.fromisoformat(guest.until) + timedelta(days=1), time.min, zone)
    return (end - now).days


def _days_of(inventory: Inventory, check: RequestCheck, vehicle: str | None, days: int | None) -> int:
    """Return the validity of the certificate in days; for a guest not beyond its last day."""
    guest = inventory.vehicles.get(vehicle or "")
    if not isinstance(guest, Guest):
        return days or CLIENT_DAYS
    most = days_left(inventory, guest, datetime.now(UTC))
    if most < 1:
        check.wrong(
            msg(f"the stay of guest `{arg(vehicle)}` ended on {arg(guest.until)}"),
            "set a later day in `until:`, or end the stay",
        )
    elif days is not None and days > most:
        check.wrong(
            msg(f"`days={arg(days)}`: guest `{arg(vehicle)}` stays until {arg(guest.until)}"),
            msg(f"for example `days={arg(most)}`"),
        )
    return max(1, min(days or CLIENT_DAYS, most))


@dataclass(frozen=True, slots=True)
class _ClientWords:
    """Arguments on the device's OpenVPN client; None if not given."""

    system: identity.ClientSystem | None
    distribution: RosDistribution | None
    openvpn: OpenVpnVersion | None
    wrap: identity.Wrap | None


def _client_words(check: RequestCheck, kind: identity.MemberKind | None) -> _ClientWords:
    system, wrap = check.choice("system", list(identity.ClientSystem)), check.choice("wrap", list(identity.Wrap))
    release = check.choice("distribution", list(RosDistribution))
    version = check.choice("openvpn", list(OpenVpnVersion))
    if kind is not None and system is not None and system not in identity.SYSTEMS[kind]:
        check.wrong(
            msg(f"`system={arg(system)}`: a {arg(kind)} does not use this system"),
            msg(f"choose one of: {arg(join(', ', identity.SYSTEMS[kind]))}"),
        )
    for word, value in (("distribution", release), ("openvpn", version)):
        if kind is identity.MemberKind.ROUTER and value is not None:
            check.wrong(
                msg(f"`{arg(word)}=` cannot be used with `kind=router`"),
                msg(f"leave `{arg(word)}=` out: RouterOS supports neither"),
            )
    return _ClientWords(system, release, version, wrap)


def _wrap(
    inventory: Inventory, check: RequestCheck, client: _ClientWords, kind: identity.MemberKind, vehicle: str | None
) -> identity.Wrap:
    """Return a key type that the device's OpenVPN supports; contradictory arguments are collected as errors."""
    declared_vehicle = inventory.vehicles[vehicle] if vehicle is not None else None
    for word in ("distribution", "openvpn"):
        value, declared_value = getattr(client, word), getattr(declared_vehicle, word, None)
        if None not in (value, declared_value) and value != declared_value:
            check.wrong(
                msg(
                    f"`{arg(word)}={arg(value)}`: the inventory has `{arg(vehicle)}` with `{arg(word)}: "
                    f"{arg(declared_value)}`"
                ),
                msg(f"leave `{arg(word)}=` out, or correct vehicles.yml"),
            )
    version = systems.openvpn(inventory, kind, vehicle, version=client.openvpn, release=client.distribution)
    if client.wrap is identity.Wrap.TLS_CRYPT_V2 and version is OpenVpnVersion.V2_4:
        check.wrong(
            msg(f"`wrap={arg(client.wrap)}`: the device has OpenVPN 2.4, which cannot read such a profile"),
            "leave `wrap=` out; if the device has a newer OpenVPN, add `openvpn=2.6`",
        )
    usual = systems.wrap_for(version, force_cookie=inventory.pilot.vpn.force_cookie)
    if (
        client.wrap is identity.Wrap.TLS_CRYPT_V2
        and usual is identity.Wrap.TLS_CRYPT
        and version is not OpenVpnVersion.V2_4
    ):
        check.wrong(
            msg(
                f"`wrap={arg(client.wrap)}`: the server accepts such clients only from OpenVPN 2.6 on (`force_cookie`)"
            ),
            "leave `wrap=` out; if the device has OpenVPN 2.6, add `openvpn=2.6`",
        )
    return client.wrap or usual


def _partner(inventory: Inventory, check: RequestCheck) -> str | None:
    partner, partners = check.words["partner"], inventory.partners
    if partner is None:
        check.wrong(
            "`partner=` is missing: the partner that owns the device",
            "add it, or name a computer in the inventory with `device=`",
        )
    elif partner not in partners:
        near = nearest(partner, partners)
        hint = msg(f"did you mean `partner={arg(near)}`?" if near else f"the partners are: {arg(join(', ', partners))}")
        check.wrong(msg(f"there is no partner {arg(quote(partner))} in the inventory"), hint)
    else:
        return partner
    return None


def _device(check: RequestCheck) -> str | None:
    value = check.words["device"]
    if value is None:
        check.wrong("`device=` is missing: the name of the device", "add it, for example `device=sparus2`")
        return None
    return check.run_check(lambda: names.check_name(value, "device"))


def _kind(check: RequestCheck) -> identity.MemberKind | None:
    if check.words["kind"] is None:
        check.wrong("`kind=` is missing: the kind of device", msg(f"choose one of: {arg(join(', ', _KINDS))}"))
    return check.choice("kind", _KINDS)


def _key(check: RequestCheck, kind: identity.MemberKind | None) -> identity.KeyType:
    """Return the key type; RSA for routers, as RouterOS was never seen to work with elliptic curves (facts 10)."""
    return check.choice("key", list(identity.KeyType)) or (
        identity.KeyType.RSA if kind is identity.MemberKind.ROUTER else identity.KeyType.EC
    )


def _member(inventory: Inventory, check: RequestCheck, partner: str, device: str) -> str | None:
    name = check.run_check(lambda: names.member_name(partner, device))
    if name in inventory.hosts:
        check.wrong(
            msg(f"`{arg(name)}` is a computer in the inventory"),
            msg(f"choose another name, or type `device={arg(name)}` without `partner=`"),
        )
    return name


def _vehicle(
    inventory: Inventory, check: RequestCheck, partner: str, device: str, kind: identity.MemberKind
) -> str | None:
    value = check.words["vehicle"]
    if kind is not identity.MemberKind.ROBOT:
        if value is not None:
            check.wrong(msg(f"a {arg(kind)} is not a vehicle"), "leave `vehicle=` out, or set `kind=robot`")
        return None
    key = _find_vehicle(inventory, device if value is None else value)
    if key is None:
        if value is not None:
            near = nearest(value, inventory.vehicles)
            choices = msg(f"vehicles: {arg(join(', ', inventory.vehicles))}")
            check.wrong(
                msg(f"there is no vehicle {arg(quote(value))} in the inventory"),
                msg(f"did you mean `vehicle={arg(near)}`?") if near else choices,
            )
        return None
    owner = inventory.vehicles[key].partner
    if owner not in {None, partner}:
        check.wrong(
            msg(f"vehicle `{arg(key)}` belongs to `{arg(owner)}`, not to `{arg(partner)}`"),
            msg(f"type `partner={arg(owner)}`, or correct vehicles.yml"),
        )
    return key


def _find_vehicle(inventory: Inventory, name: str) -> str | None:
    """Return the key of the vehicle with this key or alias, ignoring case and spaces; None if there is none."""
    for key, vehicle in inventory.vehicles.items():
        if _normalise_name(name) in {_normalise_name(key), *(_normalise_name(alias) for alias in vehicle.aliases)}:
            return key
    return None


def _normalise_name(name: str) -> str:
    return name.casefold().replace(" ", "-")


def _address(inventory: Inventory, check: RequestCheck, partner: str) -> IPv4Address | None:
    value, pool = check.words["address"], inventory.partners[partner].vpn_pool
    if value is None:
        return None
    hint = msg(f"use one of {arg(pool)}, or leave `address=` out")
    try:
        address = IPv4Address(value)
    except ValueError:
        check.wrong(msg(f"{arg(quote(value))} is not an IPv4 address"), hint)
        return None
    if address not in pool:
        check.wrong(msg(f"{arg(address)} is not in the address pool of `{arg(partner)}`"), hint)
    elif address in {pool.network_address, pool.broadcast_address}:
        check.wrong(msg(f"{arg(address)} is the first or last address of {arg(pool)}, which no device may have"), hint)
    return address


@dataclass(frozen=True, slots=True)
class DeviceWords:
    """Unchecked arguments of a command line, or of one record of a file."""

    place: str = ""
    """`FILE:LINE` of a record; empty for a command line."""
    partner: str | None = None
    device: str | None = None
    kind: str | None = None
    vehicle: str | None = None
    link: str | None = None
    system: str | None = None
    distribution: str | None = None
    openvpn: str | None = None
    wrap: str | None = None
    key: str | None = None
    days: str | None = None
    address: str | None = None
    recipient: str | None = None


KEYS = tuple(field.name for field in fields(DeviceWords) if field.name != "place")
"""Keys that a record of a file may contain; the command has the same arguments."""


def requests_of(inventory: Inventory, device_requests: Iterable[DeviceWords]) -> tuple[EnrolmentRequest, ...]:
    """Return the requests in the order in which they were typed. Raises InvalidRequest with all errors."""
    requests: list[EnrolmentRequest] = []
    errors: list[NetcfgError] = []
    first_by_name: dict[str, DeviceWords] = {}
    for item in device_requests:
        try:
            request = request_of(inventory, item)
        except UsageError as error:
            errors += [_with_place(item, each) for each in getattr(error, "errors", (error,))]
            continue
        requests.append(request)
        if request.name in first_by_name:
            errors.append(
                _with_place(
                    item,
                    UsageError(
                        f"`{arg(request.name)}` is defined twice, first in {arg(first_by_name[request.name].place)}"
                    ),
                )
            )
        first_by_name.setdefault(request.name, item)
    if errors:
        raise InvalidRequest(errors)
    return tuple(requests)


def _with_place(item: DeviceWords, error: NetcfgError) -> NetcfgError:
    return UsageError(f"{arg(item.place)}: {arg(error)}", hint=error.hint) if item.place else error


def request_of(inventory: Inventory, item: DeviceWords) -> EnrolmentRequest:
    """Return the request for a partner's device or an inventory host. Raises UsageError or InvalidRequest (several)."""
    check = RequestCheck(asdict(item))
    is_host = item.partner is None and (
        item.device in inventory.hosts or (item.device is not None and item.kind is None)
    )
    request = request_of_host(inventory, check) if is_host else request_of_device(inventory, check)
    check.close()
    if request is None:
        raise AssertionError("refused without a reason")
    return request


def change_of(**words: str | None) -> RenewalRequest:
    """Parse the changes of a renewal. Raises UsageError, InvalidRequest for several errors."""
    check = RequestCheck(words)
    client = _client_words(check, None)
    change = RenewalRequest(
        days=check.days(),
        wrap=client.wrap,
        key=check.choice("key", list(identity.KeyType)),
        link=check.choice("link", list(identity.MemberLink)),
        system=client.system,
        distribution=client.distribution,
    )
    check.close()
    return change


def change_for(
    inventory: Inventory, member: identity.Member, change: RenewalRequest, openvpn: str | None
) -> RenewalRequest:
    """Complete the changes for this member: a partner's device gets a key that its OpenVPN supports.

    Raises UsageError, InvalidRequest: for arguments that do not fit the member, or a key that it cannot read.
    """
    words = {"system": change.system, "distribution": change.distribution, "openvpn": openvpn}
    check = RequestCheck({**words, "wrap": change.wrap})
    if member.partner is None:
        for word in [word for word, value in words.items() if value is not None]:
            check.wrong(
                msg(f"`{arg(word)}=` cannot be used with `{arg(member.name)}`"),
                "the inventory sets it for this computer",
            )
        check.close()
        if change.wrap is None and inventory.pilot.vpn.force_cookie and member.name in inventory.hosts:
            return replace(change, wrap=systems.wrap_of_host(inventory, inventory.hosts[member.name]))
        return change
    client = _client_words(check, member.kind)
    if change.distribution is None:
        client = replace(client, distribution=member.distribution)
    vehicle = member.vehicle if member.vehicle in inventory.vehicles else None
    fitting = _wrap(inventory, check, client, member.kind, vehicle)
    days = _days_of(inventory, check, vehicle, change.days)
    check.close()
    wrap = fitting if change.wrap is not None or fitting is identity.Wrap.TLS_CRYPT else None
    return replace(change, wrap=wrap, days=days)
