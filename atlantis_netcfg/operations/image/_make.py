"""Make the image of a host, and put it on a card or into a file."""

from __future__ import annotations

import os
import re
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core import temporary
from atlantis_netcfg.core.errors import DeviceFailed, UsageError
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.image import (
    Card,
    Expanded,
    ImageRefused,
    Kind,
    Meter,
    Progress,
    Step,
    Written,
    checksum,
    customise,
    expand,
    segments,
    write,
)
from atlantis_netcfg.image.ext4 import PROGRAMS, require
from atlantis_netcfg.operations.image._receipt import Receipt, image_told
from atlantis_netcfg.operations.image._wish import layout_of, wish_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.declaration import Declaration, Host

__all__ = ["Made", "Order", "made"]

_STAGES = {
    Step.UNPACKING: Stage.OBSERVED,
    Step.CLEARING: Stage.APPLYING,
    Step.WRITING: Stage.APPLYING,
    Step.COMPARING: Stage.VERIFYING,
}


class Stopped(DeviceFailed):
    """Somebody stopped the work before a card was touched."""


@dataclass(frozen=True, slots=True)
class Order:
    """Whose image is made, and from which file."""

    declaration: Declaration
    host: Host
    image: Path
    sha256: str | None
    """As a person has typed it; None: what lies beside the image, if anything."""
    state: Path

    def check(self) -> None:
        """Refuse what can be known before the long work. Raises UsageError."""
        layout_of(self.host)
        if not self.image.is_file():
            raise ImageRefused(f"{self.image} is no file", hint="`from=` names the vendor's image, like x.img.xz")
        checksum(self.image, self.sha256)
        require(*PROGRAMS)


@dataclass(frozen=True, slots=True)
class Made:
    """The host's image as a working copy, which ends with the context."""

    order: Order
    expanded: Expanded
    notes: tuple[str, ...]
    """What a person should know."""
    notify: Subscriber

    def onto(self, card: Card) -> tuple[Written, Path]:
        """Write it; return what was read back, and where that is on record. Raises DeviceRefused, CardUnfinished."""
        order = self.order
        size = -(-self.expanded.size // card.shown.sector) * card.shown.sector
        card.still(size)
        values = image_told(order.image.name, self.expanded)
        receipt = Receipt.of(order.state, order.declaration, order.host, values)
        parts = segments(self.expanded.path, size, self.expanded.mapped)
        with receipt.writing(card.shown):
            written = write(self.expanded.path, parts, card, self._tell)
        receipt.written(written)
        return written, receipt.path

    def into(self, file: Path) -> int:
        """Keep it as a file, which appears whole or not at all; return its size. Raises UsageError."""
        try:
            with temporary.folder("image", file.parent) as scratch:
                whole = scratch / file.name
                with self.expanded.path.open("rb") as copy, whole.open("xb") as out:
                    for part in segments(self.expanded.path, self.expanded.size):
                        if part.kind is Kind.DATA:
                            _copy(copy.fileno(), out.fileno(), part.start, part.size)
                    out.truncate(self.expanded.size)
                    os.fsync(out.fileno())
                file.hardlink_to(whole)
        except FileExistsError:
            raise UsageError(f"{file} is there already", hint="name a new file, or remove that one") from None
        except OSError as error:
            raise UsageError(f"{file} cannot be written: {error.strerror}") from error
        return self.expanded.size

    def _tell(self, progress: Progress) -> None:
        self.notify(_event(self.order.host.name, progress))


@contextmanager
def made(order: Order, notify: Subscriber) -> Iterator[Made]:
    """Unpack the vendor's image and make it the host's. Raises ImageRefused, Stopped; no card is touched."""
    place = temporary.roomy()
    if not re.fullmatch(r"[A-Za-z0-9._/+-]+", str(place)):
        raise UsageError(f"no work can be done in {place}", hint="TMPDIR: a directory without blanks in its name")
    name = order.host.name
    with temporary.folder("image", place) as folder:
        try:
            ready = _make(order, folder, notify)
        except KeyboardInterrupt as error:
            raise Stopped(f"stopped while the image of {name} was made: no card was touched") from error
        yield ready


def _make(order: Order, folder: Path, notify: Subscriber) -> Made:
    name = order.host.name
    meter = Meter(Step.UNPACKING, lambda progress: notify(_event(name, progress)))
    expanded = expand(order.image, folder / "image", checksum(order.image, order.sha256), meter)
    source = f"{order.image.name}, SHA-256 {expanded.sha256}"
    notes = customise(expanded.path, layout_of(order.host), wish_of(order.declaration, order.host, source))
    notify(Event(name, Stage.PLANNED, "customised, and every change read back"))
    if not expanded.told_by:
        notes = (f"nobody has confirmed the checksum of {order.image.name}: {expanded.sha256}", *notes)
    return Made(order, expanded, notes, notify)


def _event(name: str, progress: Progress) -> Event:
    data = {"done": progress.done, "total": progress.total, "rate_bps": progress.rate_bps, "left_s": progress.left_s}
    return Event(name, _STAGES[progress.step], progress.words, data=data)


def _copy(source: int, target: int, start: int, size: int) -> None:
    end = start + size
    while start < end:
        data = os.pread(source, min(2**20, end - start), start)
        if not data:
            return
        start += os.pwrite(target, data, start)
