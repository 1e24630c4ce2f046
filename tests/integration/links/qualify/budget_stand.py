"""Random budgets over a real cable between two network namespaces, counted by the kernel at the sender's end.

`python budget_stand.py FIRST END` in a namespace of its own makes the cable, starts itself again at the far end, and
prints a line of JSON for each seed. There our reflector stands behind emulated links that lose and double packets.
"""

import json
import random
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from decimal import Decimal
from pathlib import Path

from atlantis_netcfg.emulator.udp_link import LinkShape, UdpRelay
from atlantis_netcfg.links.cost import Tariff, bill
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.messages import MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.messages_down import DownMessageStream
from atlantis_netcfg.links.qualify.session import PacketStream, ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.links.qualify.transport import UdpTransport

KEY = b"an example key, 32 octets long.."
NEAR, FAR = "192.0.2.1", "192.0.2.2"
NEAR_HARDWARE, FAR_HARDWARE = "02:00:5e:10:00:01", "02:00:5e:10:00:02"
TARIFF = Tariff(Decimal("8.00"), min_session_bytes=5000, floor_bytes_per_s=300, floor_after_s=300)
"""An example, in the shape of Certus 100's published rules; its price is not the pilot's."""
CLOSING_S = 0.15
LARGEST = 1200 + 28
_LINK_HEADER = 14
_QUIET_S = 0.15
"""Nothing has moved for so long, and nothing waits in the emulated link: nothing is under way."""
_ITSELF = Path(__file__).resolve()


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run within a random budget has used, by the kernel's count."""

    seed: int
    reason: str
    used: int
    """Octets of IP, both ways."""
    guard: int
    """What the sender has counted until it ended."""
    max_bytes: int | None
    seconds: float
    max_seconds: float | None
    price: str
    max_price: str | None
    copies: int
    lost: int


class _FarRelay(UdpRelay):
    """At the far end of the cable, and not on the loopback."""

    def __init__(self, server: tuple[str, int], up: LinkShape, down: LinkShape, seed: int) -> None:
        super().__init__(server, up, down, seed)
        self._near.close()
        self._near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._near.bind((FAR, 0))

    def wait_until_quiet(self) -> None:
        """Wait until nothing is under way any more."""
        seen, since = -1, time.monotonic()
        while time.monotonic() - since < _QUIET_S:
            time.sleep(0.01)
            now = self.up.sent_count + self.down.sent_count + len(self._due)
            if now != seen or self._due:
                seen, since = now, time.monotonic()


def _shape(draw: random.Random) -> LinkShape:
    return LinkShape(
        rate_bps=draw.choice([None, 1_000_000]),
        delay_s=draw.uniform(0, 0.05),
        loss=draw.choice([0.01, 0.3, 1.0]) if draw.random() < 0.4 else 0.0,
        duplicates=draw.choice([0.01, 0.3, 1.0]) if draw.random() < 0.5 else 0.0,
    )


def far_end() -> None:
    """Serve a relay for each seed that comes as a line; print its port, and what it counted."""
    _commands(f"link set far address {FAR_HARDWARE} up", f"address add {FAR}/24 dev far")
    _commands(f"neighbour add {NEAR} lladdr {NEAR_HARDWARE} dev far")
    with tempfile.NamedTemporaryFile() as key:
        Path(key.name).write_bytes(KEY)
        words = ["--address", "127.0.0.1", "--port", "0", "--key-file", key.name]
        program = [sys.executable, "-P", "-m", "atlantis_netcfg.links.qualify.reflector", *words]
        with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            assert process.stdout is not None
            port = int(process.stdout.readline().split()[-1])
            while line := sys.stdin.readline().strip():
                draw = random.Random(int(line))  # noqa: S311 - a test
                with _FarRelay(("127.0.0.1", port), _shape(draw), _shape(draw), int(line)) as relay:
                    _say(relay.address[1])
                    sys.stdin.readline()
                    relay.wait_until_quiet()
                    lost = sum(way.loss_count + way.drop_count for way in (relay.up, relay.down))
                    _say(relay.down.copies, lost)
            process.terminate()


