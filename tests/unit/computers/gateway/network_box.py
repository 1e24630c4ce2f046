"""A computer in a folder: files below it, and in place of `ip`, systemd and the three tools what they would do."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from network_pilots import coast

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import network_change, network_guard
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.network_change import (
    BACK,
    BACK_TIMER,
    NetworkChange,
)
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.network_desired import DesiredNetwork
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.network_files import (
    NetworkComputer,
    ProgramEnd,
)
from atlantis_netcfg.computers.parts import computer_network

PATHS = {
    "netplan": "/etc/netplan/10-atlantis.yaml",
    "ifupdown": "/etc/network/interfaces",
    "networkd": "/etc/systemd/network/05-atlantis.network",
}
_PROGRAMS = ("/usr/sbin/netplan", "/sbin/ifup", "/lib/systemd/systemd-networkd")
_FINE = ProgramEnd(0, "")


def _parts(address: str) -> dict[str, str]:
    local, _, prefix = address.partition("/")
    return {"local": local, "prefixlen": prefix}


class Killed(BaseException):
    """The process was killed."""


class Box:
    """`held`: interface -> addresses; `routes`: gateway and interface of default routes."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.computer = NetworkComputer(str(root), self.run)
        self.held: dict[str, list[str]] = {"eth0": [], "eth1": []}
        self.routes: list[tuple[str, str]] = []
        self.answers = {"10.64.1.1"}
        self.timer = self.queued = self.networkd = False
        self.asked: list[tuple[str, ...]] = []
        self.kill_at = -1
        for name in self.held:
            self.put(f"/sys/class/net/{name}/address", "02:00:5e:00:01:10\n")
        for path in _PROGRAMS:
            self.put(path, "")

    def put(self, path: str, text: str) -> None:
        place = self.root / path[1:]
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)

    def text(self, path: str) -> str | None:
        place = self.root / path[1:]
        return place.read_text() if place.exists() else None

    def state(self) -> dict[str, Any]:
        """What must be as before, or as declared."""
        files = {path: self.text(path) for path in (*PATHS.values(), "/etc/resolv.conf")}
        return {
            "files": files,
            "held": {name: list(held) for name, held in self.held.items()},
            "routes": self.routes[:],
        }

    def step(self) -> None:
        self.kill_at -= 1
        if self.kill_at == 0:
            raise Killed

    def time_passes(self) -> None:
        """The apply unit comes to its turn, then the timer."""
        self.kill_at = -1
        if self.queued:
            self.queued = False
            network_guard.apply(self.computer)
        if self.timer:
            self.timer = False
            network_guard.roll_back(self.computer)

    def power_cut(self) -> None:
        """Cut and given again: systemd has forgotten its timers; the boot unit runs, then the network starts."""
        self.kill_at = -1
        self.timer = self.queued = False
        self.held, self.routes = {"eth0": [], "eth1": []}, []
        network_guard.boot(self.computer)
        for by in PATHS:
            self._use(by)

    def run(self, words: Sequence[str]) -> ProgramEnd:
        self.step()
        self.asked.append(tuple(words))
        name = words[0].replace("-", "_")
        done: ProgramEnd = getattr(self, f"_{name}")(tuple(words[1:]))
        return done

    def _ip(self, words: tuple[str, ...]) -> ProgramEnd:
        if words[:3] == ("-json", "-4", "address"):
            rows = [{"ifname": name, "addr_info": [_parts(one) for one in held]} for name, held in self.held.items()]
            return ProgramEnd(0, json.dumps(rows))
        if words[:3] == ("-json", "-4", "route"):
            return ProgramEnd(0, json.dumps([{"gateway": gateway, "dev": name} for gateway, name in self.routes]))
        if words[:3] == ("-json", "-4", "neighbour"):
            known = [{"lladdr": "02:00:5e:00:01:01", "state": ["REACHABLE"]}] if words[4] in self.answers else []
            return ProgramEnd(0, json.dumps(known))
        if words[:3] == ("-4", "route", "show"):
            return ProgramEnd(0, "".join(f"default via {gateway} dev {name}\n" for gateway, name in self.routes))
        return self._changed(words[1:] if words[0] == "-4" else words)

    def _changed(self, words: tuple[str, ...]) -> ProgramEnd:
        match words:
            case ("address", "flush", "dev", name):
                self._empty(name)
            case ("address", "replace", address, "brd", "+", "dev", name) if address not in self.held[name]:
                self.held[name].append(address)
            case ("address", "del", address, "dev", name):
                self.held[name].remove(address)
            case ("route", "replace", "default", "via", gateway, "dev", name):
                self.routes = [(gateway, name)]
            case ("link", "set", "dev", _, "up"):
                pass
            case _:
                raise AssertionError(words)
        return _FINE

    def _empty(self, name: str) -> None:
        self.held[name] = []
        self.routes = [(gateway, device) for gateway, device in self.routes if device != name]

    def _systemctl(self, words: tuple[str, ...]) -> ProgramEnd:
        match words:
            case ("is-active", name) if name == BACK_TIMER:
                return ProgramEnd(0, "active") if self.timer else ProgramEnd(3, "inactive")
            case ("is-active", "systemd-networkd.service"):
                return ProgramEnd(0, "active") if self.networkd else ProgramEnd(3, "inactive")
            case ("is-enabled", "systemd-networkd.service"):
                link = self.root / "etc/systemd/system/multi-user.target.wants/systemd-networkd.service"
                return ProgramEnd(0, "enabled") if link.is_symlink() else ProgramEnd(1, "disabled")
            case ("start", "systemd-networkd.service"):
                self.networkd = True
            case ("stop", "systemd-networkd.socket", "systemd-networkd.service"):
                self.networkd = False
                return ProgramEnd(5, "Failed to stop systemd-networkd.socket: Unit systemd-networkd.socket not loaded.")
            case ("stop", name) if name == BACK_TIMER:
                self.timer = False
            case ("stop", name) if name == network_guard.APPLY_UNIT:
                self.queued = False
            case ("start", "--no-block", name) if name == BACK:
                self.timer = True
            case ("daemon-reload",) | ("reset-failed", _):
                pass
            case _:
                raise AssertionError(words)
        return _FINE

    def _systemd_run(self, words: tuple[str, ...]) -> ProgramEnd:
        if words[0] == f"--unit={BACK}":
            self.timer = True
        else:
            assert self.timer, "the change is started before the way back is armed"
            self.queued = True
        return _FINE

    def _netplan(self, words: tuple[str, ...]) -> ProgramEnd:
        if words == ("apply",):
            self.networkd = True
            self._use("netplan")
            return _FINE
        root = words[2] if len(words) > 1 else str(self.root)
        return self._generated(root)

    def _generated(self, root: str) -> ProgramEnd:
        for place in sorted(Path(root, "etc/netplan").glob("*.yaml")):
            text = place.read_text()
            if wrong := re.search(r"addresses: \[([\d.]+)\]", text.split("nameservers")[0]):
                return ProgramEnd(1, f"{place}:8:18: Error: address '{wrong[1]}' is missing /prefixlength")
            names = re.findall(r"name: ([\w*\"]+)|^    (e\w+):", text, re.MULTILINE)
            made = Path(root, "run/systemd/network", f"10-netplan-{place.stem}.network")
            made.parent.mkdir(parents=True, exist_ok=True)
            made.write_text("".join(f"[Match]\nName={(one or two).strip(chr(34))}\n" for one, two in names))
        return _FINE

    def _networkctl(self, words: tuple[str, ...]) -> ProgramEnd:
        if words[0] == "reconfigure":
            self._use("networkd")
        return _FINE

    def _ifdown(self, words: tuple[str, ...]) -> ProgramEnd:
        if words[1] in self.held:
            self._empty(words[1])
        return _FINE

    def _ifup(self, words: tuple[str, ...]) -> ProgramEnd:
        if words[0] == "--force":
            self._use("ifupdown")
        return _FINE

    def _use(self, by: str) -> None:
        """The tool makes of its file what it says."""
        text = self.text(PATHS[by]) or ""
        address = re.search(r"(?i)address(?:es)?[:= ]+\[?([\d.]+/\d+)", text)
        name = re.search(r"(?:name: |iface |Name=)(eth\d)", text)
        gateway = re.search(r"(?:via: |gateway |Gateway=)([\d.]+)", text)
        if address and name and gateway:
            self.held[name[1]] = [address[1]]
            self.routes = [(gateway[1], name[1])]


