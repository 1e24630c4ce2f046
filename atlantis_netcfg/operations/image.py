"""Images of gateway computers: from the inventory to an image on a card or in a file, with a record.

The record is `<state>/real/<site>/images/<UTC time>-<host>.json`, one file per card. It is on disk before the first
byte is written, with `outcome` `writing`: if that remains, the card was interrupted and does not boot. It has no
secret.
"""

from __future__ import annotations

import json
import os
import re
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from ipaddress import IPv4Interface
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import __version__
from atlantis_netcfg.computers.image import ext4, facts, writer
from atlantis_netcfg.computers.image.plan import customise
from atlantis_netcfg.computers.image.source import SourceKind, UnpackedImage, checksum, expand, segments
from atlantis_netcfg.core import errors, events, paths, temporary
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.runs import Store, write_atomically

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from atlantis_netcfg.computers.image.blocks import BlockDevice
    from atlantis_netcfg.inventory import Host, Inventory


@dataclass(slots=True)
class Receipt:
    """A record file, rewritten at each step."""

    path: Path
    content: dict[str, Any]

    @classmethod
    def of(cls, state: Path, inventory: Inventory, host: Host, image: Mapping[str, str]) -> Receipt:
        """Return a receipt that is not yet on disk."""
        began = datetime.now(UTC)
        folder = paths.private_directory(Store(state).root / host.site / "images")
        path = folder / f"{began:%Y%m%dT%H%M%S.%fZ}-{host.name}.json"
        about = {"host": host.name, "site": host.site, "revision": inventory.revision, "tool": __version__}
        return cls(path, {**about, "image": dict(image), "began": began.isoformat()})

    @contextmanager
    def writing(self, disk: BlockDevice) -> Iterator[None]:
        """Record the start of writing and, if it fails, the error."""
        values = {"name": disk.name, "label": disk.label, "serial": disk.serial, "size": disk.size, "bus": disk.bus}
        self._save(device=values, outcome="writing")
        try:
            yield
        except errors.NetcfgError as error:
            self._save(outcome="failed", message=str(error), ended=datetime.now(UTC).isoformat())
            raise

    def write_result(self, card: writer.WrittenCard) -> None:
        """Record the result of reading the card back."""
        counts = {
            "data": card.data,
            "cleared": card.cleared,
            "skipped": card.skipped,
            "compared": card.compared,
            "seconds": round(card.seconds, 3),
        }
        self._save(outcome="written", bytes=counts, ended=datetime.now(UTC).isoformat())

    def _save(self, **more: object) -> None:
        self.content |= more
        write_atomically(self.path, f"{json.dumps(self.content, indent=1, ensure_ascii=False)}\n".encode())


def image_told(name: str, image: UnpackedImage) -> dict[str, str]:
    """Return the vendor's file as data for a receipt."""
    return {"name": name, "sha256": image.sha256, "confirmed_by": image.told_by or "nobody"}


def _image_of(host: Host) -> tuple[model.SiteComputer, model.Image]:
    device = host.device
    if not isinstance(device, model.SiteComputer):
        raise errors.UsageError(
            f"`{arg(host.name)}` is a {arg(device.kind.replace('_', ' '))}; cards are only for gateways, control "
            "centres and operator stations",
            hint="give a host of group `gateways`, `control_centres` or `operator_stations`",
        )
    if device.image is None:
        raise errors.UsageError(
            f"host_vars/{arg(host.name)}.yml has no image settings for `{arg(host.name)}`",
            hint="add `image: {layout: odroid-n2, ssh_keys: [ssh-ed25519 …]}` to its `device`",
        )
    return device, device.image


def layout_of(host: Host) -> ext4.DiskLayout:
    """Return the disk layout of the host's image; raise UsageError for a host without an image."""
    return ext4.LAYOUTS[_image_of(host)[1].layout]


def wish_of(inventory: Inventory, host: Host, source: str) -> facts.ImageRequest:
    """Return the customisation of the host's image; `source` names the vendor's file. Raise UsageError."""
    device, image = _image_of(host)
    lan, pilot = inventory.sites[host.site].lan, inventory.pilot
    static = None
    if image.address_by is model.AddressBy.STATIC:
        address = IPv4Interface(f"{device.address}/{lan.network.prefixlen}")
        static = facts.StaticNetwork(address, lan.gateway, lan.domain)
    return facts.ImageRequest(
        host=host.name,
        site=host.site,
        user=image.user,
        keys=image.ssh_keys,
        static=static,
        interface=image.interface or ext4.LAYOUTS[image.layout].interface,
        time_zone=pilot.time_zone,
        time_servers=tuple(server.address for server in pilot.time_servers),
        source=source,
    )


_STAGES = {
    writer.WriterStep.UNPACKING: events.Stage.OBSERVED,
    writer.WriterStep.CLEARING: events.Stage.APPLYING,
    writer.WriterStep.WRITING: events.Stage.APPLYING,
    writer.WriterStep.COMPARING: events.Stage.VERIFYING,
}


