"""`provision inventory doctor`: check whether this laptop is ready for a site, and what to type if not."""

from __future__ import annotations

import sys
import textwrap
from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.core.printable import Row, StyledText
    from atlantis_netcfg.operations.doctor import Diagnosis, DoctorItem

DOCTOR = syntax.CommandSpec(
    "inventory doctor",
    "check whether this laptop is ready for a site",
    words=(
        syntax.Word("site", "also check the connection to this site's router", example="coastal"),
        syntax.VIA,
        syntax.INVENTORY,
    ),
    flags=(syntax.ASK_VAULT_PASS, syntax.JSON),
    details=(
        "Nothing is changed on this laptop or elsewhere, and no password is sent. As with every command, "
        "leftovers of killed commands are removed.\nWith `site=` the site's router is contacted if it is reached "
        "over the right link and that link is not metered: one TLS connection to check its certificate, without "
        "login. Encrypted values of the inventory are decrypted once, so the vault password may be needed; they "
        "are never shown.\nExit code 0: no check failed, 6: a check failed or was not possible.\nWarnings alone "
        "also end with 0, and the last lines show them."
    ),
)

_WIDTH = 80
_WORD = 4
"""Columns of a verdict; INCONCLUSIVE is longer."""
_LABEL = 5
"""Columns of `do:` and `type:`."""
_NAME = 19
"""Columns of an item's name; a longer one has a line of its own."""


def run_doctor(arguments: syntax.Arguments) -> ExitCode:
    """Run `inventory doctor`: check and report."""
    from atlantis_netcfg.core import paths, printable

    try:
        from atlantis_netcfg.cli.base.passphrase import vault_of
        from atlantis_netcfg.operations.doctor import examine
    except ImportError as error:
        _refuse_drift(error)
        raise
    diagnosis = examine(
        paths.inventory_folder(arguments.optional("inventory")),
        arguments.optional("site"),
        via=arguments.optional("via"),
        decrypt=vault_of(arguments).decrypt,
    )
    if arguments.flag("json"):
        print(json_text(diagnosis.as_json()))
    else:
        printable.show(_rows(diagnosis, arguments), sys.stdout)
    return diagnosis.exit


def _refuse_drift(error: ImportError) -> None:
    """Raise UsageError where a package that this command itself needs is missing from `.venv`, or is another one."""
    from atlantis_netcfg.core import packages, paths
    from atlantis_netcfg.core.errors import UsageError

    if wrong := packages.drift_of(paths.checkout()):
        raise UsageError(
            f"the packages in .venv differ from the pinned versions: {arg(packages.summarise(wrong))}",
            hint=(
                f"run `{arg(packages.RESTORE)}` in {arg(paths.checkout())}; the next start reinstalls them from the "
                "package index"
            ),
        ) from error


def _rows(diagnosis: Diagnosis, arguments: syntax.Arguments) -> Iterator[Row]:
    from atlantis_netcfg import __version__
    from atlantis_netcfg.core.language import translate
    from atlantis_netcfg.core.printable import Style, StyledText
    from atlantis_netcfg.operations.doctor import DoctorSection

    yield translate(f"provision {arg(__version__)} checks this laptop (read-only)")
    for section in DoctorSection:
        if items := [item for item in diagnosis.items if item.section is section]:
            yield StyledText(translate(section.value), Style.TITLE)
            for item in items:
                yield from _item_rows(item, arguments)
    yield ""
    yield from _end(diagnosis, arguments)


def _verdict(item: DoctorItem) -> StyledText:
    from atlantis_netcfg.core.events import Verdict
    from atlantis_netcfg.core.printable import Style, StyledText

    styles = {Verdict.PASS: Style.GOOD, Verdict.SKIP: Style.QUIET, Verdict.WARN: Style.WARNING}
    return StyledText(f"{item.verdict:<{_WORD}}", styles.get(item.verdict, Style.BAD))


def _item_rows(item: DoctorItem, arguments: syntax.Arguments) -> Iterator[Row]:
    from atlantis_netcfg.core.language import translate

    name = translate(item.name)
    column = 2 + _WORD + 1 + _NAME + 1
    first, *more = _wrap(translate(item.observation), column)
    if len(name) > _NAME or len(item.verdict) > _WORD:
        yield "  ", _verdict(item), f" {name}"
        more = [first, *more]
    else:
        yield "  ", _verdict(item), f" {name:<{_NAME}} {first}"
    for line in more:
        yield f"{'':<{column}}{line}"
    word = translate("do:")
    for line in _wrap(translate(item.hint), 7 + _LABEL + 1) if item.hint else ():
        yield f"{'':<7}{word:<{_LABEL}} {line}"
        word = ""
    for command in _complete_commands(item.commands, arguments):
        yield f"{'':<7}{translate('type:'):<{_LABEL}} {command}"


def _wrap(text: str, column: int) -> list[str]:
    """Wrap text at a column, without breaking paths or names."""
    return textwrap.wrap(text, _WIDTH - column, break_long_words=False, break_on_hyphens=False) or [""]


def _complete_commands(commands: tuple[str, ...], arguments: syntax.Arguments) -> list[str]:
    """Complete commands so that they can be typed: with this command's arguments and the launcher's name."""
    from atlantis_netcfg.cli.base.output import as_typed, carried_words

    words = carried_words(arguments)
    return [as_typed(f"`{each}`", words).strip("`") for each in commands]


def _end(diagnosis: Diagnosis, arguments: syntax.Arguments) -> Iterator[Row]:
    """Yield the last lines: verdict, counts, the worst item, what to type."""
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.core.language import translate
    from atlantis_netcfg.core.printable import Style, StyledText

    worst = diagnosis.worst_item
    counts = join(", ", (f"{number} {verdict}" for verdict, number in diagnosis.counts.items()))
    style = _verdict(worst).style if worst is not None else Style.GOOD
    yield StyledText(str(diagnosis.verdict), style), msg(f": {arg(counts)}")
    if worst is not None:
        yield from _wrap(f"{translate('worst:')} {translate(worst.name)}: {translate(worst.observation)}", 0)
        yield from _wrap(f"{translate('next:')}  {translate(worst.hint)}", 0) if worst.hint else ()
        for command in _complete_commands(worst.commands, arguments):
            yield f"{translate('type:')}  {command}"
    if diagnosis.exit is ExitCode.DONE and diagnosis.follows:
        word = translate("type:") if worst is None else translate("then:")
        yield msg(f"{arg(word)}  {arg(_complete_commands((diagnosis.follows,), arguments)[0])}")
