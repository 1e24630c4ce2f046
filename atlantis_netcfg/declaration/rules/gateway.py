"""The gateway computer: what its image needs from the rest of the declaration."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration.model import AddressBy, Gateway

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration.findings import Finding

__all__ = ["RULES"]


def way_in(draft: Draft) -> Iterator[Finding]:
    """Every password is removed from an image, so that without a key nobody could log in."""
    for host, _, device in draft.boxes(Gateway):
        if device.image is not None and not device.image.ssh_keys:
            message = f"nobody could log in to `{host}`: its image has no SSH key, and no password stays in it"
            hint = "write the technicians' public keys, one a line"
            yield draft.wrong(Part("device", host), ("image", "ssh_keys"), message, hint)


def keys_once(draft: Draft) -> Iterator[Finding]:
    """A technician's key stands once: who takes it back must not overlook a second line."""
    for host, _, device in draft.boxes(Gateway):
        seen: dict[str, int] = {}
        for index, key in enumerate(device.image.ssh_keys if device.image else ()):
            body = key.split(" ")[1]
            first = seen.setdefault(body, index)
            if first != index:
                line = draft.mark(Part("device", host), "image", "ssh_keys", first).line
                message = f"this key stands twice, first in line {line}"
                yield draft.wrong(Part("device", host), ("image", "ssh_keys", index), message, "remove one of the two")


def example_keys(draft: Draft) -> Iterator[Finding]:
    """Nobody holds the other half of an example key: a card with it and without passwords lets nobody in."""
    if draft.pilot is None or draft.pilot.example_values:
        return
    where = draft.where(Part("pilot"), "example_values")
    for host, _, device in draft.boxes(Gateway):
        for index, key in enumerate(device.image.ssh_keys if device.image else ()):
            if " EXAMPLE" in key:
                message = f"this SSH key is still an example, but `example_values` is false ({where})"
                hint = "write a technician's public key: the line of the .pub file"
                yield draft.wrong(Part("device", host), ("image", "ssh_keys", index), message, hint)


def reserved(draft: Draft) -> Iterator[Finding]:
    """With DHCP the declared address comes true only by a reservation; without one nobody finds the gateway."""
    for host, name, device in draft.boxes(Gateway):
        site = draft.sites.get(name)
        if device.image is None or device.image.address_by is not AddressBy.DHCP or site is None:
            continue
        if all(reservation.address != device.address for reservation in site.lan.reservations):
            message = f"`{host}` gets its address by DHCP, and the LAN of `{name}` reserves {device.address} for nobody"
            hint = f"add {{name: {host}, mac: …, address: {device.address}}} to `lan.reservations`, or write `static`"
            yield draft.wrong(Part("device", host), ("image", "address_by"), message, hint)


RULES: tuple[Rule, ...] = (way_in, keys_once, example_keys, reserved)
