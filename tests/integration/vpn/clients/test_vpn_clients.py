"""OpenVPN 2.5 and 2.6 of Debian take every profile that is handed out, and packets pass; NetworkManager reads them.

`ATLANTIS_OPENVPN_2_4=PROGRAM` adds an OpenVPN 2.4, which no Debian here has: it takes what is wrapped for it, and
refuses the rest.
"""

import json
import os
import re
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import pytest
from clients_stand import Office, Stand, Wanted, await_words, declared, device_of, made_stand
from waiting import HANG_S

from atlantis_netcfg.vpn.enrolment_package import contents
from atlantis_netcfg.vpn.identity import KeyType, MemberKind, MemberLink, Wrap

pytestmark = pytest.mark.namespace

_UNPACKED = Path(__file__).parents[4] / ".venv-setup" / "debian"
"""`make test` has unpacked the packages there."""
_PLUGIN = _UNPACKED / "network-manager-openvpn"


@dataclass(frozen=True)
class Client:
    """An OpenVPN, and where its libraries are."""

    program: Path
    libraries: Path | None = None
    wraps: tuple[Wrap, ...] = tuple(Wrap)
    """What it can read."""

    @property
    def environment(self) -> dict[str, str]:
        return {} if self.libraries is None else {"LD_LIBRARY_PATH": str(self.libraries)}


def _clients() -> dict[str, Client]:
    older = _UNPACKED / "bullseye"
    library = next((older / "libssl1.1").glob("usr/lib/*/libssl.so.1.1"), older)
    found = {
        "2.5.1": Client(older / "openvpn" / "usr" / "sbin" / "openvpn", library.parent),
        "2.6.": Client(Path("/usr/sbin/openvpn")),
    }
    if oldest := os.environ.get("ATLANTIS_OPENVPN_2_4"):
        found["2.4."] = Client(Path(oldest), wraps=(Wrap.TLS_CRYPT,))
    return found


CLIENTS = _clients()
"""By the beginning of their version."""
EVERY = {
    f"udg-{kind}-{link}-{wrap}-{key}": Wanted(f"udg-{kind}-{link}-{wrap}-{key}", kind, link, wrap, key)
    for kind, link, wrap, key in product((MemberKind.ROBOT, MemberKind.LAPTOP), MemberLink, Wrap, KeyType)
} | {
    f"udg-router-{key}": Wanted(f"udg-router-{key}", MemberKind.ROUTER, MemberLink.FIBRE, Wrap.TLS_CRYPT, key)
    for key in KeyType
}
"""Each kind of profile, on each link, with each way to wrap, with each key."""


@pytest.fixture(scope="module")
def office() -> Office:
    made = Office(declared())
    for wanted in EVERY.values():
        made.issue(wanted)
    return made


@pytest.fixture(scope="module")
def profiles(office: Office, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("profiles")
    for name, identity in office.identities.items():
        files = contents(office.declaration, identity, contact="Example Person")
        (folder / f"{name}.ovpn").write_text(files[f"{name}.ovpn"])
    return {name: folder / f"{name}.ovpn" for name in office.identities}


@pytest.fixture(scope="module")
def stand(office: Office, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    with ExitStack() as stack:
        made = made_stand(stack)
        made.serve(office.furnish(tmp_path_factory.mktemp("server") / "etc"))
        yield made


@pytest.mark.parametrize("version", CLIENTS)
def test_each_profile_connects_and_pings(version: str, office: Office, profiles: dict[str, Path], stand: Stand) -> None:
    """A router's is read by OpenVPN here; its name leads nowhere in the namespace, so it is given the address."""
    client = CLIENTS[version]
    readable = {name: path for name, path in profiles.items() if office.wanted[name].wrap in client.wraps}
    running = [_started(stand, client, path) for path in readable.values()]
    for path in readable.values():
        await_words(path.with_suffix(".log"), "Initialization Sequence Completed")
        assert f" OpenVPN {version}" in path.with_suffix(".log").read_text()
    pings = {
        name: subprocess.Popen(
            stand.inside("devices", "ping", "-q", "-c1", "-W20", "-I", device_of(path.with_suffix(".log")), "10.80.0.1")
        )
        for name, path in readable.items()
    }
    assert {name for name, ping in pings.items() if ping.wait() != 0} == set()
    shown = stand.run("devices", "ip", "-4", "-o", "address")
    expected = {str(office.identities[name].member.address) for name in readable}
    assert set(re.findall(r"inet (10\.80\.19\.\d+)/16", shown)) == expected
    for process in running:
        process.terminate()
    for process in running:
        process.wait(HANG_S)
    _refused(stand, client, [path for name, path in profiles.items() if name not in readable])


def _started(stand: Stand, client: Client, path: Path) -> subprocess.Popen[bytes]:
    conf = path.with_suffix(".conf")
    conf.write_text(path.read_text().replace("remote vpn.example.org 1194", "remote 203.0.113.2 1194"))
    words = [str(client.program), "--config", str(conf)]
    return stand.start("devices", words, path.with_suffix(".log"), client.environment)


def _refused(stand: Stand, client: Client, profiles: Sequence[Path]) -> None:
    """A client that cannot read a profile ends at once, and says so."""
    for path in profiles:
        assert _started(stand, client, path).wait(HANG_S) != 0
        assert "Unrecognized option" in path.with_suffix(".log").read_text()


def test_networkmanager_imports_each_profile(office: Office, profiles: dict[str, Path], tmp_path: Path) -> None:
    """Its plugin reads every word of a profile that it has a setting for, and puts the keys away for their owner."""
    (library,) = _PLUGIN.glob("usr/lib/*/NetworkManager/libnm-vpn-plugin-openvpn.so")
    named = {name: path for name, path in profiles.items() if office.wanted[name].kind is not MemberKind.ROUTER}
    done = subprocess.run(
        ["/usr/bin/python3", str(Path(__file__).with_name("nm_import.py")), str(library), *map(str, named.values())],
        env={**os.environ, "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert [one["id"] for one in told] == list(named)
    for one in told:
        wanted, identity = office.wanted[one["id"]], office.identities[one["id"]]
        assert (
            one.items()
            >= {
                "connection-type": "tls",
                "dev-type": "tun",
                "remote": "203.0.113.2:1194",
                "remote-cert-tls": "server",
                "tls-version-min": "1.2",
                "verify-x509-name": "name:scc-vpn",
            }.items()
        )
        assert ("data-ciphers" in one) == (wanted.wrap is Wrap.TLS_CRYPT_V2)
        for word, text in (("cert", identity.cert), ("key", identity.key.reveal()), ("ca", identity.ca)):
            assert Path(one[word]).read_text() == text
            assert Path(one[word]).stat().st_mode & 0o777 == 0o600
        assert Path(one[wanted.wrap]).read_text().strip() == identity.wrap_key.reveal().strip()
        # Once it takes the profile's `pull-filter`, the page needs its line of `ignore-auto-routes` no more.
        assert [word for word in one if "pull" in word] == []
