"""`provision plan apply`: apply a saved plan after review, and only that plan.

A saved plan is bound to the inventory (its revision) and to each device (the hash of the planned actions with the state
that they start from): when either has changed, the plan is rejected, and nothing is changed. A device already in the
planned state counts as done, so that a plan can be applied again after one device could not be reached.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.messages import arg

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Any

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.runs.report.run import RunReport

_FORMAT = "atlantis-plan-2"
_KEYS = {"format", "site", "only", "via", "offline", "rehearsed", "revision", "plans", "text", "sha256"}

APPLY = syntax.CommandSpec(
    "plan apply",
    "apply a saved plan, unless inventory or devices have changed",
    words=(
        syntax.Word(
            "file",
            "file written by `provision plan --save FILE`",
            is_required=True,
            example="coastal.plan",
            bare=True,
        ),
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("plan", "show the saved plan; no device is contacted", harmless=True),
        syntax.YES,
        *syntax.CHANGE,
    ),
    details=(
        "Site, devices and link come from the plan. The plan is refused if its file or the inventory has changed "
        "(exit code 3), or if a device has changed (exit code 4); a device that is already as planned counts as "
        "done. A plan of a rehearsal is applied in a rehearsal."
    ),
    changes=True,
    plays=True,
)


def run_apply(arguments: syntax.Arguments) -> ExitCode:
    """Run `plan apply`: read the plan, check that it is still valid, ask, apply, verify."""
    from pathlib import Path

    from atlantis_netcfg.cli.base.session import session

    file = Path(arguments.word("file"))
    plan = _read(file)
    if arguments.flag("plan"):
        return _show(plan, as_json=arguments.flag("json"))
    is_rehearsal, again = bool(plan["rehearsed"]), _command(plan, file)
    with session(
        arguments, rehearse=is_rehearsal, via=plan["via"], site=plan["site"], only=plan["only"]
    ) as site_session:
        if site_session.inventory.revision != plan["revision"]:
            raise UsageError(
                f"the inventory has changed since the plan in {arg(file)} was saved; no device was contacted",
                hint=f"make a new plan: `{arg(again)}`",
            )
        site_session.offline = Path(plan["offline"]) if plan["offline"] else None
        report = site_session.change(
            ask=not (is_rehearsal or arguments.flag("yes")), saved_plans=plan["plans"], again=again
        )
    return site_session.close(report)


def _show(plan: Mapping[str, Any], *, as_json: bool) -> ExitCode:
    from atlantis_netcfg.cli.base.output import json_text

    print(json_text({"exit": int(ExitCode.DONE), "errors": [], **plan}) if as_json else plan["text"].rstrip())
    return ExitCode.DONE


def _command(plan: Mapping[str, Any], file: Path) -> str:
    """Return the command that makes the plan again."""
    import shlex

    words = [f"site={plan['site']}"]
    words += [f"device={','.join(plan['only'])}"] if plan["only"] else []
    words += [f"via={plan['via']}"] if plan["via"] else []
    words += ["--offline", plan["offline"]] if plan["offline"] else []
    words += ["--rehearse"] if plan["rehearsed"] else []
    return shlex.join(["provision", "plan", *words, "--save", str(file)])


def refuse_place(file: Path) -> None:
    """Raise UsageError for an unusable output file, before a device is contacted."""
    if not file.parent.is_dir():
        raise UsageError(
            f"`--save {arg(file)}`: no such folder: {arg(file.parent)}", hint="give a file in an existing folder"
        )
    if file.exists() or file.is_symlink():
        try:
            _read(file)
        except UsageError as error:
            raise UsageError(
                f"`--save {arg(file)}`: the file exists and is not a saved plan", hint="give another file"
            ) from error


def save(session: CommandSession, report: RunReport, file: Path) -> str:
    """Save a plan in a file readable by its owner only; return the command that applies it, empty if it is empty.

    A plan that lacks a device, because it could not be read or was refused, is not saved: it would be applied only in
    part. Raises UsageError.
    """
    import json
    import shlex

    from atlantis_netcfg.cli.base.output import carried_words
    from atlantis_netcfg.cli.base.session import planned_state
    from atlantis_netcfg.core.atomic_files import write_atomically

    if report.exit is not ExitCode.CHANGES:
        file.unlink(missing_ok=True)
        return ""
    document: dict[str, Any] = {
        "format": _FORMAT,
        "site": session.site,
        "only": list(session.arguments.many("device")),
        "via": session.via,
        "offline": str(session.offline) if session.offline is not None else None,
        "rehearsed": session.is_rehearsal,
        "revision": session.inventory.revision,
        "plans": {name: planned_state(result) for name, result in report.devices.items()},
        "text": report.plan_as_text(),
    }
    document["sha256"] = _digest(document)
    try:
        write_atomically(file, json.dumps(document, ensure_ascii=False, indent=1).encode())
    except OSError as error:
        raise UsageError(
            f"cannot write {arg(file)}: {arg(error.strerror)}", hint="give another file with `--save`"
        ) from error
    words = [word for word in carried_words(session.arguments) if word != "--rehearse"]
    return shlex.join(["provision", "plan", "apply", str(file), *words])


def _read(file: Path) -> Mapping[str, Any]:
    """Read a saved plan. Raises UsageError."""
    import json

    try:
        plan = json.loads(file.read_bytes())
    except OSError as error:
        raise UsageError(f"cannot read {arg(file)}: {arg(error.strerror)}", hint=_HINT) from error
    except ValueError as error:
        raise UsageError(f"{arg(file)} is not a saved plan", hint=_HINT) from error
    if not isinstance(plan, dict) or set(plan) != _KEYS or plan["format"] != _FORMAT or not _is_whole(plan):
        raise UsageError(f"{arg(file)} is not a plan of this version", hint=_HINT)
    if plan["sha256"] != _digest({key: plan[key] for key in plan if key != "sha256"}):
        raise UsageError(
            f"{arg(file)} was changed since the plan was saved", hint=f"make a new plan: `{arg(_command(plan, file))}`"
        )
    return plan


def _digest(plan: Mapping[str, Any]) -> str:
    """Return a hash of everything shown of the plan, and of everything that is applied."""
    import hashlib
    import json

    return hashlib.sha256(json.dumps(plan, sort_keys=True).encode()).hexdigest()


_HINT = "`provision plan site=NAME --save FILE` saves the plan of a site"


def _is_whole(plan: Mapping[str, Any]) -> bool:
    """Return whether all values have the right type: the file may have been edited, and it decides what is changed."""
    texts = [
        plan["site"],
        plan["revision"],
        plan["text"],
        plan["sha256"],
        *(plan["only"] if isinstance(plan["only"], list) else [None]),
    ]
    hashes = plan["plans"]
    return (
        all(isinstance(each, str) for each in texts)
        and all(isinstance(plan[name], str | None) for name in ("via", "offline"))
        and isinstance(plan["rehearsed"], bool)
        and isinstance(hashes, dict)
        and all(isinstance(each, str) for each in hashes.values())
    )
