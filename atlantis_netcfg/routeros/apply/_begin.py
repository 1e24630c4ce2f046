"""Before the first change: the sign, the saved state, the net that takes everything back, and a last look.

Two laptops may have read the same device at the same time. Whoever comes second finds the other's sign, or safe mode
taken, or the device no longer as it was read; then nothing is sent.
"""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.core.events import Stage
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.journal import Protected, Signed
from atlantis_netcfg.routeros import snapshot
from atlantis_netcfg.routeros._types import FEW_FOREIGN
from atlantis_netcfg.routeros.api import Command
from atlantis_netcfg.routeros.apply._claim import CLAIMS, SIGNS, claim, claimed, claimed_by, is_claiming, signs
from atlantis_netcfg.routeros.apply._protection import Choice, Interfered, Protection
from atlantis_netcfg.routeros.apply._saving import SAVING, fetch, saved
from atlantis_netcfg.routeros.apply._state import differing, restoring
from atlantis_netcfg.routeros.observe import HISTORY, counting_rows, merged, number_of_rows, observe, printing
from atlantis_netcfg.routeros.safe_mode import Holder, SafeModeUnavailable, held_by
from atlantis_netcfg.routeros.scheduler_jobs import DeadMan, WillNotRun, arm_dead_man

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.routeros._types import Observed
    from atlantis_netcfg.routeros.api import Reply
    from atlantis_netcfg.routeros.apply._work import RunContext
    from atlantis_netcfg.routeros.apply._writer import Writer

_COUNT = Command("/system/history/print", (("count-only", ""),))
_ACTIONS = Command("/system/history/print", ((".proplist", "action"),))
_READS_FILES = Version(7, 13)
_SIGN_S = 1800.0
_SHOWN = 5


async def begin(work: RunContext) -> Writer:
    """Do all that comes before the first change. Raises DeviceFailed if somebody else was faster."""
    stages, protection = work.stages, work.protection
    alone = safe_mode_first(work)
    if alone and work.holding:
        _taken(work)
    elif alone:
        await take(work)
    signed = not work.restores and not (alone and len(stages.protected) == 1 and not stages.finish)
    sign = [claim(work.signer.text, _sign_s(work))] if signed else []
    if sign:
        work.record(Signed(device=work.job.name, sign=work.signer.text))
    look = () if alone else work.safe_mode.beside
    answers = await work.channel.flight([*sign, *SAVING, _ACTIONS if signed else _COUNT, CLAIMS, *look])
    export, probe, history, claims, *seen = answers[len(sign) :]
    if sign:
        work.sign = await claimed(work.channel, sign[0], answers[0], claims.rows, work.signer)
    found = saved(export, probe)
    text = found.text if found.text is not None else await fetch(work.channel, partial(_as_read, work))
    work.job.journal.save(work.job.name, text)
    if not work.restores:
        _nobody_else(work, claims, work.safe_mode.seen(seen) if seen else None)
        if not (protection is Protection.SAFE_MODE and _is_untouched(work, history)):
            await _look_again(work)
        # Only now: the job would take back to what was read, which has to be what is there.
        await _arm(work)
        if protection is Protection.CONSOLE and not stages.prepare:
            await take(work)
    return found.writer


def _as_read(work: RunContext) -> str:
    """Write down what was read, where the device cannot hand out its own export: the menus of this plan."""
    if work.seen.facts.version >= _READS_FILES:
        raise DeviceFailed("the state before the change cannot be saved, so nothing is changed")
    work.notes.append("the device cannot hand out its export: what was read of it is saved instead")
    return snapshot.write(work.job.name, restoring(work.seen), work.seen)


def _sign_s(work: RunContext) -> float:
    """Longer than the dead-man job waits, and than the run may take."""
    return max(_SIGN_S, 2 * (work.choice.dead_man_s or 0.0))


def safe_mode_first(work: RunContext) -> bool:
    """Tell whether safe mode is taken before anything is written: no harmless addition goes before it."""
    return work.protection is Protection.SAFE_MODE and not work.stages.prepare


