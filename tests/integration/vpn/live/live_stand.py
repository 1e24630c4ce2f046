"""The real server of the VPN and real clients, each on a computer of its own, and an echo that runs through the tunnel.

Authority, configuration, firewall and whatever is sent to the server are the product's own; only systemd is not there:
a script answers in its place. Each client has one veth to the server, and all of it ends with the stand. Whoever waits,
waits for a line of a log or for an echo, not for time.
"""

import itertools
import select
import socket
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cache
from ipaddress import IPv4Address
from pathlib import Path
from typing import Self

from live_computer import LOG, Computer
from local_link import LocalLink
from waiting import HANG_S, wait_until

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Transport, VpnServer, VpnService
from atlantis_netcfg.operations.vpn import live
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.authority.model import EnrolmentFile, EnrolmentRequest, ServerNames
from atlantis_netcfg.vpn.authority.signer import Signer
from atlantis_netcfg.vpn.identity import Identity, MemberKind, Wrap
from atlantis_netcfg.vpn.server import FOLDER, MANAGEMENT, server_conf

__all__ = ["LOG", "NAME", "Client", "Computer", "Echo", "Record", "Server", "record", "server_of"]

NAME = "scc-vpn"
PARTNER = "iqua"
_PASSPHRASE = Secret("a passphrase of nobody, for tests")
_ECHO = 7
_SYSTEMCTL = """\
#!/bin/sh
test -e /run/no-systemd && exit 1
pid=$(cat /run/openvpn.pid 2>/dev/null) && kill -0 "$pid" 2>/dev/null || pid=0
test $pid = 0 && state=failed || state=active
printf 'LoadState=loaded\\nActiveState=%s\\nSubState=%s\\nMainPID=%s\\n' $state $state $pid
"""
_SIGSTOP = 19


@cache
def declaration() -> Inventory:
    """The shipped pilot; its partners may use an echo on the server itself."""
    shipped = load(Path(__file__).parents[4] / "inventory")
    echo = VpnService(name="echo", host=NAME, transport=Transport.UDP, port=_ECHO)
    vpn = shipped.pilot.vpn.model_copy(update={"services": (echo,)})
    return replace(shipped, pilot=shipped.pilot.model_copy(update={"vpn": vpn}))


def _server_addresses() -> tuple[IPv4Address, IPv4Address]:
    """In its LAN, where it listens, and in the VPN."""
    device = declaration().hosts[NAME].device
    assert isinstance(device, VpnServer)
    assert device.vpn_address is not None
    return device.address, device.vpn_address


@dataclass
class Record:
    """An authority, and the identities that it has handed out."""

    authority: Authority
    identities: dict[str, Identity] = field(default_factory=dict)
    _numbers: Iterator[int] = field(default_factory=itertools.count)

    @contextmanager
    def signing(self) -> Iterator[Signer]:
        with self.authority.unlock(lambda: _PASSPHRASE, "test") as signer:
            yield signer

    def deliver(self, identity: Identity) -> EnrolmentFile:
        self.identities[identity.certificate.common_name] = identity
        return EnrolmentFile("nowhere", "00" * 32)

    def onboard(self, count: int = 1, *, wrap: Wrap = Wrap.TLS_CRYPT_V2) -> list[str]:
        """So many new members of a partner, by their names."""
        pool = declaration().partners[PARTNER].vpn_pool
        devices = [f"d{next(self._numbers)}" for _ in range(count)]
        wishes = [
            EnrolmentRequest(
                name=f"{PARTNER}-{device}",
                kind=MemberKind.LAPTOP,
                partner=PARTNER,
                device=device,
                pool=pool,
                wrap=wrap,
            )
            for device in devices
        ]
        with self.signing() as signer:
            return [one.member.name for one in signer.issue(wishes, self.deliver)]

    def renew(self, name: str) -> str:
        with self.signing() as signer:
            return signer.renew(name, self.deliver).certificate.common_name

    def revoke(self, *names: str) -> tuple[str, ...]:
        with self.signing() as signer:
            return signer.revoke(names, "a test").common_names

    def address(self, name: str) -> str:
        return str(self.authority.membership().members[name].address)


