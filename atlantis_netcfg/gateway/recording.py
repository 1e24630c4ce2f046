"""The declared recording of a gateway: topics of ROS 2 as bags of rosbag2, in a folder that keeps within its budget.

The service lives as long as the VPN's interface, as the data gateway does. The packages' names are those of the
archives of ROS 2; no package of ROS was to be had here, so the real recorder has not been run by us.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.gateway.interop import ENVIRONMENT, VPN_INTERFACE
from atlantis_netcfg.gateway.parts import Check, Configuration, ConvergeStep, File, Unit, run_on
from atlantis_netcfg.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.declaration.model import Recording

SERVICE = "atlantis-recording.service"
USER = "svc-recording"
_PROGRAM = "/usr/local/lib/atlantis/recording.py"
_ACCOUNT = "/usr/lib/sysusers.d/atlantis-recording.conf"
_FOLDER = "/etc/tmpfiles.d/atlantis-recording.conf"
_UNIT = f"/etc/systemd/system/{SERVICE}"

_UP_OR_DOWN = f"""\
if [ -e {_UNIT} ]; then
    systemctl --quiet is-active sys-subsystem-net-devices-{VPN_INTERFACE}.device || exit 0
    exec systemctl --no-block start {SERVICE}
fi
rm -f /etc/systemd/system/*.wants/{SERVICE}
systemctl daemon-reload
exec systemctl stop {SERVICE}
"""
_RUNS_WITH_THE_VPN = f"""\
systemctl --quiet is-active sys-subsystem-net-devices-{VPN_INTERFACE}.device || exit 0
tries=0
while [ "$tries" -lt 30 ]; do
    if systemctl --quiet is-active {SERVICE}; then exit 0; fi
    tries=$((tries + 1))
    sleep 0.5
done
exit 1
"""


def packages(release: str) -> tuple[str, ...]:
    """What records; `ros-base` has it since Humble, and Foxy's has not."""
    return tuple(
        f"ros-{release}-{name}" for name in ("ros2bag", "rosbag2-transport", "rosbag2-storage-default-plugins")
    )


def recording(declared: Recording | None, release: str) -> Configuration:
    """Pure. None: what is taken away."""
    files = tuple(_files(declared, release)) if declared is not None else ()
    laid = {file.path for file in files}
    return Configuration(
        files=files,
        absent=tuple(path for path in (_UNIT, _PROGRAM, _ACCOUNT, _FOLDER) if path not in laid),
        steps=(
            ConvergeStep("make the recording's account", run_on(_ACCOUNT, "systemd-sysusers"), (_ACCOUNT,)),
            ConvergeStep("make the recording's folder", run_on(_FOLDER, "systemd-tmpfiles", "--create"), (_FOLDER,)),
            ConvergeStep("start the recording with the VPN, or take it away", ("sh", "-c", _UP_OR_DOWN), (_UNIT,)),
        ),
        units=(Unit(SERVICE, enabled=True, after=(_UNIT, _PROGRAM), wait=False),) if files else (),
        checks=_CHECKS if files else (),
    )


_CHECKS = (
    Check(
        ("sh", "-c", _RUNS_WITH_THE_VPN),
        "the recording does not run, though the VPN's interface is there",
        f"on the computer: `systemctl status {SERVICE}` and `journalctl -eu {SERVICE}` tell why",
    ),
)


def _files(declared: Recording, release: str) -> tuple[File, ...]:
    names = {"user": USER, "program": _PROGRAM, "environment": ENVIRONMENT, "interface": VPN_INTERFACE}
    unit = environment().get_template("gateway/recording.service.j2")
    return (
        File(_ACCOUNT, f'u {USER} - "ATLANTIS recording" {declared.folder}\n'),
        File(_FOLDER, f"d {declared.folder} 0750 {USER} {USER} -\n"),
        File(_PROGRAM, environment().get_template("gateway/recording.py").render()),
        File(_UNIT, unit.render(recording=declared, setup=f"/opt/ros/{release}/setup.sh", **names)),
    )
