"""Changing a device: save its state, take safe mode, write, verify in a new session, release.

Any failure is raised; `_settle` then finds out the state of the device.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from atlantis_netcfg import runs
from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.events import Stage
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros import _types, api, pin, safe_mode, scheduler_jobs, snapshot
from atlantis_netcfg.routeros.apply import _protection, _state
from atlantis_netcfg.routeros.apply._writer import ActionError, Writer
from atlantis_netcfg.routeros.link_use import ROUTES
from atlantis_netcfg.routeros.menus import MENUS
from atlantis_netcfg.routeros.observe import (
    CERTIFICATES,
    HISTORY,
    LATER,
    LEAVES,
    counting_rows,
    final_reads,
    merge_menus,
    modem_row,
    number_of_rows,
    observe,
    printing,
    read_back,
    read_counts,
)
from atlantis_netcfg.routeros.planner import CannotPlan, plan

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from atlantis_netcfg.routeros.api._values import Channel
    from atlantis_netcfg.routeros.apply._work import RunContext


_COUNT = api.Command("/system/history/print", (("count-only", ""),))
_ACTIONS = api.Command("/system/history/print", ((".proplist", "action"),))
_READS_FILES = Version(7, 13)
_SIGN_S = 1800.0
_SHOWN_HANDS = 5


async def begin(work: RunContext) -> Writer:
    """Do all steps before the first change. Raises DeviceError if another run is working on the device.

    Two laptops may have read the same device at the same time. The second one finds the other's run marker, or safe
    mode taken, or the device changed since it was read; then it sends nothing.
    """
    stages, protection = work.stages, work.protection
    alone = safe_mode_first(work)
    early = work.early if work.holding and not needs_run_marker(work) else ()
    if alone and work.holding:
        _record_protection(work)
    elif alone:
        await take_safe_mode(work)
    sign = [_state.claim(work.signer.text, _marker_lifetime_s(work))] if needs_run_marker(work) else []
    if sign:
        work.record(runs.SignRecord(device=work.job.name, sign=work.signer.text))
    questions = [*sign, *_state.SAVING, _ACTIONS, _state.CLAIMS] if sign else BEFORE
    answers = early or await work.channel.flight([*questions, *(() if alone else work.safe_mode.beside)])
    await asyncio.sleep(0)  # whoever has stopped the run meanwhile is heard before anything is written
    export, probe, history, claims, *holder_replies = answers[len(sign) :]
    if sign:
        work.sign = await _state.confirm_claim(work.channel, sign[0], answers[0], claims.rows, work.signer)
    saved_export = _state.parse_export(export, probe)
    text = (
        saved_export.text
        if saved_export.text is not None
        else await _state.fetch(work.channel, partial(_as_read, work))
    )
    work.job.journal.save(work.job.name, text)
    if not work.restores:
        _require_no_other_session(work, claims, work.safe_mode.read_holder(holder_replies) if holder_replies else None)
        if not (protection is _protection.Protection.SAFE_MODE and _is_untouched(work, history)):
            await _recheck_state(work)
        # Only now: the job would take back to what was read, which has to be what is there.
        await _arm(work)
        if protection is _protection.Protection.CONSOLE and not stages.prepare:
            await take_safe_mode(work)
    return saved_export.writer


BEFORE = (*_state.SAVING, _COUNT, _state.CLAIMS)
"""Requests before the first change of a run without a run marker."""


def needs_run_marker(work: RunContext) -> bool:
    """Return True if anything is written while safe mode is not held, which requires a run marker."""
    stages = work.stages
    return not work.restores and not (safe_mode_first(work) and len(stages.pieces) == 1 and not stages.finish)


def _as_read(work: RunContext) -> str:
    """Build a snapshot from the rows that were read, for a device that cannot export its configuration."""
    if work.observation.facts.version >= _READS_FILES:
        raise DeviceError("cannot save the state before the change, so nothing is changed")
    work.notes.append("the device cannot export its configuration: the rows that were read are saved instead")
    return snapshot.write(work.job.name, _state.restore_target(work.observation), work.observation)


def _marker_lifetime_s(work: RunContext) -> float:
    """Return the lifetime of the run marker: longer than the dead-man job waits and the run may take."""
    return max(_SIGN_S, 2 * (work.choice.dead_man_s or 0.0))


def safe_mode_first(work: RunContext) -> bool:
    """Return True if safe mode is taken before any write, that is, no harmless addition precedes it."""
    return work.protection is _protection.Protection.SAFE_MODE and not work.stages.prepare


async def take_safe_mode(work: RunContext) -> None:
    """Take safe mode. Raises DeviceError if somebody else holds it afterwards."""
    work.holding = True
    try:
        holder = await work.safe_mode.take(work.channel)
    except safe_mode.SafeModeUnavailable:
        work.holding = False
        raise
    work.owner = holder.who
    _record_protection(work)


def _record_protection(work: RunContext) -> None:
    work.record(runs.ProtectionRecord(device=work.job.name, how=work.choice.value))
    work.say(Stage.PROTECTED, "safe mode is active: the device undoes the changes if the session is lost")


def _require_no_other_session(work: RunContext, claims: api.Reply, holder: safe_mode.Holder | None) -> None:
    other = work.signer.other(_state.parse_markers(claims.rows))
    if other is not None:
        raise _state.claim_conflict(other, work.job.site)
    if holder is not None and holder.is_taken and not holder.ours:
        raise safe_mode.holder_error(holder.who)


async def _arm(work: RunContext) -> None:
    """Arm the dead-man job if one is planned; if the device does not run it, safe mode alone is sufficient."""
    after_s, script = work.choice.dead_man_s, work.script
    if after_s is None or script is None:
        return
    now = asyncio.get_running_loop().time()
    # From here on the job may be there, whatever becomes of this session.
    work.dead_man = scheduler_jobs.DeadMan("", now, after_s)
    try:
        work.dead_man = await scheduler_jobs.arm_dead_man(work.channel, script, work.signer.text, after_s, now)
    except scheduler_jobs.WillNotRun as problem:
        work.dead_man = None
        if work.protection is not _protection.Protection.CONSOLE:
            raise
        work.choice = _protection.ProtectionChoice(
            _protection.Protection.CONSOLE, None, msg(f"no dead-man job: {arg(problem)}")
        )
        work.notes.append(msg(f"no dead-man job: {arg(problem)}"))
        return
    work.say(
        Stage.PROTECTED,
        msg(f"a dead-man job is armed: the device rolls everything back in {arg(after_s / 60):.0f} min"),
    )
    if work.protection is _protection.Protection.DEAD_MAN:
        work.record(runs.ProtectionRecord(device=work.job.name, how=work.choice.value))


def _is_untouched(work: RunContext, history: api.Reply) -> bool:
    """Return True if nothing was changed since the device was read, judged by the length of its history."""
    known_length = work.observation.facts.history
    if known_length >= HISTORY - 1:
        return False
    if history.ret is not None:
        return history.ret == str(known_length)
    newer = [row.get("action", "") for row in history.rows]
    return len(newer) == known_length or (
        len(newer) == known_length + 1 and any(map(_state.is_claiming, (newer[0], newer[-1])))
    )


async def _recheck_state(work: RunContext) -> None:
    """Read everything once more and require that it still matches the plan's basis.

    In a menu with very many rows, rows are only counted: over a satellite each thousand costs 94 kB. Limitation: a
    value that somebody sets there in these seconds is missed; if the plan touches the menu, it is read in full before
    the change becomes permanent.
    """
    rows = work.observation.rows
    long = [path for path in rows if len(rows[path]) > _types.FEW_FOREIGN]
    if long:
        now = await _read_and_count(work, long)
    else:
        now = await observe(work.channel, work.job.endpoint, work.job.desired_state.menus, tuple(rows))
    changed_menus = _state.differing_menus(work.observation, now, work.job.desired_state.run_time)
    if changed_menus:
        raise _protection.InterferenceError(
            f"somebody else has changed the device since it was read ({arg(join(', ', changed_menus[:_SHOWN_HANDS]))})",
            hint="run the same command again: it computes a new plan from the current state",
        )


async def _read_and_count(work: RunContext, long: Sequence[str]) -> _types.Observation:
    """Read all menus except `long`; of those count the rows, and read them only if the count has changed."""
    rows = work.observation.rows
    short = [path for path in rows if path not in long]
    replies = await work.channel.flight([*map(printing, short), *map(counting_rows, long)])
    # Our own sign is a row, too.
    known_counts = {path: len(rows[path]) + (path == _state.SIGNS and work.sign is not None) for path in long}
    numbers = zip(long, replies[len(short) :], strict=True)
    changed_menus = [path for path, reply in numbers if number_of_rows(reply) != known_counts[path]]
    now = merge_menus(work.observation, short, replies[: len(short)])
    return (
        merge_menus(now, changed_menus, await work.channel.flight([*map(printing, changed_menus)]))
        if changed_menus
        else now
    )


_LIST_LIMIT = 3


class VerificationError(DeviceError):
    """A new session did not find the desired state, or could not be opened: the change must be rolled back."""


async def change(work: RunContext) -> None:
    """Apply the plan; on return, everything was read back and is permanent."""
    writer = await begin(work)
    stages = work.stages
    if stages.prepare:
        await _write(work, writer, stages.prepare)
    holder: safe_mode.Holder | None = None
    for number, piece in enumerate(stages.pieces):
        if number:
            await _checkpoint(work, holder)
        if not work.holding:
            await take_safe_mode(work)
        holder = await _write(work, writer, piece)
    await verify(work, stages.finish)
    if work.holding:
        await _release(work, await _holder(work), last=not stages.finish and work.dead_man is None)
    await _confirm(work)
    if stages.finish:
        await _finish(work, writer)
    if farewell := work.marker_removal():
        await work.channel.flight(farewell)
        work.note_marker_removed(farewell)
    work.confirmed_count = len(work.aim.actions)
    work.record(
        runs.ActionConfirmation(device=work.job.name, actions=tuple(action.number for action in work.aim.actions))
    )


async def _write(work: RunContext, writer: Writer, actions: Sequence[_types.Action]) -> safe_mode.Holder | None:
    """Send actions in turns; each is journalled before it is sent and after it is acknowledged.

    Return who held safe mode at the end, if known from the same round trip.
    """
    holder: safe_mode.Holder | None = None
    for turn in writer.turns(actions):
        holder = work.safe_mode.read_holder(await _send(work, writer, turn, work.safe_mode.beside))
        if work.holding and holder is not None and not holder.ours:
            raise _lose_protection(work, holder)
    return holder


async def _send(
    work: RunContext, writer: Writer, turn: Sequence[_types.Action], beside: Sequence[api.Command] = ()
) -> tuple[api.Reply, ...]:
    """Send one turn; return the replies to `beside`."""
    if work.dead_man is not None and work.dead_man.is_near(asyncio.get_running_loop().time()):
        raise safe_mode.ProtectionLost("the change takes so long that the dead-man job is about to roll it back")
    layers = dict.fromkeys(action.layer.name.lower() for action in turn)
    numbers = tuple(dict.fromkeys(action.number for action in turn))
    work.record(runs.LayerSent(device=work.job.name, layer=" ".join(layers), actions=numbers))
    work.has_sent_changes = True
    write_result = await writer.send(work.channel, turn, beside)
    work.acknowledged_numbers.update(write_result.acknowledged_numbers)
    if write_result.refusal is not None:
        work.note(runs.ActionAcknowledgement(device=work.job.name, actions=write_result.acknowledged_numbers))
        raise ActionError(write_result.refusal)
    work.record(runs.ActionAcknowledgement(device=work.job.name, actions=write_result.acknowledged_numbers))
    layer_names = join(" ", map(msg, layers))
    work.say(
        Stage.APPLYING,
        msg(f"{arg(len(work.acknowledged_numbers))} of {arg(len(work.aim.actions))} sent ({arg(layer_names)})"),
    )
    return write_result.beside


def _lose_protection(work: RunContext, holder: safe_mode.Holder) -> safe_mode.ProtectionLost:
    work.holding = False
    who = msg(
        f"{arg(holder.who)} has taken over safe mode from us" if holder.is_taken else "we no longer hold safe mode"
    )
    return safe_mode.ProtectionLost(f"{arg(who)} in the middle of the change")


async def _checkpoint(work: RunContext, holder: safe_mode.Holder | None) -> None:
    """Make a part permanent when safe mode cannot record more; a new session proves that access still works.

    `holder` was read together with the part's last script; if not, it is requested.
    """
    session = await work.contact.reach(work.job.patience.verify_s, "checkpoint", insist=False)
    await work.contact.leave(session, wait=False)
    await _release(work, holder or await work.safe_mode.look(work.channel))
    try:
        await take_safe_mode(work)
    except safe_mode.SafeModeUnavailable as unavailable:
        await _take_later(work, unavailable)


async def _take_later(work: RunContext, current: safe_mode.SafeModeUnavailable) -> None:
    """Wait until a person's session that holds safe mode has ended; it must not have changed anything.

    Raises SafeModeUnavailable, InterferenceError.
    """
    holder = await work.contact.until_free(work.safe_mode, work.channel, work.job.patience.undo_s)
    if holder.is_taken and not holder.ours:
        raise current
    await take_safe_mode(work)
    now = await observe(work.channel, work.job.endpoint, work.job.desired_state.menus, tuple(work.observation.rows))
    try:
        _verify_against_plan(
            work, now, [each for each in work.aim.actions if each.number not in work.acknowledged_numbers]
        )
    except VerificationError as changed:
        raise _protection.InterferenceError(
            f"somebody else has changed the device between two parts of the change: {arg(changed)}"
        ) from changed


async def verify(work: RunContext, rest: Sequence[_types.Action]) -> None:
    """Read back in a new session; only `rest` may still differ. Raises VerificationError."""
    work.say(Stage.VERIFYING, "verifying in a new session")
    now = await _wait_for_pin_result(work, await _read_anew(work))
    _verify_against_plan(work, now, rest)
    await _wait_for_routes(work, now)
    work.after = now
    work.record(runs.VerificationRecord(device=work.job.name, state=_state.digest(now)))


async def _read_anew(work: RunContext) -> _types.Observation:
    patience, clock = work.job.patience, asyncio.get_running_loop().time
    until = clock() + patience.verify_s
    while True:
        try:
            session = await work.contact.reach(max(0.0, until - clock()), "verifying", insist=False)
            return await _read(work, session)
        except api.SessionLost as lost:
            if clock() >= until:
                raise VerificationError(f"no new session lasts long enough to read the device: {arg(lost)}") from lost
            await asyncio.sleep(patience.first_poll_s)
        except DeviceError as failed:
            raise VerificationError(f"cannot log in to the device again: {arg(failed)}", hint=failed.hint) from failed


async def _read(work: RunContext, session: Channel) -> _types.Observation:
    """Read the changed menus, and dependent ones where other menus may change or the old state is restored."""
    job, observation = work.job, work.observation
    touched_menus = tuple(dict.fromkeys(action.menu for action in work.aim.actions))
    if not work.restores and LEAVES.issuperset(touched_menus):
        return await read_back(session, job.endpoint, observation, touched_menus, job.counted_ports)
    retained_rows = {
        path: rows for path, rows in observation.rows.items() if path in LATER and path not in touched_menus
    }
    following = [path for path in observation.rows if path not in retained_rows]
    now = await observe(session, job.endpoint, job.desired_state.menus, following, job.counted_ports, observation.facts)
    return replace(now, rows={**retained_rows, **now.rows})


async def _wait_for_pin_result(work: RunContext, now: _types.Observation) -> _types.Observation:
    """Wait until the modem reports the result of a PIN, for which it restarts. Raises VerificationError."""
    patience, clock = work.job.patience, asyncio.get_running_loop().time
    until = clock() + patience.modem_s
    monitor = pin.monitor_of(now.rows.get(pin.LTE, ()))
    while pin.pending(work.job.desired_state, now):
        if clock() >= until:
            raise VerificationError(f"the modem did not accept the PIN within {arg(patience.modem_s):.0f} s")
        await asyncio.sleep(patience.first_poll_s)
        now = replace(now, modem=modem_row(await work.channel.command(monitor)))
    return now


async def _wait_for_routes(work: RunContext, now: _types.Observation) -> None:
    """Wait until the routes have the effect that the job expects, if it defines one. Raises VerificationError."""
    if work.job.shows is None:
        return
    clock = asyncio.get_running_loop().time
    until = clock() + work.job.patience.settle_s
    while why := work.job.shows(now):
        if clock() >= until:
            raise VerificationError(why)
        await asyncio.sleep(work.job.patience.first_poll_s)
        now = merge_menus(now, (ROUTES,), [await work.channel.command(printing(ROUTES))])


def _verify_against_plan(work: RunContext, now: _types.Observation, rest: Iterable[_types.Action]) -> None:
    try:
        second = plan(work.job.name, work.job.desired_state, now)
    except CannotPlan as problem:
        raise VerificationError(f"no plan can be made for the state that was read back: {arg(problem)}") from problem
    remaining_actions = Counter(map(_action_key, second.actions)) - Counter(map(_action_key, rest))
    if remaining_actions:
        names = [f"{verb} {subject}" for (_, verb, subject) in list(remaining_actions)[:_LIST_LIMIT]]
        more = msg(
            f" and {arg(len(remaining_actions) - _LIST_LIMIT)} more" if len(remaining_actions) > _LIST_LIMIT else ""
        )
        raise VerificationError(f"the device did not keep everything; still to do: {arg(join('; ', names))}{arg(more)}")
    unused_rows = [
        row for row in _state.find_invalid_rows(now) if row not in _state.find_invalid_rows(work.observation)
    ]
    if unused_rows:
        raise VerificationError(
            f"the device accepted these rows but does not use them: {arg(join('; ', unused_rows[:_LIST_LIMIT]))}"
        )


def _action_key(action: _types.Action) -> tuple[str, str, str]:
    return (action.menu, action.verb, action.subject)


async def _holder(work: RunContext) -> safe_mode.Holder:
    """Return the holder of safe mode, as seen by the new session; if unclear, ask in our session."""
    owner = work.after.facts.safe_mode_owner if work.after is not None else None
    if owner is not None and owner == work.owner:
        return safe_mode.Holder(is_taken=True, ours=True, who=owner)
    return await work.safe_mode.look(work.channel)


async def _release(work: RunContext, holder: safe_mode.Holder, *, last: bool = False) -> None:
    """Release safe mode, unless somebody has taken it from us or has undone its changes."""
    if not holder.ours:
        raise _lose_protection(work, holder)
    witness = _witness(work)
    work.record(runs.Releasing(device=work.job.name))
    farewell = work.marker_removal() if last else ()
    look = final_reads(work.job.counted_ports)
    reads = [each.command for each in witness]
    answers = await work.safe_mode.release(work.channel, [*reads, *look, *farewell])
    if look:
        work.last_look = read_counts(*answers[len(witness) : len(witness) + len(look)])
    answers = answers[: len(witness)]
    work.holding = False
    work.note_marker_removed(farewell)
    if not _are_changes_present(witness, answers):
        raise safe_mode.ProtectionLost("somebody undid the change before it was released")
    work.record(runs.ReleaseRecord(device=work.job.name))


async def _confirm(work: RunContext) -> None:
    """Remove the dead-man job; from then on the change is permanent."""
    if work.dead_man is None:
        return
    if work.protection is _protection.Protection.DEAD_MAN:
        work.record(runs.Releasing(device=work.job.name))
    witness = _witness(work)
    farewell = () if work.stages.finish else work.marker_removal()
    reads = [each.command for each in witness]
    in_time, answers = await scheduler_jobs.disarm(work.channel, work.dead_man.id, [*reads, *farewell])
    answers = answers[: len(witness)]
    work.dead_man = None
    work.note_marker_removed(farewell)
    if not in_time or not _are_changes_present(witness, answers):
        raise safe_mode.ProtectionLost("the dead-man job ran before it could be removed")
    if work.protection is _protection.Protection.DEAD_MAN:
        work.record(runs.ReleaseRecord(device=work.job.name))


@dataclass(frozen=True, slots=True)
class _Witness:
    """A menu, read together with the release, that would show if the last part had been undone."""

    menu: str
    after: _types.Observation
    is_counted: bool
    """The last part changed the number of rows, so that counting them is enough."""

    @property
    def command(self) -> api.Command:
        """The command that reads or counts the menu."""
        return counting_rows(self.menu) if self.is_counted else printing(self.menu)

    def is_change_present(self, reply: api.Reply) -> bool:
        """Return True if the change is still in place. Raises CommandError."""
        if self.is_counted:
            return number_of_rows(reply.check()) == len(self.after.rows[self.menu])
        return not _state.differing_menus(self.after, merge_menus(self.after, (self.menu,), (reply,)))


def _witness(work: RunContext) -> list[_Witness]:
    """Choose a menu of the last part as witness: one that need only be counted, else the shortest."""
    if work.after is None:
        return []
    after = work.after
    last = (*work.stages.pieces[-1:], work.stages.prepare)[0]
    row_changes: Counter[str] = Counter()
    for action in last:
        row_changes[action.menu] += {_types.Verb.ADD: 1, _types.Verb.REMOVE: -len(action.ids)}.get(action.verb, 0)
    # Whether a device counts by a query is not known; reading back gets on without that.
    plain = {menu for menu, rows in row_changes.items() if rows and not counting_rows(menu).queries}
    countable_menus = {menu for menu in plain if all(map(MENUS[menu].is_touchable, after.rows[menu]))}
    menu = min(row_changes, key=lambda menu: (menu not in countable_menus, len(after.rows[menu]), menu))
    return [_Witness(menu, after, menu in countable_menus)]


def _are_changes_present(witness: Sequence[_Witness], answers: Sequence[api.Reply]) -> bool:
    return all(each.is_change_present(reply) for each, reply in zip(witness, answers, strict=True))


async def _finish(work: RunContext, writer: Writer) -> None:
    """Send the actions that depend on rows verified first, and read the result back.

    Both replies come in one round trip. If rows are missing, the read may have been executed first, which proves
    nothing; then it is repeated.
    """
    observation = work.after or work.observation
    menus = tuple(dict.fromkeys(action.menu for action in work.stages.finish))
    answers: tuple[api.Reply, ...] = ()
    turns = list(writer.turns(work.stages.finish))
    for number, turn in enumerate(turns, start=1):
        farewell = work.marker_removal() if number == len(turns) else ()
        answers = await _send(work, writer, turn, (*map(printing, menus), *farewell))
        work.note_marker_removed(farewell)
    answers = answers[: len(menus)]
    work.after = merge_menus(observation, menus, answers)
    try:
        _verify_against_plan(work, work.after, ())
    except VerificationError:
        work.after = merge_menus(observation, menus, await work.channel.flight([printing(menu) for menu in menus]))
        _verify_against_plan(work, work.after, ())


POLICIES = ("read", "write", "policy", "test", "sensitive", "api")
"""Policies that our user's group needs: without `sensitive` a secret reads as empty, and would be written again."""

