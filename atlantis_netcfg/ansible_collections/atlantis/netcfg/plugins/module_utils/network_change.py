"""A change of the network in two steps: one session stages it, a later session confirms it, or it is rolled back.

A kill at any moment leaves the computer with a complete configuration. The program and the units that roll back stay on
the computer; they are on the disk and armed before the first file changes. systemd makes the change, not the session.
"""

from __future__ import annotations

import inspect
import ipaddress
import json
import os
import time
from pathlib import Path
from typing import Any

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.stored_messages import pack, unpack

from . import network_files, network_guard
from .errors import ModuleError, as_module_error
from .network_desired import OURS, DesiredNetwork, has_same_settings
from .network_files import NetworkComputer, state_of
from .network_guard import (
    APPLIED_PATH,
    APPLY_AFTER_S,
    APPLY_UNIT,
    DESIRED_PATH,
    OUTCOME,
    PENDING,
    PREVIOUS,
    ROOM,
    addresses,
    running,
)

_SERVERS = ("sshd", "dropbear")
"""SSH server processes; OpenSSH 9.8 and later name the process of a session `sshd-session`."""
_ANCESTORS = 20
_PARENT, _START_TIME = 1, 19
"""Indexes in /proc/PID/stat after the process name (fields 4 and 22 in proc(5))."""


def ssh_server_start_s() -> float | None:
    """Return the uptime, in seconds, at which our SSH server process started; None if not called over SSH."""
    pid = "self"
    for _ in range(_ANCESTORS):
        try:
            text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
        except OSError:
            return None
        name, fields = text.partition("(")[2].rpartition(")")[0], text.rpartition(")")[2].split()
        if name.startswith(_SERVERS):
            return int(fields[_START_TIME]) / os.sysconf("SC_CLK_TCK")
        pid = fields[_PARENT]
        if pid == "0":
            return None
    return None


FOLDER = "/usr/local/lib"
_PACKAGE = "atlantis_network"
BACK, BACK_TIMER = "atlantis-network-back.service", "atlantis-network-back.timer"
_BOOT = "atlantis-network-boot.service"
_UNITS = "/etc/systemd/system"


def program(verb: str) -> tuple[str, ...]:
    """Return the command line that runs `network_guard` with a verb, in `FOLDER`."""
    return ("/usr/bin/python3", "-m", f"{_PACKAGE}.network_guard", verb)


_TEXTS = {
    BACK: f"""\
# Written by `provision`. Started by a timer while a change of the network waits for its confirmation.
[Unit]
Description=Take an unconfirmed change of the network back
ConditionPathExists={PENDING}
StartLimitIntervalSec=0

[Service]
Type=oneshot
WorkingDirectory={FOLDER}
ExecStart={" ".join(program("back"))}
Restart=on-failure
RestartSec=10
""",
    _BOOT: f"""\
# Written by `provision`. After a power cut: a change of the network that nobody has confirmed does not survive it.
[Unit]
Description=Take an unconfirmed change of the network back, before the network starts
DefaultDependencies=no
ConditionPathExists={PENDING}
RequiresMountsFor={PENDING} {FOLDER} /etc
After=local-fs.target systemd-remount-fs.service
Before=network-pre.target systemd-networkd.service networking.service NetworkManager.service shutdown.target
Wants=network-pre.target
Conflicts=shutdown.target

[Service]
Type=oneshot
WorkingDirectory={FOLDER}
ExecStart={" ".join(program("boot"))}

[Install]
WantedBy=multi-user.target
""",
}


def install(computer: NetworkComputer) -> None:
    """Update the program and the units to this version; enable the unit for the boot."""
    files = {f"{_UNITS}/{name}": text for name, text in _TEXTS.items()}
    for module in (network_files, network_guard):
        files[f"{FOLDER}/{_PACKAGE}/{module.__name__.rpartition('.')[2]}.py"] = inspect.getsource(module)
    for path, text in files.items():
        if computer.read(path) != text:
            computer.write(path, text, 0o644)
    computer.link(f"{_UNITS}/multi-user.target.wants/{_BOOT}", f"{_UNITS}/{_BOOT}")
    computer.run(("systemctl", "daemon-reload"))


_NETWORKD = "systemd-networkd.service"
_ENABLED_LINK = f"/etc/systemd/system/multi-user.target.wants/{_NETWORKD}"
_UNIT = f"/lib/systemd/system/{_NETWORKD}"
_ROOM_BYTES = 64 * 1024
_MARGIN_S = 60.0
"""Seconds beyond the rollback window for restoring the previous configuration."""
_SETTLED_S = 5.0
"""Seconds that a new configuration may take to become effective after its tool has ended."""
_PAUSE_S = 0.1


