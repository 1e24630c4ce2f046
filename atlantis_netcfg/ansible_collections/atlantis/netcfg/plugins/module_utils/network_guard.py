"""Change the network of this computer, and roll back an unconfirmed change. Started by systemd, never by a session.

Verbs:

    apply    puts the files of `wanted.json` in place and brings them into effect
    back     restores the files of `previous.json` and brings them into effect
    boot     the same before the network starts, after a power cut

A change is unconfirmed as long as the file `pending` exists: removing that file is the confirmation. This file and
`network_files` are installed unchanged, so that they do not depend on the toolkit.
"""

from __future__ import annotations

import json
import re
import sys
import time
from typing import Iterator, Sequence

from .network_files import FOLDER, Manifest, NetworkComputer, put

PENDING, APPLIED_PATH, OUTCOME = (f"{FOLDER}/{name}" for name in ("pending", "applied", "outcome"))
PREVIOUS, DESIRED_PATH = f"{FOLDER}/previous.json", f"{FOLDER}/wanted.json"
ROOM = f"{FOLDER}/room"
"""Placeholder of a few blocks, removed before files are restored: the disk may have become full by then."""
APPLY_UNIT = "atlantis-network-apply.service"
APPLY_AFTER_S = 2.0
"""Delay so that the requesting session still receives its response."""
_COME_BACK_S = 15.0
"""Seconds for the tool to restore the previous addresses before they are set directly; DHCP is slow."""
_PAUSE_S = 0.1
_TOOLS = (("/etc/netplan/", "netplan"), ("/etc/network/", "ifupdown"), ("/etc/systemd/network/", "networkd"))