def record(folder: Path) -> Record:
    """A new authority. Its key is sealed as Ansible does it, which takes less time than age."""
    lan, _ = _server_addresses()
    vpn = declaration().pilot.vpn
    names = ServerNames(NAME, (vpn.endpoint_name,), (vpn.endpoint, lan))
    return Record(Authority.init(folder, _PASSPHRASE, names, "test", sealed_by="vault"))


class Server(Computer):
    """The server's computer, as its role leaves it, but for what is live."""

    def __init__(self, stack: ExitStack, made: Record) -> None:
        super().__init__(stack)
        self.stack, self.record, self.clients = stack, made, 0
        self._process: subprocess.Popen[bytes] | None = None
        lan, _ = _server_addresses()
        self.run("ip", "address", "add", f"{lan}/32", "dev", "lo")
        folder = made.authority.folder
        self.put(f"{FOLDER}/ca.crt", (folder / "ca.crt").read_text())
        for name in ("server.crt", "server.key", "tls-crypt-v2.key", "tls-crypt.key"):
            self.put(f"{FOLDER}/{name}", (folder / "server" / name).read_text(), 0o600)
        self.at(f"{FOLDER}/ccd").mkdir()
        self.put("/etc/openvpn/server/atlantis.conf", server_conf(declaration(), declaration().hosts[NAME]))
        self.put("/usr/local/sbin/systemctl", _SYSTEMCTL, 0o755)
        self.at(MANAGEMENT).parent.mkdir(mode=0o710)
        echo = self.udp()
        echo.bind(("0.0.0.0", _ECHO))  # noqa: S104 - its own namespace
        threading.Thread(target=_echo, args=(echo,), daemon=True).start()
        stack.callback(_shut, echo)
        stack.callback(self.stop)
        self.link = stack.enter_context(LocalLink(NAME, self.enter))

    def push(self) -> live.PushResult:
        return live.push(declaration(), self.record.authority, self.link)

    def revoke(self, *common_names: str) -> live.RevocationEvidence:
        return live.revoke_live(declaration(), self.record.authority, self.link, common_names)

    def throw_out(self, name: str) -> live.RevocationEvidence:
        """As a command does it: recorded, done, settled."""
        names = self.record.revoke(name)
        evidence = self.revoke(*names)
        if evidence.is_confirmed:
            self.record.authority.confirm_revocations(names)
        return evidence

    def go_on(self) -> live.RevocationEvidence | None:
        return live.finish_revocations(declaration(), self.record.authority, self.link)

    def drift(self) -> tuple[str, ...]:
        authority = self.record.authority
        return live.drift(live.observe(self.link), live.desired_files(declaration(), authority), authority.membership())

    def start(self, *words: str) -> None:
        """Start OpenVPN, and wait until it is up."""
        self.at(LOG).write_text("")
        command = ("openvpn", "--config", "/etc/openvpn/server/atlantis.conf", "--log-append", LOG, "--disable-dco")
        self._process = subprocess.Popen([*self.enter, *command, "--writepid", "/run/openvpn.pid", *words])
        self.said("Initialization Sequence Completed")

    def stop(self) -> None:
        """As a crash does it: no client is told."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    @property
    def lives(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def names(self) -> list[str]:
        """The common names of its sessions, by its own word; a client that was refused is listed for a while."""
        return sorted(one.common_name for one in live.sessions(self.link) if one.is_up)

    def client(self, common_name: str) -> "Client":
        """A computer with that identity; nothing is started."""
        return Client(self.stack, self, self.record.identities[common_name])


class Client(Computer):
    """A member's computer: it starts OpenVPN as often as it is told to."""

    def __init__(self, stack: ExitStack, server: Server, identity: Identity) -> None:
        super().__init__(stack)
        server.clients += 1
        far, here, there = f"to{server.clients}", f"10.99.{server.clients}.2", f"10.99.{server.clients}.1"
        lan, _ = _server_addresses()
        # No other way to the server: without its tunnel it reaches no address in the VPN.
        self.run("ip", "link", "add", "eth0", "type", "veth", "peer", "name", far, "netns", str(server.pid))
        server.run("sh", "-c", f"ip address add {there}/24 dev {far} && ip link set {far} up")
        self.run(
            "sh", "-c", f"ip address add {here}/24 dev eth0 && ip link set eth0 up && ip route add {lan} via {there}"
        )
        self.process: subprocess.Popen[bytes] | None = None
        self.become(identity)
        stack.callback(self.stop)

    def become(self, identity: Identity, *more: str) -> None:
        """Take an identity for the next start."""
        lan, _ = _server_addresses()
        inline = {
            "ca": identity.ca,
            "cert": identity.cert,
            "key": identity.key.reveal(),
            str(identity.certificate.wrap): identity.wrap_key.reveal(),
        }
        lines = (
            "client", "proto udp4", f"remote {lan} 1194", "dev tun0", "dev-type tun", "nobind", "persist-key",
            "remote-cert-tls server", "tls-version-min 1.2", "data-ciphers AES-256-GCM", "verb 3",
            "connect-retry 1 1", f"log-append {LOG}", "explicit-exit-notify 1",
            "ignore-unknown-option disable-dco", "disable-dco", *more,
        )  # fmt: skip
        blocks = "".join(f"<{option}>\n{text}\n</{option}>\n" for option, text in inline.items())
        self.put("/etc/openvpn/client.conf", "\n".join(lines) + "\n" + blocks, 0o600)

    def start(self, *, wait: bool = True, program: Sequence[str] = ("openvpn",)) -> None:
        self.at(LOG).write_text("")
        self.process = subprocess.Popen([*self.enter, *program, "--config", "/etc/openvpn/client.conf"])
        if wait:
            self.said("Initialization Sequence Completed")

    def stop(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None

    def pause(self) -> None:
        """Let its OpenVPN hear nothing more, as behind a dead link."""
        assert self.process is not None
        self.process.send_signal(_SIGSTOP)

    def ended(self) -> int:
        """Wait until its OpenVPN has gone by itself."""
        assert self.process is not None
        return self.process.wait(HANG_S)

    @property
    def up(self) -> bool:
        return "Initialization Sequence Completed" in self.log()


@dataclass
class Echo:
    """Asks through the tunnel every few ms. Times are of time.monotonic().

    What counts is when a question was asked: an answer may have waited for a busy processor.
    """

    client: Client
    every_s: float = 0.004
    asked: list[float] = field(default_factory=list)
    """When each question was asked, also where no tunnel was left that it could leave by."""
    answered: dict[int, float] = field(default_factory=dict)
    """Number of a question to when its answer came."""
    _over: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Self:
        self._socket = self.client.udp()
        self._socket.setblocking(False)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        _, tunnel = _server_addresses()
        while not self._over.is_set():
            self.asked.append(time.monotonic())
            with suppress(OSError):
                self._socket.sendto(str(len(self.asked) - 1).encode(), (str(tunnel), _ECHO))
            end = time.monotonic() + self.every_s
            while (left := end - time.monotonic()) > 0:
                if select.select([self._socket], [], [], left)[0]:
                    with suppress(OSError):
                        self.answered[int(self._socket.recv(64))] = time.monotonic()

    def goes(self) -> None:
        """Wait for answers to what is asked from now on."""
        began = len(self.asked)
        wait_until(
            lambda: sum(one >= began for one in list(self.answered)) > 2,
            lambda: f"no echo:\n{self.client.log()[-900:]}",
        )

    def answers(self, questions: int = 20) -> int:
        """Ask so many times more; gives how often that was answered."""
        began = len(self.asked)
        wait_until(lambda: len(self.asked) >= began + questions, lambda: "nothing is asked any more")
        return sum(one >= began for one in list(self.answered))

    @property
    def last(self) -> float:
        """When the last question was asked that was answered."""
        return self.asked[max(self.answered)]


def _echo(made: socket.socket) -> None:
    with suppress(OSError):
        while True:
            data, back = made.recvfrom(64)
            if back is None:
                return
            with suppress(OSError):  # its firewall may forbid it
                made.sendto(data, back)


def _shut(made: socket.socket) -> None:
    with suppress(OSError):
        made.shutdown(socket.SHUT_RDWR)
    made.close()


@contextmanager
def server_of(made: Record) -> Iterator[Server]:
    """A server that has what is recorded, and runs."""
    with ExitStack() as stack:
        server = Server(stack, made)
        server.push()
        server.start()
        yield server
