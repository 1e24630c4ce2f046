"""`provision verify`: which assumptions about RouterOS hold on a device."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import ACCEPT_COST, ASK_VAULT_PASS, INVENTORY, JSON, VIA, Command, Flag, Word

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.cli._session import Session
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.verifying import Verified, Verifying

COMMAND = Command(
    "verify",
    "show which assumptions about RouterOS hold on a device, with evidence",
    words=(
        Word("device", "the RouterOS device", required=True, example="coastal-router"),
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("try", "also what needs a write: scratch rows under safe mode, taken back at once"),
        Flag("silence", "also what takes ten minutes: a session that holds safe mode and falls silent"),
        Flag("rehearse", "the same with the emulated device", harmless=True),
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details=(
        "Without `--try` the device is only read. The report is also written to a file that can be sent back. Exit "
        "code 0: what was shown holds, 6: something does not hold or gave no usable answer, 7: nothing was shown."
    ),
    changes=True,
    again="type the same again: scratch rows go with their session, by the safe mode of the device",
)


def run(arguments: Arguments) -> ExitCode:
    """Ask what it may cost, ask the device, tell."""
    import json

    from atlantis_netcfg.cli._progress import progress
    from atlantis_netcfg.cli._session import session
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.request import refuse_examples
    from atlantis_netcfg.operations.verifying import Verifying, written

    name = arguments.word("device")
    silence = arguments.flag("silence") and not arguments.flag("rehearse")
    _check_privilege(silence=silence)
    found: list[Host] = []

    def chosen(declaration: Declaration) -> tuple[Host, ...]:
        found.append(_host(declaration, name))
        return tuple(found)

    with session(
        arguments, rehearse=arguments.flag("rehearse"), via=arguments.optional("via"), site="", chosen=chosen
    ) as opened:
        (host,) = found
        opened.site = host.site
        refuse_examples(opened.declaration, rehearsed=opened.rehearsed)
        with progress(quiet=opened.as_json) as notify:
            verifying = Verifying(
                opened.declaration,
                host,
                opened.request(Mode.DRIFT),
                notify,
                tries=arguments.flag("try"),
                silence=silence,
            )
            _pay(opened, verifying)
            verified = _verified(opened, verifying)
        # What an emulated device does is no news to anybody.
        result = verified if opened.rehearsed else written(verified, opened.state)
    print(json.dumps(result.as_json(), ensure_ascii=False) if opened.as_json else result.as_text())
    return result.exit


def _check_privilege(*, silence: bool) -> None:
    """Refuse before any device is asked. Raises UsageError."""
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.routeros.api import may_cut_off

    if silence and not may_cut_off():
        raise UsageError(
            "`--silence`: this computer lets only root make a connection fall silent; no device was contacted",
            hint="type the same with `sudo`, or without `--silence`",
        )


def _host(declaration: Declaration, name: str) -> Host:
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.core.suggest import nearest
    from atlantis_netcfg.operations.kinds import handled

    if name in declaration.hosts:
        host = declaration.hosts[name]
        if not handled(host):
            raise UsageError(f"{name} is a {host.device.kind.replace('_', ' ')}, and no RouterOS device")
        return host
    near = nearest(name, declaration.hosts)
    raise UsageError(
        f"no device is called `{name}`",
        hint=f"did you mean `device={near}`?" if near else f"there are: {', '.join(declaration.hosts)}",
    )


def _verified(opened: Session, verifying: Verifying) -> Verified:
    """Ask; where rows are added nobody else may work at the site meanwhile."""
    if not (verifying.tries or verifying.silence):
        return verifying.run()
    with opened.store.lock(opened.site, f"provision verify device={verifying.host.name} --try"):
        return verifying.run()


def _pay(opened: Session, verifying: Verifying) -> None:
    """Tell what it costs where that is paid by the byte. Raises CostRefused; a rehearsal costs nothing."""
    from atlantis_netcfg.cli._consent import pay

    cost = verifying.cost
    if opened.rehearsed or not cost.link.metered:
        return
    if cost.over_cap:
        raise cost.refusal()
    pay([cost.words], accepted=opened.arguments.flag(ACCEPT_COST.name), as_json=opened.as_json)