async def take(work: RunContext) -> None:
    """Take safe mode. Raises DeviceFailed if it is not ours then."""
    work.holding = True
    try:
        holder = await work.safe_mode.take(work.channel)
    except SafeModeUnavailable:
        work.holding = False
        raise
    work.owner = holder.who
    _taken(work)


def _taken(work: RunContext) -> None:
    work.record(Protected(device=work.job.name, how=work.choice.value))
    work.say(Stage.PROTECTED, "safe mode is active: the device takes the changes back if the session is lost")


def _nobody_else(work: RunContext, claims: Reply, holder: Holder | None) -> None:
    other = work.signer.other(signs(claims.rows))
    if other is not None:
        raise claimed_by(other, work.job.site)
    if holder is not None and holder.taken and not holder.ours:
        raise held_by(holder.who)


async def _arm(work: RunContext) -> None:
    """Arm the dead-man job where one was planned; safe mode alone is enough where the device does not run it."""
    after_s, script = work.choice.dead_man_s, work.script
    if after_s is None or script is None:
        return
    now = asyncio.get_running_loop().time()
    # From here on the job may be there, whatever becomes of this session.
    work.dead_man = DeadMan("", now, after_s)
    try:
        work.dead_man = await arm_dead_man(work.channel, script, work.signer.text, after_s, now)
    except WillNotRun as problem:
        work.dead_man = None
        if work.protection is not Protection.CONSOLE:
            raise
        work.choice = Choice(Protection.CONSOLE, None, f"no dead-man job: {problem}")
        work.notes.append(f"no dead-man job: {problem}")
        return
    work.say(Stage.PROTECTED, f"a dead-man job is armed: the device takes everything back in {after_s / 60:.0f} min")
    if work.protection is Protection.DEAD_MAN:
        work.record(Protected(device=work.job.name, how=work.choice.value))


def _is_untouched(work: RunContext, history: Reply) -> bool:
    """Tell whether nobody has changed anything since the device was read, as far as the history's length can tell."""
    known = work.seen.facts.history
    if known >= HISTORY - 1:
        return False
    if history.ret is not None:
        return history.ret == str(known)
    newer = [row.get("action", "") for row in history.rows]
    return len(newer) == known or (len(newer) == known + 1 and any(map(is_claiming, (newer[0], newer[-1]))))


async def _look_again(work: RunContext) -> None:
    """Read everything once more: it has to be what the plan was made for.

    Of a menu with very many rows they are counted: over a satellite each thousand costs 94 kB. Given up: what somebody
    sets there in these seconds; where the plan touches the menu, it is read in full before anything becomes permanent.
    """
    rows = work.seen.rows
    long = [path for path in rows if len(rows[path]) > FEW_FOREIGN]
    if long:
        now = await _counted(work, long)
    else:
        now = await observe(work.channel, work.job.endpoint, work.job.desired.menus, tuple(rows))
    changed = differing(work.seen, now, work.job.desired.run_time)
    if changed:
        raise Interfered(
            f"somebody else has changed the device since it was read ({', '.join(changed[:_SHOWN])})",
            hint="run the same command again: it plans from what is there now",
        )


async def _counted(work: RunContext, long: Sequence[str]) -> Observed:
    """Read all menus but the `long` ones, whose rows are counted, and read where they have become more or fewer."""
    rows = work.seen.rows
    short = [path for path in rows if path not in long]
    replies = await work.channel.flight([*map(printing, short), *map(counting_rows, long)])
    # Our own sign is a row, too.
    known = {path: len(rows[path]) + (path == SIGNS and work.sign is not None) for path in long}
    numbers = zip(long, replies[len(short) :], strict=True)
    moved = [path for path, reply in numbers if number_of_rows(reply) != known[path]]
    now = merged(work.seen, short, replies[: len(short)])
    return merged(now, moved, await work.channel.flight([*map(printing, moved)])) if moved else now
