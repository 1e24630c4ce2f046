"""Package files as MikroTik's are built, with nothing in them that a device would run."""

import struct
from pathlib import Path

from atlantis_netcfg.core.versions import Version

MAGIC = bytes.fromhex("1ef1d0ba")
PAYLOAD = 21


def part(kind: int, body: bytes) -> bytes:
    return struct.pack("<HI", kind, len(body)) + body


def info(name: str, version: Version, kind: int = 1) -> bytes:
    head = struct.pack("<16sBBBB", name.encode(), version.patch, ord("f"), version.minor, version.major)
    return part(kind, head + struct.pack("<I", 1_700_000_000) + bytes(11))


def contents(name: str, version: str, architecture: str, *, payload: int = 2000) -> bytes:
    inside = "system" if name == "routeros" else name
    body = info(inside, Version.parse(version)) + part(16, architecture.encode())
    body += part(2, b"for tests only") + part(PAYLOAD, b"\xa5" * payload)
    return MAGIC + struct.pack("<I", len(body)) + body


def write(folder: Path, name: str, version: str, architecture: str, *, payload: int = 2000) -> Path:
    path = folder / f"{name}-{version}-{architecture}.npk"
    path.write_bytes(contents(name, version, architecture, payload=payload))
    return path
