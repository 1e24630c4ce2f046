"""Rules for gateways: each part has its prerequisites, and no token travels in clear text.

Also what the gateway computer's image needs from the rest of the inventory.
"""

from __future__ import annotations

from ipaddress import AddressValueError, IPv4Address
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _draft, model

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.inventory.findings import Finding

_PILOT = _draft.Part("pilot")


def release_known(draft: _draft.Draft) -> Iterator[Finding]:
    """Require `dds:` where ROS 2 is installed: it names the release and how programs discover each other."""
    if draft.pilot is None or draft.pilot.dds is not None:
        return
    if draft.pilot.gateways.ros2 is not None:
        hint = "add `dds:` with its `distribution:`"
        yield draft.finding_at(_PILOT, ("gateways", "ros2"), "the release of ROS 2 is not set", hint)


def pins_once(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a package that is pinned twice."""
    ros2 = draft.pilot.gateways.ros2 if draft.pilot is not None else None
    seen_packages: set[str] = set()
    for index, pin in enumerate(ros2.pins if ros2 is not None else ()):
        if pin.package in seen_packages:
            message = msg(f"`{arg(pin.package)}` is pinned twice")
            yield draft.finding_at(_PILOT, ("gateways", "ros2", "pins", index), message, "remove one of the two")
        seen_packages.add(pin.package)


def builds_on_ros(draft: _draft.Draft) -> Iterator[Finding]:
    """Require `ros2:` for the interop library, which is a ROS 2 workspace."""
    if draft.pilot is None:
        return
    gateways = draft.pilot.gateways
    if gateways.interop is not None and gateways.ros2 is None:
        message = "the library is built against ROS 2, which is not set"
        yield draft.finding_at(_PILOT, ("gateways", "interop"), message, "add `ros2:` next to it")


def tested_with_examples(draft: _draft.Draft) -> Iterator[Finding]:
    """Require `examples:` for the connection test: its robot is one of the examples."""
    interop = draft.pilot.gateways.interop if draft.pilot is not None else None
    if interop is not None and interop.connection_test is not None and interop.examples is None:
        message = "the program of the connection test is one of the examples, which are not set"
        where = ("gateways", "interop", "connection_test")
        yield draft.finding_at(_PILOT, where, message, "add `examples:` next to it, or remove the test")


def check_token_transport(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a token sent over plain HTTP; inside a site's own network that is accepted."""
    interop = draft.pilot.gateways.interop if draft.pilot is not None else None
    if interop is None:
        return
    both: tuple[tuple[str, model.Repository | None], ...] = (
        ("library", interop.library),
        ("examples", interop.examples),
    )
    for name, repository in both:
        if repository is None or repository.token is None:
            continue
        parts = urlsplit(repository.url)
        if parts.scheme == "http" and not _is_private_address(parts.hostname or ""):
            message = "the token would be sent over plain HTTP, readable for everyone on the path"
            yield draft.finding_at(_PILOT, ("gateways", "interop", name, "url"), message, "use https://")


def _is_private_address(host: str) -> bool:
    try:
        return IPv4Address(host).is_private
    except AddressValueError:
        return False


def one_interface(draft: _draft.Draft) -> Iterator[Finding]:
    """Require the same interface in image and `network:`; otherwise the first run cuts off the gateway."""
    for host, _, device in draft.valid_devices(model.SiteComputer):
        if device.network is None or device.image is None or device.image.interface is None:
            continue
        if device.network.interface != device.image.interface:
            line = draft.mark(_draft.Part("device", host), "image", "interface").line
            message = msg(
                f"the image configures `{arg(device.image.interface)}` (line {arg(line)}), not "
                f"`{arg(device.network.interface)}`"
            )
            hint = "use the same name in both: `ip link` on the board shows it"
            yield draft.finding_at(_draft.Part("device", host), ("network", "interface"), message, hint)


RULES: tuple[_draft.Rule, ...] = (
    release_known,
    pins_once,
    builds_on_ros,
    tested_with_examples,
    check_token_transport,
    one_interface,
)


def require_ssh_key(draft: _draft.Draft) -> Iterator[Finding]:
    """Require an SSH key for every image: it has no passwords, so without a key nobody could log in."""
    for host, _, device in draft.valid_devices(model.SiteComputer):
        if device.image is not None and not device.image.ssh_keys:
            message = msg(
                f"nobody could log in to `{arg(host)}`: its image has no SSH key, and its passwords are removed"
            )
            hint = "add the public keys of the technicians, one per line"
            yield draft.finding_at(_draft.Part("device", host), ("image", "ssh_keys"), message, hint)


def keys_once(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a technician's SSH key that is listed twice: revoking one line would leave the other."""
    for host, _, device in draft.valid_devices(model.SiteComputer):
        index_by_key: dict[str, int] = {}
        for index, key in enumerate(device.image.ssh_keys if device.image else ()):
            body = key.split(" ")[1]
            first = index_by_key.setdefault(body, index)
            if first != index:
                line = draft.mark(_draft.Part("device", host), "image", "ssh_keys", first).line
                message = msg(f"this key is here twice, first in line {arg(line)}")
                yield draft.finding_at(
                    _draft.Part("device", host), ("image", "ssh_keys", index), message, "remove one of the two"
                )


def require_reservation(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a reservation for a gateway that uses DHCP: only that gives it the address in the inventory."""
    for host, name, device in draft.valid_devices(model.SiteComputer):
        site = draft.sites.get(name)
        if device.image is None or device.image.address_by is not model.AddressBy.DHCP or site is None:
            continue
        if all(reservation.address != device.address for reservation in site.lan.reservations):
            message = msg(
                f"`{arg(host)}` gets its address by DHCP, but the LAN of `{arg(name)}` reserves {arg(device.address)} "
                "for nobody"
            )
            hint = msg(
                f"add {{name: {arg(host)}, mac: …, address: {arg(device.address)}}} to `lan.reservations`, or write "
                "`static`"
            )
            yield draft.finding_at(_draft.Part("device", host), ("image", "address_by"), message, hint)


GATEWAY_RULES: tuple[_draft.Rule, ...] = (require_ssh_key, keys_once, require_reservation)
