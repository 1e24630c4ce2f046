"""Rules for the 4G unit and fail-over: fields that a driver needs or cannot use, the SIM, consistent times.

A field that the driver ignores is refused, because the person who wrote it expects an effect. What the router can do
with the times: templates/routeros/parts/netwatch.rsc.j2.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _draft
from atlantis_netcfg.inventory._yaml import SealedSecret
from atlantis_netcfg.inventory.model import LteDriver, LteRouter

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.inventory.findings import Finding

_ROUTEROS, _RUTOS, _MODEMMANAGER, _AT = (
    LteDriver.ROUTEROS,
    LteDriver.RUTOS,
    LteDriver.MODEMMANAGER,
    LteDriver.AT,
)


@dataclass(frozen=True, slots=True)
class LteField:
    """An inventory field that only some drivers can use."""

    path: tuple[str, ...]
    of: tuple[LteDriver, ...]
    """Drivers that use the field; with any other driver it is rejected."""
    needed_by: tuple[LteDriver, ...] = ()
    """Drivers that require the field."""
    hint: str = ""
    """What to write if the field is missing."""


FIELDS: tuple[LteField, ...] = (
    LteField(
        ("access",),
        of=(_ROUTEROS, _RUTOS),
        needed_by=(_ROUTEROS, _RUTOS),
        hint="add `access: {user: …, password: …}`",
    ),
    LteField(("access", "admin_user"), of=(_RUTOS,)),
    LteField(("access", "admin_password"), of=(_RUTOS,)),
    LteField(("host",), of=(_MODEMMANAGER, _AT)),
    LteField(
        ("serial",),
        of=(_AT,),
        needed_by=(_AT,),
        hint="add `serial:` with the port of the modem, for example /dev/ttyUSB2",
    ),
    LteField(("sim", "user"), of=(_ROUTEROS, _RUTOS)),
    LteField(("sim", "password"), of=(_ROUTEROS, _RUTOS)),
    LteField(("sim", "pin"), of=(_ROUTEROS, _RUTOS)),
    LteField(("sim", "bands"), of=(_ROUTEROS, _RUTOS)),
)
"""Fields of the drivers, in the order of the inventory."""

_APN = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9.-]{0,98}[A-Za-z0-9])?")
"""APN as in 3GPP TS 23.003, 9.1: labels like those of a DNS name, at most 100 characters."""
_PIN = re.compile(r"[0-9]{4,8}")
"""PIN as in 3GPP TS 31.101, 9.5.1."""
_PORT = re.compile(r"/dev/[\w./-]+")


def _value(device: LteRouter, path: tuple[str, ...]) -> object:
    result: object = device
    for name in path:
        result = getattr(result, name, None)
    return result


def fields(draft: _draft.Draft) -> Iterator[Finding]:
    """Require the fields that the driver needs, and refuse those that it ignores."""
    for host, _, device in draft.valid_devices(LteRouter):
        part, driver = _draft.Part("device", host), device.driver
        for field in FIELDS:
            is_set = _value(device, field.path) not in {None, ()}
            name = ".".join(field.path)
            if is_set and driver not in field.of:
                drivers = msg(f"{arg(field.of[0])} and {arg(field.of[-1])}") if field.of[1:] else field.of[0]
                message = msg(f"`{arg(name)}` has no effect with driver `{arg(driver)}`")
                yield draft.finding_at(
                    part, field.path, message, msg(f"remove it: it is only for driver {arg(drivers)}")
                )
            elif not is_set and driver in field.needed_by:
                message = msg(f"driver `{arg(driver)}` needs `{arg(name)}`")
                path = ("driver",)
                yield draft.finding_at(part, path, message, field.hint)


def apn(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a valid access point name."""
    for host, _, device in draft.valid_devices(LteRouter):
        name = device.sim.apn
        if name is not None and not _APN.fullmatch(name):
            message = msg(f"`{arg(name)}` is not an access point name: letters, digits, dots and dashes, no spaces")
            yield draft.finding_at(
                _draft.Part("device", host), ("sim", "apn"), message, "copy it from the SIM's contract"
            )


