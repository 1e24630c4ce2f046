"""`iw`: the words of iw 5.4 to 6.7 (`link.c`, `station.c`, `interface.c`, `reg.c`), from general knowledge."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.emulator.linux._spec import AssociationSpec, ComputerSpec, InterfaceSpec

__all__ = ["iw"]

Printed = tuple[int, str, str]
_NO_DEVICE = (237, "", "command failed: No such device (-19)\n")
_USAGE = (1, "", "Usage:\tiw [options] command\n")


def iw(spec: ComputerSpec, argv: Sequence[str]) -> Printed:
    """Answer `iw reg get` and `iw dev NAME link|info|station dump`."""
    words = list(argv[1:])
    if words == ["reg", "get"]:
        return 0, _REGULATION.format(country=spec.country, region=_REGIONS.get(spec.country, "ETSI")), ""
    if len(words) < 3 or words[0] != "dev":  # noqa: PLR2004 - dev, its name, a command
        return _USAGE
    interface = spec.interface(words[1])
    if interface is None or not interface.wireless:
        return _NO_DEVICE
    shown = {"link": _link, "info": _info, "station dump": _station}.get(" ".join(words[2:]))
    return _USAGE if shown is None else (0, shown(interface), "")


_REGIONS = {"00": "UNSET"}
_REGULATION = """global
country {country}: DFS-{region}
\t(2400 - 2483 @ 40), (N/A, 20), (N/A)
\t(5150 - 5250 @ 80), (N/A, 23), (N/A), NO-OUTDOOR, AUTO-BW
\t(5250 - 5350 @ 80), (N/A, 20), (0 ms), NO-OUTDOOR, DFS, AUTO-BW
\t(5470 - 5725 @ 160), (N/A, 27), (0 ms), DFS

"""


def _link(interface: InterfaceSpec) -> str:
    there = interface.association
    if there is None or not interface.up:
        return "Not connected.\n"
    return (
        f"Connected to {there.bssid.lower()} (on {interface.name})\n"
        f"\tSSID: {there.ssid}\n"
        f"\tfreq: {there.frequency_mhz}\n"
        f"\tRX: {there.tx_packets * 210} bytes ({there.tx_packets} packets)\n"
        f"\tTX: {there.tx_packets * 180} bytes ({there.tx_packets} packets)\n"
        f"\tsignal: {there.signal_dbm} dBm\n"
        f"\trx bitrate: {there.rate_mbps:.1f} MBit/s\n"
        f"\ttx bitrate: {there.rate_mbps:.1f} MBit/s\n"
        "\tbss flags:\tshort-slot-time\n"
        "\tdtim period:\t2\n"
        "\tbeacon int:\t100\n"
    )


def _info(interface: InterfaceSpec) -> str:
    there = interface.association if interface.up else None
    ssid = "" if there is None else f"\tssid {there.ssid}\n"
    return (
        f"Interface {interface.name}\n"
        "\tifindex 3\n"
        "\twdev 0x1\n"
        f"\taddr {(interface.mac or '').lower()}\n"
        f"{ssid}"
        f"\ttype {interface.type}\n"
        "\twiphy 0\n"
        f"{'' if there is None else _channel(there)}"
        "\ttxpower 20.00 dBm\n"
    )


def _channel(there: AssociationSpec) -> str:
    number = (there.frequency_mhz - 5000) // 5 if there.frequency_mhz > 5000 else (there.frequency_mhz - 2407) // 5  # noqa: PLR2004 - MHz
    return f"\tchannel {number} ({there.frequency_mhz} MHz), width: 20 MHz, center1: {there.frequency_mhz} MHz\n"


def _level(there: AssociationSpec) -> str:
    chains = f" [{', '.join(map(str, there.chains_dbm))}]" if there.chains_dbm else ""
    return f"{there.signal_dbm}{chains} dBm"


def _station(interface: InterfaceSpec) -> str:
    there = interface.association
    if there is None or not interface.up:
        return ""
    lines = (
        ("inactive time:", f"{there.inactive_ms} ms"),
        ("rx bytes:", there.tx_packets * 210),
        ("rx packets:", there.tx_packets),
        ("tx bytes:", there.tx_packets * 180),
        ("tx packets:", there.tx_packets),
        ("tx retries:", there.tx_retries),
        ("tx failed:", there.tx_failed),
        ("rx drop misc:", 2),
        ("signal:  ", _level(there)),
        ("signal avg:", _level(there)),
        ("tx bitrate:", f"{there.rate_mbps:.1f} MBit/s"),
        ("rx bitrate:", f"{there.rate_mbps:.1f} MBit/s"),
        ("authorized:", "yes"),
        ("authenticated:", "yes"),
        ("associated:", "yes"),
        ("preamble:", "long"),
        ("WMM/WME:", "yes"),
        ("MFP:\t", "no"),
        ("TDLS peer:", "no"),
        ("DTIM period:", 2),
        ("beacon interval:100", ""),
        ("short slot time:yes", ""),
        ("connected time:", f"{there.connected_s} seconds"),
    )
    text = "".join(f"\t{name}\t{value}\n" if value != "" else f"\t{name}\n" for name, value in lines)
    return f"Station {there.bssid.lower()} (on {interface.name})\n{text}"
