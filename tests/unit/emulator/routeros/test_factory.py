"""A twin as it comes out of its box, and the certificates that are made on it."""

import asyncio
import hashlib
import ssl
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest
from cryptography import x509

from atlantis_netcfg.emulator.routeros import Device, EmulatedRouter, ManagementSpec, RouterSpec, User
from atlantis_netcfg.emulator.routeros.answers import Caller
from atlantis_netcfg.routeros.rsc import parse

LAPTOP = ManagementSpec(address="192.168.88.1/24", port="ether2", technician="192.168.88.10")
FACTORY = RouterSpec(
    name="box", factory=True, users=(User(name="admin"),), first_contact=LAPTOP, clock=datetime(1970, 1, 2, tzinfo=UTC)
)


@pytest.fixture
def box() -> Device:
    return Device(FACTORY, time.monotonic)


def admin(device: Device) -> Caller:
    return device.login("admin", "", via="ssh", address=LAPTOP.technician)


def said(device: Device, *words: str) -> list[str]:
    answers = device.run(admin(device), words)
    return [answer.kind if not answer.words else f"{answer.kind} {answer.words[-1]}" for answer in answers]


def row(device: Device, name: str) -> dict[str, str]:
    answers = device.run(admin(device), ["/certificate/print", f"?name={name}"])
    return dict(word[1:].partition("=")[::2] for word in answers[0].words)


def test_factory_config_bridges_all_ports_but_the_first(box: Device) -> None:
    statements = parse(box.export()).statements
    bridged = [dict(one.values)["interface"] for one in statements if one.menu == "/interface/bridge/port"]
    assert bridged == [f"ether{number}" for number in range(2, 9)]
    assert all("defconf" in str(dict(one.values)) for one in statements if one.verb == "add" and one.menu != "/ip/pool")


def test_laptop_can_connect_on_bridge_ports_only(box: Device) -> None:
    way = (LAPTOP.technician, LAPTOP.local, "ssh")
    assert box.path_open(*way, plug="ether2")
    assert box.path_open(*way, plug="ether8")
    assert not box.path_open(*way, plug="ether1")
    assert not box.path_open("10.64.101.10", "10.64.101.1", "ssh")


def test_laptop_loses_access_with_its_bridge_port(box: Device) -> None:
    port = box.run(admin(box), ["/interface/bridge/port/print", "?interface=ether2"])[0].words[0].removeprefix("=.id=")
    assert said(box, "/interface/bridge/port/remove", f"=.id={port}") == ["!done"]
    assert not box.path_open(LAPTOP.technician, LAPTOP.local, "ssh", is_established=True, plug="ether2")
    assert box.path_open(LAPTOP.technician, LAPTOP.local, "ssh", is_established=True, plug="ether3")


def test_a_template_becomes_a_certificate_when_it_is_signed(box: Device) -> None:
    add = ["/certificate/add", "=name=api", "=common-name=box", "=days-valid=100", "=key-size=prime256v1"]
    assert said(box, *add)[0].startswith("!done")
    assert "fingerprint" not in row(box, "api")
    assert box.certificate("api") is None
    assert said(box, "/certificate/sign", "=.id=api")[-1] == "!done"
    pem = box.certificate("api")
    assert pem is not None
    found = x509.load_pem_x509_certificate(pem.encode())
    assert row(box, "api")["fingerprint"] == found.fingerprint(found.signature_hash_algorithm).hex()  # type: ignore[arg-type]
    assert row(box, "api")["private-key"] == "true"
    assert (found.not_valid_after_utc - found.not_valid_before_utc).days == 100
    assert found.not_valid_before_utc.year == 1970
    assert said(box, "/certificate/sign", "=.id=api")[0] == "!trap =message=failure: certificate already signed"


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("=key-size=12", "invalid value for argument key-size"),
        ("=subject-alt-name=host", "invalid value for argument subject-alt-name"),
        ("=digest-algorithm=md5", "invalid value for argument digest-algorithm"),
    ],
)
def test_invalid_certificate_values_are_refused(box: Device, argument: str, words: str) -> None:
    said(box, "/certificate/add", "=name=api", "=common-name=box", argument)
    assert said(box, "/certificate/sign", "=.id=api")[0] == f"!trap =message={words}"
    assert box.certificate("api") is None


def test_certificate_authority_signs_a_certificate(box: Device) -> None:
    usage = "=key-usage=key-cert-sign,crl-sign"
    said(box, "/certificate/add", "=name=ca", "=common-name=ca", "=key-size=prime256v1", usage)
    said(box, "/certificate/add", "=name=api", "=common-name=box", "=key-size=prime256v1")
    assert said(box, "/certificate/sign", "=.id=api", "=ca=ca")[0] == "!trap =message=failure: invalid CA"
    said(box, "/certificate/sign", "=.id=ca")
    assert said(box, "/certificate/sign", "=.id=api", "=ca=ca")[-1] == "!done"
    pem = box.certificate("api")
    assert pem is not None
    assert "CN=ca" in x509.load_pem_x509_certificate(pem.encode()).issuer.rfc4514_string()


def test_certificate_file_is_imported_with_its_key(box: Device) -> None:
    said(box, "/certificate/add", "=name=api", "=common-name=box", "=key-size=prime256v1")
    said(box, "/certificate/sign", "=.id=api")
    pem = box.certificate("api")
    assert pem is not None
    other = Device(FACTORY, time.monotonic)
    assert said(other, "/file/add", "=name=box.pem", f"=contents={pem}")[0].startswith("!done")
    assert "=decryption-failures=0" in said(other, "/certificate/import", "=file-name=box.pem")[0]
    assert row(other, "box.pem_0")["fingerprint"] == row(box, "api")["fingerprint"]
    assert row(other, "box.pem_0")["private-key"] == "true"
    assert said(other, "/certificate/import", "=file-name=none.pem")[0] == "!trap =message=no such item"


def test_keys_survive_a_power_cut(box: Device) -> None:
    said(box, "/certificate/add", "=name=api", "=common-name=box", "=key-size=prime256v1")
    said(box, "/certificate/sign", "=.id=api")
    again = Device(FACTORY, time.monotonic)
    again.restore(box.snapshot())
    assert again.certificate("api") == box.certificate("api")


def test_tls_presents_the_signed_certificate(tmp_path: Path) -> None:
    assert asyncio.run(_shown(tmp_path, signed=True))


def test_tls_handshake_fails_before_the_certificate_is_signed(tmp_path: Path) -> None:
    with pytest.raises(ssl.SSLError):
        asyncio.run(_shown(tmp_path, signed=False))


async def _shown(folder: Path, *, signed: bool) -> bool:
    async with EmulatedRouter(FACTORY, state_dir=folder) as router:
        steps = [["/certificate/add", "=name=api", "=common-name=box", "=key-size=prime256v1"]]
        steps += [["/certificate/sign", "=.id=api"]] if signed else []
        for step in [*steps, ["/ip/service/set", "=.id=api-ssl", "=certificate=api"]]:
            await router.console(step)
        settings = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        settings.check_hostname, settings.verify_mode = False, ssl.CERT_NONE
        port = router.first_contact_ports[8729]
        _, writer = await asyncio.open_connection(router.host, port, ssl=settings)
        seen = writer.get_extra_info("ssl_object").getpeercert(binary_form=True)
        writer.close()
        return hashlib.sha256(seen).hexdigest() == router.pin
