"""What stays on the computer: the program that takes a change back, and the units that start it."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING

from . import network_files, network_guard
from .network_guard import PENDING

if TYPE_CHECKING:
    from .network_files import Computer

__all__ = ["BACK", "BACK_TIMER", "FOLDER", "install", "program"]

FOLDER = "/usr/local/lib"
_PACKAGE = "atlantis_network"
BACK, BACK_TIMER = "atlantis-network-back.service", "atlantis-network-back.timer"
_BOOT = "atlantis-network-boot.service"
_UNITS = "/etc/systemd/system"


def program(verb: str) -> tuple[str, ...]:
    """What is started, in `FOLDER`."""
    return ("/usr/bin/python3", "-m", f"{_PACKAGE}.network_guard", verb)


_TEXTS = {
    BACK: f"""\
# Written by `provision`. Started by a timer while a change of the network waits for its confirmation.
[Unit]
Description=Take an unconfirmed change of the network back
ConditionPathExists={PENDING}
StartLimitIntervalSec=0

[Service]
Type=oneshot
WorkingDirectory={FOLDER}
ExecStart={" ".join(program("back"))}
Restart=on-failure
RestartSec=10
""",
    _BOOT: f"""\
# Written by `provision`. After a power cut: a change of the network that nobody has confirmed does not survive it.
[Unit]
Description=Take an unconfirmed change of the network back, before the network starts
DefaultDependencies=no
ConditionPathExists={PENDING}
RequiresMountsFor={PENDING} {FOLDER} /etc
After=local-fs.target systemd-remount-fs.service
Before=network-pre.target systemd-networkd.service networking.service NetworkManager.service shutdown.target
Wants=network-pre.target
Conflicts=shutdown.target

[Service]
Type=oneshot
WorkingDirectory={FOLDER}
ExecStart={" ".join(program("boot"))}

[Install]
WantedBy=multi-user.target
""",
}


def install(computer: Computer) -> None:
    """Bring program and units to this version; the one for the boot is enabled."""
    files = {f"{_UNITS}/{name}": text for name, text in _TEXTS.items()}
    for module in (network_files, network_guard):
        files[f"{FOLDER}/{_PACKAGE}/{module.__name__.rpartition('.')[2]}.py"] = inspect.getsource(module)
    for path, text in files.items():
        if computer.read(path) != text:
            computer.write(path, text, 0o644)
    computer.link(f"{_UNITS}/multi-user.target.wants/{_BOOT}", f"{_UNITS}/{_BOOT}")
    computer.run(("systemctl", "daemon-reload"))