_TUNNEL = "/interface/ovpn-client"
_INSTALL = "type `provision vpn install device={}` first"
_NO_CERTIFICATE = ("", "none", "auto")
_FEATURES = {"/ip/proxy": "proxy", "/ip/socks": "socks", "/tool/bandwidth-server": "bandwidth-test"}
"""Menus that device-mode can forbid (manual, Device-mode), with the name of the feature."""


def find_missing_requirements(
    plan: _types.Plan, observation: _types.Observation, *, console: bool = False
) -> tuple[str, ...]:
    """Return everything that the device or our user lacks for this plan; `console`: protected by SSH safe mode.

    All missing items are reported together.
    """
    facts = observation.facts
    return (
        *_missing_policies(facts, (*POLICIES, "ssh") if console else POLICIES),
        *_missing_certificates(plan, observation),
        *_forbidden_features(plan, facts),
    )


def _missing_policies(facts: _types.Facts, required_policies: Sequence[str]) -> Iterator[str]:
    if not facts.policies:
        yield "the device does not show the permissions of our user: it must be a local user with policy `policy`"
        return
    lacking = [policy for policy in required_policies if policy not in facts.policies]
    if lacking:
        yield msg(f"our user lacks the permissions {arg(join(', ', lacking))}: its group needs these policies")


