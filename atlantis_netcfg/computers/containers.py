"""Containers: podman runs a service of the inventory from an archive, never from a registry.

Each container has a script that its systemd unit and the drift check call. The image is loaded from the archive with
the inventory's SHA-256, and its digest is stored: later runs must have the same digest. The container is a process of
its unit, so that systemd enforces its limits. Its root is read-only, it has no privileges, and it writes to one folder.
It shares the computer's network: the firewall decides who can reach a port.

Tried with podman 4.3.1 of Debian 12. Its engine is `crun`: `runc` moves a container out of the cgroups of its unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.computers import parts
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Address

FOLDER = "/etc/atlantis/containers"
"""Folder managed by this toolkit alone: a script for each container, and its environment."""
IMAGES = "/var/lib/atlantis/images"
"""Folder to which a person copies an archive, as SHA256.tar; a bundle on the computer is searched as well."""
PACKAGES = ("crun", "podman")
_BUNDLES = "/var/lib/atlantis/bundle"
_MISSING = 3
"""Exit code of `load` if the archive is missing: this is reported, and stops nothing else."""
_MB = 1_000_000
UNITS = tuple(
    parts.Unit(f"podman{name}", enabled=False, active=False)
    for name in ("-auto-update.timer", "-auto-update.service", "-restart.service", ".socket", ".service")
)
"""Units that Debian's podman starts: updates from a registry, and an API for any client. Neither is declared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PodmanContainer:
    """Values for the template of a container's script."""

    name: str
    """Name of its unit without the suffix, and of the podman container."""
    service: str
    """Declared name of the service."""
    archive: str
    sha256: str
    user: str
    """Account of this computer whose user and group ids it has inside."""
    arguments: str = ""
    volumes: tuple[str, ...] = ()
    variables: tuple[tuple[str, str], ...] = ()
    """Environment variables; the value of a secret is a placeholder."""
    env_files: tuple[str, ...] = ()
    """Files with environment variables that something else writes."""
    is_privileged: bool = False
    """Whether it listens at a privileged port."""
    topics: str = ""
    """Text of a topics file beside the script, which it can read."""
    master: IPv4Address | None = None
    """ROS 1: master to which it announces the address at which it is reached from there."""

    @property
    def script(self) -> str:
        """Path of the container's script."""
        return f"{FOLDER}/{self.name}"

    @property
    def environment(self) -> str:
        """Path of the container's environment file."""
        return f"{self.script}.env"

    @property
    def topics_file(self) -> str:
        """Path of the bridge's topics file, the same inside the container."""
        return f"{self.script}.yaml"

    def files(self) -> Iterator[parts.File]:
        """Yield the script, the environment (readable only by root) and the topics of a bridge."""
        names = {"images": IMAGES, "bundles": _BUNDLES, "missing": _MISSING}
        text = environment().get_template("gateway/container.sh.j2").render(container=self, **names)
        yield parts.File(self.script, text, mode="0755", validate=("sh", "-n", "%s"))
        if self.variables:
            yield parts.File(
                self.environment, "".join(f"{name}={value}\n" for name, value in self.variables), mode="0600"
            )
        if self.topics:
            yield parts.File(self.topics_file, self.topics)

    def step(self) -> parts.ConvergeStep:
        """Return the step that loads the image, if the archive is present."""
        run = ("sh", "-c", f'"$1" load || [ $? -eq {_MISSING} ]', "sh", self.script)
        return parts.ConvergeStep(msg(f"load the image of {arg(self.service)}"), run, (self.script,))

    def check(self) -> parts.Check:
        """Return the check that the container runs the image of the inventory."""
        return parts.Check(
            (self.script, "image"),
            msg(f"the service `{arg(self.service)}` does not run from the image of the inventory"),
            msg(
                f"its archive {arg(self.archive)} must be on the computer as {arg(IMAGES)}/{arg(self.sha256)}.tar, or "
                "in the bundle"
            ),
        )


def folder_budget_check(service: str, folder: str, budget_mb: int) -> parts.Check:
    """Return the check that a service's folder is not larger than its budget."""
    look = f'[ ! -d "$1" ] || [ "$(du -s -B {_MB} "$1" | cut -f 1)" -le "$2" ]'
    return parts.Check(
        ("sh", "-c", look, "sh", folder, str(budget_mb)),
        msg(f"the service `{arg(service)}` uses more than {arg(budget_mb)} MB in {arg(folder)}"),
        msg(f"on the computer: `du -sh {arg(folder)}`; remove what is not needed, or set another `budget_mb`"),
    )
