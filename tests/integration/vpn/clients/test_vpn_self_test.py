"""The self-test of a hand-out against a real server: it ends in PASS, or names the fault that was made."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from clients_stand import (
    CLOSED_PORT,
    REFUSED_PORT,
    SILENT_PORT,
    Office,
    Stand,
    Wanted,
    await_words,
    declared,
    made_stand,
)

from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.enrolment_package import contents
from atlantis_netcfg.vpn.identity import Identity, KeyType, Wrap

pytestmark = pytest.mark.namespace

PYTHON = "/usr/bin/python3"
SILENCE_S, WAIT_S = 8, 60
"""How long the test waits where nothing will come, and where an answer ends the waiting."""
NOBODY, GAGGED = 65534, 65533
"""An ordinary user, and one whom the computer's own firewall lets send nothing."""
_FAKETIME = next(Path("/usr/lib").glob("*/faketime/libfaketime.so.1"), None)
CONTACT = "Example Person, +00 000"


@dataclass(frozen=True)
class Fault:
    """What is broken on this device's way, and a piece of what the test has to say.

    Devices that get as far as a session differ: two with one certificate throw each other out.
    """

    said: str
    device: str = "udg-good"
    port: int = 1194
    user: int = NOBODY
    clock: str = ""
    foreign_key: bool = False
    another_server: bool = False
    where: str = "devices"

    @property
    def wait_s(self) -> int:
        return SILENCE_S if "nothing" in self.said else WAIT_S


FAULTS = {
    "revoked by the list": Fault(
        "203.0.113.2 port 1194 sent a first response and then nothing more", device="udg-revoked"
    ),
    "no more admitted": Fault("the control centre does not accept this device's certificate", device="udg-gone"),
    "server down": Fault(f"203.0.113.2 port {CLOSED_PORT} refuses the connection", port=CLOSED_PORT),
    "refused on the way": Fault(f"203.0.113.2 port {REFUSED_PORT} refuses the connection", port=REFUSED_PORT),
    "port blocked": Fault(f"203.0.113.2 port {SILENT_PORT} does not respond", port=SILENT_PORT),
    "another tls-crypt-v2 key": Fault("203.0.113.2 port 1194 does not respond", foreign_key=True),
    "another tls-crypt key": Fault("203.0.113.2 port 1194 does not respond", device="udg-shared", foreign_key=True),
    "another server": Fault("does not present the control centre's certificate", another_server=True),
    "own firewall": Fault("a firewall on this computer blocks the VPN's packets", user=GAGGED),
    "no network": Fault("this computer has no route to 203.0.113.2", where="alone"),
    "clock of the year 2000": Fault("this computer's clock says 2000-01-01", clock="@2000-01-01 12:00:00"),
    "expired": Fault("the certificate has expired on", clock="+400d"),
    "clock half a day behind": Fault("the control centre admits this device", device="udg-behind", clock="-13h"),
    "no root": Fault("without root the test makes no tunnel", device="udg-rootless"),
}


@pytest.fixture(scope="module")
def office() -> Office:
    made = Office(declared())
    for wanted in (
        *map(Wanted, ("udg-good", "udg-behind", "udg-rootless")),
        Wanted("udg-revoked", revoked=True),
        Wanted("udg-gone", admitted=False),
        Wanted("udg-shared", wrap=Wrap.TLS_CRYPT, key=KeyType.RSA),
    ):
        made.issue(wanted)
    return made


@pytest.fixture(scope="module")
def stand(office: Office, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    with ExitStack() as stack:
        made = made_stand(stack)
        made.serve(office.furnish(tmp_path_factory.mktemp("server") / "etc"))
        rules = f"meta skuid {GAGGED} drop; udp dport {REFUSED_PORT} reject"
        rule = f"table inet own {{ chain out {{ type filter hook output priority 0; {rules}; }}; }}"
        subprocess.run(made.inside("devices", "nft", "-f", "-"), input=rule, text=True, check=True)
        made.run("server", "ip", "address", "add", "10.80.0.2/32", "dev", "lo")  # for the control centre
        yield made


def unpacked(declaration: Inventory, identity: Identity, folder: Path, user: int = 0) -> Path:
    """A hand-out as its owner has unpacked it."""
    folder.mkdir(mode=0o755, parents=True)
    for name, text in contents(declaration, identity, contact=CONTACT).items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o600)
        os.chown(folder / name, user, user)
    return folder