@pytest.fixture
def box(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Box:
    """A computer without a configuration, which time and the gateway obey."""
    made = Box(tmp_path)
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))  # who is killed leaves what he has there
    monkeypatch.setattr("os.fsync", lambda _handle: made.step())
    monkeypatch.setattr(DesiredNetwork, "_trigger_arp", lambda _self: None)
    monkeypatch.setattr(network_change, "ssh_server_start_s", network_guard.boot_time)
    monkeypatch.setattr("time.sleep", lambda _s: made.time_passes())
    monkeypatch.setattr(network_change, "_SETTLED_S", 0.0)
    monkeypatch.setattr(network_guard, "_COME_BACK_S", 0.0)
    return made


def wish(by: str, **changes: Any) -> DesiredNetwork:  # noqa: ANN401
    part = computer_network(*coast(by))
    assert part is not None
    return DesiredNetwork.of({"resolver": None, **part.as_dict(), **changes})


def made(box: Box, by: str, **changes: Any) -> NetworkChange:  # noqa: ANN401
    return NetworkChange(box.computer, wish(by, **changes))


def moved(by: str) -> dict[str, str]:
    content = wish(by).content.replace("10.64.1.10/", "10.64.1.77/")
    return {"address": "10.64.1.77/24", "content": content}


def settled(box: Box, by: str) -> dict[str, Any]:
    change = made(box, by)
    name = change.stage()
    assert name is not None
    box.queued = False
    network_guard.apply(box.computer)
    assert change.confirm(name)["state"] == "confirmed"
    return box.state()
