"""What a RutOS unit is set to: read over SSH, and put into the words of the journal, without what is secret."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.lte import rutos_settings
from atlantis_netcfg.journal import PlannedAction

if TYPE_CHECKING:
    from atlantis_netcfg.bearers.lte.rutos_settings import Change
    from atlantis_netcfg.console.ssh import Commands

__all__ = ["LAYER", "masked", "planned_action", "sections_of"]

LAYER = "uci"
_TOUCHED = ("proto", "sim", "apn", "auto_apn", "auth", "username", "position", "deny_roaming")
_SECRET = ("password", "pincode")


def sections_of(shell: Commands) -> dict[tuple[str, str], dict[str, str]]:
    """The unit's configuration, by package and section. Raises SettingRefused, ConsoleLost."""
    end = shell.run(rutos_settings.SHOW)
    if end.code:
        said = (end.error.strip() or f"exit status {end.code}").splitlines()[0]
        raise rutos_settings.SettingRefused(
            f"the unit's configuration cannot be read over SSH: {said}",
            hint="is `admin_user` one who may log in over SSH, and is this a Teltonika unit?",
        )
    return rutos_settings.parse_show(end.out)


def masked(sections: dict[tuple[str, str], dict[str, str]]) -> str:
    """The configuration of before as far as a run may change it, secrets masked; other people's stands beside it."""
    return "".join(
        f"{package}.{section}.{option}='{'********' if option in _SECRET else value}'\n"
        for (package, section), options in sections.items()
        for option, value in options.items()
        if option in (*_TOUCHED, *_SECRET)
    )


def planned_action(number: int, one: Change) -> PlannedAction:
    """One setting as the journal holds it."""
    value = "********" if one.secret else one.value
    return PlannedAction(
        number=number,
        layer=LAYER,
        menu=f"{one.package}.{one.section}",
        verb="set",
        subject=one.option,
        values=((one.option, value),),
    )
