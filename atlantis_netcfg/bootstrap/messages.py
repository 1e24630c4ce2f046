"""How first contact ends short of its goal, in words for a person beside the device."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from atlantis_netcfg.bootstrap._errors import CutOff, NotFactoryFresh, StillToMove
from atlantis_netcfg.bootstrap.classify import foreign
from atlantis_netcfg.console.types import ConsoleLost, HostKeyChanged, SafeModeHeld
from atlantis_netcfg.core.errors import DeviceFailed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.bootstrap._steps import Step
    from atlantis_netcfg.bootstrap.target import Facts, Wish
    from atlantis_netcfg.core.errors import NetcfgError

__all__ = ["cut_off", "not_fresh", "repeatable", "still_to_move"]


@contextmanager
def repeatable(wish: Wish) -> Iterator[None]:
    """Say of whatever breaks in that the same command goes on."""
    try:
        yield
    except ConsoleLost as lost:
        raise CutOff(
            f"{wish.name}: {lost}",
            hint="run the same command again: first contact goes on where it was cut",
        ) from lost
    except HostKeyChanged as changed:
        raise HostKeyChanged(
            f"{wish.name}: the SSH host key is not the one that was pinned at first contact; "
            f"pinned is {changed.pinned}, it showed {changed.seen}",
            pinned=changed.pinned,
            seen=changed.seen,
            hint="another device, or somebody in between: no password was sent to it\n"
            "if it is another box than before, or was reset on purpose: the same command with --replaced",
        ) from changed
    except SafeModeHeld as held:
        raise DeviceFailed(
            f"{wish.name}: somebody else holds safe mode on the device",
            hint="a session that was cut lets go after about 9 minutes; then run the same command again",
        ) from held


def cut_off(wish: Wish, step: Step, lost: ConsoleLost) -> CutOff:
    """Say at which step the connection was lost."""
    hint = "run the same command again: first contact goes on where it was cut"
    if step.key == "management":
        hint = (
            f"is the laptop plugged into {wish.port}? That port leaves the factory's network now: plug into "
            "another one (not the first, which is for the internet), wait up to 9 minutes until the router has "
            "taken the change back, then run the same command again"
        )
    return CutOff(f"{wish.name}: the connection was lost at: {step.title} ({lost})", hint=hint)


def not_fresh(wish: Wish, facts: Facts) -> NotFactoryFresh:
    """Say what somebody has configured, and how to take the device all the same."""
    found = foreign(facts, wish)
    rest = f", and {len(found) - 5} more" if len(found) > 5 else ""  # noqa: PLR2004 - what a person takes in
    return NotFactoryFresh(
        f"this device ({facts.board}) is not factory-fresh, so it was not touched; "
        f"somebody has configured: {', '.join(found[:5])}{rest}",
        hint="if it is really to become "
        f"{wish.name}: the same command with --take-over saves its export first, then goes on",
    )


def still_to_move(wish: Wish, error: NetcfgError) -> StillToMove:
    """Say where the laptop has to go."""
    return StillToMove(
        f"nobody answered at {wish.host} ({error}); the default configuration is still on the router, "
        f"which can be reached both ways",
        hint=f"plug the laptop into {wish.port}, give it the address {wish.laptop}, "
        "then run the same command again: it goes on from here",
    )
