"""Two small responders on gateways and control centres, for checklists and for link measurements.

The first responds to checklists of other computers. It is bound to the VPN address only, and the firewall admits only
the pilot's own computers (`computers.base`). It proves that data arrive and return, not that a partner's program works.

The second is the far end of measured links, from the folder `links/qualify/reflector`: it responds to clients that have
the key. It runs only on the control centre in `pilot.qualify`, open to everybody, since each link has another public
address. A measurement starts it, and it exits at the end: its port is closed at other times.
"""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

from atlantis_netcfg.computers import parts
from atlantis_netcfg.computers.services import HOLDS_PORT
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host

SERVICE = "atlantis-reflector.service"
PROGRAM = "/usr/local/lib/atlantis/reflector.py"
QUALIFY_SERVICE = "atlantis-qualify.service"
QUALIFY_FOLDER = "/usr/local/lib/atlantis/qualify"
QUALIFY_KEY = "/etc/atlantis/qualify.key"
QUALIFY_SECRET = "@secret key of pilot.qualify@"  # noqa: S105 - the word in its place
_UNITS = "/etc/systemd/system"
_UNIT = f"{_UNITS}/{SERVICE}"
_QUALIFY_UNIT = f"{_UNITS}/{QUALIFY_SERVICE}"
_PACKAGE = "reflector"
_START = f"/usr/bin/python3 -s -B -m {_PACKAGE}"
_PRIVILEGED_PORT = 1024
_IDLE_S = 900
"""The reflector exits after this many seconds without a packet; by then all its sessions would have expired."""
_TAKE_AWAY = f"""\
[ ! -e {_UNITS}/$1 ] || exit 0
rm -f {_UNITS}/*.wants/$1
systemctl daemon-reload
! systemctl --quiet is-active $1 || exec systemctl stop $1
"""


def reflector(host: Host) -> parts.Configuration:
    """Build the checklist responder (pure); on a computer without VPN, remove it."""
    assert isinstance(host.device, model.ServerComputer)  # noqa: S101 - `gateway_base` checks it
    away = stop_step("remove the responder for checklists", SERVICE)
    if host.device.vpn_address is None:
        return parts.Configuration(absent=(_UNIT, PROGRAM), steps=(away,))
    unit = _unit(
        title="responder for checklists of other sites",
        command=f"/usr/bin/python3 -I {PROGRAM} {host.name} {host.device.vpn_address} {model.REFLECTOR_PORT}",
    )
    return parts.Configuration(
        files=(
            parts.File(PROGRAM, environment().get_template("gateway/reflector.py").render()),
            parts.File(_UNIT, unit),
        ),
        steps=(away,),
        units=(parts.Unit(SERVICE, enabled=True, active=True, after=(_UNIT, PROGRAM)),),
        checks=(_port_check(SERVICE, model.REFLECTOR_PORT, "nothing responds to checklists of other sites"),),
    )


def qualify_settings(host: str, pilot: model.Pilot) -> model.Qualify | None:
    """Return the inventory's measurement settings if this computer is the far end, else None."""
    return pilot.qualify if pilot.qualify is not None and pilot.qualify.reflector == host else None


def link_reflector(host: str, pilot: model.Pilot) -> parts.Configuration:
    """Build the responder for measured links (pure); on other computers, remove it."""
    away = stop_step("remove the far end of measured links", QUALIFY_SERVICE)
    qualify = qualify_settings(host, pilot)
    if qualify is None:
        return parts.Configuration(absent=(_QUALIFY_UNIT, QUALIFY_KEY), only=(QUALIFY_FOLDER,), steps=(away,))
    unit = _unit(
        title="far end of measured links",
        command=f"{_START} --name {host} --port {qualify.port} --idle-s {_IDLE_S} --key-file -",
        restart="on-failure",
        folder=QUALIFY_FOLDER,
        key=QUALIFY_KEY,
        privileged=qualify.port < _PRIVILEGED_PORT,
    )
    programs = tuple(
        parts.File(f"{QUALIFY_FOLDER}/{_PACKAGE}/{source.name}", source.read_text("utf-8"))
        for source in sorted(
            resources.files("atlantis_netcfg.links.qualify.reflector").iterdir(), key=lambda source: source.name
        )
        if source.name.endswith(".py")
    )
    files = (*programs, parts.File(QUALIFY_KEY, f"{QUALIFY_SECRET}\n", mode="0600"), parts.File(_QUALIFY_UNIT, unit))
    return parts.Configuration(
        files=files,
        only=(QUALIFY_FOLDER,),
        steps=(away,),
        units=(parts.Unit(QUALIFY_SERVICE, enabled=False, after=tuple(file.path for file in files)),),
        checks=(
            parts.Check(
                ("sh", "-c", f"cd {QUALIFY_FOLDER} && exec {_START} --help >/dev/null"),
                "the program that responds to link measurements does not start",
                msg(f"on the computer: `cd {arg(QUALIFY_FOLDER)} && {arg(_START)} --help` shows why"),
            ),
        ),
    )


def _unit(**values: str | bool) -> str:
    usual = {"folder": "", "key": "", "privileged": False, "restart": "always"}
    return environment().get_template("gateway/reflector.service.j2").render(usual | values)


def stop_step(words: str, service: str) -> parts.ConvergeStep:
    """Return the step that stops a service without unit file."""
    return parts.ConvergeStep(words, ("sh", "-c", _TAKE_AWAY, "sh", service), (f"{_UNITS}/{service}",))


def _port_check(service: str, port: int, finding: str) -> parts.Check:
    return parts.Check(
        ("sh", "-c", HOLDS_PORT, "sh", service, "u", str(port)),
        msg(f"{arg(finding)} at UDP port {arg(port)}"),
        msg(f"on the computer: `systemctl status {arg(service)}` and `journalctl -eu {arg(service)}` show why"),
    )