def broken(fault: Fault, office: Office, folder: Path) -> Path:
    """The hand-out of a device whose way has this fault."""
    pilot = office.declaration.pilot
    vpn = pilot.vpn.model_copy(update={"port": fault.port})
    declaration = replace(office.declaration, pilot=pilot.model_copy(update={"vpn": vpn}))
    identity = office.identities[fault.device]
    if fault.foreign_key:
        shared = identity.certificate.wrap is Wrap.TLS_CRYPT
        key = pki.shared_key() if shared else pki.client_key(pki.server_key(), b"cn=udg-good")
        identity = replace(identity, wrap_key=key)
    made = unpacked(declaration, identity, folder, fault.user)
    if fault.another_server:
        profile = made / f"{fault.device}.ovpn"
        profile.write_text(profile.read_text().replace("verify-x509-name scc-vpn", "verify-x509-name scc-other"))
    return made


def clocked(fault: Fault) -> list[str]:
    """Said to `env`, behind the change of user: the library shares what it knows among one user's programs."""
    if not fault.clock:
        return []
    assert _FAKETIME is not None
    return ["env", f"LD_PRELOAD={_FAKETIME}", f"FAKETIME={fault.clock}", "TZ=UTC"]


def at_home(stand: Stand, folder: Path, user: int, *command: str, where: str = "devices") -> list[str]:
    """A command beside the hand-out, as a user who may not look into root's folders: a mount of its own leads there."""
    home = ["sh", "-c", 'mount --bind "$0" /mnt && cd /mnt && exec "$@"', str(folder)]
    who = ["setpriv", f"--reuid={user}", f"--regid={user}", "--clear-groups"]
    return stand.inside(where, *home, *who, *command)


def test_self_test_names_every_fault(office: Office, stand: Stand, tmp_path: Path) -> None:
    """All at once: most of them are silence, and take their time."""
    running = {}
    for number, (case, fault) in enumerate(FAULTS.items()):
        folder = broken(fault, office, tmp_path / str(number))
        command = [*clocked(fault), PYTHON, "self-test.py", "--wait", str(fault.wait_s)]
        running[case] = subprocess.Popen(
            at_home(stand, folder, fault.user, *command, where=fault.where),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
    said = {case: process.communicate()[0] for case, process in running.items()}
    assert {case: said[case] for case, fault in FAULTS.items() if fault.said not in said[case]} == {}
    assert {case: process.returncode for case, process in running.items()} == dict.fromkeys(FAULTS, 6)
    assert all(text.endswith(f"Control centre: {CONTACT}\n") for text in said.values())
    assert not any("PASS:" in text or "Traceback" in text for text in said.values())
    # The devices' own firewall refused it: no server, and no computer of the control centre, has heard anything.
    assert "control centre" not in said["refused on the way"].partition("What to do:")[0]


def test_self_test_as_root_passes_and_leaves_nothing_behind(office: Office, stand: Stand, tmp_path: Path) -> None:
    folder = unpacked(office.declaration, office.identities["udg-good"], tmp_path / "handout")
    command = stand.inside("devices", PYTHON, str(folder / "self-test.py"))
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert "  ok    tunnel  came up in " in done.stdout
    assert "  ok    server  10.80.0.1 responds in " in done.stdout
    assert done.stdout.endswith("PASS: udg-good is in the VPN.\n")
    assert "10.80." not in stand.run("devices", "ip", "-4", "-o", "address")


def test_self_test_passes_over_existing_tunnel(office: Office, stand: Stand, tmp_path: Path) -> None:
    """Also without root, and without a program `openvpn` in reach, as with OpenVPN Connect."""
    folder = unpacked(office.declaration, office.identities["udg-shared"], tmp_path / "handout", NOBODY)
    log = tmp_path / "log"
    profile = folder / "udg-shared.ovpn"
    tunnel = stand.start("devices", ["openvpn", "--config", str(profile)], log)
    await_words(log, "Initialization Sequence Completed")
    stand.run("devices", "sysctl", "-qw", f"net.ipv4.ping_group_range=0 {NOBODY}")
    command = at_home(stand, folder, NOBODY, "env", "PATH=/nonexistent", PYTHON, "self-test.py")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    tunnel.terminate()
    tunnel.wait()
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert "  ok    tunnel  an interface of this computer has this device's address 10.80.19.6" in done.stdout
    assert done.stdout.endswith("PASS: udg-shared is in the VPN.\n")
