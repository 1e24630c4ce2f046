"""Pinned certificates and SSH host keys: a device that shows another one is not trusted."""

from __future__ import annotations

import fcntl
import json
import os
from contextlib import contextmanager
from typing import TYPE_CHECKING

from atlantis_netcfg.core.atomic_files import open_lock, write_atomically
from atlantis_netcfg.runs import files

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_HOST_KEY = "ssh "
"""Before a device's name where its host key is kept; names have no spaces."""
_WINDOW = "window "
"""Before a device's name where is kept how many questions it bears at once."""


class Pins:
    """SHA-256 (hex) of each device's certificate, and its SSH host key (`SHA256:...`), by device name.

    Beside them stands how many questions a device bears at once, if that was found out: it goes with the certificate.
    Several processes may write at once.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def get(self, device: str) -> str | None:
        """The pinned certificate, or None where nobody has agreed to one. Raises PinsDamaged."""
        return self._read().get(device)

    def pin(self, device: str, certificate: str) -> str:
        """Pin what was not known and return what is pinned: an earlier pin stays."""
        with self._writing() as pins:
            return pins.setdefault(device, certificate)

    def change(self, device: str, certificate: str | None) -> None:
        """Trust another certificate from now on, or (None) forget the device; only on a person's word."""
        with self._writing() as pins:
            pins.pop(_WINDOW + device, None)
            if certificate is None:
                pins.pop(device, None)
            else:
                pins[device] = certificate

    def host_key(self, device: str) -> str | None:
        """The pinned SSH host key as OpenSSH prints it, or None where nobody has agreed to one. Raises PinsDamaged."""
        return self._read().get(_HOST_KEY + device)

    def change_host_key(self, device: str, host_key: str | None) -> None:
        """Trust another host key from now on, or (None) none; only on a person's word."""
        self.change(_HOST_KEY + device, host_key)

    def window(self, device: str) -> int | None:
        """How many questions the device bears at once; None: as many as it was ever asked. Raises PinsDamaged."""
        text = self._read().get(_WINDOW + device, "")
        return int(text) if text.isdecimal() else None

    def narrow(self, device: str, window: int) -> None:
        """Ask the device no more than `window` questions at once from now on."""
        with self._writing() as pins:
            pins[_WINDOW + device] = str(window)

    @contextmanager
    def _writing(self) -> Iterator[dict[str, str]]:
        with files.os_errors_as("the file of pinned certificates", self._path):
            files.make_private(self._path.parent)
            guard = open_lock(self._path.with_suffix(".lock"))
            try:
                fcntl.flock(guard, fcntl.LOCK_EX)
                before = self._read()
                pins = dict(before)
                yield pins
                if pins != before:
                    write_atomically(self._path, json.dumps(pins, indent=1, sort_keys=True).encode() + b"\n")
            finally:
                os.close(guard)

    def _read(self) -> dict[str, str]:
        try:
            data = json.loads(self._path.read_bytes())
        except FileNotFoundError:
            return {}
        except (OSError, ValueError) as error:
            raise self._damage_error() from error
        if not isinstance(data, dict) or not all(isinstance(value, str) for value in data.values()):
            raise self._damage_error()
        return data

    def _damage_error(self) -> files.DamagedPinsError:
        return files.DamagedPinsError(
            f"the file of pinned certificates cannot be read: {self._path}",
            hint="restore it from a copy; without it no device can be told from an impostor",
        )
