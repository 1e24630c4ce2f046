"""Listening for robots on a gateway or control centre, over SSH, without installing anything there."""

from __future__ import annotations

import json
import shlex
import zlib
from base64 import b64decode
from importlib import resources
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.computers.services import ENVIRONMENT
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.processes.remote_process import Carrier
from atlantis_netcfg.inventory import model
from atlantis_netcfg.inventory.robots.reading import FOLDER, key_names
from atlantis_netcfg.operations.common.request import Request, refuse_examples
from atlantis_netcfg.operations.computers._access import computer_access, key_trouble
from atlantis_netcfg.operations.computers.remote_session import ssh_command
from atlantis_netcfg.operations.robots import dds_of, peers_of
from atlantis_netcfg.robots.message_types import INTERFACES, MessageTypes
from atlantis_netcfg.robots.network import profile
from atlantis_netcfg.robots.observation import read_heard

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from atlantis_netcfg.core.processes.remote_process import ProcessResult
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.robots.observation import RobotObservation

VENV: Final = "/opt/atlantis-dds"
"""Virtual environment in which cyclonedds is searched besides the system's Python."""
_BOOT: Final = "import sys,zlib;exec(zlib.decompress(sys.stdin.buffer.read()))"
_EXTRA_S: Final = 240.0
"""Seconds to connect and to receive the end of the response: each may meet a satellite's gap of 70 s."""
_LARGEST: Final = 32_000_000
"""Maximum bytes of a response, decompressed."""
_NOT_FOUND: Final = 127


class ListenError(errors.NetcfgError):
    """Another computer did not listen to the end, so nothing is known about any robot."""

    exit = errors.ExitCode.CHECKS_FAILED


def listening_computer(inventory: Inventory, host: Host) -> model.ServerComputer:
    """Return the computer of a host that can listen; raise UsageError for one without DDS."""
    if not isinstance(host.device, model.ServerComputer):
        there = join(
            ", ", (each.name for each in inventory.hosts.values() if isinstance(each.device, model.ServerComputer))
        )
        raise errors.UsageError(
            f"`{arg(host.name)}` is a {arg(host.device.kind)}: it does not use DDS", hint=f"hosts that do: {arg(there)}"
        )
    return host.device


def listen_there(
    inventory: Inventory,
    host: Host,
    seconds: float,
    *,
    sites: Sequence[str] | None = None,
    request: Request | None = None,
) -> RobotObservation:
    """Listen at `host` for robots of `sites`; default: of its site or, for a control centre, of all sites.

    Raises ListenError, and UsageError for a computer that uses no DDS or has an example address.
    """
    dds, request = dds_of(inventory), request or Request()
    device = listening_computer(inventory, host)
    refuse_examples(inventory, is_rehearsal=request.rehearsed)
    if sites is None:
        sites = list(inventory.sites) if isinstance(device, model.ControlCentre) else [host.site]
    names, _ = key_names(inventory)
    settings = {
        "domain": dds.domain,
        "address": dds.address_of(device),
        "profile": profile(dds.address_of(device), peers_of(inventory, sites), dds.participants),
        "seconds": seconds,
        "topic": names.configuration_topic,
        "types": MessageTypes(inventory.root / FOLDER / INTERFACES).fields,
    }
    access = computer_access(inventory, host, request)
    command = [*ssh_command(access)[:-1], "-C", ssh_command(access)[-1], _command(dds)]
    carrier = Carrier(_program(settings), limit_s=seconds + _EXTRA_S)
    try:
        result = carrier.run(command)
    except OSError as error:
        raise ListenError(
            f"{arg(host.name)} was not contacted: {arg(error)}", hint="install the OpenSSH client"
        ) from None
    return _observation(host, access, result)


def _program(settings: Mapping[str, Any]) -> bytes:
    """Return the listener and its settings as one compressed program."""
    source = (resources.files("atlantis_netcfg.robots") / "listener.py").read_text(encoding="utf-8")
    words = json.dumps(settings, separators=(",", ":"))
    return zlib.compress(f"{source}\n\nmain(json.loads({words!r}))\n".encode(), 9)


def _command(dds: model.Dds) -> str:
    """Return the shell command: Python with cyclonedds if present, else with ROS 2 and the site's environment."""
    home = shlex.quote(f"/opt/ros/{dds.distribution.value}/setup.sh")
    return (
        f"cd /; p={VENV}/bin/python3; [ -x $p ] || p=python3; "
        "if ! $p -c 'import cyclonedds' 2>/dev/null; then p=python3; "
        f"if [ -r {home} ]; then . {home}; fi; if [ -r {ENVIRONMENT} ]; then set -a; . {ENVIRONMENT}; set +a; fi; fi; "
        f"exec $p -c {shlex.quote(_BOOT)}"
    )


def _observation(host: Host, access: Mapping[str, Any], result: ProcessResult) -> RobotObservation:
    """Return the program's observation; raise ListenError."""
    for line in reversed(result.out.splitlines()):
        try:
            answer = json.loads(line)
            if "trouble" in answer:
                raise _trouble(host, str(answer["trouble"]), str(answer["words"]))
            data = zlib.decompressobj().decompress(b64decode(answer["heard"]), _LARGEST)
            return read_heard(json.loads(data))
        except (ValueError, LookupError, TypeError, RecursionError, zlib.error):
            continue
    text = result.err.decode(errors="replace").strip()
    last = text.rpartition("\n")[2] or msg(f"exit code {arg(result.rc)}")
    if (trouble := key_trouble(host.name, text)) is not None:
        raise ListenError(f"{arg(host.name)} at {arg(access['host'])}: {arg(trouble[0])}", hint=trouble[1])
    if "Permission denied" in text:
        hint = msg(
            f"copy your key there: `ssh-copy-id -p {arg(access['port'])} {arg(access['user'])}@{arg(access['host'])}`"
        )
        raise ListenError(f"{arg(host.name)} refused the login as {arg(access['user'])}: {arg(last)}", hint=hint)
    if result.rc == _NOT_FOUND:
        raise ListenError(
            f"{arg(host.name)} has no python3: {arg(last)}", hint=f"on {arg(host.name)}: `apt-get install python3`"
        )
    if b"alive" in result.out:
        message = msg(f"the connection to {arg(host.name)} was lost before the listening time ended: {arg(last)}")
        raise ListenError(message, hint="no results for any robot: run the same command again")
    words = "no response in time" if result.overdue else last
    hint = "check its power and your connection to it, then run the same command again"
    raise ListenError(f"{arg(host.name)} was not reached: {arg(words)}", hint=hint)


def _trouble(host: Host, trouble: str, words: str) -> ListenError:
    if trouble == "missing":
        hint = msg(
            "a run of its site installs ROS 2 if the inventory has it (docs/gateways.md); otherwise on x86_64, "
            f"on that computer: `python3 -m venv {arg(VENV)} && {arg(VENV)}/bin/pip install cyclonedds`"
        )
        return ListenError(f"{arg(host.name)} cannot listen for robots: it has neither cyclonedds nor ROS 2", hint=hint)
    hint = msg(f"does {arg(host.name)} have its `dds` address? Check there: `ip address`")
    return ListenError(f"{arg(host.name)} could not listen: {arg(words[:300])}", hint=hint)