def _missing_certificates(plan: _types.Plan, observation: _types.Observation) -> Iterator[str]:
    if CERTIFICATES not in observation.rows:
        return
    there = {row.get("name") for row in observation.rows[CERTIFICATES]}
    for action in plan.actions:
        name = dict(action.values).get("certificate", "")
        if name not in _NO_CERTIFICATE and name not in there:
            needs = msg(f"{arg(MENUS[action.menu].title)} needs certificate {arg(name)}, which is not on the device")
            yield msg(
                f"{arg(needs)}: "
                f"{arg(msg(_INSTALL.format(arg(plan.device))) if action.menu == _TUNNEL else 'import it first')}"
            )


def _forbidden_features(plan: _types.Plan, facts: _types.Facts) -> Iterator[str]:
    for action in plan.actions:
        if (
            action.menu == scheduler_jobs.MENU
            and action.verb is not _types.Verb.REMOVE
            and (why := scheduler_jobs.forbidden(facts))
        ):
            yield msg(
                f"{arg(why)}, so the job {arg(action.subject)} would never run: allow it with /system device-mode "
                "update"
            )
        feature = _FEATURES.get(action.menu)
        is_enabled = dict(action.values).get("enabled") in ("yes", "true")
        if feature is not None and is_enabled and facts.device_mode.get(feature) in ("false", "no"):
            yield msg(
                f"device-mode {arg(facts.device_mode.get('mode', ''))} forbids {arg(feature)}: allow it with"
                f" /system device-mode update {arg(feature)}=yes and press the button"
            )
