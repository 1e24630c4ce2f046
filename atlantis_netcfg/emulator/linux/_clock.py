"""`timedatectl show` (systemd 245) and `chronyc -n -c` (chrony 3.5 to 4.3, `client.c`)."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.emulator.linux._spec import ComputerSpec

__all__ = ["chronyc", "timedatectl"]

Printed = tuple[int, str, str]
_UNSYNCHRONISED = (
    "00000000,,0,0.000000000,0.000000000,0.000000000,0.000000000,0.000,0.000,0.000,1.000000000,1.000000000,0.0,"
    "Not synchronised\n"
)


def timedatectl(spec: ComputerSpec, argv: Sequence[str], now: float) -> Printed:
    """Answer `timedatectl show`; `now`: seconds since 1970 by its own clock."""
    if list(argv[1:]) != ["show"]:
        return 1, "", f"Unknown command verb {argv[1] if len(argv) > 1 else ''}.\n"
    time = spec.time
    stamp = datetime.fromtimestamp(now, UTC).astimezone(ZoneInfo(time.zone)).strftime("%a %Y-%m-%d %H:%M:%S %Z")
    told = {
        "Timezone": time.zone,
        "LocalRTC": "no",
        "CanNTP": "yes",
        "NTP": "yes" if time.ntp else "no",
        "NTPSynchronized": "yes" if time.synchronised else "no",
        "TimeUSec": stamp,
        "RTCTimeUSec": stamp,
    }
    return 0, "".join(f"{name}={value}\n" for name, value in told.items()), ""


def chronyc(spec: ComputerSpec, argv: Sequence[str], now: float) -> Printed:
    """Answer `chronyc -n -c tracking` and `sources`."""
    time = spec.time
    if not time.chrony:
        return 1, "", "506 Cannot talk to daemon\n"
    command = argv[-1]
    if command == "sources":
        mark, reach = ("*", 377) if time.synchronised else ("?", 0)
        return 0, f"^,{mark},{time.server},{time.stratum - 1},6,{reach},12,0.000120,0.000120,0.002000000\n", ""
    if command != "tracking":
        return 1, "", "Unrecognized command\n"
    if not time.synchronised:
        return 0, _UNSYNCHRONISED, ""
    number = "".join(f"{int(part):02X}" for part in time.server.split("."))
    known = "0.000012345,0.000010000,0.000020000,-11.234,0.001,0.020,0.012000000,0.001000000,64.2"
    return 0, f"{number},{time.server},{time.stratum},{now - 40:.9f},{known},Normal\n", ""
