"""The declared services of a computer: what is started for them, and whether it listens where it is declared.

The program is its partner's, who brings it; the unit, the account, the folder and the bounds are ours. Whom its port is
open to stands in the computer's firewall (`gateway.base`), and for partners also in that of the VPN's server
(`vpn.policy`). That a program answers well is not looked at here: only that it runs and holds its port.

`StartedService` is what any unit of ours is made of; one that takes part in DDS lives as long as the VPN's interface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.gateway.parts import Brought, Check, Configuration, ConvergeStep, File, Unit, run_on
from atlantis_netcfg.render import environment

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from atlantis_netcfg.declaration.model import HostedService, ServiceProgram

LIST = "/etc/atlantis/services"
"""The units that are declared, one a line: whatever else of that name stands on the computer is taken away."""
_UNITS = "/etc/systemd/system"
_ACCOUNTS = "/usr/lib/sysusers.d/atlantis-services.conf"
_FOLDERS = "/etc/tmpfiles.d/atlantis-services.conf"
_PRIVILEGED_PORT = 1024
"""Ports below belong to root (ip(7)): the unit is given that one capability."""

_TAKE_AWAY = f"""\
for path in {_UNITS}/atlantis-service-*.service; do
    [ -e "$path" ] || continue
    unit="${{path##*/}}"
    grep -qsx "$unit" {LIST} && continue
    systemctl --quiet disable --now "$unit" || exit 1
    rm -f "$path" || exit 1
done
exec systemctl daemon-reload
"""
_HOLDS_PORT = """\
unit="$1" kind="$2" port="$3" tries=0
while [ "$tries" -lt 30 ]; do
    case "$(systemctl show --property ActiveState --value "$unit")" in active | activating) ;; *) exit 1 ;; esac
    for process in $(ss -H -l -n -p "-$kind" "sport = :$port" | grep -o 'pid=[0-9]*' | cut -d = -f 2); do
        ! grep -qs "/$unit" "/proc/$process/cgroup" || exit 0
    done
    tries=$((tries + 1))
    sleep 0.5
done
exit 1
"""
"""A process of this very unit listens: whoever else has the port is somebody else. A program may need 15 s to begin."""
_RUNS = """\
before="$(systemctl show --property ActiveState,MainPID "$1")"
sleep 1
case "$before" in *ActiveState=active*) ;; *) exit 1 ;; esac
[ "$before" = "$(systemctl show --property ActiveState,MainPID "$1")" ]
"""
"""Of a service without a port: it runs, and a second later it is the same process."""


VPN_INTERFACE = "tun0"
"""Of OpenVPN on a gateway."""
ENVIRONMENT = "/etc/atlantis/ros.env"
"""Domain, middleware and profile: written by the part `gateway_dds`, which restarts what has read it."""
_DEVICE = f"sys-subsystem-net-devices-{VPN_INTERFACE}.device"
_UP_OR_DOWN = f"""\
if [ -e "{_UNITS}/$1" ]; then
    systemctl --quiet is-active {_DEVICE} || exit 0
    exec systemctl --no-block start "$1"
