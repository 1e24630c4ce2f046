"""True answers of a site made wrong, for whatever a checklist asks that tells no position.

Knows the words of programs, of RouterOS, of MAVLink and of RTPS, and nothing of the probes. An answer is plain data:
`out` and `rc` of a program, `rows` of a menu, `bearer` of a link, `offers` of DHCP servers, `datagrams` of
participants, `chunks` and `senders` of a stream.
"""

import json
import math
import re
import struct
from collections.abc import Callable, Mapping
from random import Random
from typing import Any

from pymavlink.dialects.v20 import common

Told = dict[str, Any]
"""One answer."""
STRANGERS = tuple(f"10.64.1.{last}" for last in range(200, 250))
TROUBLES = ("silent", "unreachable", "denied", "missing", "busy", "no place")


def card(random: Random) -> str:
    return "02:00:5e:" + ":".join(f"{random.randrange(256):02x}" for _ in range(3))


# Any answer.


def not_given(*names: str) -> Callable[[Random, dict[str, Told]], None]:
    """Nobody answers one of these questions."""

    def lie(random: Random, told: dict[str, Told]) -> None:
        told[random.choice(names)]["trouble"] = random.choice(TROUBLES)

    return lie


def refused(*names: str) -> Callable[[Random, dict[str, Told]], None]:
    def lie(random: Random, told: dict[str, Told]) -> None:
        one = told[random.choice(names)]
        if "rows" in one:
            one["rows"] = None
        else:
            one["out"], one["rc"] = random.choice(("", "usage: none\n")), random.choice((1, 2, 255))

    return lie


def garbled(*names: str) -> Callable[[Random, dict[str, Told]], None]:
    """Another device's words, or noise."""

    def lie(random: Random, told: dict[str, Told]) -> None:
        one = told[random.choice(names)]
        noise = "".join(chr(random.randrange(32, 127)) for _ in range(random.randrange(1, 200)))
        if "rows" in one:
            one["rows"] = tuple({f"x{number}": noise[number:]} for number in range(random.randrange(1, 4)))
        else:
            one["out"] = random.choice((noise, "[" + noise, "{}", "null\n", '[{"a":', "<html></html>"))

    return lie


def swapped(*names: str) -> Callable[[Random, dict[str, Told]], None]:
    """Two answers of a kind, each in the place of the other."""

    def lie(random: Random, told: dict[str, Told]) -> None:
        one, other = random.sample(names, 2)
        told[one], told[other] = told[other], told[one]

    return lie


def rewritten(name: str, pattern: str, *words: str) -> Callable[[Random, dict[str, Told]], None]:
    """What a program printed, with other words in one place."""

    def lie(random: Random, told: dict[str, Told]) -> None:
        text, made = re.subn(pattern, random.choice(words), told[name]["out"])
        assert made, f"{pattern} is not in {told[name]['out']!r}"
        told[name]["out"] = text

    return lie


def rows_with(name: str, where: Mapping[str, str], /, **values: tuple[str | None, ...]) -> Callable[..., None]:
    """One row of those with these values is told otherwise; None: it lacks the property."""

    def lie(random: Random, told: dict[str, Told]) -> None:
        rows = [dict(row) for row in told[name]["rows"]]
        fitting = [row for row in rows if where.items() <= row.items()]
        assert fitting, f"no row with {where} in {rows}"
        row = random.choice(fitting)
        for key, choices in values.items():
            value, prop = random.choice(choices), key.replace("_", "-")
            row.pop(prop, None)
            if value is not None:
                row[prop] = value
        told[name]["rows"] = tuple(rows)

    return lie


def without_row(name: str, where: Mapping[str, str]) -> Callable[[Random, dict[str, Told]], None]:
    def lie(random: Random, told: dict[str, Told]) -> None:
        rows = [dict(row) for row in told[name]["rows"]]
        rows.remove(random.choice([row for row in rows if where.items() <= row.items()]))
        told[name]["rows"] = tuple(rows)

    return lie


