"""The declared services of a computer: what is started for them, and whether it listens where it is declared.

The program is its partner's, who brings it; the unit, the account, the folder and the bounds are ours. Whom its port is
open to stands in the computer's firewall (`gateway.base`), and for partners also in that of the VPN's server
(`vpn.policy`). That a program answers well is not looked at here: only that it runs and holds its port.
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
HOLDS_PORT = """\
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


@dataclass(frozen=True, slots=True)
class _Hosted:
    """A service that is started here; what the template of its unit sees."""

    name: str
    program: ServiceProgram
    is_privileged: bool

    @property
    def unit(self) -> str:
        return f"atlantis-service-{self.name}.service"

    @property
    def user(self) -> str:
        return self.program.user or f"svc-{self.name}"

    @property
    def data(self) -> str:
        return self.program.data or f"/var/lib/svc-{self.name}"


def services(declared: Iterable[HostedService]) -> Configuration:
    """Pure. Without a service that is started here: what is taken away."""
    started = [(service, service.program) for service in declared if service.program is not None]
    hosted = {
        service.name: _Hosted(service.name, program, service.port is not None and service.port < _PRIVILEGED_PORT)
        for service, program in started
    }
    files = tuple(_files(hosted.values())) if hosted else ()
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
        units=tuple(
            Unit(each.unit, enabled=True, active=True, after=(f"{_UNITS}/{each.unit}",), wait=False)
            for each in hosted.values()
        ),
        brought=tuple(Brought(each.program.path, _not_brought(each)) for each in hosted.values()),
        checks=tuple(_check(hosted[service.name], service) for service, _ in started),
    )


def _files(hosted: Iterable[_Hosted]) -> Iterator[File]:
    each_one = tuple(hosted)
    accounts = {each.user: f'u {each.user} - "ATLANTIS service" {each.data}\n' for each in each_one}
    yield File(_ACCOUNTS, "".join(accounts.values()))
    yield File(_FOLDERS, "".join(f"d {each.data} 0750 {each.user} {each.user} -\n" for each in each_one))
    yield File(LIST, "".join(f"{each.unit}\n" for each in each_one))
    template = environment().get_template("gateway/service.service.j2")
    for each in each_one:
        yield File(f"{_UNITS}/{each.unit}", template.render(service=each))


def _not_brought(hosted: _Hosted) -> str:
    return (
        f"{hosted.program.path} of the service `{hosted.name}` is not there: once its partner has brought it, it starts"
    )


def _check(hosted: _Hosted, service: HostedService) -> Check:
    hint = f"on the computer: `systemctl status {hosted.unit}` and `journalctl -eu {hosted.unit}` tell why"
    if service.port is None:
        return Check(("sh", "-c", _RUNS, "sh", hosted.unit), f"the service `{service.name}` does not stay up", hint)
    kind = "t" if service.transport.value == "tcp" else "u"
    return Check(
        ("sh", "-c", HOLDS_PORT, "sh", hosted.unit, kind, str(service.port)),
        f"the service `{service.name}` does not listen at {service.transport} port {service.port}",
        hint,
    )
