"""SSH access to a gateway computer: testinfra over OpenSSH, one connection, with its host key pinned before."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from testinfra.backend.ssh import SshBackend  # type: ignore[import-untyped] # it ships no types
from testinfra.host import Host as Testinfra  # type: ignore[import-untyped] # as above

from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.processes.remote_process import Carrier, ProcessResult
from atlantis_netcfg.operations.common.request import Request, refuse_examples
from atlantis_netcfg.operations.common.session_link import FAST_S, site_link_of
from atlantis_netcfg.operations.computers._access import key_trouble
from atlantis_netcfg.operations.computers.parts import ACCESS, PARTS

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, Inventory

_OPTIONS = (
    "BatchMode=yes",
    "Compression=yes",
    # A key that is not known is refused, and one that has changed: see `provision device trust`.
    "StrictHostKeyChecking=yes",
    # As long as a satellite may be silent, and longer: see ansible.cfg.
    "ServerAliveInterval=20",
    "ServerAliveCountMax=6",
)
_CONNECT_S, _CONNECT_SLOWLY_S = 15, 120
_GRACE_S, _GRACE_SLOWLY_S = 30.0, 270.0
"""Time to connect, to send and to receive the last response; over a slow link each may have a gap of 70 s."""


class GatewayUnreachable(NetcfgError):
    """The gateway could not be reached, so nothing is known of it."""


class _SshBackend(SshBackend):  # type: ignore[misc] # testinfra ships no types
    """Builds OpenSSH's command as testinfra does, and lets a carrier run it."""

    def __init__(self, carrier: Carrier, spec: str, **how: Any) -> None:  # noqa: ANN401 - as testinfra has it
        super().__init__(spec, **how)
        self.carrier = carrier
        self.ended: ProcessResult | None = None

    def run_local(self, command: str, *args: str) -> Any:  # noqa: ANN401 - testinfra's result
        """Run ssh directly, without a local shell."""
        argv = shlex.split(self.quote(command, *args))
        self.ended = self.carrier.run(argv)
        # Text, as testinfra would otherwise ask the computer for its encoding, which is one more connection.
        out, err = (data.decode(errors="replace") for data in (self.ended.out, self.ended.err))
        return self.result(self.ended.rc, command.encode(), out, err)


@dataclass(frozen=True, slots=True)
class GatewayAccess:
    """SSH parameters of a gateway."""

    name: str
    spec: str
    login: str
    """Arguments that a person types after `ssh`."""
    ssh_config: str | None
    options: str
    connect_s: int
    grace_s: float
    """Time that the route may take beyond what the computer itself needs."""
    sudo: bool

    def run(self, command: str, *words: str, carrier: Carrier | None = None) -> ProcessResult:
        """Run a command as root, in one connection; quoted arguments replace `%s`. Raises GatewayUnreachable."""
        backend = _SshBackend(
            carrier or Carrier(),
            self.spec,
            ssh_config=self.ssh_config,
            ssh_extra_args=self.options,
            timeout=self.connect_s,
            controlpersist=0,
            sudo=self.sudo,
        )
        try:
            Testinfra(backend).run(command, *words)
        except RuntimeError as error:
            raise self._not_reached(str(getattr(error.args[0], "stderr", error)).strip(), backend.ended) from None
        except OSError as error:
            raise GatewayUnreachable(
                f"{arg(self.name)} is unreachable: {arg(error)}", hint="install the OpenSSH client"
            ) from None
        assert backend.ended is not None  # noqa: S101 - it has just run
        return backend.ended

    def _not_reached(self, text: str, result: ProcessResult | None) -> GatewayUnreachable:
        hint = "check its power and its cable, then run the same command again"
        if "Permission denied" in text:
            hint = msg(f"install your key there: `ssh-copy-id {arg(self.login)}`")
        elif (trouble := key_trouble(self.name, text)) is not None:
            text, hint = trouble
        silent = "no response in time" if result is not None and result.overdue else "ssh said nothing"
        return GatewayUnreachable(
            f"{arg(self.name)} is unreachable: {(arg(text.splitlines()[-1] if text else silent))}", hint=hint
        )


def way_in(inventory: Inventory, host: Host, request: Request, ssh_config: str | None = None) -> GatewayAccess:
    """Return the SSH access to a gateway. Raises GatewayUnreachable: example values, or a rehearsal without it.

    `ssh_config`: OpenSSH configuration file for the host's name, instead of the address in the inventory.
    """
    try:
        refuse_examples(inventory, is_rehearsal=request.rehearsed or ssh_config is not None)
        access = PARTS[ACCESS](inventory, host, request)
        slow = site_link_of(inventory, host, request.via.get(host.name)).rtt_s >= FAST_S
    except UsageError as error:
        raise GatewayUnreachable(str(error), hint=error.hint) from None
    if request.rehearsed and host.name not in request.targets:
        raise GatewayUnreachable(f"{arg(host.name)} is not emulated in this rehearsal")
    # ssh takes the first value of an option: what the access says comes after ours.
    options = [*(f"-o {option}" for option in _OPTIONS), access["ssh_args"]]
    return GatewayAccess(
        name=host.name,
        spec=host.name if ssh_config else f"{access['user']}@{access['host']}:{access['port']}",
        login=host.name if ssh_config else f"-p {access['port']} {access['user']}@{access['host']}",
        ssh_config=ssh_config,
        options=" ".join(options),
        connect_s=_CONNECT_SLOWLY_S if slow else _CONNECT_S,
        grace_s=_GRACE_SLOWLY_S if slow else _GRACE_S,
        sudo=bool(access["become"]),
    )