def more_rows(name: str, at: int, *rows: Mapping[str, str]) -> Callable[[Random, dict[str, Told]], None]:
    """A row more, before the row at that place or at the end (-1)."""

    def lie(random: Random, told: dict[str, Told]) -> None:
        there = list(told[name]["rows"])
        there.insert(len(there) if at < 0 else at, dict(random.choice(rows)))
        told[name]["rows"] = tuple(there)

    return lie


# Pings.


def pinged(random: Random, address: str, count: int, more: str = "") -> str:
    """As iputils prints it when everything is answered."""
    base = random.uniform(0.3, 60)
    times = [base * random.uniform(0.9, 1.3) for _ in range(count)]
    lines = "".join(
        f"64 bytes from {address}: icmp_seq={number} ttl=64 time={took:.3g} ms\n"
        for number, took in enumerate(times, 1)
    )
    mean = sum(times) / count
    return (
        f"PING {address} ({address}) {more}56(84) bytes of data.\n{lines}\n--- {address} ping statistics ---\n"
        f"{count} packets transmitted, {count} received, 0% packet loss, time {200 * count}ms\n"
        f"rtt min/avg/max/mdev = {min(times):.3f}/{mean:.3f}/{max(times):.3f}/0.200 ms\n"
    )


def ping_lies(address: str, count: int) -> dict[str, Callable[[Random, dict[str, Told]], None]]:
    """Of the answer `ping`."""

    def doubled(random: Random, told: dict[str, Told]) -> None:
        twice = random.randrange(max(3, count // 5), count + 1)
        lines = [f"64 bytes from {address}: icmp_seq={n} ttl=64 time=2.0 ms (DUP!)\n" for n in range(1, twice + 1)]
        shown = random.choice(("".join(lines), ""))
        out = told["ping"]["out"].replace("\n\n---", f"\n{shown}\n---")
        told["ping"]["out"] = out.replace(" received,", f" received, +{twice} duplicates,")

    def short(random: Random, told: dict[str, Told]) -> None:
        sent = random.randrange(1, count)
        kept = [line for line in told["ping"]["out"].splitlines(keepends=True) if not _later(line, sent)]
        told["ping"]["out"] = (
            "".join(kept)
            .replace(f"{count} packets", f"{sent} packets")
            .replace(f"{count} received", f"{sent} received")
        )

    def cut(random: Random, told: dict[str, Told]) -> None:
        out = told["ping"]["out"]
        told["ping"]["out"] = out[: random.randrange(len(out) * 2 // 3)]

    def silent(random: Random, told: dict[str, Told]) -> None:
        beyond = random.choice(("", "From 10.64.1.10 icmp_seq=1 Destination Host Unreachable\n"))
        told["ping"]["out"] = (
            f"PING {address} ({address}) 56(84) bytes of data.\n{beyond}\n--- {address} ping statistics ---\n"
            f"{count} packets transmitted, 0 received, 100% packet loss, time 3823ms\n"
        )

    return {
        "answers come twice": doubled,
        "the ping was cut short": short,
        "the ping's words were cut": cut,
        "no response": silent,
        "another address responses": rewritten(
            "ping", f"from {re.escape(address)}:", *(f"from {a}:" for a in STRANGERS)
        ),
        "another address was asked": rewritten("ping", re.escape(address), *STRANGERS),
        "answers are damaged": rewritten(
            "ping", "icmp_seq=1 ", "icmp_seq=1 wrong data byte #16 ", "icmp_seq=1 BAD CHECKSUM! "
        ),
        "nothing came of the ping": not_given("ping"),
        "the ping is noise": garbled("ping"),
    }


def _later(line: str, sent: int) -> bool:
    found = re.search(r"icmp_seq=(\d+)", line)
    return found is not None and int(found[1]) > sent


# MAVLink.

BEGAN = 1_800_000_000.0
VEHICLE, OTHER = "10.64.1.24", "10.64.1.77"
RC_RECEIVER, ARMED, UNUSED = 0x10000, 0x80, 0xFFFF
Frame = tuple[float, str, bytes]


class Autopilot:
    """What one component sends; its own count begins anywhere."""

    def __init__(self, random: Random, system: int = 1, component: int = 1, version: int = 2) -> None:
        self.packer: Any = common.MAVLink(None, srcSystem=system, srcComponent=component)
        self.version = version
        self.since = random.uniform(10, 5000)

    def packed(self, message: Any) -> bytes:  # noqa: ANN401 - pymavlink has no types
        frame = bytes(message.pack(self.packer, force_mavlink1=self.version == 1))
        self.packer.seq = (self.packer.seq + 1) % 256
        return frame

    def beat(self, mode: int = 0x51) -> bytes:
        return self.packed(self.packer.heartbeat_encode(2, 3, mode, 0, 3))

    def status(self, bits: tuple[int, int, int] = (RC_RECEIVER,) * 3) -> bytes:
        return self.packed(self.packer.sys_status_encode(*bits, 250, 16200, -1, -1, *[0] * 6))

    def channels(self, count_s: float, values: list[int], rssi: int) -> bytes:
        told = [*values, *[UNUSED] * (18 - len(values))]
        return self.packed(self.packer.rc_channels_encode(round(1000 * count_s), len(values), *told, rssi))

    def time(self, unix_s: float) -> bytes:
        return self.packed(self.packer.system_time_encode(round(unix_s * 1e6), 1000))

    def override(self, values: list[int]) -> bytes:
        return self.packed(self.packer.rc_channels_override_encode(1, 1, *values[:8]))


def flight(random: Random, *, sticks: bool = False, **changes: Any) -> list[Frame]:  # noqa: ANN401 - of what follows
    """Frames of a vehicle that stands; every change makes one thing wrong.

    `clock`: its count from the seconds passed; `axes`: channels from the seconds passed.
    """
    given: dict[str, Any] = {
        "system": 1,
        "component": 1,
        "version": random.choice((1, 2)),
        "sender": VEHICLE,
        "mode": 0x51,
        "clock": float,
        "bits": (RC_RECEIVER,) * 3,
        "rssi": random.randrange(100, 254),
        "beats": True,
        "status": True,
        "channels": True,
        "unix": None,
        "axes": _circles(random) if sticks else None,
        "last_s": None,
    } | changes
    pilot = Autopilot(random, given["system"], given["component"], given["version"])
    rate, count, ends = random.choice((2, 4, 10)), random.randrange(4, 17), 12.0 if sticks else 8.0
    rest = [random.randrange(1000, 2001) for _ in range(count)]
    found: list[Frame] = []
    for step in range(int(ends * rate)):
        at = 0.1 + step / rate + random.uniform(0, 0.02)
        if given["last_s"] is not None and at > given["last_s"]:
            break
        said = []
        if step % rate == 0:
            said += [pilot.beat(given["mode"])] if given["beats"] else []
            said += [pilot.status(given["bits"])] if given["status"] else []
            said += [pilot.time(given["unix"] + at)] if given["unix"] is not None else []
        values = list(rest) if given["axes"] is None else [*given["axes"](at), *rest[4:]]
        if given["channels"]:
            said.append(pilot.channels(pilot.since + given["clock"](at), values, given["rssi"]))
        found += [(at, given["sender"], one) for one in said]
    return found


def _circles(random: Random) -> Callable[[float], list[int]]:
    """Two sticks that go round, each at its own pace; a hand is never exact."""
    paces = [random.uniform(1.2, 3.0) for _ in range(2)]
    phases = [random.uniform(0, 6) for _ in range(2)]
    reach = random.randrange(200, 480)

    def at(seconds: float) -> list[int]:
        turns = [2 * math.pi * seconds / pace + phase for pace, phase in zip(paces, phases, strict=True)]
        axes = (math.sin(turns[0]), math.cos(turns[1]), math.sin(turns[1]), math.cos(turns[0]))
        return [1500 + round(reach * axis) + random.randrange(-4, 5) for axis in axes]

    return at


def _together(random: Random) -> Callable[[float], list[int]]:
    """One movement on all four axes, the same way or the other, with the noise of a radio."""
    signs, pace = [random.choice((-1, 1)) * random.uniform(0.5, 1) for _ in range(4)], random.uniform(1, 4)
    return lambda at: [
        1500 + round(400 * sign * math.sin(2 * math.pi * at / pace)) + random.randrange(-3, 4) for sign in signs
    ]


def _stepped(random: Random) -> Callable[[float], list[int]]:
    levels = [random.randrange(1100, 1900) for _ in range(30)]
    return lambda at: [levels[int(at * 2)]] * 4


RC_LIES: Mapping[str, Callable[[Random, bool], list[Frame]]] = {
    "another computer": lambda r, s: flight(r, sticks=s, sender=r.choice(STRANGERS)),
    "another component": lambda r, s: flight(r, sticks=s, component=r.choice((2, 100, 158, 190, 191, 240))),
    "another vehicle": lambda r, s: flight(r, sticks=s, system=r.randrange(2, 200)),
    "one message again and again": lambda r, s: flight(r, sticks=s, clock=lambda _: 7.0),
    "played too fast": lambda r, s: flight(r, sticks=s, clock=_paced(r, 3, 50)),
    "played too slowly": lambda r, s: flight(r, sticks=s, clock=_paced(r, 0.01, 0.3)),
    "played in a loop": lambda r, s: flight(r, sticks=s, clock=_looped(r)),
    "played backwards": lambda r, s: flight(r, sticks=s, clock=lambda at: 5 - 5 * at),
    "of another time": lambda r, s: flight(r, sticks=s, unix=BEGAN + r.choice((-1, 1)) * r.uniform(120, 1e6)),
    "armed": lambda r, s: flight(r, sticks=s, mode=0x51 | ARMED),
    "no heartbeat": lambda r, s: flight(r, sticks=s, beats=False),
    "no channels": lambda r, s: flight(r, sticks=s, channels=False),
    "overridden": lambda r, s: _with(flight(r, sticks=s), Autopilot(r, 255, 190).override([1500] * 8)),
    "every frame damaged": lambda r, s: [(at, who, _flipped(r, data)) for at, who, data in flight(r, sticks=s)],
    "another protocol": lambda r, s: [(at, who, b"$GPGGA,1*00\r\n") for at, who, _ in flight(r, sticks=s)],
    "nothing": lambda _r, _s: [],
    "channels of another component": lambda r, s: sorted(
        [*flight(r, sticks=s, channels=False), *flight(r, sticks=s, component=100, beats=False, status=False)]
    ),
    "channels of another computer": lambda r, s: sorted(
        [*flight(r, sticks=s, channels=False), *flight(r, sticks=s, sender=OTHER, beats=False, status=False)]
    ),
}
HEARD_LIES: Mapping[str, Callable[[Random], list[Frame]]] = {
    "no channel in use": lambda r: [*_unused(r)],
    "receiver gone": lambda r: flight(
        r, bits=r.choice(((0, 0, 0), (RC_RECEIVER, 0, 0), (RC_RECEIVER, RC_RECEIVER, 0)))
    ),
    "stopped": lambda r: flight(r, last_s=r.uniform(1.2, 4.0)),
}
STICK_LIES: Mapping[str, Callable[[Random], list[Frame]]] = {
    "in lockstep": lambda r: flight(r, sticks=True, axes=_together(r)),
    "in lockstep, in steps": lambda r: flight(r, sticks=True, axes=_stepped(r)),
    "at rest": lambda r: flight(r, sticks=True, axes=lambda _: [1500] * 4),
    "sticks of another computer": lambda r: sorted(
        [*flight(r, sticks=True, axes=lambda _: [1500] * 4), *flight(r, sticks=True, sender=OTHER)]
    ),
    "sticks of another system": lambda r: sorted(
        [*flight(r, sticks=True, axes=lambda _: [1500] * 4), *flight(r, sticks=True, system=9)]
    ),
}


def _paced(random: Random, least: float, most: float) -> Callable[[float], float]:
    by = random.uniform(least, most)
    return lambda at: at * by


def _looped(random: Random) -> Callable[[float], float]:
    of = random.uniform(2, 5)
    return lambda at: at % of


def _unused(random: Random) -> list[Frame]:
    pilot = Autopilot(random)
    return [
        (second + place / 10, VEHICLE, one)
        for second in range(8)
        for place, one in enumerate((pilot.beat(), pilot.status(), pilot.channels(second, [UNUSED] * 8, 200)))
    ]


def _with(frames: list[Frame], other: bytes) -> list[Frame]:
    return sorted([*frames, *((at + 0.01, VEHICLE, other) for at, *_ in frames[::5])])


def _flipped(random: Random, data: bytes) -> bytes:
    place = random.randrange(1, len(data))
    return data[:place] + bytes([data[place] ^ random.randrange(1, 256)]) + data[place + 1 :]


# RTPS.


def rtps_lies() -> dict[str, Callable[[Random, dict[str, Told]], None]]:
    """Of the answer `participants`: what true participants have sent, to somebody else or otherwise."""

    def changed(change: Callable[[Random, bytes, bytes], bytes]) -> Callable[[Random, dict[str, Told]], None]:
        def lie(random: Random, told: dict[str, Told]) -> None:
            one = told["participants"]
            one["datagrams"] = tuple((who, change(random, data, one["prefix"])) for who, data in one["datagrams"])

        return lie

    def only(number: int) -> Callable[[Random, dict[str, Told]], None]:
        def lie(_random: Random, told: dict[str, Told]) -> None:
            one = told["participants"]
            one["datagrams"] = one["datagrams"][number : number + 1]

        return lie

    def locators(random: Random, data: bytes, _: bytes) -> bytes:
        address = bytes(random.choice(((127, 0, 0, 1), (10, 64, 1, 10), (192, 168, 8, random.randrange(256)))))
        return re.sub(rb"(\x32\x00\x18\x00.{20}).{4}", lambda found: found[1] + address, data, flags=re.DOTALL)

    def unannounced(random: Random, data: bytes, _: bytes) -> bytes:
        return data.replace(b"\x00\x01\x00\xc2", bytes([0, random.randrange(2, 9), 0, 0xC2]))

    return {
        "nobody": only(9),
        "a heartbeat alone": only(1),
        "meant for somebody else": changed(lambda r, data, own: data.replace(own, r.randbytes(12))),
        "sent back": changed(lambda _, data, own: data[:8] + own + data[20:]),
        "other bytes": changed(lambda r, data, _: r.randbytes(len(data))),
        "another protocol": changed(lambda r, data, _: r.choice((b"RTPX", b"HTTP", b"\0\0\0\0")) + data[4:]),
        "cut": changed(lambda r, data, _: data[: r.randrange(len(data) // 2)]),
        "no announcement": changed(unannounced),
        "reached elsewhere": changed(locators),
        "another domain": changed(
            lambda r, data, _: re.sub(
                rb"\x0f\x00\x04\x00.{4}",
                b"\x0f\x00\x04\x00" + struct.pack("<I", r.randrange(1, 200)),
                data,
                flags=re.DOTALL,
            )
        ),
        "not asked": not_given("participants"),
        "sockets not told": not_given("sockets"),
        "sockets garbled": garbled("sockets"),
    }


# Addresses and routes of a computer.


def cards_changed(name: str, change: Callable[[Random, list[dict[str, Any]]], None]) -> Callable[..., None]:
    """What `ip -j` prints, read, changed and printed again."""

    def lie(random: Random, told: dict[str, Told]) -> None:
        rows = json.loads(told[name]["out"])
        change(random, rows)
        told[name]["out"] = json.dumps(rows) + "\n"

    return lie


def held(rows: list[dict[str, Any]], interface: str) -> dict[str, Any]:
    """The first IPv4 address of an interface."""
    link = next(row for row in rows if row["ifname"] == interface)
    found: dict[str, Any] = next(one for one in link["addr_info"] if one["family"] == "inet")
    return found