def pin(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a malformed PIN, which would cost one of three tries; an encrypted PIN cannot be checked."""
    for host, _, device in draft.valid_devices(LteRouter):
        number = device.sim.pin
        if number is None or isinstance(number, SealedSecret) or _PIN.fullmatch(number.reveal()):
            continue
        message = "the PIN must have 4 to 8 digits; a wrong one uses one of the SIM's three attempts"
        hint = "put the PIN from the SIM's letter in the vault, or remove `pin` until there is one"
        yield draft.finding_at(_draft.Part("device", host), ("sim", "pin"), message, hint)


def administrator(draft: _draft.Draft) -> Iterator[Finding]:
    """Require both name and password for a RutOS administrator, or neither."""
    for host, _, device in draft.valid_devices(LteRouter):
        access = device.access
        if access is None or (access.admin_user is None) == (access.admin_password is None):
            continue
        missing, there = ("admin_password", "admin_user") if access.admin_user else ("admin_user", "admin_password")
        message = msg(f"`{arg(there)}` is set without `{arg(missing)}`: nobody could log in to configure the unit")
        hint = msg(f"add `{arg(missing)}`, or remove `{arg(there)}`: then the unit is only checked")
        yield draft.finding_at(_draft.Part("device", host), ("access", there), message, hint)


def check_rutos_quoting(draft: _draft.Draft) -> Iterator[Finding]:
    """Refuse quotes and backslashes in RutOS values: they go to `uci` in single quotes."""
    for host, _, device in draft.valid_devices(LteRouter):
        user = device.sim.user
        if device.driver is _RUTOS and user is not None and ("'" in user or "\\" in user):
            message = msg(f"`{arg(user)}` cannot be set on a RutOS unit: it contains a quote or a backslash")
            yield draft.finding_at(
                _draft.Part("device", host), ("sim", "user"), message, "copy it from the SIM's contract"
            )


def require_local_modem(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a modem at a port of the computer that runs `provision`: others cannot be read."""
    for host, _, device in draft.valid_devices(LteRouter):
        part = _draft.Part("device", host)
        if device.host is not None and device.driver in {_MODEMMANAGER, _AT}:
            message = msg(f"a modem in another computer (`{arg(device.host)}`) cannot be read yet")
            hint = "remove `host` and run `provision` on that computer, or write `driver: manual`"
            yield draft.finding_at(part, ("host",), message, hint)
        if device.driver is _AT and device.serial is not None and not _PORT.fullmatch(device.serial):
            message = msg(f"`{arg(device.serial)}` is not a serial port")
            yield draft.finding_at(part, ("serial",), message, "write its full path, for example /dev/ttyUSB2")


def require_gateway_address(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a routing 4G unit has its link's gateway address, where the site's router looks for it."""
    for host, name, device in draft.valid_devices(LteRouter):
        site = draft.sites.get(name)
        if site is None or device.driver not in {_ROUTEROS, _RUTOS}:
            continue
        for index, link in enumerate(site.bearers):
            both = {link.gateway, device.address}
            if link.device == host and len(both) > 1 and all(address in link.network for address in both):
                where = draft.where(_draft.Part("site", name), "bearers", index, "gateway")
                message = msg(
                    f"the address {arg(device.address)} is not the gateway of link `{arg(link.name)}` ({arg(where)})"
                )
                yield draft.finding_at(
                    _draft.Part("device", host), ("address",), message, msg(f"write {arg(link.gateway)}")
                )


RULES: tuple[_draft.Rule, ...] = (
    fields,
    apn,
    pin,
    administrator,
    check_rutos_quoting,
    require_local_modem,
    require_gateway_address,
)

_MOST = 9
_SATELLITE_HOLD_S = 90
"""Minimum hold time: longer than an outage of 70 s observed on Certus (facts/devices.md, section 3)."""
"""Links are ten apart in distance, and a hundred more when they are given up: RouterOS has distances up to 255."""


def there_is_another_link(draft: _draft.Draft) -> Iterator[Finding]:
    """Report `failover` at a site with one link: there is nothing to fail over to."""
    for name, site in draft.sites.items():
        if "failover" in site.model_fields_set and len(site.bearers) == 1:
            message = msg(f"`failover` is set, but `{arg(site.bearers[0].name)}` is the only link of `{arg(name)}`")
            yield draft.finding_at(
                _draft.Part("site", name), ("failover",), message, "remove `failover:`, or add a second link"
            )


def returns_no_sooner_than_it_leaves(draft: _draft.Draft) -> Iterator[Finding]:
    """Require `fail_back_s` ≥ `hold_down_s`: otherwise the link flaps with every short interruption."""
    for name, site in draft.sites.items():
        times = site.failover
        if times.fail_back_s < times.hold_down_s:
            message = msg(
                f"a link is left after {arg(times.hold_down_s)} s without responses and used again after "
                f"{arg(times.fail_back_s)} s with responses: an unstable link would switch all the time"
            )
            key = "fail_back_s" if "fail_back_s" in times.model_fields_set else "hold_down_s"
            hint = "set `fail_back_s` to at least `hold_down_s`, better to some minutes"
            yield draft.finding_at(_draft.Part("site", name), ("failover", key), message, hint)


def metered_links_to_ask_over(draft: _draft.Draft) -> Iterator[Finding]:
    """Report `metered_probe_s` at a site that has no metered link with probe targets before its last link."""
    for name, site in draft.sites.items():
        if "metered_probe_s" not in site.failover.model_fields_set or len(site.bearers) == 1:
            continue
        if not any(link.metered and link.canaries for link in site.bearers[:-1]):
            message = msg(f"`metered_probe_s` is set, but no metered link of `{arg(name)}` has probe targets")
            hint = "remove it: free links are probed every 5 s, and the last link is not probed"
            yield draft.finding_at(_draft.Part("site", name), ("failover", "metered_probe_s"), message, hint)


def satellites_are_asked_within_a_budget(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a budget for probe targets on a satellite link: airtime is for traffic.

    Probing must also be useful: another link follows, and the link's own gaps do not count as a failure.
    """
    for name, site in draft.sites.items():
        for index, link in enumerate(site.bearers):
            if not (link.kind.traits.allow_list and link.canaries):
                continue
            part, path, last = _draft.Part("site", name), ("bearers", index, "canaries"), index == len(site.bearers) - 1
            hold_s = site.failover.hold_down_s
            hint = msg(
                f"remove `canaries:`; `provision measure satellite site={arg(name)}` tests the satellite on request"
            )
            if link.probe_target_budget_bytes is None:
                message = msg(
                    f"link `{arg(link.name)}` is a satellite link with probe targets: pinging them is billed day and "
                    "night"
                )
                budget = msg(
                    f"remove `canaries:`; `provision measure satellite site={arg(name)}` tests the satellite on "
                    "request. Or set how much they may use in a month: `canary_budget_mb: 2`"
                )
                yield draft.finding_at(part, path, message, hint if last else budget)
            elif last:
                message = msg(
                    f"link `{arg(link.name)}` is a satellite link and the last one: its probe targets would not be "
                    "probed"
                )
                yield draft.finding_at(part, path, message, hint)
            elif hold_s < _SATELLITE_HOLD_S:
                message = msg(
                    f"link `{arg(link.name)}` is a satellite link with gaps of up to 70 s, but would be left after "
                    f"{arg(hold_s)} s without a response"
                )
                longer = msg(f"set `hold_down_s` below `failover:` to {arg(_SATELLITE_HOLD_S)} or more")
                yield draft.finding_at(part, path, message, longer)


def not_too_many_links(draft: _draft.Draft) -> Iterator[Finding]:
    """Report more links at a site than the router has route distances for."""
    for name, site in draft.sites.items():
        if len(site.bearers) > _MOST:
            message = msg(f"`{arg(name)}` has {arg(len(site.bearers))} links; the maximum is {arg(_MOST)}")
            yield draft.finding_at(
                _draft.Part("site", name), ("bearers", _MOST), message, "remove links that are not used"
            )


FAILOVER_RULES: tuple[_draft.Rule, ...] = (
    there_is_another_link,
    returns_no_sooner_than_it_leaves,
    metered_links_to_ask_over,
    satellites_are_asked_within_a_budget,
    not_too_many_links,
)
