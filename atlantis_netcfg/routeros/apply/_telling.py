"""What a run says at its end and of its plan, the same for one device and for the two ends of a bridge."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from atlantis_netcfg.core.secret import MASK
from atlantis_netcfg.journal import JournalFailed, Outcome, PlannedAction, conclude, unrecorded
from atlantis_netcfg.routeros import snapshot

if TYPE_CHECKING:
    from collections.abc import Iterable

    from atlantis_netcfg.routeros._types import Action, Observed, Plan
    from atlantis_netcfg.routeros.apply._job import DeviceJob, DeviceResult

AGREE_APART = (
    "`--plan` shows them; to let them go, type the same with `--remove-foreign` (plain Ansible: with "
    "`-e atlantis_remove_foreign=true`), for `--yes` does not say that"
)


def unagreed(job: DeviceJob, plan: Plan) -> str:
    """Return why the plan needs a person's word of its own, and has none; empty: it may go on."""
    return "" if job.remove_foreign or not plan.foreign_words else f"nobody has agreed that it {plan.foreign_words}"


def number_of(plan: Plan) -> str:
    """Say how much a plan does: actions, and rows where one action is about several."""
    number, rows = len(plan.actions), plan.weight
    words = f"{number} action{'s' if number != 1 else ''}"
    return words if rows == number else f"{words} on {rows} rows"


def planned(action: Action) -> PlannedAction:
    """Write an action for the journal, secrets masked."""
    return PlannedAction(
        number=action.number,
        layer=action.layer.name.lower(),
        menu=action.menu,
        verb=action.verb.value,
        subject=action.subject,
        ids=action.ids,
        values=action.shown(),
    )


def cleaned(text: str, actions: Iterable[Action]) -> str:
    """Mask secrets of a plan in a text of the device, should it ever repeat one."""
    for action in actions:
        for name, value in action.values:
            if name in action.secrets and value:
                text = text.replace(value, MASK)
    return text


def ended(job: DeviceJob, result: DeviceResult, read: Observed | None) -> DeviceResult:
    """Record the outcome, and keep what was `read` back for drift to be dated by and for a replacement.

    A journal that cannot be written is said in the result, which is not green then.
    """
    outcome = Outcome(
        device=result.name,
        status=result.status,
        exit=int(result.exit),
        message=result.message,
        open=result.left_open,
    )
    if read is not None:
        try:
            job.journal.confirm(job.name, partial(_state, job, read))
        except JournalFailed as failure:
            # The state is missing for drift and for a replacement; the outcome itself may still be recorded.
            if str(failure) not in result.message:
                result = replace(result, notes=(*result.notes, str(failure)))
    return unrecorded(result, conclude(job.journal, outcome))


def _state(job: DeviceJob, read: Observed) -> str:
    """Write the state as text; the device has ended well, and a fault of ours in here must not say otherwise."""
    try:
        return snapshot.write(job.name, job.desired, read)
    except Exception as fault:
        why = f"provision itself failed ({type(fault).__name__})"
        raise JournalFailed(f"the confirmed state cannot be written: {why}") from fault
