"""SSH host keys: shown before the password is sent, compared with the pin, written as OpenSSH writes them."""

from __future__ import annotations

import base64
import hashlib

import paramiko

from atlantis_netcfg.console._errors import HostKeyChanged, UnknownHostKey
from atlantis_netcfg.core.errors import TRUST

__all__ = ["PinnedKey", "fingerprint"]


def fingerprint(key: paramiko.PKey) -> str:
    """`SHA256:` and the unpadded base64 of the key's digest, as `ssh-keygen -l` prints it."""
    digest = base64.b64encode(hashlib.sha256(key.asbytes()).digest()).decode()
    return f"SHA256:{digest.rstrip('=')}"


class PinnedKey(paramiko.MissingHostKeyPolicy):
    """Lets one key through; paramiko asks it after the key exchange and before any authentication."""

    def __init__(self, pin: str | None) -> None:
        self._pin = pin
        self.seen: str | None = None

    def missing_host_key(self, client: paramiko.SSHClient, hostname: str, key: paramiko.PKey) -> None:  # noqa: ARG002
        """Raise UnknownHostKey without a pin, HostKeyChanged if the keys differ."""
        self.seen = fingerprint(key)
        if self._pin is None:
            raise UnknownHostKey(
                f"{hostname}: its SSH host key is not known here, so it was told no password; it showed {self.seen}",
                fingerprint=self.seen,
                hint=TRUST,
            )
        if self._pin != self.seen:
            raise HostKeyChanged(
                f"{hostname}: the SSH host key is not the one of this device; pinned is {self._pin}, "
                f"it showed {self.seen}",
                pinned=self._pin,
                seen=self.seen,
                hint="another device at this address, a reset device, or somebody in between: nothing was sent to it",
            )
