"""A partner's device, held against the declaration: its partner, its name, the robot that it is, its address."""

from __future__ import annotations

from ipaddress import IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.operations.vpn._check import shown
from atlantis_netcfg.vpn import names
from atlantis_netcfg.vpn.authority import CLIENT_DAYS, EnrolmentRequest
from atlantis_netcfg.vpn.identity import KeyType, Kind, Link, Wrap

if TYPE_CHECKING:
    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.operations.vpn._check import Check

__all__ = ["request_of_device"]

_KINDS = tuple(kind for kind in Kind if kind is not Kind.HOST)


def request_of_device(declaration: Declaration, check: Check) -> EnrolmentRequest | None:
    """The wish; None where something is wrong, which `check` has kept."""
    partner, device, kind = _partner(declaration, check), _device(check), _kind(check)
    link, wrap, key = (check.choice("link", list(Link)), check.choice("wrap", list(Wrap)), _key(check, kind))
    days = check.days()
    if partner is None or device is None or kind is None:
        return None
    name = _member(declaration, check, partner, device)
    vehicle = _vehicle(declaration, check, partner, device, kind)
    address = _address(declaration, check, partner)
    if name is None:
        return None
    return EnrolmentRequest(
        name=name,
        kind=kind,
        partner=partner,
        device=device,
        address=address,
        pool=declaration.partners[partner].vpn_pool,
        link=link or Link.FIBRE,
        vehicle=vehicle,
        wrap=wrap or Wrap.TLS_CRYPT_V2,
        key=key,
        days=days or CLIENT_DAYS,
    )


def _partner(declaration: Declaration, check: Check) -> str | None:
    typed, known = check.words["partner"], declaration.partners
    if typed is None:
        check.wrong("`partner=` is missing: whose device it is", "add it, or name a declared computer by `host=`")
    elif typed not in known:
        near = nearest(typed, known)
        hint = f"did you mean `partner={near}`?" if near else f"the partners are: {', '.join(known)}"
        check.wrong(f"there is no partner {shown(typed)} in the inventory", hint)
    else:
        return typed
    return None


def _device(check: Check) -> str | None:
    typed = check.words["device"]
    if typed is None:
        check.wrong("`device=` is missing: what the device is called", "add it, as in `device=sparus2`")
        return None
    return check.checked(lambda: names.check_name(typed, "device"))


def _kind(check: Check) -> Kind | None:
    if check.words["kind"] is None:
        check.wrong("`kind=` is missing: what the device is", f"it takes one of: {', '.join(_KINDS)}")
    return check.choice("kind", _KINDS)


def _key(check: Check, kind: Kind | None) -> KeyType:
    """RouterOS was never seen to work with elliptic curves here (facts 10)."""
    return check.choice("key", list(KeyType)) or (KeyType.RSA if kind is Kind.ROUTER else KeyType.EC)


def _member(declaration: Declaration, check: Check, partner: str, device: str) -> str | None:
    name = check.checked(lambda: names.member_name(partner, device))
    if name in declaration.hosts:
        check.wrong(f"`{name}` is a declared computer", f"another name for the device, or `host={name}`")
    return name


def _vehicle(declaration: Declaration, check: Check, partner: str, device: str, kind: Kind) -> str | None:
    typed = check.words["vehicle"]
    if kind is not Kind.ROBOT:
        if typed is not None:
            check.wrong(f"a {kind} is no vehicle", "leave `vehicle=` out, or say `kind=robot`")
        return None
    found = _named(declaration, device if typed is None else typed)
    if found is None:
        if typed is not None:
            near = nearest(typed, declaration.vehicles)
            known = f"the vehicles are: {', '.join(declaration.vehicles)}"
            check.wrong(f"there is no vehicle {shown(typed)}", f"did you mean `vehicle={near}`?" if near else known)
        return None
    owner = declaration.vehicles[found].partner
    if owner not in {None, partner}:
        check.wrong(
            f"the vehicle `{found}` is `{owner}`'s, and not `{partner}`'s",
            f"type `partner={owner}`, or correct vehicles.yml",
        )
    return found


def _named(declaration: Declaration, typed: str) -> str | None:
    """The key of the vehicle that is called so: by its key, or by another name; neither case nor spaces count."""
    for key, vehicle in declaration.vehicles.items():
        if _plain(typed) in {_plain(key), *(_plain(alias) for alias in vehicle.aliases)}:
            return key
    return None


def _plain(name: str) -> str:
    return name.casefold().replace(" ", "-")


def _address(declaration: Declaration, check: Check, partner: str) -> IPv4Address | None:
    typed, pool = check.words["address"], declaration.partners[partner].vpn_pool
    if typed is None:
        return None
    hint = f"one of {pool}, or leave `address=` out"
    try:
        address = IPv4Address(typed)
    except ValueError:
        check.wrong(f"{shown(typed)} is no IPv4 address", hint)
        return None
    if address not in pool:
        check.wrong(f"{address} is not in the pool of `{partner}`", hint)
    elif address in {pool.network_address, pool.broadcast_address}:
        check.wrong(f"{address} is the first or the last of {pool}, and no device's", hint)
    return address
