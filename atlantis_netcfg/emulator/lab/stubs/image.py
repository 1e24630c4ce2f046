"""A stub container image: the machine's own Python, with the stub of a service.

The module also sets what podman lacks in a lab machine, which real computers do not get.
"""

from __future__ import annotations

import hashlib
import io
import json
import platform
import tarfile
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.lab.stubs.archive import StubError, service_program

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

PODMAN_IN_A_MACHINE: Mapping[str, str] = {
    "/etc/containers/storage.conf": '[storage]\ndriver = "vfs"\nrunroot = "/run/containers/storage"\n'
    'graphroot = "/var/lib/containers/storage"\n',
    "/etc/containers/containers.conf": "[containers]\nkeyring = false\n",
}
"""Podman settings: no overlay on the machine's overlay disk, and no keyring, which systemd-nspawn does not allow."""
NOT_REHEARSED = (
    "containers: the images are placeholders that only listen at the inventory's ports",
    "containers: podman stores them as plain folders (vfs), and creates no keyring for them",
)
_ARCHITECTURES = {"x86_64": "amd64", "aarch64": "arm64"}
_STANDARD_LIBRARY = ("collections", "encodings", "importlib", "lib-dynload", "re")
_LIBRARIES = ("libc", "libdl", "libexpat", "libm", "libpthread", "libutil", "libz")
_END = "import os, signal\nsignal.signal(signal.SIGTERM, lambda *_: os._exit(0))\n"
"""Handler for SIGTERM: process 1 of a container receives only signals that it has a handler for."""


def service_image(root: Path, kind: str, port: int) -> bytes:
    """Return an archive as `docker save` writes it; same Debian in `root`, same bytes. Raises StubError."""
    python = next((path for path in sorted(root.glob("usr/bin/python3.*")) if path.name[8:].isdigit()), None)
    if python is None:
        raise StubError(f"{root} has no Python for the stand-in of an image")
    files = {path: (root / path).read_bytes() for path in _of_python(root, python)}
    files["stand-in.py"] = (_END + service_program(kind, port)).encode()
    layer = _tar(files)
    digest = hashlib.sha256(layer).hexdigest()
    config = json.dumps(
        {
            "architecture": _ARCHITECTURES.get(platform.machine(), platform.machine()),
            "os": "linux",
            "config": {"Entrypoint": [f"/usr/bin/{python.name}", "-S", "-I", "/stand-in.py"]},
            "rootfs": {"type": "layers", "diff_ids": [f"sha256:{digest}"]},
        }
    ).encode()
    name = f"{hashlib.sha256(config).hexdigest()}.json"
    layers = [f"{digest}/layer.tar"]
    manifest = json.dumps([{"Config": name, "RepoTags": ["example.org/stand-in:rehearsal"], "Layers": layers}])
    return _tar({name: config, layers[0]: layer, "manifest.json": manifest.encode()})


def _of_python(root: Path, python: Path) -> Iterator[str]:
    """Yield the paths that Python needs to open a socket."""
    files = {python}
    home = root / "usr/lib" / python.name
    files |= set(home.glob("*.py"))
    for folder in _STANDARD_LIBRARY:
        files |= {path for path in (home / folder).rglob("*") if path.suffix in {".py", ".so"}}
    for place in (*root.glob("usr/lib/*-linux-gnu*"), root / "usr/lib64", root / "usr/lib"):
        files |= {path for name in _LIBRARIES for path in place.glob(f"{name}.so.*")}
        files |= set(place.glob("ld-linux*.so.*"))
    yield from sorted(path.relative_to(root).as_posix() for path in files if path.is_file())


def _tar(files: Mapping[str, bytes]) -> bytes:
    """Pack files reproducibly, without times and owners. `/lib` is a link to `/usr/lib`, as in Debian."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        if "stand-in.py" in files:
            for name in ("lib", "lib64", "bin"):
                link = tarfile.TarInfo(name)
                link.type, link.linkname = tarfile.SYMTYPE, f"usr/{name}"
                archive.addfile(link)
        for name, data in files.items():
            member = tarfile.TarInfo(name)
            member.size, member.mode = len(data), 0o755
            archive.addfile(member, io.BytesIO(data))
    return buffer.getvalue()
