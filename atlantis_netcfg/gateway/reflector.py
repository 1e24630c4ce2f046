"""What answers the checklist of the other computers: a small program of ours on every gateway and control centre.

It is bound to the address in the VPN alone, and the firewall lets only the pilot's own computers come to it
(`gateway.base`). It shows that data arrive and come back, not that any program of a partner works.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.model import REFLECTOR_PORT, ServerComputer
from atlantis_netcfg.gateway.parts import Check, Configuration, ConvergeStep, File, Unit
from atlantis_netcfg.gateway.services import HOLDS_PORT
from atlantis_netcfg.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.declaration import Host

SERVICE = "atlantis-reflector.service"
PROGRAM = "/usr/local/lib/atlantis/reflector.py"
_UNIT = f"/etc/systemd/system/{SERVICE}"
_TAKE_AWAY = f"""\
[ ! -e {_UNIT} ] || exit 0
rm -f /etc/systemd/system/*.wants/{SERVICE}
systemctl daemon-reload
! systemctl --quiet is-active {SERVICE} || exec systemctl stop {SERVICE}
"""


def reflector(host: Host) -> Configuration:
    """Pure. Of a computer that is not in the VPN: what is taken away."""
    assert isinstance(host.device, ServerComputer)  # noqa: S101 - `gateway_base` has looked
    taken_away = ConvergeStep("take the answers to checklists away", ("sh", "-c", _TAKE_AWAY), (_UNIT,))
    if host.device.vpn_address is None:
        return Configuration(absent=(_UNIT, PROGRAM), steps=(taken_away,))
    values = {"program": PROGRAM, "name": host.name, "address": host.device.vpn_address, "port": REFLECTOR_PORT}
    return Configuration(
        files=(
            File(PROGRAM, environment().get_template("gateway/reflector.py").render()),
            File(_UNIT, environment().get_template("gateway/reflector.service.j2").render(values)),
        ),
        steps=(taken_away,),
        units=(Unit(SERVICE, enabled=True, active=True, after=(_UNIT, PROGRAM)),),
        checks=(
            Check(
                ("sh", "-c", HOLDS_PORT, "sh", SERVICE, "u", str(REFLECTOR_PORT)),
                f"nothing answers the checklists of other sites at UDP port {REFLECTOR_PORT}",
                f"on the computer: `systemctl status {SERVICE}` and `journalctl -eu {SERVICE}` tell why",
            ),
        ),
    )