fi
rm -f {_UNITS}/*.wants/"$1"
systemctl daemon-reload
exec systemctl stop "$1"
"""
"""systemd starts it with the interface; where that is up already, this does."""
_RUNS_WITH_THE_VPN = f"""\
systemctl --quiet is-active {_DEVICE} || exit 0
tries=0
while [ "$tries" -lt 30 ]; do
    if systemctl --quiet is-active "$1"; then exit 0; fi
    tries=$((tries + 1))
    sleep 0.5
done
exit 1
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class StartedService:
    """What the template of a unit sees."""

    name: str
    """Of the unit, with its ending."""
    title: str
    user: str
    folder: str
    """The only one that it may write to."""
    command: str
    memory_mb: int | None = None
    restart: str = "always"
    stop_s: int = 20
    ends_itself: bool = False
    """It is the program that ends whatever it has started."""
    is_privileged: bool = False
    """It listens at a port of root's."""
    dds: bool = False
    """It takes part in DDS over the VPN."""

    @property
    def path(self) -> str:
        """Of its unit."""
        return f"{_UNITS}/{self.name}"

    def unit(self) -> File:
        """Its unit."""
        template = environment().get_template("gateway/service.service.j2")
        return File(self.path, template.render(service=self, interface=VPN_INTERFACE, environment=ENVIRONMENT))


def with_the_vpn(what: str, service: str) -> ConvergeStep:
    """Start what has a unit, and end what has none, in words for people and by the name of the unit."""
    run = ("sh", "-c", _UP_OR_DOWN, "sh", service)
    return ConvergeStep(f"start {what} with the VPN, or take it away", run, (f"{_UNITS}/{service}",))


def runs_with_the_vpn(what: str, service: str) -> Check:
    """It runs as long as the VPN's interface is there."""
    return Check(
        ("sh", "-c", _RUNS_WITH_THE_VPN, "sh", service),
        f"{what} does not run, though the VPN's interface is there",
        _tells_why(service),
    )


def _tells_why(unit: str) -> str:
    return f"on the computer: `systemctl status {unit}` and `journalctl -eu {unit}` tell why"


def services(declared: Iterable[HostedService]) -> Configuration:
    """Pure. Without a service that is started here: what is taken away."""
    started = [(service, service.program) for service in declared if service.program is not None]
    hosted = [_hosted(service, program) for service, program in started]
    files = tuple(_files(hosted)) if hosted else ()
    laid = {file.path for file in files}
    return Configuration(
        files=files,
        absent=tuple(path for path in (LIST, _ACCOUNTS, _FOLDERS) if path not in laid),
        steps=(
            ConvergeStep("make the accounts of services", run_on(_ACCOUNTS, "systemd-sysusers"), (_ACCOUNTS,)),
            ConvergeStep(
                "make the folders of services",
                run_on(_FOLDERS, "systemd-tmpfiles", "--create"),
                (_FOLDERS,),
            ),
            ConvergeStep("take away services that are not declared", ("sh", "-c", _TAKE_AWAY), (LIST,)),
        ),
        units=tuple(Unit(each.name, enabled=True, active=True, after=(each.path,), wait=False) for each in hosted),
        brought=tuple(Brought(program.path, _not_brought(service, program)) for service, program in started),
        checks=tuple(_check(service) for service, _ in started),
    )


def _unit(service: HostedService) -> str:
    return f"atlantis-service-{service.name}.service"


def _hosted(service: HostedService, program: ServiceProgram) -> StartedService:
    return StartedService(
        name=_unit(service),
        title=f"service {service.name}",
        user=program.user or f"svc-{service.name}",
        folder=program.data or f"/var/lib/svc-{service.name}",
        command=program.command,
        memory_mb=program.memory_mb,
        restart=program.restart.value,
        is_privileged=service.port is not None and service.port < _PRIVILEGED_PORT,
    )


def _files(hosted: Iterable[StartedService]) -> Iterator[File]:
    each_one = tuple(hosted)
    accounts = {each.user: f'u {each.user} - "ATLANTIS service" {each.folder}\n' for each in each_one}
    yield File(_ACCOUNTS, "".join(accounts.values()))
    yield File(_FOLDERS, "".join(f"d {each.folder} 0750 {each.user} {each.user} -\n" for each in each_one))
    yield File(LIST, "".join(f"{each.name}\n" for each in each_one))
    for each in each_one:
        yield each.unit()


def _not_brought(service: HostedService, program: ServiceProgram) -> str:
    return f"{program.path} of the service `{service.name}` is not there: once its partner has brought it, it starts"


def _check(service: HostedService) -> Check:
    unit = _unit(service)
    hint = _tells_why(unit)
    if service.port is None:
        return Check(("sh", "-c", _RUNS, "sh", unit), f"the service `{service.name}` does not stay up", hint)
    kind = "t" if service.transport.value == "tcp" else "u"
    return Check(
        ("sh", "-c", _HOLDS_PORT, "sh", unit, kind, str(service.port)),
        f"the service `{service.name}` does not listen at {service.transport} port {service.port}",
        hint,
    )
