"""What is handed to a router: refused below 7.17, taken above, by the twin and, as far as it goes, by OpenVPN."""

import subprocess
import time
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.emulator.routeros import Device, RouterSpec, User
from atlantis_netcfg.emulator.routeros.certificates import OvpnError, read_ovpn
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Transport
from atlantis_netcfg.vpn import routeros
from atlantis_netcfg.vpn.rehearsal import rehearsed_identity
from atlantis_netcfg.vpn.routeros import RouterTooOld, check_version

SHIPPED = load(Path(__file__).parents[4] / "inventory")
ROUTER = SHIPPED.hosts["coastal-router"]
IDENTITY = rehearsed_identity(SHIPPED, ROUTER)
FILE, SCRIPT = "iqua-router.ovpn", "iqua-router.rsc"
TCP = replace(
    SHIPPED,
    pilot=SHIPPED.pilot.model_copy(
        update={"vpn": SHIPPED.pilot.vpn.model_copy(update={"transport": Transport.TCP, "cipher": "aes128-gcm"})}
    ),
)


@dataclass
class Console:
    """A router of somebody else, and a technician at it."""

    device: Device

    @classmethod
    def of(cls, version: str) -> "Console":
        spec = RouterSpec(name="theirs", version=version, users=(User(name="admin", password="x"),))
        return cls(Device(spec, time.monotonic))

    def say(self, *words: str) -> list[str]:
        caller = self.device.login("admin", "x", via="api-ssl", address="10.64.101.10")
        return [" ".join((answer.kind, *answer.words)) for answer in self.device.run(caller, words)]

    def put(self, name: str, text: str) -> None:
        assert self.say("/file/add", f"=name={name}", f"=contents={text}")[0].startswith("!done")

    def files(self) -> str:
        return "\n".join(self.say("/file/print", "=.proplist=name"))


@pytest.mark.parametrize(
    ("version", "words"),
    [
        ("6.49.18", "over TCP alone"),
        ("7.8", "cannot import"),
        ("7.16.2", "no tls-crypt"),
        ("7.17rc3", "no tls-crypt"),
        ("7.17", None),
        ("7.24", None),
    ],
)
def test_version_support_of_routeros(version: str, words: str | None) -> None:
    parsed = Version.parse(version)
    if words is None:
        check_version(parsed)
        return
    with pytest.raises(RouterTooOld, match=words) as refused:
        check_version(parsed, where="their router")
    assert str(refused.value).startswith(f"their router runs RouterOS {version}, which ")
    assert "upgrade it to RouterOS 7.17 or later" in (refused.value.hint or "")


@pytest.mark.parametrize(
    ("version", "pilot"),
    [("7.17", SHIPPED), ("7.18.2", TCP), ("7.21.5", SHIPPED)],
    ids=["7.17", "7.18.2-tcp", "7.21.5"],
)
def test_script_creates_the_client_and_leaves_no_key_file(version: str, pilot: Inventory) -> None:
    theirs = Console.of(version)
    for _ in range(2):
        theirs.put(FILE, routeros.profile(pilot, IDENTITY).reveal())
        theirs.put(SCRIPT, routeros.script(pilot, IDENTITY, FILE))
        assert theirs.say("/import", f"=file-name={SCRIPT}") == ["!done"]
        assert theirs.say("/file/remove", f"=numbers={SCRIPT}") == ["!done"]
        assert FILE not in theirs.files()
        row, done = theirs.say("/interface/ovpn-client/print")
        assert done == "!done"
        vpn = pilot.pilot.vpn
        for value in ("name=ovpn-atlantis", "disabled=false", "auth=sha256", "verify-server-certificate=true"):
            assert f"={value}" in row
        for value in (f"cipher={vpn.cipher}", f"protocol={vpn.transport}", "certificate=cert_ovpn-import"):
            assert f"={value}" in row
        assert theirs.device.is_wrapped("ovpn-atlantis")


def test_script_on_an_older_version_fails_and_leaves_no_key_file() -> None:
    theirs = Console.of("7.16")
    theirs.put(FILE, routeros.profile(SHIPPED, IDENTITY).reveal())
    theirs.put(SCRIPT, routeros.script(SHIPPED, IDENTITY, FILE))
    assert theirs.say("/import", f"=file-name={SCRIPT}")[0].endswith("=message=expected item id")
    assert FILE not in theirs.files()
    assert theirs.say("/interface/ovpn-client/print") == ["!done"]
    theirs.put(FILE, routeros.profile(SHIPPED, IDENTITY).reveal())
    said = theirs.say("/interface/ovpn-client/import-ovpn-configuration", f"=file-name={FILE}", "=ovpn-user=u")
    assert said[0].endswith("unsupported option '<tls-crypt-v2>'")


def test_neither_secret_nor_password_is_in_the_script() -> None:
    script = routeros.script(SHIPPED, IDENTITY, FILE)
    secret = IDENTITY.key.reveal().splitlines()[3]
    assert secret in routeros.profile(SHIPPED, IDENTITY).reveal()
    assert secret not in script
    assert "password" not in script


def test_name_too_long_for_routeros_is_cut() -> None:
    member = replace(IDENTITY.member, name="a" * 48)
    assert len(routeros.handed_out(SHIPPED, replace(IDENTITY, member=member)).user) == 27


def test_mark_depends_on_the_keys() -> None:
    other = rehearsed_identity(SHIPPED, ROUTER)
    assert routeros.mark(IDENTITY) == routeros.mark(IDENTITY) != routeros.mark(other)
    assert routeros.mark(IDENTITY).startswith("02:")


def test_openvpn_accepts_the_profile(tmp_path: Path) -> None:
    path = tmp_path / FILE
    path.touch(mode=0o600)
    path.write_text(routeros.profile(SHIPPED, IDENTITY).reveal())
    command = ["openvpn", "--config", str(path), "--show-ciphers"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


GOOD = "client\ndev tun\nproto udp\nremote v.example.org 1194\ncipher AES-256-GCM\nauth SHA256\nkey-direction 1\n"
WRAP = "<tls-crypt>\nkey\n</tls-crypt>\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD.replace("SHA256", "SHA1") + WRAP, "tls-crypt needs auth SHA256 and key-direction 1"),
        (GOOD.replace("key-direction 1\n", "") + WRAP, "tls-crypt needs auth SHA256 and key-direction 1"),
        (GOOD.replace("cipher AES-256-GCM\n", ""), "missing option 'cipher'"),
        (GOOD.replace("AES-256-GCM", "CHACHA20-POLY1305"), "unsupported option 'cipher CHACHA20-POLY1305'"),
        (GOOD.replace("remote v.example.org 1194\n", ""), "missing option 'remote'"),
        (GOOD + "data-ciphers AES-256-GCM\n", "unsupported option 'data-ciphers'"),
        (GOOD + "<secret>\nx\n</secret>\n", "unsupported option '<secret>'"),
    ],
)
def test_invalid_profile_is_refused(text: str, words: str) -> None:
    with pytest.raises(OvpnError, match=f"^{words}$"):
        read_ovpn(text, wraps=True)


def test_valid_profile_is_parsed() -> None:
    read = read_ovpn(GOOD.replace("\n", "\r\n") + WRAP, wraps=True)
    assert read.values["connect-to"] == "v.example.org"
    assert (read.values["mode"], read.values["protocol"], read.values["cipher"]) == ("ip", "udp", "aes256-gcm")
    assert read.wrap == "key\n"
    assert "key" not in repr(read)
