"""Transfer of recordings from gateways and robots to the control centre; deployed with `gateway_base`.

A gateway logs in to its account at the control centre, through the VPN. Its key is its SSH host key, which is in the
inventory: no key exchange is needed, and a new card brings no unknown key. For that key and address sshd allows a
single program, which writes below one folder only. The gateway accepts only the control centre's host key of the
inventory.

Recordings on a robot are first collected by its gateway. The robot's computer belongs to its owner: nothing is deployed
there. The owner admits the gateway by one line (`line_for_robot`), read-only, to one folder.

Both accept SSH from the VPN, as every computer of the pilot does, and the VPN policy lets our own hosts reach each
other: no firewall rule is added.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from atlantis_netcfg.computers import parts
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, Inventory

SERVICE = "atlantis-retrieval.service"
PROGRAM = "/usr/local/lib/atlantis/retrieval.py"
STATE = "/var/lib/atlantis/retrieval"
USER = "svc-retrieval"
PACKAGES = ("openssh-client", "rsync")
_ROBOT_PROGRAM = "/usr/local/lib/atlantis/retrieval_robot.py"
_SETTINGS = "/etc/atlantis/retrieval.json"
_KNOWN_HOSTS = "/etc/atlantis/retrieval.known_hosts"
_UNIT = f"/etc/systemd/system/{SERVICE}"
_RECEIVER = "/usr/local/lib/atlantis/retrieval_receive.py"
_KEYS = "/etc/atlantis/retrieval.keys"
_SSHD = "/etc/ssh/sshd_config.d/50-atlantis-retrieval.conf"
_ACCOUNT = "/usr/lib/sysusers.d/atlantis-retrieval.conf"
_FOLDER = "/etc/tmpfiles.d/atlantis-retrieval.conf"
_HOST_KEYS = {"ssh-ed25519": "ed25519", "ssh-rsa": "rsa"}
"""Key type to the name of its file in /etc/ssh; all other types are ECDSA."""
_TAKE_AWAY = f"""\
[ ! -e {_UNIT} ] || exit 0
rm -f /etc/systemd/system/*.wants/{SERVICE} {STATE}/job.json
systemctl daemon-reload
! systemctl --quiet is-active {SERVICE} || exec systemctl stop {SERVICE}
"""
_MATCH = f"""\
# atlantis: gateways lay recordings down by this account, and nobody else logs in to it.
Match User {USER}
    AuthorizedKeysFile {_KEYS}
    PermitTTY no
"""


def sources_of(inventory: Inventory, host: str) -> tuple[model.RetrievalSource | model.RetrievalRobot, ...]:
    """Return the sources that a gateway sends: its own recordings, then those of robots."""
    retrieval = inventory.pilot.retrieval
    sources = () if retrieval is None else retrieval.all_sources
    return tuple(source for source in sources if source.host == host)


def packages(inventory: Inventory, host: Host) -> tuple[str, ...]:
    """Return the packages needed at both ends of a transfer."""
    retrieval = inventory.pilot.retrieval
    ends = () if retrieval is None else (retrieval.to, *(source.host for source in retrieval.all_sources))
    return PACKAGES if host.name in ends else ()


def robot_address(inventory: Inventory, robot: model.RetrievalRobot) -> str:
    """Return a robot's address: from the inventory, else from its reservation at the gateway's site."""
    if robot.address is not None:
        return str(robot.address)
    lan = inventory.sites[inventory.hosts[robot.host].site].lan
    return next(str(each.address) for each in lan.reservations if each.name == robot.robot)


def line_for_robot(inventory: Inventory, robot: model.RetrievalRobot) -> str:
    """Return a line for the robot's `authorized_keys`: read-only access to one folder."""
    kind, key = (_computer(inventory, robot.host).ssh.host_key or "").split(" ")[:2]
    return f'restrict,command="rrsync -ro {robot.folder}" {kind} {key} {robot.host}'


def retrieval(inventory: Inventory, host: Host, *, is_rehearsal: bool = False) -> parts.Configuration:
    """Build the transfer configuration (pure); without one, remove it. A rehearsal uses another host key."""
    config, sources = inventory.pilot.retrieval, sources_of(inventory, host.name)
    sends = () if config is None or not sources else _sender(inventory, host, config, sources)
    takes = () if config is None or config.to != host.name else _receiver(inventory, config)
    files = (*sends, *takes)
    file_paths = {file.path for file in files}
    ours = (_UNIT, PROGRAM, _ROBOT_PROGRAM, _SETTINGS, _KNOWN_HOSTS, _SSHD, _KEYS, _RECEIVER, _ACCOUNT, _FOLDER)
    return parts.Configuration(
        files=files,
        absent=tuple(path for path in ours if path not in file_paths),
        steps=(
            parts.ConvergeStep("remove the retrieval of recordings", ("sh", "-c", _TAKE_AWAY), (_UNIT,)),
            parts.ConvergeStep(
                "create the account for recordings", parts.run_on(_ACCOUNT, "systemd-sysusers"), (_ACCOUNT,)
            ),
            parts.ConvergeStep(
                "create the folder for recordings", parts.run_on(_FOLDER, "systemd-tmpfiles", "--create"), (_FOLDER,)
            ),
            parts.ConvergeStep(
                "let sshd admit gateways, or stop admitting them", ("systemctl", "reload", "ssh.service"), (_SSHD,)
            ),
        ),
        units=(parts.Unit(SERVICE, enabled=True),) if sends else (),
        checks=(_key_check(host),) if files and not is_rehearsal else (),
    )


def _sender(
    inventory: Inventory,
    host: Host,
    config: model.Retrieval,
    sources: tuple[model.RetrievalSource | model.RetrievalRobot, ...],
) -> tuple[parts.File, ...]:
    centre, device = _computer(inventory, config.to), _computer(inventory, host.name)
    settings = {
        "from": str(device.vpn_address),
        "from_host": host.name,
        "to": config.to,
        "address": str(centre.vpn_address),
        "port": centre.ssh.port,
        "user": USER,
        "key": _key_file(device),
        "sources": {source.name: _source(inventory, source) for source in sources},
    }
    robots = [source for source in sources if isinstance(source, model.RetrievalRobot)]
    host_keys = [(config.to, centre.ssh.host_key), *((robot.robot, robot.host_key) for robot in robots)]
    templates = environment()
    unit = templates.get_template("gateway/retrieval.service.j2")
    return (
        parts.File(_SETTINGS, json.dumps(settings, indent=1) + "\n"),
        parts.File(_KNOWN_HOSTS, "".join(f"{name} {key}\n" for name, key in host_keys)),
        parts.File(PROGRAM, templates.get_template("gateway/retrieval.py").render()),
        parts.File(_ROBOT_PROGRAM, templates.get_template("gateway/retrieval_robot.py").render()),
        parts.File(_UNIT, unit.render(program=PROGRAM, state=STATE, collected=model.COLLECTION_FOLDER)),
    )


def _source(inventory: Inventory, source: model.RetrievalSource | model.RetrievalRobot) -> dict[str, str | int]:
    if not isinstance(source, model.RetrievalRobot):
        return {"folder": source.folder}
    return {
        "folder": f"{model.COLLECTION_FOLDER}/{source.robot}",
        "budget": source.budget_mb * 1_000_000,
        "robot_address": robot_address(inventory, source),
        "robot_port": source.port,
        "robot_user": source.user,
    }


def _receiver(inventory: Inventory, config: model.Retrieval) -> tuple[parts.File, ...]:
    lines = []
    for host in dict.fromkeys(source.host for source in config.all_sources):
        device = _computer(inventory, host)
        names = ",".join(source.name for source in sources_of(inventory, host))
        command = f"/usr/bin/python3 -I {_RECEIVER} {names} {config.folder} {config.budget_mb}"
        kind, key = (device.ssh.host_key or "").split(" ")[:2]
        lines.append(f'restrict,from="{device.vpn_address}",command="{command}" {kind} {key} {host}\n')
    return (
        parts.File(_ACCOUNT, f'u {USER} - "ATLANTIS recordings" {config.folder} /bin/sh\n'),
        parts.File(_FOLDER, f"d {config.folder} 0750 {USER} {USER} -\n"),
        parts.File(_KEYS, "".join(lines)),
        parts.File(_SSHD, _MATCH, validate=("sshd", "-t", "-f", "%s")),
        parts.File(_RECEIVER, environment().get_template("gateway/retrieval_receive.py").render()),
    )


def _computer(inventory: Inventory, name: str) -> model.ServerComputer:
    device = inventory.hosts[name].device
    assert isinstance(device, model.ServerComputer)  # noqa: S101 - the rules of the inventory check it
    return device


def _key_file(device: model.ServerComputer) -> str:
    kind = (device.ssh.host_key or "").split(" ", maxsplit=1)[0]
    return f"/etc/ssh/ssh_host_{_HOST_KEYS.get(kind, 'ecdsa')}_key"


def _key_check(host: Host) -> parts.Check:
    device = host.device
    assert isinstance(device, model.ServerComputer)  # noqa: S101 - as above
    key = (device.ssh.host_key or "").split(" ")[1]
    return parts.Check(
        ("grep", "-qF", f" {key}", f"{_key_file(device)}.pub"),
        "the SSH host key of this computer differs from the inventory, so recordings cannot be retrieved",
        msg(f"copy its {arg(_key_file(device))}.pub to `ssh.host_key` in host_vars/{arg(host.name)}.yml"),
    )
