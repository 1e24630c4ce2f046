"""What survives a power cut: the configuration as one JSON file in the state directory, certificates beside it."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.emulator.routeros.wire import private
from atlantis_netcfg.emulator.routeros.wire.tls import certificate

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Flash"]


class Flash:
    """The state directory of one twin; nobody but its owner may read it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file = folder / "flash.json"
        self._written: str | None = None

    def load(self) -> dict[str, Any] | None:
        """What was saved last, or None on the first start."""
        if not self._file.exists():
            return None
        loaded: dict[str, Any] = json.loads(self._file.read_text(encoding="utf-8"))
        return loaded

    def save(self, snapshot: dict[str, Any]) -> None:
        """Replace the file atomically, if there is anything new."""
        text = json.dumps(snapshot)
        if text == self._written:
            return
        private.write(self._file, text.encode())
        self._written = text

    def certificate(self, name: str, *, common_name: str, address: str) -> Path:
        """PEM file of the certificate that the router calls `name`."""
        return certificate(self._folder / "certificates", name, common_name=common_name, address=address)

    def keep(self, pem: str) -> Path:
        """A file with this key and certificate."""
        path = self._folder / "certificates" / f"{hashlib.sha256(pem.encode()).hexdigest()[:16]}.used.pem"
        if not path.exists():
            private.write(path, pem.encode())
        return path

    @property
    def host_key(self) -> Path:
        """Where the SSH host key lies; it may have to be made first."""
        return self._folder / "host-key"

    def forget_host_key(self) -> None:
        """Let the next connection find a new SSH host key, as after a reset of the router."""
        self.host_key.unlink(missing_ok=True)

    def forget_certificates(self) -> None:
        """Let the next connection find new keys, as after a reset of the router."""
        for file in (self._folder / "certificates").glob("*.pem"):
            file.unlink()
