"""The steps of first contact, as a function of what is found."""

from dataclasses import replace
from datetime import UTC, datetime

import pytest
from found import DEFAULTS, NOW, WISH, adopted, facts

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros.first_contact.steps import (
    CLEARED_MENUS,
    DeviceState,
    clear,
    close_door,
    foreign,
    prepare,
    recognise,
)

ALTERNATIVES = "subject-alt-name=IP:10.64.101.1,DNS:coastal-router"
KEY = "key-size=2048 days-valid=3650 key-usage=digital-signature,key-encipherment,tls-server"
TEMPORARY = 'comment="atlantis: first contact"'


def typed(found: object) -> list[str]:
    return [line.text for step in found for line in step.lines]  # type: ignore[attr-defined]


def test_preparation_adds_user_certificate_and_management_address() -> None:
    lines = typed(prepare(facts(), WISH, NOW))
    assert lines == [
        '/user add name=provision group=full password="a \\"b\\" \\$c" comment=atlantis',
        f"/certificate add name=atlantis-api common-name=coastal-router {ALTERNATIVES} {KEY}",
        "/certificate sign atlantis-api",
        "/ip service set api-ssl certificate=atlantis-api disabled=no port=8729",
        "/interface bridge port remove *2",
        f"/ip firewall filter add chain=input action=accept in-interface=ether8 {TEMPORARY} place-before=*1",
        '/ip address add address=10.64.101.1/24 interface=ether8 comment="atlantis: management"',
    ]


def test_a_password_is_marked_as_a_secret() -> None:
    (line,) = (line for step in prepare(facts(), WISH, NOW) for line in step.lines if "password" in line.text)
    assert line.secrets == (WISH.password,)
    assert 'a "b" $c' not in repr(line.secrets)


def test_adopted_device_needs_no_steps() -> None:
    assert prepare(adopted(), WISH, NOW) == ()
    assert clear(adopted()) == ()
    assert close_door(adopted(), WISH) == ()


@pytest.mark.parametrize(
    ("version", "date"),
    [(Version(7, 10), "2026-06-01"), (Version(7, 9, 2), "jun/01/2026"), (Version(6, 49, 18), "jun/01/2026")],
)
def test_a_clock_of_1970_is_set_first(version: Version, date: str) -> None:
    found = facts(version=version, now=datetime(1970, 1, 2, tzinfo=UTC))
    assert typed(prepare(found, WISH, NOW))[0] == f"/system clock set date={date} time=12:00:00"
    assert typed(prepare(replace(found, now=None), WISH, NOW))[0].startswith("/system clock")


def test_unsigned_certificate_is_only_signed() -> None:
    found = adopted(certificates=({".id": "*1", "name": "atlantis-api", "fingerprint": ""},))
    assert typed(prepare(found, WISH, NOW)) == ["/certificate sign atlantis-api"]


def test_our_disabled_user_is_enabled() -> None:
    locked = {".id": "*2", "name": "provision", "group": "read", "disabled": "true"}
    (line,) = typed(prepare(adopted(users=(*adopted().users[:1], locked)), WISH, NOW))
    assert line.startswith("/user set provision group=full disabled=no password=")


def test_default_configuration_is_removed_in_a_working_order() -> None:
    lines = typed(clear(facts()))
    assert lines == [
        "/ip firewall filter remove *2",
        "/ip firewall filter remove *1",
        "/ip pool remove *1",
        "/ip dns set allow-remote-requests=no",
        "/ip neighbor discovery-settings set discover-interface-list=static",
        "/ip address remove *1",
        "/interface bridge port remove *2",
        "/interface bridge port remove *1",
        "/interface bridge remove *1",
    ]


def test_managed_rows_stay_and_first_contact_rows_are_removed() -> None:
    export = (
        '/ip firewall filter\nadd action=accept chain=input comment="atlantis: first contact"\n'
        'add action=accept chain=input comment="atlantis: managed"\nadd action=drop chain=input comment=defconf\n'
    )
    assert typed(clear(facts(export))) == ["/ip firewall filter remove *3", "/ip firewall filter remove *1"]


def test_rows_made_by_the_device_are_left() -> None:
    rows = dict.fromkeys(CLEARED_MENUS, ())
    rows["/ip/address"] = ({".id": "*1", "address": "10.0.0.7/24", "dynamic": "true"},)  # type: ignore[assignment]
    rows["/interface/list"] = (  # type: ignore[assignment]
        {".id": "*2000000", "name": "all", "builtin": "true"},
        {".id": "*2000011", "name": "static"},
    )
    assert clear(facts("", rows=rows)) == ()


def test_every_other_user_is_disabled() -> None:
    users = tuple({"name": name, "disabled": "false"} for name in ("admin", "the boss", "provision"))
    assert typed(close_door(facts(users=users), WISH)) == ["/user disable admin", '/user disable "the boss"']


@pytest.mark.parametrize(
    ("found", "standing"),
    [
        (facts(), DeviceState.FACTORY),
        (facts(""), DeviceState.FACTORY),
        (facts(DEFAULTS + "/system clock\nset time-zone-name=Europe/Lisbon\n"), DeviceState.FACTORY),
        (
            facts(DEFAULTS + "/interface wifi\nset [ find default-name=wifi1 ] configuration.mode=ap\n"),
            DeviceState.FACTORY,
        ),
        (facts(users=(*facts().users, {"name": "provision", "group": "full"})), DeviceState.HALF),
        (facts(DEFAULTS + "/ip service\nset api-ssl certificate=atlantis-api\n"), DeviceState.FACTORY),
        (adopted(DEFAULTS), DeviceState.HALF),
        (adopted(users=(*adopted().users, {"name": "boss"})), DeviceState.SOMEONES),
        (adopted(), DeviceState.ADOPTED),
        (
            adopted("/system identity\nset name=coastal-router\n/ip pool\nadd name=lan ranges=10.1.0.2\n"),
            DeviceState.ADOPTED,
        ),
        (facts(DEFAULTS + "/system identity\nset name=boat\n"), DeviceState.SOMEONES),
        (facts(DEFAULTS + "/ip service\nset telnet disabled=yes\n"), DeviceState.SOMEONES),
        (facts(DEFAULTS + "/ip dns\nset servers=10.0.0.1\n"), DeviceState.SOMEONES),
        (facts(users=(*facts().users, {"name": "boss"})), DeviceState.SOMEONES),
        (facts(certificates=({"name": "webfig"},)), DeviceState.SOMEONES),
    ],
)
def test_device_state_is_recognised(found: object, standing: DeviceState) -> None:
    assert recognise(found, WISH, NOW) is standing  # type: ignore[arg-type]


def test_declared_certificate_may_already_exist() -> None:
    found = facts(certificates=({"name": "atlantis-vpn"},))
    assert recognise(found, WISH, NOW) is DeviceState.SOMEONES
    assert recognise(found, replace(WISH, certificates=("atlantis-api", "atlantis-vpn")), NOW) is DeviceState.FACTORY


def test_foreign_configuration_is_named_without_values() -> None:
    export = DEFAULTS + "/ppp secret\nadd name=a password=hunter2\nadd name=b\n/system identity\nset name=boat\n"
    said = foreign(facts(export, users=({"name": "boss"},), certificates=({"name": "webfig"},)), WISH)
    assert said == ("/ppp secret (2)", "/system identity (1)", "user boss", "certificate webfig")
