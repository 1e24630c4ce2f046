"""The SSH host key of a twin: made when it is first needed, kept on its flash.

It is Ed25519, which is quickly made; a device has an RSA key unless `/ip/ssh host-key-type` says otherwise.
"""

from __future__ import annotations

import base64
import hashlib
from typing import TYPE_CHECKING

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_ssh_private_key,
)

from atlantis_netcfg.emulator.routeros.wire import host as private

if TYPE_CHECKING:
    from pathlib import Path


def host_key(path: Path) -> bytes:
    """The private key in OpenSSH's format."""
    if not path.exists():
        key = Ed25519PrivateKey.generate()
        private.write(path, key.private_bytes(Encoding.PEM, PrivateFormat.OpenSSH, NoEncryption()))
    return path.read_bytes()


def fingerprint(path: Path) -> str:
    """`SHA256:...`, as `ssh-keygen -l` prints it."""
    key = load_ssh_private_key(host_key(path), None).public_key()
    blob = base64.b64decode(key.public_bytes(Encoding.OpenSSH, PublicFormat.OpenSSH).split()[1])
    return "SHA256:" + base64.b64encode(hashlib.sha256(blob).digest()).decode().rstrip("=")
