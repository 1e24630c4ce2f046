"""Rules for a computer's services: unique free ports, known partners, accounts with few rights.

Also that the parts of the pilot's ROS 2 chosen for a control centre are in the inventory.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _draft, model
from atlantis_netcfg.inventory.findings import Finding, suggest

if TYPE_CHECKING:
    from collections.abc import Iterator

_PILOT = _draft.Part("pilot")
_NTP_PORT = 123
_PortKey = tuple[model.Transport, int]


def _services(draft: _draft.Draft) -> Iterator[tuple[str, model.ServerComputer, int, model.HostedService]]:
    """Yield host, device, list index and service."""
    for host, _, device in draft.valid_devices(model.ServerComputer):
        for index, service in enumerate(device.services):
            yield host, device, index, service


def names_once(draft: _draft.Draft) -> Iterator[Finding]:
    """Require unique service names per host: the name is that of the unit and of the account."""
    index_by_name: dict[tuple[str, str], int] = {}
    for host, _, index, service in _services(draft):
        first = index_by_name.setdefault((host, service.name), index)
        if first != index:
            line = draft.mark(_draft.Part("device", host), "services", first, "name").line
            message = msg(
                f"`{arg(service.name)}` is already the name of a service of `{arg(host)}`, in line {arg(line)}"
            )
            yield draft.finding_at(
                _draft.Part("device", host), ("services", index, "name"), message, "give each its own name"
            )


def ports_once(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a port that two services use, or that the toolkit itself uses on that computer."""
    owner_by_port: dict[tuple[str, _PortKey], str] = {}
    for host, device in draft.devices.items():
        if isinstance(device, model.ServerComputer):
            owner_by_port |= {(host, key): why for key, why in _occupied_ports(draft, host, device).items()}
    for host, _, index, service in _services(draft):
        if service.port is None:
            continue
        part, path, key = (
            _draft.Part("device", host),
            ("services", index, "port"),
            (host, (service.transport, service.port)),
        )
        if key in owner_by_port:
            message = msg(
                f"{arg(service.transport)} port {arg(service.port)} of `{arg(host)}` is already "
                f"{arg(owner_by_port[key])}"
            )
            yield draft.finding_at(part, path, message, "choose a free port")
        why = msg(f"that of the service `{arg(service.name)}`, in line {arg(draft.mark(part, *path).line)}")
        owner_by_port.setdefault(key, why)


def _occupied_ports(draft: _draft.Draft, host: str, device: model.ServerComputer) -> dict[_PortKey, str]:
    """Return the ports in use on the computer apart from its own services, with their purpose."""
    owner_by_port: dict[_PortKey, str] = {
        (model.Transport.UDP, _NTP_PORT): "that of the time server for the LAN",
        (model.Transport.TCP, device.ssh.port): "that of SSH",
    }
    if draft.pilot is None:
        return owner_by_port
    if device.vpn_address is not None:
        owner_by_port[model.Transport.UDP, model.REFLECTOR_PORT] = "that of the responder for checklists of other sites"
    if draft.pilot.qualify is not None:
        owner_by_port[model.Transport.UDP, draft.pilot.qualify.port] = (
            "that of the far end of measurements (pilot.qualify)"
        )
    if draft.pilot.dds is not None:
        owner_by_port |= {(model.Transport.UDP, port): "one of DDS" for port in draft.pilot.dds.all_ports}
    for index, service in enumerate(draft.pilot.vpn.services):
        if service.host == host:
            where = draft.where(_PILOT, "vpn", "services", index, "port")
            owner_by_port[service.transport, service.port] = msg(f"a service for all partners ({arg(where)})")
    return owner_by_port