class NetworkChange:
    """Change of one interface; `changes` and `diff` are its result, in check mode the planned one."""

    def __init__(self, computer: NetworkComputer, request: DesiredNetwork) -> None:
        self.computer = computer
        self.desired = request
        self.changes: list[str] = []
        self.diff: list[dict[str, str]] = []

    def stage(self, *, check: bool = False) -> str | None:
        """Stage the differences and let systemd apply them; return the change's name, None if there are none."""
        try:
            if not check:
                self._end_earlier()
            entries = self._compare()
            self.desired.require_no_conflicts(self.computer)
            if not self.changes:
                return None
            self.desired.require_applicable(self.computer)
            return None if check else self._stage(entries)
        except OSError as error:
            raise as_module_error(error, str(error.filename or "/var/lib/atlantis/network")) from error

    def confirm(self, name: str) -> dict[str, Any]:
        """Keep the change if it is in effect and this session was opened after it; return its state as `look` does.

        With `again` in the result, this session is older than the change and proves nothing.
        """
        if self._wait_applied(name):
            began, end_s = ssh_server_start_s(), (self.computer.load(APPLIED_PATH) or {}).get("ended_s")
            if began is not None and end_s is not None and began <= end_s:
                return {"state": "pending", "again": True, "why": "this session is older than the change"}
            if missing := self._missing(name):
                self._start_rollback()
                return {"state": "pending", "again": False, "why": missing}
            self._keep(name)
        return {**self.look(name, 0.0), "again": False}

    def look(self, name: str, patience_s: float) -> dict[str, Any]:
        """Return the state of a change (pending, confirmed or rolled back) and why; waits while it is pending."""
        end = time.monotonic() + patience_s
        while self._is_pending(name) and time.monotonic() < end:
            time.sleep(_PAUSE_S)
        if self._is_pending(name):
            return {"state": "pending", "why": "it waits for confirmation"}
        values = unpack(self.computer.load(OUTCOME) or {})
        if values.get("id") != name:
            return {"state": "unknown", "why": "the change is unknown on this computer"}
        return {"state": "confirmed" if values["confirmed"] else "rolled back", "why": values["why"]}

    def _compare(self) -> list[dict[str, Any]]:
        """Return the changed files as a manifest; fills `changes` and `diff`."""
        entries = []
        for path, text in self.desired.files(self.computer).items():
            now = state_of(self.computer, path)
            mode = self.desired.mode if path == self.desired.path else 0o644
            entry = {"path": path, "absent": True}
            if text is not None:
                entry = {"path": path, "text": text, "mode": mode, "uid": os.geteuid(), "gid": os.getegid()}
            alike = {**now, "text": ""} == {**entry, "text": ""} and has_same_settings(now.get("text"), text)
            entries.append(now if alike else entry)
            if not alike:
                self.changes.append(msg(f"file {arg(path)} removed") if text is None else msg(f"file {arg(path)}"))
                before = now.get("text") or ""
                result = before if OURS in before else ""  # somebody else's may hold the key of a radio network
                self.diff.append({"before_header": path, "after_header": path, "before": result, "after": text or ""})
        if self.desired.by == "networkd" and not self._is_networkd_state("is-enabled", "enabled"):
            entries.append({"path": _ENABLED_LINK, "link": _UNIT})
            self.changes.append(msg(f"unit {arg(_NETWORKD)} enabled"))
        if not self.changes:
            self.changes += [
                msg(f"network {arg(self.desired.interface)} applied: {arg(what)}")
                for what in self.desired.list_deviations(self.computer)
            ]
        return entries

    def _stage(self, entries: list[dict[str, Any]]) -> str:
        computer, name = self.computer, os.urandom(8).hex()
        interfaces = self._interfaces()
        with computer.hold_lock():
            if computer.load(PENDING) is not None:
                raise ModuleError("another run is changing this computer's network", "wait until it ends")
            active = self._is_networkd_state("is-active", "active")
            previous = {
                "files": [state_of(computer, entry["path"]) for entry in entries],
                "interfaces": interfaces,
                "networkd": active,
                "running": running(computer, interfaces),
            }
            becomes = {
                "files": entries,
                "interfaces": interfaces,
                "networkd": active or self.desired.by != "ifupdown",
                "running": self._rows(),
            }
            install(computer)
            computer.remove(APPLIED_PATH)
            for path, value in ((PREVIOUS, previous), (DESIRED_PATH, becomes)):
                computer.write(path, json.dumps(value, indent=1))
            computer.write(ROOM, " " * _ROOM_BYTES)
            silent = msg(f"no new session reached {arg(self.desired.ip)} within {arg(self.desired.rollback_s)} s")
            computer.write(PENDING, json.dumps(pack({"id": name, "unconfirmed": silent})))
            try:
                self._arm()
            except ModuleError:
                computer.remove(PENDING)
                raise
        return name

    def _arm(self) -> None:
        """Arm the rollback first, and schedule the change only when the rollback is certain to run."""
        self.computer.run(("systemctl", "stop", BACK_TIMER))
        window_s = APPLY_AFTER_S + self.desired.rollback_s
        self._systemd_run((f"--unit={BACK}", f"--on-active={window_s:.0f}s", "--timer-property=AccuracySec=100ms"))
        if self.computer.run(("systemctl", "is-active", BACK_TIMER)).output != "active":
            raise ModuleError("the rollback timer does not run; nothing was changed")
        self.computer.run(("systemctl", "reset-failed", APPLY_UNIT))
        try:
            here = (f"--unit={APPLY_UNIT}", f"--working-directory={FOLDER}")
            self._systemd_run(("--no-block", "--collect", *here, *program("apply")))
        except ModuleError:
            self.computer.run(("systemctl", "stop", BACK_TIMER))
            raise

    def _systemd_run(self, words: tuple[str, ...]) -> None:
        result = self.computer.run(("systemd-run", *words))
        if result.code:
            raise ModuleError(
                f"systemd does not start the rollback units; nothing was changed: {arg(result.output)}",
                "`systemctl status` there shows the state",
            )

    def _rows(self) -> list[str]:
        """Return the changes in the format of `running`."""
        device = f"dev {self.desired.interface}"
        return [f"address replace {self.desired.address} brd + {device}"]

    def _interfaces(self) -> list[str]:
        """Return the desired interface, and any that has an address of the same LAN now: the LAN moves away from it."""
        lan = ipaddress.IPv4Interface(self.desired.address).network
        there = [
            name
            for name, current in addresses(self.computer).items()
            if any(ipaddress.IPv4Interface(item).ip in lan for item in current)
        ]
        return list(dict.fromkeys([self.desired.interface, *there]))

    def _is_networkd_state(self, verb: str, word: str) -> bool:
        return self.computer.run(("systemctl", verb, _NETWORKD)).output.split("\n")[0].startswith(word)

    def _end_earlier(self) -> None:
        """Roll back a change that an earlier run has left pending before another one starts."""
        pending = self.computer.load(PENDING)
        if pending is None:
            return
        is_armed = self.computer.run(("systemctl", "is-active", BACK_TIMER)).output == "active"
        if not is_armed:
            self._start_rollback()
        if self.look(pending["id"], self.desired.rollback_s + _MARGIN_S)["state"] == "pending":
            raise ModuleError(
                "an earlier network change still waits for confirmation",
                f"`systemctl status {arg(BACK)}` there shows why it was not rolled back",
            )

    def _missing(self, name: str) -> str:
        """Return what is still missing after the tool's time; record it first in case the window closes meanwhile."""
        missing = join("; ", self.desired.wait_until_reachable(self.computer, 0.0))
        if not missing:
            return ""
        with self.computer.hold_lock():
            if self._is_pending(name):
                self.computer.write(PENDING, json.dumps(pack({"id": name, "unconfirmed": missing})))
        return join("; ", self.desired.wait_until_reachable(self.computer, _SETTLED_S))

    def _start_rollback(self) -> None:
        self.computer.run(("systemctl", "start", "--no-block", BACK))

    def _is_pending(self, name: str) -> bool:
        pending = self.computer.load(PENDING)
        return pending is not None and pending["id"] == name

    def _wait_applied(self, name: str) -> bool:
        """Wait until the tool has ended; False if the change is no longer waiting."""
        end = time.monotonic() + self.desired.rollback_s
        while self._is_pending(name) and time.monotonic() < end:
            if (self.computer.load(APPLIED_PATH) or {}).get("ended_s") is not None:
                return True
            time.sleep(_PAUSE_S)
        return False

    def _keep(self, name: str) -> None:
        """Make the new configuration permanent; it is so from the moment that the pending marker is removed."""
        with self.computer.hold_lock():
            if not self._is_pending(name):
                return
            values = {"id": name, "confirmed": True, "why": "a new session has confirmed it"}
            self.computer.write(OUTCOME, json.dumps(values))
            self.computer.remove(PENDING)
        self.computer.run(("systemctl", "stop", BACK_TIMER))
        for path in (APPLIED_PATH, DESIRED_PATH, ROOM):
            self.computer.remove(path)
