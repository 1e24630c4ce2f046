"""From what somebody asked for to the wish that the authority takes: everything is checked before anything is opened.

All that the declaration says is held against it here (partner, pool, vehicle, declared host), so that a refused name
costs no passphrase and leaves no file. What only the record knows (a name or an address that is taken) the authority
refuses by itself.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.operations.vpn._check import Check, Refused
from atlantis_netcfg.operations.vpn._computers import request_of_host
from atlantis_netcfg.operations.vpn._devices import request_of_device
from atlantis_netcfg.vpn.authority import RenewalRequest
from atlantis_netcfg.vpn.identity import KeyType, Link, Wrap

if TYPE_CHECKING:
    from collections.abc import Iterable

    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.vpn.authority import EnrolmentRequest

__all__ = ["KEYS", "DeviceWords", "Refused", "change_of", "request_of", "requests_of"]


@dataclass(frozen=True, slots=True)
class DeviceWords:
    """What a person, or one record of a file, has asked for; nothing of it is checked yet."""

    place: str = ""
    """`FILE:LINE` of a record; empty for a command line."""
    partner: str | None = None
    device: str | None = None
    kind: str | None = None
    host: str | None = None
    vehicle: str | None = None
    link: str | None = None
    wrap: str | None = None
    key: str | None = None
    days: str | None = None
    address: str | None = None
    recipient: str | None = None


KEYS = tuple(field.name for field in fields(DeviceWords) if field.name != "place")
"""What a record of a file may hold; the words of the command are the same."""


def requests_of(declaration: Declaration, requested: Iterable[DeviceWords]) -> tuple[EnrolmentRequest, ...]:
    """The wishes, in the order of what was asked for. Raises Refused with everything that is wrong."""
    wishes: list[EnrolmentRequest] = []
    errors: list[NetcfgError] = []
    seen: dict[str, DeviceWords] = {}
    for item in requested:
        try:
            request = request_of(declaration, item)
        except UsageError as error:
            errors += [_placed(item, each) for each in getattr(error, "errors", (error,))]
            continue
        wishes.append(request)
        if request.name in seen:
            errors.append(
                _placed(item, UsageError(f"`{request.name}` is there twice, first in {seen[request.name].place}"))
            )
        seen.setdefault(request.name, item)
    if errors:
        raise Refused(errors)
    return tuple(wishes)


def _placed(item: DeviceWords, error: NetcfgError) -> NetcfgError:
    return UsageError(f"{item.place}: {error}", hint=error.hint) if item.place else error


def request_of(declaration: Declaration, item: DeviceWords) -> EnrolmentRequest:
    """The wish for a partner's device, or for a declared host. Raises UsageError, Refused when more is wrong."""
    check = Check(asdict(item))
    request = request_of_host(declaration, check) if item.host is not None else request_of_device(declaration, check)
    check.close()
    if request is None:
        raise AssertionError("refused without a reason")
    return request


def change_of(**words: str | None) -> RenewalRequest:
    """What a renewal changes, from the words. Raises UsageError, Refused when more is wrong."""
    check = Check(words)
    change = RenewalRequest(
        days=check.days(),
        wrap=check.choice("wrap", list(Wrap)),
        key=check.choice("key", list(KeyType)),
        link=check.choice("link", list(Link)),
    )
    check.close()
    return change
