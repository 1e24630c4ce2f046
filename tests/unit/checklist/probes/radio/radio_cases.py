"""What the tests of the radio columns share: a case as data, and the words of programs on a gateway.

The answers of `iw` are made here after its sources (link.c, station.c, interface.c and reg.c of 5.16; Ubuntu 20.04 has
5.4, Debian 12 has 5.19): no radio is needed, and mac80211_hwsim is not on every computer that tests. Those of `ip` and
`ping` are from iproute2 6.1 and iputils 20221126.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import yaml

from atlantis_netcfg.checklist.probes import Answer, CommandResult, Probe, ProbeResult, Trouble
from atlantis_netcfg.core.events import Verdict

BSSID = "04:f0:21:45:12:9a"


@dataclass(frozen=True, slots=True)
class Case:
    """Answers that differ from the healthy ones; what is to be said of them stands under its name in a .yml beside."""

    name: str
    answers: Mapping[str, Answer] = field(default_factory=dict)
    endpoint: Mapping[str, Any] = field(default_factory=dict)
    probe: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.name


def listed(test: str) -> dict[str, Any]:
    """What is said, case by case, in the .yml of a test: findings, and all evidence where it is compared."""
    told = Path(test).with_name(Path(test).stem.removeprefix("test_probe_") + ".yml").read_text(encoding="utf-8")
    return cast("dict[str, Any]", yaml.safe_load(told))


def check(case: Case, told: Mapping[str, Any], probe: Probe, healthy: Mapping[str, Answer]) -> ProbeResult:
    """Judge, and compare with what is listed; every sentence that is no PASS says what to do."""
    judged = probe.judge({**healthy, **case.answers})
    wanted = told[case.name] if isinstance(told[case.name], dict) else {"findings": told[case.name]}
    assert [f"{one.verdict} {one.code}: {one.message}" for one in judged.findings] == wanted["findings"]
    assert all(one.hint for one in judged.findings if one.verdict is not Verdict.PASS)
    if "evidence" in wanted:
        assert [f"{one.type} {one.what}: {one.value}" for one in judged.evidence] == wanted["evidence"]
    return judged


def codes(*tables: Mapping[str, Any]) -> set[str]:
    """Every code that some case lists."""
    cases = [case for table in tables for case in table.values()]
    lines = [line for case in cases for line in (case["findings"] if isinstance(case, dict) else case)]
    return {line.split(" ")[1].rstrip(":") for line in lines}


def printed(out: str, rc: int = 0, err: str = "") -> CommandResult:
    """What a program printed."""
    return CommandResult(None, rc=rc, out=out, err=err)


NOBODY = CommandResult(Trouble.NO_PLACE, "coastal-gateway: connection timed out")


def linked(  # noqa: PLR0913, PLR0917 - the lines that `iw` prints
    ssid: str | None = "EXAMPLE-SPARUS",
    signal: str = "-52 dBm",
    mhz: str = "5500",
    rx: str = "144.4 MBit/s MCS 15 short GI",
    tx: str = "130.0 MBit/s MCS 15",
    bssid: str = BSSID,
) -> CommandResult:
    """`iw dev wlan1 link`."""
    name = "" if ssid is None else f"\tSSID: {ssid}\n"
    lines = (
        f"Connected to {bssid} (on wlan1)\n{name}\tfreq: {mhz}\n\tRX: 128230 bytes (1013 packets)\n"
        f"\tTX: 18110 bytes (142 packets)\n\tsignal: {signal}\n\trx bitrate: {rx}\n\ttx bitrate: {tx}\n\n"
        "\tbss flags:\tshort-slot-time\n\tdtim period:\t2\n\tbeacon int:\t100\n"
    )
    return printed(lines)


def stations(signal: str = "-52 [-54, -55] dBm", mean: str = "-52 [-54, -55] dBm", bssid: str = BSSID) -> CommandResult:
    """`iw dev wlan1 station dump`."""
    return printed(
        f"Station {bssid} (on wlan1)\n\tinactive time:\t12 ms\n\trx bytes:\t128230\n\trx packets:\t1013\n"
        "\ttx bytes:\t18110\n\ttx packets:\t142\n\ttx retries:\t3\n\ttx failed:\t0\n\tbeacon loss:\t0\n"
        f"\tsignal:  \t{signal}\n\tsignal avg:\t{mean}\n\tbeacon signal avg:\t-51 dBm\n"
        "\ttx bitrate:\t130.0 MBit/s MCS 15\n\trx bitrate:\t144.4 MBit/s MCS 15 short GI\n"
        "\tauthorized:\tyes\n\tauthenticated:\tyes\n\tassociated:\tyes\n\tconnected time:\t77 seconds\n"
    )


def info(kind: str = "managed", channel: str = "100 (5500 MHz), width: 20 MHz, center1: 5500 MHz") -> CommandResult:
    """`iw dev wlan1 info`."""
    return printed(
        f"Interface wlan1\n\tifindex 4\n\twdev 0x100000001\n\taddr 02:00:5e:00:01:31\n\tssid EXAMPLE-SPARUS\n"
        f"\ttype {kind}\n\twiphy 1\n\tchannel {channel}\n\ttxpower 20.00 dBm\n"
    )


def rules(*countries: str) -> CommandResult:
    """`iw reg get`."""
    blocks = [f"country {one}: DFS-ETSI\n\t(5470 - 5725 @ 160), (N/A, 26), (0 ms), DFS\n" for one in countries]
    return printed("global\n" + "\nphy#1\n".join(blocks))


def card(flags: str = '"BROADCAST","MULTICAST","UP","LOWER_UP"', more: str = "") -> CommandResult:
    """`ip -j addr show dev wlan1`."""
    return printed(f'[{{"ifindex":4,"ifname":"wlan1","flags":[{flags}],{more}"operstate":"UP","addr_info":[]}}]\n')


def way(dev: str = "wlan1", address: str = "10.70.2.1") -> CommandResult:
    """`ip -j route get`."""
    return printed(f'[{{"dst":"{address}","dev":"{dev}","prefsrc":"10.70.2.2","flags":[],"uid":0,"cache":[]}}]\n')


def pings(
    received: int = 20, mean: float = 3.2, address: str = "10.70.2.1", more: str = "", twice: int = 0
) -> CommandResult:
    """`ping -n -c 20 -i 0.2 -W 2`."""
    lines = "".join(
        f"64 bytes from {address}: icmp_seq={number} ttl=64 time={mean} ms\n" for number in range(1, received + 1)
    )
    lines += "".join(
        f"64 bytes from {address}: icmp_seq={number} ttl=64 time={mean} ms (DUP!)\n" for number in range(1, twice + 1)
    )
    again = f", +{twice} duplicates" if twice else ""
    lost = f"{100 * (20 - received) / 20:g}% packet loss"
    times = f"rtt min/avg/max/mdev = {mean / 2:.3f}/{mean:.3f}/{mean * 2:.3f}/0.512 ms\n" if received else "\n"
    return printed(
        f"PING {address} ({address}) 56(84) bytes of data.\n{lines}{more}\n--- {address} ping statistics ---\n"
        f"20 packets transmitted, {received} received{again}, {lost}, time 3823ms\n{times}",
        rc=0 if received else 1,
    )
