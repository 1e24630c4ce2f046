"""Files of a device for transfers: bytes by name, limited disk size, rights."""

from __future__ import annotations

import hashlib
import json
import os
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.eventlog import write_all
from atlantis_netcfg.core.paths import write_private
from atlantis_netcfg.emulator.routeros import answers
from atlantis_netcfg.emulator.routeros.console.run import run_file
from atlantis_netcfg.emulator.routeros.core import Core, FlashFile
from atlantis_netcfg.emulator.routeros.wire.tls import certificate

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path


class FileSide:
    """SFTP functions of `Device`. Transfers need the policy `ftp` (Manual, User). Assumption: sftp-policy."""

    _core: Core

    def tick(self) -> None:
        """Process everything that is due."""
        raise NotImplementedError

    def file_data(self, caller: answers.Caller) -> dict[str, bytes]:
        """Return all files. Raises Trap without permission."""
        self.tick()
        if not {"ftp", "read"} <= self._core.policies(caller):
            raise answers.Trap("not enough permissions (9)")
        return {
            name: file.contents.encode(errors="surrogateescape")
            for name, file in self._core.files.items()
            if not file.folder
        }

    @property
    def folders(self) -> frozenset[str]:
        """All folders except the root."""
        return frozenset(name for name, file in self._core.files.items() if file.folder)

    def make_folder(self, caller: answers.Caller, name: str) -> None:
        """Create an empty folder. Raises Trap."""
        if not {"ftp", "write"} <= self._core.policies(caller):
            raise answers.Trap("not enough permissions (9)")
        self._core.files[name] = FlashFile(self._core.number(), "", self._core.stamp(), folder=True)

    def free_space(self, *, besides: str = "") -> int:
        """Return the bytes free for a file that replaces `besides`."""
        return self._core.free_space(besides=besides)

    def store_file(self, caller: answers.Caller, name: str, data: bytes) -> None:
        """Write or overwrite a file. Raises Trap."""
        core = self._core
        if not {"ftp", "write"} <= core.policies(caller):
            raise answers.Trap("not enough permissions (9)")
        if len(data) > self.free_space(besides=name):
            raise answers.Trap(answers.DISK_FULL)
        number = core.files[name].number if name in core.files else core.number()
        core.files[name] = FlashFile(number, data.decode(errors="surrogateescape"), core.stamp())

    def drop_file(self, name: str) -> bool:
        """Delete a file; return False if it does not exist."""
        return self._core.files.pop(name, None) is not None

    def run_upload(self, caller: answers.Caller, name: str) -> None:
        """Run a file whose name ends with `.auto.rsc`, and write an `.auto.log` (Manual, Configuration Management)."""
        core = self._core
        outcome = run_file(core, caller, core.files[name].contents)
        report = name.removesuffix(".rsc") + ".log"
        self.store_file(
            caller, report, (outcome.output + "\n" if outcome.output else "").encode(errors="surrogateescape")
        )


_FIRST_ROOM = 65_536
"""Minimum bytes of appended lines before the file is replaced.

A file replaced at double its size is written twice in all.
"""


def _replay(tables: dict[str, list[list[Any]]], menu: str, number: int, position: int | None, rest: list[Any]) -> None:
    rows = tables.setdefault(menu, [])
    rows[:] = [row for row in rows if row[0] != number]
    if position is not None:
        rows.insert(position, [number, *rest])


class Flash:
    """State directory of one emulated router, readable only by its owner."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file = folder / "flash.json"
        self._beside: dict[str, Any] = {}
        self._counters: Mapping[str, int] = {}
        self._room = 0

    def load(self) -> dict[str, Any] | None:
        """Return the last saved state, or None on the first start."""
        if not self._file.exists():
            return None
        first, *lines = self._file.read_text(encoding="utf-8").split("\n")
        state: dict[str, Any] = json.loads(first)
        for line in lines[:-1]:  # behind the last end of a line a killed process may have left a part of one
            beside, changes, counters = json.loads(line)
            state |= beside
            state["configuration"]["counters"] |= counters
            for change in changes:
                _replay(state["configuration"]["tables"], *change)
        return state

    def save(self, snapshot: dict[str, Any], beside: dict[str, Any]) -> None:
        """Replace the file atomically; `beside` is the snapshot's data other than rows."""
        data = json.dumps(snapshot).encode() + b"\n"
        write_private(self._file, data)
        self._beside, self._counters = beside, snapshot["configuration"]["counters"]
        self._room = max(len(data), _FIRST_ROOM)

    def extend(self, beside: dict[str, Any], changes: Sequence[Sequence[Any]], counters: Mapping[str, int]) -> bool:
        """Append changes as one line; return False if the file has grown too long and must be replaced."""
        new = {name: value for name, value in beside.items() if value != self._beside.get(name)}
        new_counters = {name: number for name, number in counters.items() if number != self._counters.get(name)}
        if not new and not changes and not new_counters:
            return True
        data = json.dumps([new, changes, new_counters]).encode() + b"\n"
        self._room -= len(data)
        if self._room < 0:
            return False
        handle = os.open(self._file, os.O_WRONLY | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            write_all(handle, data)
        finally:
            os.close(handle)
        self._beside, self._counters = beside, dict(counters)
        return True

    def certificate(self, name: str, *, common_name: str, address: str) -> Path:
        """Return the PEM file of the certificate `name`."""
        return certificate(self._folder / "certificates", name, common_name=common_name, address=address)

    def keep(self, pem: str) -> Path:
        """Write a file with this key and certificate, unless it exists; return its path."""
        path = self._folder / "certificates" / f"{hashlib.sha256(pem.encode()).hexdigest()[:16]}.used.pem"
        if not path.exists():
            write_private(path, pem.encode())
        return path

    @property
    def host_key(self) -> Path:
        """Path of the SSH host key, which may not exist yet."""
        return self._folder / "host-key"

    def forget_host_key(self) -> None:
        """Delete the SSH host key, as a reset does; the next connection gets a new one."""
        self.host_key.unlink(missing_ok=True)

    def forget_certificates(self) -> None:
        """Delete the certificates, as a reset does; the next connection gets new keys."""
        for file in (self._folder / "certificates").glob("*.pem"):
            file.unlink()
