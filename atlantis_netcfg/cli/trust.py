"""`provision trust`: who answers at the devices of a site, shown to a person who agrees or does not."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import INVENTORY, ONLY, Command, Word

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.operations.trust import Identity

COMMAND = Command(
    "trust",
    "show who answers at the devices of a site, and keep what you agree to",
    words=(Word("site", "the site", required=True, example="coastal"), ONLY, INVENTORY),
    details=(
        "Nobody is told a password: each device shows its certificate or its SSH host key, and you compare it with "
        "what the device prints on its own console. It needs a terminal. For other computers, and for AWX, declare it: "
        "`fingerprint` under `access`, `host_key` under `ssh` of a computer."
    ),
)


def run(arguments: Arguments) -> ExitCode:
    """Look at each device, ask where something is new, and keep the answers."""
    import sys

    from atlantis_netcfg.cli._vpn import declared
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.core.errors import NothingMatched, UsageError, worst
    from atlantis_netcfg.declaration import choose
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.operations.request import refuse_examples
    from atlantis_netcfg.operations.trust import has_identity

    declaration = declared(arguments)
    chosen = choose(declaration, arguments.word("site"), arguments.many("only"))
    hosts = [host for host in chosen if has_identity(host)]
    if not hosts:
        raise NothingMatched("nobody logs in to any of these devices: there is nothing to trust")
    refuse_examples(declaration, rehearsed=False)
    if not sys.stdin.isatty():
        raise UsageError(
            "nobody is here to agree to an identity, so nothing was trusted",
            hint="type the same on a terminal; or declare `fingerprint` under `access`, or `host_key` under `ssh`",
        )
    request = Request(state=paths.state_dir())
    return worst([_trust_device(declaration, host, request) for host in hosts])


def _trust_device(declaration: Declaration, host: Host, request: Request) -> ExitCode:
    """One device; what is wrong with it keeps no other from being looked at."""
    from atlantis_netcfg.cli._outcome import tell
    from atlantis_netcfg.core.errors import ExitCode, NetcfgError, worst
    from atlantis_netcfg.operations.computers._access import is_computer
    from atlantis_netcfg.operations.trust import identities

    try:
        if is_computer(host):
            return _computer(declaration, host, request)
        return worst([_device(identity, request) for identity in identities(declaration, host, request)])
    except NetcfgError as error:
        tell([error])
        return ExitCode.FAILED


def _device(identity: Identity, request: Request) -> ExitCode:
    from atlantis_netcfg.cli._consent import agreed
    from atlantis_netcfg.core.errors import DeviceFailed, ExitCode
    from atlantis_netcfg.operations.trust import agree

    shows = f"{identity.device}: its {identity.service} is {identity.seen}"
    if identity.known:
        print(f"{shows}, as {'declared' if identity.declared else 'agreed to before'}", flush=True)
        return ExitCode.DONE
    field = "fingerprint" if identity.service == "certificate" else "host_key"
    if identity.declared:
        raise DeviceFailed(
            f"{shows}, and the inventory declares {identity.declared}: nothing was trusted",
            hint=f"another device, a new certificate, or somebody in between; if it was renewed: change `{field}`",
        )
    print(f"{shows}; {f'agreed to before was {identity.pinned}' if identity.pinned else 'it was not seen before'}")
    print(f"  {identity.compare}", flush=True)
    agreed(f"Is this {identity.device}, and no other")
    agree(identity, request)
    print(f"kept on this computer; for all others declare `{field}: {identity.seen}` under its `access`", flush=True)
    return ExitCode.DONE


def _computer(declaration: Declaration, host: Host, request: Request) -> ExitCode:
    from atlantis_netcfg.core.errors import DeviceFailed, ExitCode
    from atlantis_netcfg.operations.trust import Computer, KeyState

    computer = Computer(declaration, host, request)
    state = computer.look()
    declared = getattr(host.device, "ssh", None)
    if state is not KeyState.KNOWN and declared is not None and declared.host_key is not None:
        raise DeviceFailed(
            f"{host.name} does not show the SSH host key that the inventory declares: nothing was trusted",
            hint="another computer, a new card, or somebody in between; if it was set up anew: change `host_key`",
        )
    if state is KeyState.CHANGED:
        raise DeviceFailed(
            f"{host.name} shows another SSH host key than before: nothing was trusted",
            hint=f"only if it is a new computer or a new card: `ssh-keygen -R {host.name}`, then type the same again",
        )
    if state is KeyState.UNKNOWN:
        print(f"{host.name}: OpenSSH shows its key; on the computer: ssh-keygen -lf /etc/ssh/ssh_host_ed25519_key.pub")
        computer.ask()
        if computer.look() is not KeyState.KNOWN:
            raise DeviceFailed(f"{host.name}: not agreed, so nothing was trusted")
    print(f"{host.name}: its SSH host key is known", flush=True)
    return ExitCode.DONE
