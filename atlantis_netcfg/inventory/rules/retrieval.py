"""Rules for retrieving recordings: both ends have known host keys, and robots are within a gateway's reach."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import _draft, model
from atlantis_netcfg.inventory.findings import Finding, suggest

if TYPE_CHECKING:
    from collections.abc import Iterator

_PILOT = _draft.Part("pilot")
_HARDWARE = "sk-"
"""Prefix of key types whose private key is on a hardware token, not on the computer."""


def ends_known(draft: _draft.Draft) -> Iterator[Finding]:
    """Require gateways as sources and a control centre as destination."""
    retrieval = draft.pilot.retrieval if draft.pilot is not None else None
    if retrieval is None:
        return
    yield from _check_retrieval_host(draft, ("to",), retrieval.to, model.ControlCentre, "control centre")
    for index, source in enumerate(retrieval.sources):
        yield from _check_retrieval_host(draft, ("sources", index, "host"), source.host, model.Gateway, "gateway")
    for index, robot in enumerate(retrieval.robots):
        yield from _check_retrieval_host(draft, ("robots", index, "host"), robot.host, model.Gateway, "gateway")


def robots_known(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a robot is a vehicle of the inventory with one gateway and a folder name that no computer uses."""
    retrieval = draft.pilot.retrieval if draft.pilot is not None else None
    names = [] if retrieval is None else [robot.robot for robot in retrieval.robots]
    vehicle_names = draft.names("vehicle")
    for index, name in enumerate(names):
        path = ("retrieval", "robots", index, "robot")
        if name not in vehicle_names:
            hint = suggest(name, vehicle_names, none="add it to vehicles.yml")
            yield draft.finding_at(_PILOT, path, msg(f"vehicle `{arg(name)}` does not exist"), hint)
        elif name in names[:index]:
            hint = "keep the one with the gateway of the site where the robot is now"
            yield draft.finding_at(_PILOT, path, msg(f"`{arg(name)}` is twice in this list"), hint)
        elif name in draft.layout.hosts:
            message = msg(f"`{arg(name)}` is also the name of a computer; both would use the same folder")
            yield draft.finding_at(_PILOT, path, message, "give the vehicle another key")


def require_unmetered_collection(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a gateway collects over an unmetered path: from a robot in its LAN or Wi-Fi range."""
    retrieval = draft.pilot.retrieval if draft.pilot is not None else None
    for index, robot in enumerate(retrieval.robots if retrieval is not None else ()):
        path = ("retrieval", "robots", index)
        here = draft.layout.hosts.get(robot.host, "")
        site, vehicle = draft.sites.get(here), draft.vehicles.get(robot.robot)
        if site is None or vehicle is None:
            continue  # that is told
        if robot.address is None:
            if robot.robot not in [reservation.name for reservation in site.lan.reservations]:
                message = msg(f"the address of `{arg(robot.robot)}` at {arg(here)} is missing")
                hint = msg(f"add `address:` here, or reserve one in `lan.reservations` of {arg(here)}")
                yield draft.finding_at(_PILOT, path, message, hint)
            continue
        wifi = vehicle.endpoints.wifi
        radio = wifi.client.network if wifi is not None and wifi.client is not None else None
        if robot.address not in site.lan.network and (radio is None or robot.address not in radio):
            message = msg(
                f"{arg(robot.address)} is neither in the LAN of {arg(here)} nor in the network of `{arg(robot.robot)}` "
                "itself"
            )
            hint = msg(
                f"collected data is not counted, so it must stay at the site: {arg(site.lan.network)} is the LAN of "
                f"{arg(here)}"
            )
            yield draft.finding_at(_PILOT, (*path, "address"), message, hint)


def check_collection_folder(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a source folder that overlaps the gateway's collection folder, whose files must not be removed."""
    retrieval = draft.pilot.retrieval if draft.pilot is not None else None
    gateways = {robot.host for robot in retrieval.robots} if retrieval is not None else set()
    for index, source in enumerate(retrieval.sources if retrieval is not None else ()):
        if source.host in gateways and _overlaps_collection(source.folder):
            path = ("retrieval", "sources", index, "folder")
            message = msg(f"{arg(source.folder)} is where `{arg(source.host)}` stores what it collects from robots")
            yield draft.finding_at(
                _PILOT, path, message, "choose another folder: the data is sent under the robot's own name"
            )
    for host, _, device in draft.valid_devices(model.Gateway):
        if host in gateways and device.recording is not None and _overlaps_collection(device.recording.folder):
            message = msg(f"{arg(device.recording.folder)} is where `{arg(host)}` stores what it collects from robots")
            yield draft.finding_at(_draft.Part("device", host), ("recording",), message, "choose another folder")


def _overlaps_collection(folder: str) -> bool:
    return f"{folder}/".startswith(f"{model.COLLECTION_FOLDER}/") or f"{model.COLLECTION_FOLDER}/".startswith(
        f"{folder}/"
    )


def sources_once(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a gateway that is listed twice as a source: it has one folder at the control centre."""
    retrieval = draft.pilot.retrieval if draft.pilot is not None else None
    names = [] if retrieval is None else [source.host for source in retrieval.sources]
    for index, name in enumerate(names):
        if name in names[:index]:
            path = ("retrieval", "sources", index, "host")
            yield draft.finding_at(_PILOT, path, msg(f"`{arg(name)}` is twice in this list"), "remove one")


def _check_retrieval_host(
    draft: _draft.Draft, path: tuple[str | int, ...], name: str, kind: type[model.ServerComputer], words: str
) -> Iterator[Finding]:
    where = ("retrieval", *path)
    if name not in draft.layout.hosts:
        host_names = [host for host, _, _ in draft.valid_devices(kind)]
        hint = suggest(name, host_names, none=msg(f"add the {arg(words)} first"))
        yield draft.finding_at(_PILOT, where, msg(f"host `{arg(name)}` does not exist"), hint)
        return
    device = draft.devices.get(name)
    if device is None:
        return  # that is told
    if not isinstance(device, kind):
        hint = msg(
            f"name a {arg(words)}: "
            f"{arg(join(', ', (host for host, _, _ in draft.valid_devices(kind))) or 'none in the inventory')}"
        )
        yield draft.finding_at(_PILOT, where, msg(f"`{arg(name)}` is not a {arg(words)}"), hint)
        return
    if device.vpn_address is None:
        message = msg(f"recordings are sent through the VPN, but `{arg(name)}` has no VPN address")
        yield draft.finding_at(_PILOT, where, message, msg(f"set `vpn_address:` of `{arg(name)}`"))
    if device.ssh.host_key is None or device.ssh.host_key.startswith(_HARDWARE):
        message = msg(
            f"the two ends of a transfer identify each other by SSH host keys, but that of `{arg(name)}` is missing"
        )
        hint = msg(
            f"set `ssh: {{host_key: …}}` in host_vars/{arg(name)}.yml, from its /etc/ssh/ssh_host_ed25519_key.pub"
        )
        yield draft.finding_at(_PILOT, where, message, hint)


RULES: tuple[_draft.Rule, ...] = (
    ends_known,
    sources_once,
    robots_known,
    require_unmetered_collection,
    check_collection_folder,
)