def boot_time() -> float:
    """Return the seconds since this computer was started, independent of clock changes."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def addresses(computer: NetworkComputer) -> dict[str, list[str]]:
    """Return the IPv4 addresses of each interface except the loopback, with their prefix lengths."""
    result = computer.run(("ip", "-json", "-4", "address", "show"))
    links = json.loads(result.output or "[]") if result.code == 0 else []
    return {
        link["ifname"]: [f"{item['local']}/{item['prefixlen']}" for item in link["addr_info"]]
        for link in links
        if link and link["ifname"] != "lo"
    }


def running(computer: NetworkComputer, interfaces: Sequence[str]) -> list[str]:
    """Return current addresses and routes of interfaces, as `ip -batch` commands that restore them."""
    rows = []
    for name, current in addresses(computer).items():
        if name in interfaces:
            rows.append(f"link set dev {name} up")
            rows += [f"address replace {address} brd + dev {name}" for address in current]
    for row in computer.run(("ip", "-4", "route", "show", "table", "main")).output.splitlines():
        words = [word for word in row.split() if word not in ("linkdown", "dead", "pervasive", "offload")]
        if "kernel" not in words and any(name in words for name in interfaces):
            rows.append(f"route replace {' '.join(words)}")
    return rows


def _address_commands(rows: Sequence[str]) -> set[str]:
    """Select the commands that set an address."""
    return {row for row in rows if row.startswith("address ")}


def _interfaces(manifest: Manifest) -> list[str]:
    """Return the interface names in the files of ifupdown, except the loopback."""
    texts = [item.get("text", "") for item in manifest["files"] if item["path"].startswith("/etc/network/")]
    names = re.findall(r"^\s*iface\s+(\S+)", "\n".join(texts), re.MULTILINE)
    return [name for name in dict.fromkeys(names) if name != "lo"]


def activate(computer: NetworkComputer, manifest: Manifest, other: Manifest) -> list[str]:
    """Replace the files of `other` by those of `manifest`, and make the tools use them; return error messages."""
    for name in _interfaces(other):
        computer.run(("ifdown", "--force", name))
    for name in manifest["interfaces"]:
        computer.run(("ip", "-4", "address", "flush", "dev", name))
    complaints = []
    try:
        put(computer, manifest)
    except OSError as error:
        complaints.append(f"{error.filename}: {error.strerror}")
    for words in _commands(manifest):
        result = computer.run(words)
        if result.code and words[:2] != ("systemctl", "stop"):  # what is not installed needs no stopping
            complaints.append(f"`{' '.join(words)}` failed: {result.output}")
    return complaints


def _commands(manifest: Manifest) -> Iterator[Sequence[str]]:
    """Yield the commands that make the tools use their files."""
    tools = {tool for item in manifest["files"] for prefix, tool in _TOOLS if item["path"].startswith(prefix)}
    if "netplan" in tools:
        yield ("netplan", "apply")
    if not manifest["networkd"]:
        yield ("systemctl", "stop", "systemd-networkd.socket", "systemd-networkd.service")
    elif "networkd" in tools:
        yield ("systemctl", "daemon-reload")
        yield ("systemctl", "start", "systemd-networkd.service")
        yield ("networkctl", "reload")
        yield ("networkctl", "reconfigure", *manifest["interfaces"])
    for name in _interfaces(manifest):
        yield ("ifup", "--force", name)


def apply(computer: NetworkComputer) -> None:
    """Bring the staged change into effect; if that fails, take it back at once."""
    with computer.hold_lock():
        pending, desired_manifest, previous = (computer.load(path) for path in (PENDING, DESIRED_PATH, PREVIOUS))
        if pending is None or desired_manifest is None or previous is None or computer.load(APPLIED_PATH) is not None:
            return
        computer.write(APPLIED_PATH, json.dumps({"id": pending["id"], "ended_s": None}))
        complaints = activate(computer, desired_manifest, previous)
        computer.write(APPLIED_PATH, json.dumps({"id": pending["id"], "ended_s": boot_time()}))
        if complaints:
            _roll_back(computer, complaints[0])


def roll_back(computer: NetworkComputer) -> None:
    """Roll back an unconfirmed change. Raises OSError if a file could not be restored."""
    computer.run(("systemctl", "stop", APPLY_UNIT))
    with computer.hold_lock():
        _roll_back(computer)


def _roll_back(computer: NetworkComputer, why: str | None = None) -> None:
    pending, previous = computer.load(PENDING), computer.load(PREVIOUS)
    if pending is None or previous is None:
        return
    computer.remove(ROOM)
    if computer.load(APPLIED_PATH) is not None:
        desired_manifest = computer.load(DESIRED_PATH) or previous
        activate(computer, previous, desired_manifest)
        _settle(computer, previous, desired_manifest)
    put(computer, previous)
    _close_change(computer, pending, why or pending["unconfirmed"])


def _settle(computer: NetworkComputer, previous: Manifest, desired_manifest: Manifest) -> None:
    """Wait for the tool; then restore what it did not, and remove what it left of the change."""
    rows, names = previous["running"], previous["interfaces"]
    end = time.monotonic() + _COME_BACK_S
    while _address_commands(rows) - _address_commands(running(computer, names)) and time.monotonic() < end:
        time.sleep(_PAUSE_S)
    now = running(computer, names)
    for row in desired_manifest["running"]:
        if row in now and row not in rows:
            computer.run(("ip", *row.replace(" replace ", " del ").replace(" brd +", "").split()))
    for row in rows:
        if row not in now:
            computer.run(("ip", *row.split()))


def boot(computer: NetworkComputer) -> None:
    """After a power cut during an unconfirmed change, restore the files before the network starts."""
    with computer.hold_lock():
        pending, previous = computer.load(PENDING), computer.load(PREVIOUS)
        if pending is None or previous is None:
            return
        computer.remove(ROOM)
        put(computer, previous)
        if any(item["path"].startswith("/etc/netplan/") for item in previous["files"]):
            computer.run(("netplan", "generate"))  # its own generator has run before us, with the files of the change
        _close_change(computer, pending, "the computer was restarted before a new session had confirmed it")


def _close_change(computer: NetworkComputer, pending: Manifest, why: str) -> None:
    values = {"id": pending["id"], "confirmed": False, "why": why, "texts": pending.get("texts", [])}
    computer.write(OUTCOME, json.dumps(values))
    computer.remove(PENDING)
    computer.remove(APPLIED_PATH)


def main(verb: str) -> None:
    """Run the verb that systemd passes."""
    computer = NetworkComputer()
    if verb == "apply":
        time.sleep(APPLY_AFTER_S)
        apply(computer)
    elif verb == "back":
        roll_back(computer)
    else:
        boot(computer)


if __name__ == "__main__":
    main(sys.argv[1])
