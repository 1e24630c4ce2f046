"""`ping` of iputils, without waiting: its words are those of version 20221126, seen on a real one."""

from __future__ import annotations

from ipaddress import AddressValueError, IPv4Address, IPv4Interface
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.emulator.linux._spec import ComputerSpec, EchoSpec

__all__ = ["ping"]

Printed = tuple[int, str, str]
_ARP_S = 3.0
"""Three questions, one a second (arp(7): mcast_solicit, retrans_time)."""
_WITH_VALUE = ("-c", "-i", "-W", "-I", "-s", "-w")


def ping(spec: ComputerSpec, argv: Sequence[str]) -> Printed:
    """Answer at once what a ping would have said in the end."""
    if len(argv) < 2:  # noqa: PLR2004 - the program and a target
        return 1, "", "ping: usage error: Destination address required\n"
    options = {word: argv[place + 1] for place, word in enumerate(argv[:-1]) if word in _WITH_VALUE}
    target, count = argv[-1], int(options.get("-c", "1"))
    through = options.get("-I")
    if not _is_address(target):
        return 2, "", f"ping: {target}: Name or service not known\n"
    if through is not None and spec.interface(through) is None:
        return 2, "", f"ping: SO_BINDTODEVICE {through}: No such device\n"
    way = spec.towards(target)
    if through is None and way is None:
        return 2, "", "ping: connect: Network is unreachable\n"
    device = through or (way[0] if way is not None else "")
    own = spec.interface(device)
    source = str(IPv4Interface(own.addresses[0].address).ip) if own is not None and own.addresses else "0.0.0.0"  # noqa: S104 - printed
    head = f"PING {target} ({target}) " + (f"from {source} {through}: " if through else "") + "56(84) bytes of data.\n"
    interval = float(options.get("-i", "1"))
    waits = (interval, float(options.get("-W", "10")))
    echo = spec.echoes.get(target)
    if echo is None or own is None or not own.up:
        on_segment = own is not None and own.up and (way is None or way[1] is None) and own.mac is not None
        return 1, head + _silence(target, source, count, waits, on_segment=on_segment), ""
    lines, received = _answers(target, echo, count)
    return (0 if received else 1), head + lines + _sum(target, count, received, interval, echo), ""


def _is_address(text: str) -> bool:
    try:
        IPv4Address(text)
    except AddressValueError:
        return False
    return True


def _answers(target: str, echo: EchoSpec, count: int) -> tuple[str, int]:
    """The share that is lost is lost evenly, beginning with the last of each run."""
    kept = [number for number in range(1, count + 1) if not _lost(number, echo.loss_percent)]
    lines = (f"64 bytes from {target}: icmp_seq={number} ttl=64 time={_time(echo.rtt_ms)} ms\n" for number in kept)
    return "".join(lines), len(kept)


def _lost(number: int, percent: float) -> bool:
    return int(number * percent / 100) > int((number - 1) * percent / 100)


def _time(value: float) -> str:
    """Three figures, as iputils prints them."""
    digits = next((digits for least, digits in ((100, 0), (10, 1), (1, 2)) if value >= least), 3)
    return f"{value:.{digits}f}"


def _percent(count: int, received: int) -> str:
    return f"{100 * (count - received) / count:.6g}%"


def _sum(target: str, count: int, received: int, interval: float, echo: EchoSpec) -> str:
    took = round((count - 1) * interval * 1000)
    head = f"\n--- {target} ping statistics ---\n{count} packets transmitted, {received} received, "
    rtt = f"{echo.rtt_ms:.3f}"
    tail = f"rtt min/avg/max/mdev = {rtt}/{rtt}/{rtt}/0.000 ms\n" if received else "\n"
    return f"{head}{_percent(count, received)} packet loss, time {took}ms\n{tail}"


def _silence(target: str, source: str, count: int, waits: tuple[float, float], *, on_segment: bool) -> str:
    """On a segment the kernel gives up asking by ARP after some seconds, and says so where ping still listens."""
    interval, patience = waits
    unreachable = on_segment and (count - 1) * interval + patience > _ARP_S
    told = [f"From {source} icmp_seq={number} Destination Host Unreachable\n" for number in range(1, count + 1)]
    errors = f"+{count} errors, " if unreachable else ""
    took = round((count - 1) * interval * 1000)
    middle = f"\n--- {target} ping statistics ---\n{count} packets transmitted, 0 received, "
    return f"{''.join(told) if unreachable else ''}{middle}{errors}100% packet loss, time {took}ms\n\n"