def near_end(seeds: range) -> None:
    """Make the cable, and run within the budget of each seed."""
    _commands("link set lo up")
    again = ["unshare", "--net", sys.executable, "-P", str(_ITSELF), "far"]
    with subprocess.Popen(again, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as far:
        assert far.stdin is not None
        assert far.stdout is not None
        _wait_for_namespace(far.pid)
        _commands(f"link add near address {NEAR_HARDWARE} type veth peer name far netns {far.pid}")
        _commands(f"address add {NEAR}/24 dev near", "link set near up")
        _commands(f"neighbour add {FAR} lladdr {FAR_HARDWARE} dev near")
        far.stdin.write("go\n")
        for seed in seeds:
            far.stdin.write(f"{seed}\n")
            far.stdin.flush()
            port = int(far.stdout.readline())
            with UdpTransport((FAR, port)) as transport:
                before = _counted()
                limits, guard, reason, seconds = _run(seed, transport)
                by_guard = guard.sent_bytes + guard.received_bytes
                far.stdin.write("ended\n")
                far.stdin.flush()
                copies, lost = map(int, far.stdout.readline().split())
                # The socket is open until here: the kernel would answer what comes later, by ICMP.
                used = _counted() - before
            price = bill(used, seconds, TARIFF).price
            found = Outcome(
                seed,
                reason,
                used,
                by_guard,
                limits.max_bytes,
                seconds,
                limits.max_seconds,
                str(price),
                None if limits.max_price is None else str(limits.max_price),
                copies,
                lost,
            )
            _say(json.dumps(asdict(found)))
        far.stdin.close()


def _run(seed: int, transport: UdpTransport) -> tuple[Budget, BudgetGuard, str, float]:
    draw = random.Random(seed + 1_000_000)  # noqa: S311 - a test
    budget = Budget(
        max_bytes=draw.choice([None, draw.randrange(30_000)]),
        max_seconds=draw.choice([None, draw.uniform(0, 0.8)]),
        max_price=draw.choice([None, Decimal(draw.randrange(40, 300)) / 1000]),
        tariff=TARIFF,
        closing_s=CLOSING_S,
    )
    peer = ReflectorPeer(KEY)
    plan = MessagePlan(
        draw.randrange(1, 9000), draw.uniform(2, 20), 0.4, draw.random() < 0.5, timeout_s=0.15, give_up_s=0.4
    )
    streams: list[PacketStream] = [
        Train("t", TrainPlan(draw.choice([112, 172, 584, 1200]), 0.01, 0.4, CLOSING_S), peer, transport, _drop),
        MessageStream("m", plan, peer, transport, _drop),
        DownMessageStream("d", plan, peer, transport, _drop),
    ]
    guard = BudgetGuard(budget, time.monotonic)
    reason = run(transport, peer, draw.sample(streams, draw.randrange(1, 4)), guard)
    return budget, guard, reason, guard.seconds


def _say(*words: object) -> None:
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def _drop(sample: object) -> None:
    """No sample is kept: what is counted is the wire."""


def _counted() -> int:
    """Octets of IP that have passed the sender's interface, both ways (/sys would show another namespace's)."""
    (line,) = (line for line in Path("/proc/net/dev").read_text().splitlines() if line.strip().startswith("near:"))
    fields = [int(field) for field in line.split(":")[1].split()]
    received, received_packets, sent, sent_packets = fields[0], fields[1], fields[8], fields[9]
    return received + sent - (received_packets + sent_packets) * _LINK_HEADER


def _wait_for_namespace(pid: int) -> None:
    own = Path("/proc/self/ns/net").readlink()
    end = time.monotonic() + 40
    while time.monotonic() < end:
        with suppress(OSError):
            if Path(f"/proc/{pid}/ns/net").readlink() != own:
                return
        time.sleep(0.01)
    raise TimeoutError("the far end has no namespace of its own")


def _commands(*commands: str) -> None:
    """Type them as words of `ip`. No IPv6: what it says by itself would be counted."""
    for name in ("all", "default"):
        Path(f"/proc/sys/net/ipv6/conf/{name}/disable_ipv6").write_text("1")
    for command in commands:
        subprocess.run(["ip", *command.split()], check=True)


if __name__ == "__main__":
    if sys.argv[1] == "far":
        sys.stdin.readline()
        _commands("link set lo up")
        far_end()
    else:
        near_end(range(int(sys.argv[1]), int(sys.argv[2])))