def open_ports(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a port for a service that is open to others, and VPN membership for access through the VPN."""
    for host, device, index, service in _services(draft):
        path = ("services", index)
        if service.port is None and (service.open_to or service.partners):
            message = msg(f"the service `{arg(service.name)}` has no port that can be opened")
            yield draft.finding_at(
                _draft.Part("device", host), path, message, "set its `port:`, or remove who can reach it"
            )
        elif device.vpn_address is None and (service.partners or model.ServiceNetwork.VPN in service.open_to):
            message = msg(
                f"`{arg(service.name)}` must be reachable through the VPN, but `{arg(host)}` has no VPN address"
            )
            yield draft.finding_at(
                _draft.Part("device", host),
                path,
                message,
                msg(f"set `vpn_address:` of `{arg(host)}`, or `open_to: [lan]`"),
            )


def partners_known(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a service's partners exist: a misspelt one would be kept out without notice."""
    whole = draft.nodes.get(_draft.Part("partners"))
    if whole is None or not isinstance(whole.value, dict):
        return  # that is told
    partner_names = draft.names("partner")
    for host, _, index, service in _services(draft):
        for place, partner in enumerate(service.partners):
            path = ("services", index, "partners", place)
            if partner not in partner_names:
                hint = suggest(partner, partner_names, none="add it to `partners`")
                yield draft.finding_at(
                    _draft.Part("device", host), path, msg(f"partner `{arg(partner)}` does not exist"), hint
                )
            elif partner in service.partners[:place]:
                yield draft.finding_at(
                    _draft.Part("device", host), path, msg(f"`{arg(partner)}` is twice in this list"), "remove one"
                )


def started_once(draft: _draft.Draft) -> Iterator[Finding]:
    """Require either a program or a container for a service, and one value per variable."""
    for host, _, index, service in _services(draft):
        part, path = _draft.Part("device", host), ("services", index, "container")
        if service.container is None:
            continue
        if service.program is not None:
            message = msg(f"the service `{arg(service.name)}` is both a program and a container")
            yield draft.finding_at(part, path, message, "remove one of them")
        names: set[str] = set()
        for place, variable in enumerate(service.container.environment):
            where = (*path, "environment", place)
            if (variable.value is None) == (variable.secret is None):
                message = msg(f"`{arg(variable.name)}` has neither a value nor a secret")
                if variable.secret is not None:
                    message = msg(f"`{arg(variable.name)}` has both a value and a secret")
                yield draft.finding_at(part, where, message, "write `value:`, or `secret:` with a vaulted value")
            if variable.name in names:
                yield draft.finding_at(part, where, msg(f"`{arg(variable.name)}` is twice in this list"), "remove one")
            names.add(variable.name)


def programs_apart(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a partner's program does not run as root and shares no folder with another service."""
    owner_by_folder: dict[tuple[str, str], str] = {}
    for host, _, index, service in _services(draft):
        if service.workload is None:
            continue
        form = "program" if service.program is not None else "container"
        part, path = _draft.Part("device", host), ("services", index, form)
        if service.workload.user == "root":
            message = msg(f"the service `{arg(service.name)}` would run as root, but its program is not ours")
            yield draft.finding_at(part, (*path, "user"), message, "remove `user:`: the service gets its own account")
        if service.workload.data is not None:
            first = owner_by_folder.setdefault((host, service.workload.data), service.name)
            if first != service.name:
                message = msg(f"{arg(service.workload.data)} is already the folder of the service `{arg(first)}`")
                yield draft.finding_at(part, (*path, "data"), message, "give each its own folder")


def containers_possible(draft: _draft.Draft) -> Iterator[Finding]:
    """Refuse containers on Ubuntu 20.04 (required by Foxy): its archive has no podman."""
    for host, _, device in draft.valid_devices(model.ServerComputer):
        if not _has_foxy(draft, device):
            continue
        message = msg(f"`{arg(host)}` gets ROS 2 foxy and so has Ubuntu 20.04, whose archive has no podman")
        hint = "run the container on a computer without foxy: Debian 12 has podman"
        for index, each in enumerate(device.services):
            if each.container is not None:
                yield draft.finding_at(_draft.Part("device", host), ("services", index, "container"), message, hint)
        if device.ros1_bridge is not None and device.ros1_bridge.archive is not None:
            hint = "remove `archive:` and `sha256:`: there the bridge is a ROS package"
            yield draft.finding_at(_draft.Part("device", host), ("ros1_bridge",), message, hint)


def _has_foxy(draft: _draft.Draft, device: model.ServerComputer) -> bool:
    """Return whether the computer gets ROS 2 Foxy, and so Ubuntu 20.04's package archive."""
    if draft.pilot is None or draft.pilot.dds is None or draft.pilot.gateways.ros2 is None:
        return False
    return draft.pilot.dds.distribution is model.RosDistribution.FOXY and device.has_ros2


def bridges_possible(draft: _draft.Draft) -> Iterator[Finding]:
    """Require DDS over the VPN for a ROS 1 bridge, and a name that no service has."""
    for host, _, device in draft.valid_devices(model.ServerComputer):
        part, bridge = _draft.Part("device", host), device.ros1_bridge
        if bridge is None:
            continue
        if draft.pilot is not None and draft.pilot.dds is None:
            message = msg(f"`{arg(host)}` bridges topics to ROS 2, but the pilot has no DDS settings")
            yield draft.finding_at(part, ("ros1_bridge",), message, "add `dds: {distribution: …}` to pilot.yml")
        if device.vpn_address is None:
            message = msg(f"the bridge of `{arg(host)}` uses the VPN, but `{arg(host)}` has no VPN address")
            yield draft.finding_at(part, ("ros1_bridge",), message, msg(f"set `vpn_address:` of `{arg(host)}`"))
        for index, service in enumerate(device.services):
            if service.name == model.ROS1_BRIDGE:
                message = msg(f"`{arg(model.ROS1_BRIDGE)}` is the name of the bridge to ROS 1 of `{arg(host)}`")
                yield draft.finding_at(part, ("services", index, "name"), message, "give the service another name")
        topics = [each.topic for each in bridge.topics]
        for index, topic in enumerate(topics):
            if topic in topics[:index]:
                path = ("ros1_bridge", "topics", index)
                yield draft.finding_at(part, path, msg(f"`{arg(topic)}` is twice in this list"), "remove one")


def bridge_is_package_or_image(draft: _draft.Draft) -> Iterator[Finding]:
    """Require the package for a ROS 1 bridge on Foxy, and an image with its hash elsewhere."""
    for host, _, device in draft.valid_devices(model.ServerComputer):
        part, bridge = _draft.Part("device", host), device.ros1_bridge
        if bridge is None:
            continue
        if (bridge.archive is None) is not (bridge.sha256 is None):
            message = msg(f"the bridge of `{arg(host)}` has only one of `archive:` and `sha256:`")
            yield draft.finding_at(part, ("ros1_bridge",), message, "write both; with foxy, neither")
        elif bridge.archive is None and draft.pilot is not None and not _has_foxy(draft, device):
            message = msg(f"there is no package for the bridge of `{arg(host)}`: `{arg(host)}` does not get ROS 2 foxy")
            hint = "add `archive:` and `sha256:` of an image that contains it (docs/robots.md)"
            yield draft.finding_at(part, ("ros1_bridge",), message, hint)


def require_configured_choices(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that whatever is chosen for a control centre is configured for the pilot; the library needs ROS 2."""
    if draft.pilot is None:
        return
    gateways = draft.pilot.gateways
    for host, _, device in draft.valid_devices(model.ControlCentre):
        part = _draft.Part("device", host)
        if device.ros2 and gateways.ros2 is None:
            message = msg(f"`{arg(host)}` needs ROS 2, but the pilot has no ROS 2 settings")
            yield draft.finding_at(
                part, ("ros2",), message, "add `gateways: {ros2: …}` to pilot.yml, or write `ros2: false`"
            )
        if device.interop and gateways.interop is None:
            message = msg(f"`{arg(host)}` needs the library, but the pilot has no settings for it")
            yield draft.finding_at(
                part, ("interop",), message, "add `gateways: {interop: …}`, or write `interop: false`"
            )
        elif device.interop and not device.ros2:
            message = msg(f"the library of `{arg(host)}` is built against ROS 2, which it does not have")
            yield draft.finding_at(part, ("interop",), message, "add `ros2: true` next to it")


def recorder_declared(draft: _draft.Draft) -> Iterator[Finding]:
    """Require ROS 2 on a gateway that records, and unique topics."""
    for host, _, device in draft.valid_devices(model.Gateway):
        if device.recording is None:
            continue
        part, topics = _draft.Part("device", host), device.recording.topics
        if draft.pilot is not None and draft.pilot.gateways.ros2 is None:
            message = msg(f"`{arg(host)}` records ROS 2 topics, but the pilot has no ROS 2 settings")
            yield draft.finding_at(part, ("recording",), message, "add `gateways: {ros2: …}` to pilot.yml")
        for index, topic in enumerate(topics):
            if topic in topics[:index]:
                path = ("recording", "topics", index)
                yield draft.finding_at(part, path, msg(f"`{arg(topic)}` is twice in this list"), "remove one")


RULES: tuple[_draft.Rule, ...] = (
    names_once,
    ports_once,
    open_ports,
    partners_known,
    started_once,
    programs_apart,
    containers_possible,
    bridges_possible,
    bridge_is_package_or_image,
    require_configured_choices,
    recorder_declared,
)
