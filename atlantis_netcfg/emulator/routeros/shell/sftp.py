"""Files of the router by SFTP and SCP, the same as in `/file`; a folder is a row there, and part of names."""

from __future__ import annotations

import posixpath
import stat
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import asyncssh

from atlantis_netcfg.emulator.routeros.answers import Trap

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from atlantis_netcfg.emulator.routeros.answers import Caller
    from atlantis_netcfg.emulator.routeros.device import Device
    from atlantis_netcfg.emulator.routeros.shell._work import WorkItem
    from atlantis_netcfg.emulator.routeros.wire.link import LinkFault


class _SftpConnection(Protocol):
    @property
    def device(self) -> Device: ...

    @property
    def labour(self) -> WorkItem: ...

    @property
    def over(self) -> bool: ...

    def caller(self) -> Caller: ...

    def end_channel(self, caller: Caller) -> None: ...


@dataclass(slots=True)
class _Handle:
    name: str
    data: bytearray
    faults: list[LinkFault]
    writing: bool


class Sftp(asyncssh.SFTPServer):
    """One SFTP or SCP channel."""

    def __init__(self, chan: asyncssh.SSHServerChannel[bytes], connection: _SftpConnection) -> None:
        super().__init__(chan)
        self._channel = chan
        self._connection = connection
        self._device: Device = connection.device
        self._caller = self._connection.caller()

    def exit(self) -> None:
        """Close the channel."""
        if not self._channel.is_closing():
            self._channel.exit(0)
        self._connection.end_channel(self._caller)

    async def open(self, path: bytes, pflags: int, attrs: asyncssh.SFTPAttrs) -> _Handle:
        """Open a file for reading, or for writing from its start."""
        del attrs
        name = _normalise_path(path)
        files = self._files()
        writing = bool(pflags & asyncssh.FXF_WRITE)
        if (not writing and name not in files) or not self._is_folder(name.rpartition("/")[0]):
            raise asyncssh.SFTPNoSuchFile(f"no such file: {name}")
        faults = await self._connection.labour.begin(f"sftp {'put' if writing else 'get'} {name}")
        data = b"" if pflags & asyncssh.FXF_TRUNC else files.get(name, b"")
        if writing:
            self._store(name, data)
        return _Handle(name, bytearray(data), faults, writing)

    def read(self, file_obj: object, offset: int, size: int) -> bytes:
        """Return bytes of the file."""
        return bytes(_handle(file_obj).data[offset : offset + size])

    def write(self, file_obj: object, offset: int, data: bytes) -> int:
        """Write bytes at an offset, if the flash has room."""
        handle = _handle(file_obj)
        growth = max(0, offset + len(data) - len(handle.data))
        if growth and growth > self._device.free_space(besides=handle.name) - len(handle.data):
            raise asyncssh.SFTPNoSpaceOnFilesystem("disk full")
        handle.data.extend(bytes(max(0, offset - len(handle.data))))
        handle.data[offset : offset + len(data)] = data
        return len(data)

    async def close(self, file_obj: object) -> None:
        """Store the file; one whose name ends with `.auto.rsc` is run."""
        handle = _handle(file_obj)
        if handle.writing:
            self._store(handle.name, bytes(handle.data))
            if handle.name.endswith(".auto.rsc") and not self._connection.over:
                self._device.run_upload(self._caller, handle.name)
        await self._connection.labour.end(handle.faults)

    def stat(self, path: bytes) -> asyncssh.SFTPAttrs:
        """Return size and time."""
        name = _normalise_path(path)
        files = self._files()
        if self._is_folder(name):
            return asyncssh.SFTPAttrs(type=asyncssh.FILEXFER_TYPE_DIRECTORY, permissions=stat.S_IFDIR | 0o755, size=0)
        if name not in files:
            raise asyncssh.SFTPNoSuchFile(f"no such file: {name}")
        return _attributes(files[name])

    lstat = stat

    def fstat(self, file_obj: object) -> asyncssh.SFTPAttrs:
        """Return size and time of an open file."""
        return _attributes(bytes(_handle(file_obj).data))

    def setstat(self, path: bytes, attrs: asyncssh.SFTPAttrs) -> None:
        """Ignore times and modes."""

    def fsetstat(self, file_obj: object, attrs: asyncssh.SFTPAttrs) -> None:
        """Truncate a file; times and modes are ignored."""
        if attrs.size is not None:
            del _handle(file_obj).data[attrs.size :]

    def fsync(self, file_obj: object) -> None:
        """Do nothing: the flash is always in sync."""

    async def scandir(self, path: bytes) -> AsyncIterator[asyncssh.SFTPName]:
        """Yield the contents of a folder; the root is a folder."""
        folder, files = _normalise_path(path), self._files()
        if not self._is_folder(folder):
            raise asyncssh.SFTPNoSuchFile(f"no such file: {folder}")
        for name in sorted({*files, *self._device.folders}):
            above, _, last = name.rpartition("/")
            if above == folder:
                yield asyncssh.SFTPName(last.encode(), attrs=self.stat(name.encode()))

    def remove(self, path: bytes) -> None:
        """Delete a file."""
        name = _normalise_path(path)
        if name not in self._files() or not self._device.drop_file(name):
            raise asyncssh.SFTPNoSuchFile("no such file")

    def rename(self, oldpath: bytes, newpath: bytes) -> None:
        """Rename a file."""
        files = self._files()
        if _normalise_path(oldpath) not in files:
            raise asyncssh.SFTPNoSuchFile("no such file")
        self._store(_normalise_path(newpath), files[_normalise_path(oldpath)])
        self._device.drop_file(_normalise_path(oldpath))

    posix_rename = rename

    def realpath(self, path: bytes) -> bytes:
        """Return the absolute path; a session starts in the root."""
        return b"/" + _normalise_path(path).encode()

    def mkdir(self, path: bytes, attrs: asyncssh.SFTPAttrs) -> None:
        """Create a folder in an existing folder."""
        del attrs
        name = _normalise_path(path)
        files = self._files()
        if name in files or self._is_folder(name) or not self._is_folder(name.rpartition("/")[0]):
            raise asyncssh.SFTPFailure(f"cannot make {name}")
        try:
            self._device.make_folder(self._caller, name)
        except Trap as refused:
            raise asyncssh.SFTPPermissionDenied(refused.message) from refused

    def rmdir(self, path: bytes) -> None:
        """Delete an empty folder."""
        name = _normalise_path(path)
        if any(other.startswith(f"{name}/") for other in (*self._files(), *self._device.folders)):
            raise asyncssh.SFTPFailure(f"{name} is not empty")
        if name not in self._device.folders or not self._device.drop_file(name):
            raise asyncssh.SFTPNoSuchFile(f"no such file: {name}")

    def _is_folder(self, name: str) -> bool:
        return not name or name in self._device.folders

    def _files(self) -> dict[str, bytes]:
        try:
            return self._device.file_data(self._caller)
        except Trap as refused:
            raise asyncssh.SFTPPermissionDenied(refused.message) from refused

    def _store(self, name: str, data: bytes) -> None:
        try:
            self._device.store_file(self._caller, name, data)
        except Trap as refused:
            raise asyncssh.SFTPNoSpaceOnFilesystem(refused.message) from refused


def _normalise_path(path: bytes) -> str:
    text = path.decode(errors="surrogateescape")
    return posixpath.normpath(f"/{text}").strip("/")


def _handle(file_obj: object) -> _Handle:
    if not isinstance(file_obj, _Handle):
        raise asyncssh.SFTPFailure("not a file of ours")
    return file_obj


def _attributes(data: bytes) -> asyncssh.SFTPAttrs:
    now = int(time.time())
    kind, mode = asyncssh.FILEXFER_TYPE_REGULAR, stat.S_IFREG | 0o644
    return asyncssh.SFTPAttrs(type=kind, size=len(data), permissions=mode, atime=now, mtime=now)
