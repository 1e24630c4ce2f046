"""What is on a host already: its dpkg status from a file, out of the vendor's image, or from the board itself."""

from __future__ import annotations

import gzip
import shlex
import zlib
from typing import TYPE_CHECKING

from atlantis_netcfg.bundle import BundleRefused, Target, read_target
from atlantis_netcfg.bundle.programs import run
from atlantis_netcfg.core import temporary
from atlantis_netcfg.declaration.model import Gateway, ImageLayout
from atlantis_netcfg.image import LAYOUTS, ImageRefused, checksum, expand
from atlantis_netcfg.image.ext4 import Ext4, require
from atlantis_netcfg.image.layouts import find
from atlantis_netcfg.operations.computers._access import key_trouble
from atlantis_netcfg.operations.computers.parts import ACCESS, PARTS

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.request import Request

__all__ = ["from_board", "from_file", "from_image"]

_STATUS = "/var/lib/dpkg/status"
_ASKED = f"gzip -9c {_STATUS}"


def from_file(path: Path) -> Target:
    """Read a copy of /var/lib/dpkg/status. Raises BundleRefused."""
    try:
        status = path.read_bytes()
    except OSError as error:
        raise BundleRefused(
            f"{path} cannot be read: {error.strerror or error}", hint=f"`status=` names a copy of the board's {_STATUS}"
        ) from error
    return read_target(status, str(path))


def from_image(host: Host, image: Path, tell: Callable[[int, int], None]) -> Target:
    """Read it out of the vendor's image that the host's card is made of. Raises BundleRefused, ImageRefused."""
    if not image.is_file():
        raise ImageRefused(f"{image} is no file", hint="`image=` names the vendor's image, like x.img.xz")
    require("e2fsck", "debugfs")
    device = host.device
    declared = device.image.layout if isinstance(device, Gateway) and device.image is not None else ImageLayout.PLAIN
    with temporary.folder("bundle", temporary.roomy()) as folder:
        copy = folder / "image"
        expand(image, copy, checksum(image), tell)
        root = Ext4(copy, find(copy, LAYOUTS[declared]).root)
        root.recover()
        status = root.read(_STATUS)
    if status is None:
        raise BundleRefused(f"{image} holds no {_STATUS}", hint="bundles are made for Debian and Ubuntu")
    return read_target(status, image.name)


def from_board(declaration: Declaration, host: Host, request: Request) -> Target:
    """Ask the board itself, by SSH. Raises BundleRefused; nothing is asked over a link that is paid by the byte."""
    access = PARTS[ACCESS](declaration, host, request)
    others = "`status=FILE` (a copy of its /var/lib/dpkg/status) or `image=FILE` says what is on it"
    if access.get("metered"):
        raise BundleRefused(f"{host.name} is reached over {access['metered']}, which is paid by the byte", hint=others)
    options = ["-o", "BatchMode=yes", "-o", "ConnectTimeout=120", "-p", str(access["port"])]
    words = [*options, *shlex.split(access["ssh_args"]), f"{access['user']}@{access['host']}", _ASKED]
    done = run(["ssh", *words])
    if done.returncode != 0:
        text = done.stderr.decode(errors="replace").strip()
        why, hint = key_trouble(host.name, text) or (text.splitlines()[-1] if text else "no word", others)
        raise BundleRefused(f"{host.name} was asked what is installed on it, and did not answer: {why}", hint=hint)
    try:
        status = gzip.decompress(done.stdout)
    except (OSError, EOFError, zlib.error) as error:
        raise BundleRefused(f"{host.name}: its answer was cut off", hint="type the same again") from error
    return read_target(status, f"{host.name}:{_STATUS}")
