"""Pinned certificates and SSH host keys: a device that shows another one is not trusted."""

from __future__ import annotations

import fcntl
import json
import os
from contextlib import contextmanager
from typing import TYPE_CHECKING

from atlantis_netcfg.core.atomic_files import open_lock, write_atomically
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.runs import files

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_HOST_KEY = "ssh "
"""Prefix of a device's name for its host key; names contain no spaces."""
_WINDOW = "window "
"""Prefix of a device's name for the number of parallel requests that it supports."""


class Pins:
    """SHA-256 (hex) of each device's certificate, and its SSH host key (`SHA256:...`), by device name.

    Also the number of parallel requests that a device supports, if known; it is dropped with the certificate. Several
    processes may write at once.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def get(self, device: str) -> str | None:
        """Return the pinned certificate, None if nobody has confirmed one. Raises DamagedPinsError."""
        return self._read().get(device)

    def pin(self, device: str, certificate: str) -> str:
        """Pin an unknown certificate and return the pinned one; an earlier pin is kept."""
        with self._edit_pins() as pins:
            return pins.setdefault(device, certificate)

    def change(self, device: str, certificate: str | None) -> None:
        """Replace the certificate, or (None) forget the device; only after confirmation by the user."""
        with self._edit_pins() as pins:
            pins.pop(_WINDOW + device, None)
            if certificate is None:
                pins.pop(device, None)
            else:
                pins[device] = certificate

    def host_key(self, device: str) -> str | None:
        """Return the pinned SSH host key in OpenSSH's format, None if not confirmed. Raises DamagedPinsError."""
        return self._read().get(_HOST_KEY + device)

    def change_host_key(self, device: str, host_key: str | None) -> None:
        """Replace the host key, or (None) remove it; only after confirmation by the user."""
        self.change(_HOST_KEY + device, host_key)

    def window(self, device: str) -> int | None:
        """Return the number of parallel requests the device supports; None if unlimited. Raises DamagedPinsError."""
        text = self._read().get(_WINDOW + device, "")
        return int(text) if text.isdecimal() else None

    def narrow(self, device: str, window: int) -> None:
        """Limit the device to `window` parallel requests from now on."""
        with self._edit_pins() as pins:
            pins[_WINDOW + device] = str(window)

    @contextmanager
    def _edit_pins(self) -> Iterator[dict[str, str]]:
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
            f"the file of pinned certificates cannot be read: {arg(self._path)}",
            hint="restore it from a copy; without it no device can be told from an impostor",
        )