class ImageInterruptError(errors.DeviceError):
    """The work was interrupted before a card was touched."""


@dataclass(frozen=True, slots=True)
class ImageOrder:
    """An order for a host's image, made from the vendor's file."""

    inventory: Inventory
    host: Host
    image: Path
    sha256: str | None
    """SHA-256 as typed by a person; None: taken from a file beside the image, if there is one."""
    state: Path

    def check(self) -> None:
        """Check everything possible before the long work; raise UsageError."""
        layout_of(self.host)
        if not self.image.is_file():
            raise facts.ImageError(
                f"{arg(self.image)} is not a file", hint="`from=` takes the vendor's image, like x.img.xz"
            )
        checksum(self.image, self.sha256)
        ext4.require_tools(*ext4.PROGRAMS)


@dataclass(frozen=True, slots=True)
class MadeImage:
    """A working copy of the host's image, deleted at the end of the context."""

    order: ImageOrder
    image: UnpackedImage
    notes: tuple[str, ...]
    """Notes for the person."""
    notify: events.Subscriber

    def write_to_card(self, card: writer.Card) -> tuple[writer.WrittenCard, Path]:
        """Write the image to a card; return verified result and record path. Raise BlockDeviceError, CardWriteError."""
        order = self.order
        size = -(-self.image.size // card.disk.sector) * card.disk.sector
        card.require_unchanged(size)
        values = image_told(order.image.name, self.image)
        receipt = Receipt.of(order.state, order.inventory, order.host, values)
        parts = segments(self.image.path, size, self.image.spans)
        with receipt.writing(card.disk):
            result = writer.write(self.image.path, parts, card, self._tell)
        receipt.write_result(result)
        return result, receipt.path

    def save_as_file(self, file: Path) -> int:
        """Save the image as a file, atomically; return its size. Raise UsageError."""
        try:
            with temporary.folder("image", file.parent) as scratch:
                whole = scratch / file.name
                with self.image.path.open("rb") as copy, whole.open("xb") as out:
                    for part in segments(self.image.path, self.image.size):
                        if part.kind is SourceKind.DATA:
                            _copy(copy.fileno(), out.fileno(), part.start, part.size)
                    out.truncate(self.image.size)
                    os.fsync(out.fileno())
                file.hardlink_to(whole)
        except FileExistsError:
            raise errors.UsageError(
                f"{arg(file)} already exists", hint="give a new file name, or remove the existing file"
            ) from None
        except OSError as error:
            raise errors.UsageError(f"cannot write {arg(file)}: {arg(error.strerror)}") from error
        return self.image.size

    def _tell(self, progress: writer.Progress) -> None:
        self.notify(_event(self.order.host.name, progress))


@contextmanager
def prepare_image(order: ImageOrder, notify: events.Subscriber) -> Iterator[MadeImage]:
    """Unpack and customise the vendor's image; raise ImageError or ImageInterruptError. No card is touched."""
    place = temporary.large_temp_dir()
    if not re.fullmatch(r"[A-Za-z0-9._/+-]+", str(place)):
        raise errors.UsageError(
            f"cannot use {arg(place)} as working directory", hint="set TMPDIR: a directory without spaces in its name"
        )
    name = order.host.name
    with temporary.folder("image", place) as folder:
        try:
            ready = _make(order, folder, notify)
        except KeyboardInterrupt as error:
            raise ImageInterruptError(
                f"interrupted while the image of {arg(name)} was being made: no card was written"
            ) from error
        yield ready


def _make(order: ImageOrder, folder: Path, notify: events.Subscriber) -> MadeImage:
    name = order.host.name
    meter = writer.WriteMeter(writer.WriterStep.UNPACKING, lambda progress: notify(_event(name, progress)))
    image = expand(order.image, folder / "image", checksum(order.image, order.sha256), meter)
    source = f"{order.image.name}, SHA-256 {image.sha256}"
    notes = customise(image.path, layout_of(order.host), wish_of(order.inventory, order.host, source))
    notify(events.Event(name, events.Stage.PLANNED, "customised, and every change read back"))
    if not image.told_by:
        notes = (msg(f"the checksum of {arg(order.image.name)} was not confirmed: {arg(image.sha256)}"), *notes)
    return MadeImage(order, image, notes, notify)


def _event(name: str, progress: writer.Progress) -> events.Event:
    data = {
        "done": progress.done_bytes,
        "total": progress.total,
        "rate_bps": progress.rate_bps,
        "left_s": progress.left_s,
    }
    return events.Event(name, _STAGES[progress.step], progress.words, data=data)


def _copy(source: int, target: int, start: int, size: int) -> None:
    end = start + size
    while start < end:
        data = os.pread(source, min(2**20, end - start), start)
        if not data:
            return
        start += os.pwrite(target, data, start)
