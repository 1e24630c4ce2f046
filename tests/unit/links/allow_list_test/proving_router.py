"""A router as a proof sees it: counters, a filter that can be opened, and who answers beyond the satellite."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from atlantis_netcfg.routeros.api import Command, Reply, Traffic, Trap

LAPTOP = "10.64.101.10"
PORT, OUT, BACK = "ether3", "to-satellite", "from-satellite"
VPN_RULE = {"action": "return", "src-address": "203.0.113.2", "src-port": "1194", "protocol": "udp"}
NTP_RULE = {"action": "return", "src-address": "192.0.2.123", "src-port": "123", "protocol": "udp"}

SECOND_NTP_RULE = {**NTP_RULE, "src-address": "192.0.2.124"}


@dataclass
class Fake:
    """Answers `flight` and `command` like a session; `turns` counts the flights with pings beyond the satellite."""

    beyond: dict[str, int] = field(default_factory=dict)
    """Address to the number of unanswered echo requests before it answers."""
    open: bool = False
    """Whether the filter lets every echo request out, as if somebody had broken it."""
    at_factory: bool = False
    port_name: str = PORT
    terminal: bool = True
    active: bool = False
    tunnel: str | None = "true"
    counts_after: int | None = None
    """Number of readings after which an answer of the VPN server is counted."""
    safe_mode: bool = True
    stuck: bool = False
    """The rows stay when safe mode is unrolled."""
    burst_bytes: int = 0
    """What somebody else sends over the satellite between two readings."""
    traffic: Traffic = field(default_factory=Traffic)
    rows: list[dict[str, str]] = field(default_factory=list)
    sent: list[Command] = field(default_factory=list)
    bytes: int = 1000
    dropped: int = 7
    readings: int = 0
    held: bool = False
    connects: bool = False
    """Whether TCP connections come up."""
    asks_time: bool = True
    """Whether the time client asks when it is switched on."""
    tells_time: bool = False
    """Whether the time server answers."""
    tells_both: bool = False
    """Whether the second one answers as well."""
    vpn_counts: tuple[bool, bool] = (True, True)
    """Whether a question and an answer of the VPN that a row leads over the satellite are counted on their way."""
    more_rules: tuple[dict[str, str], ...] = ()
    """Rules of the filter besides those of VPN and time."""
    clock: list[str] = field(default_factory=list)
    """What the time client was set to."""

    async def command(self, command: Command, *, silence_s: float | None = None) -> Reply:
        return (await self.flight([command], silence_s=silence_s))[0]

    async def flight(self, commands: Sequence[Command], *, silence_s: float | None = None) -> list[Reply]:  # noqa: ARG002 - a session's
        return [self._answer(command) for command in commands]

    def _answer(self, command: Command) -> Reply:
        self.sent.append(command)
        self.traffic.sent_bytes += 100
        words = dict(command.arguments)
        known: dict[str, Callable[[], Reply]] = {
            "/interface/print": self._port,
            "/ip/firewall/filter/print": lambda: self._filter(command),
            "/ip/route/print": self._routes,
            "/interface/ovpn-client/print": self._tunnels,
            "/tool/ping": lambda: self._ping(words),
            "/safe-mode/take": self._take,
            "/safe-mode/print": self._holder,
            "/safe-mode/unroll": self._unroll,
            "/safe-mode/release": self._release,
            "/ip/firewall/filter/add": lambda: self._add(command.path, words),
            "/ip/firewall/filter/remove": self._remove,
            "/routing/rule/add": lambda: self._add(command.path, words),
            "/routing/rule/remove": self._remove,
            "/routing/rule/print": lambda: self._ours(command) or Reply(rows=({".id": "*A"},)),
            "/tool/netwatch/add": lambda: self._add(command.path, words),
            "/tool/netwatch/remove": self._remove,
            "/tool/netwatch/print": lambda: self._watched(command),
            "/system/ntp/client/set": lambda: self._time(words),
        }
        return known[command.path]()

    def _port(self) -> Reply:
        self.readings += 1
        self.bytes += self.burst_bytes
        return Reply(rows=({"name": self.port_name, "default-name": PORT, "rx-byte": "0", "tx-byte": str(self.bytes)},))

    def _filter(self, command: Command) -> Reply:
        if (ours := self._ours(command)) is not None:
            return ours
        asked = self.asks_time and self.clock == ["no", "yes"]
        led = any(row["menu"] == "/routing/rule" and row.get("src-address") == f"{LAPTOP}/32" for row in self.rows)
        come = 4 + int(self.counts_after is not None and self.readings > self.counts_after)
        come += int(led and self.vpn_counts[1])
        return Reply(
            rows=(
                {".id": "*1", "chain": OUT, "packets": str(int(asked)), **_reversed(NTP_RULE)},
                {".id": "*2", "chain": OUT, "action": "drop", "packets": str(self.dropped)},
                {".id": "*3", "chain": BACK, "packets": str(come), **VPN_RULE},
                {".id": "*4", "chain": BACK, "packets": str(int(asked and self.tells_time)), **NTP_RULE},
                {".id": "*6", "chain": OUT, "packets": str(int(asked)), **_reversed(SECOND_NTP_RULE)},
                {".id": "*7", "chain": BACK, "packets": str(int(asked and self.tells_both)), **SECOND_NTP_RULE},
                {".id": "*5", "chain": BACK, "action": "drop", "packets": "2"},
                {".id": "*8", "chain": OUT, "packets": str(int(led and self.vpn_counts[0])), **_reversed(VPN_RULE)},
                *self.more_rules,
            )
        )

    def _routes(self) -> Reply:
        gateway = "10.10.2.1" if self.active else "198.51.100.11"
        return Reply(rows=({"dst-address": "0.0.0.0/0", "gateway": gateway, "active": "true", "distance": "1"},))

    def _tunnels(self) -> Reply:
        return Reply(rows=() if self.tunnel is None else ({"name": "ovpn-scc", "running": self.tunnel},))

    def _ping(self, words: dict[str, str]) -> Reply:
        if "arp-ping" in words:
            if words["interface"] != self.port_name:
                return Reply(trap=Trap("input does not match any value of interface"))
            return _echo(answered=self.at_factory)
        if words["address"] == "10.10.2.1":
            return _echo(answered=self.terminal)
        return self._beyond(words["address"], int(words["count"]))

    def _beyond(self, address: str, count: int) -> Reply:
        admitted = self.open or address == "192.0.2.50" or any(row.get("dst-address") == address for row in self.rows)
        if not admitted:
            self.dropped += count
            return _echo(answered=False)
        self.bytes += 84 * count
        left = self.beyond.get(address)
        if left is None or left > 0:
            self.beyond.update({} if left is None else {address: left - count})
            return _echo(answered=False)
        self.bytes += 84 * count
        return _echo(answered=True)

    def _holder(self) -> Reply:
        held = "true" if self.held else "false"
        return Reply(rows=({"enabled": held, "current": held},))

    def _take(self) -> Reply:
        self.held = self.safe_mode
        return Reply() if self.safe_mode else Reply(trap=Trap("no such command prefix", 0))

    def _unroll(self) -> Reply:
        self.held = False
        self.rows = self.rows if self.stuck else []
        return Reply()

    def _release(self) -> Reply:
        assert self.rows == [], "safe mode is let go with rows of the proof on the router"
        self.held = False
        return Reply()

    def _add(self, path: str, words: dict[str, str]) -> Reply:
        assert self.held, "a row is added without safe mode"
        self.rows.append({"menu": path.removesuffix("/add"), **words})
        return Reply(ret="*99")

    def _remove(self) -> Reply:
        self.rows = self.rows if self.stuck else self.rows[1:]
        return Reply()

    def _ours(self, command: Command) -> Reply | None:
        """The rows of the proof in a menu, if it is those that are asked for."""
        if not any(query.startswith("?comment=") for query in command.queries):
            return None
        menu = command.path.removesuffix("/print")
        return Reply(rows=tuple({".id": "*99", **row} for row in self.rows if row["menu"] == menu))

    def _watched(self, command: Command) -> Reply:
        ours = self._ours(command)
        assert ours is not None
        status = "up" if self.connects else "down"
        return Reply(rows=tuple({**row, "status": status} for row in ours.rows))

    def _time(self, words: dict[str, str]) -> Reply:
        assert self.held
        self.clock.append(words["enabled"])
        return Reply()


def _reversed(rule: dict[str, str]) -> dict[str, str]:
    """The rule that lets out what this one lets in again."""
    return {name.replace("src-", "dst-"): value for name, value in rule.items()}


def _echo(*, answered: bool) -> Reply:
    return Reply(rows=({"sent": "1", "received": "1" if answered else "0"},))
