"""Files, and the commands that read or write them: `/file`, `/import`, `/export`, `/execute`, `/system/backup`."""

from __future__ import annotations

import json

from atlantis_netcfg.emulator.routeros import answers
from atlantis_netcfg.emulator.routeros.commands import _checks
from atlantis_netcfg.emulator.routeros.console import run
from atlantis_netcfg.emulator.routeros.console.export import Form, export_text
from atlantis_netcfg.emulator.routeros.core import Call, CallResult, Core, FlashFile
from atlantis_netcfg.emulator.routeros.spec import Deviation, Execute
from atlantis_netcfg.emulator.routeros.values import id_text

_MOST_CONTENTS = 60 * 1024
_MOST_SCRIPT = 64 * 1024
_MOST_CHUNK = 32768
_TRUE = ("", "yes", "true")


def _check_arguments(core: Core, call: Call) -> None:
    for name in (*call.arguments, *call.unset):
        if name not in core.schema.arguments(call.menu, call.command) | {".id"}:
            raise _checks.unknown(name)


def _require_argument(call: Call, name: str) -> str:
    if name not in call.arguments:
        raise _checks.MissingArgument(name)
    return call.arguments[name]


def _find_file_name(core: Core, text: str) -> str:
    """Return the name of a file, given its name or id."""
    for name, file in core.files.items():
        if text in (name, id_text(file.number)):
            return name
    raise _checks.no_such_item()


def _write(core: Core, name: str, contents: str) -> FlashFile:
    if len(contents) > core.free_space(besides=name):
        raise answers.Trap(answers.DISK_FULL)
    number = core.files[name].number if name in core.files else core.number()
    core.files[name] = FlashFile(number, contents, core.stamp())
    return core.files[name]


def add(core: Core, call: Call) -> CallResult:
    """Create a file; contents come in one argument of limited size (Manual, Files: 60 kB)."""
    _check_arguments(core, call)
    name = _require_argument(call, "name")
    if name in core.files:
        raise answers.Trap("failure: file already exists")
    return CallResult(ret=id_text(_write(core, name, _checked_contents(call)).number))


def _checked_contents(call: Call) -> str:
    contents = call.arguments.get("contents", "")
    if len(contents.encode(errors="surrogateescape")) > _MOST_CONTENTS:
        raise answers.Trap("invalid value for argument contents", answers.Category.ARGUMENT)
    return contents


def _target_names(core: Core, call: Call) -> list[str]:
    selector = call.arguments.get(".id") or call.arguments.get("numbers")
    if selector is None:
        raise _checks.MissingArgument(".id")
    return [_find_file_name(core, part) for part in selector.split(",")]


def set_(core: Core, call: Call) -> CallResult:
    """Overwrite or rename a file."""
    _check_arguments(core, call)
    for name in _target_names(core, call):
        if "contents" in call.arguments:
            _write(core, name, _checked_contents(call))
        if "name" in call.arguments:
            core.files[call.arguments["name"]] = core.files.pop(name)
    return CallResult()


def remove(core: Core, call: Call) -> CallResult:
    """Delete files."""
    _check_arguments(core, call)
    for name in _target_names(core, call):
        del core.files[name]
    return CallResult()


def read(core: Core, call: Call) -> CallResult:
    """Return `chunk-size` bytes of a file from `offset`."""
    _check_arguments(core, call)
    data = core.files[_find_file_name(core, _require_argument(call, "file"))].contents.encode(errors="surrogateescape")
    offset, size = _number(call, "offset", 0), _number(call, "chunk-size", _MOST_CHUNK)
    if not 1 <= size <= _MOST_CHUNK:
        raise answers.Trap(f"value of chunk-size out of range (1..{_MOST_CHUNK})", answers.Category.ARGUMENT)
    return CallResult(rows=[{"data": data[offset : offset + size].decode(errors="surrogateescape")}])


def _number(call: Call, name: str, default: int) -> int:
    text = call.arguments.get(name, str(default))
    if not text.isdecimal():
        raise answers.Trap(f"invalid value for argument {name}", answers.Category.ARGUMENT)
    return int(text)


def export(core: Core, call: Call) -> CallResult:
    """Export the configuration to a file or, on the console, as text; by API without `file`, return nothing.

    Version 6 shows secrets by default, version 7 hides them (Manual, Configuration Management).
    """
    _check_arguments(core, call)
    if "where" in call.arguments:
        raise answers.Trap(f"not rehearsed by the twin: {call.path} where")
    show_sensitive = "show-sensitive" in call.arguments or not (
        core.schema.at_least("7.0") or "hide-sensitive" in call.arguments
    )
    form = Form(
        verbose="verbose" in call.arguments,
        terse="terse" in call.arguments,
        show_sensitive=show_sensitive and "sensitive" in core.policies(call.caller),
    )
    text = export_text(core, call.menu, form)
    if "file" in call.arguments:
        name = call.arguments["file"]
        _write(core, name if name.endswith(".rsc") else f"{name}.rsc", text)
        return CallResult()
    return CallResult(text=text if call.console else "")


def import_(core: Core, call: Call) -> CallResult:
    """Run a file of commands; with `dry-run` only check the syntax."""
    _check_arguments(core, call)
    text = core.files[_find_file_name(core, _require_argument(call, "file-name"))].contents
    first = _number(call, "from-line", 1)
    text = "\n".join(text.split("\n")[first - 1 :])
    if call.arguments.get("dry-run", "no") in _TRUE:
        error = run.check_syntax(core, text)
    else:
        error = run.run_file(core, call.caller, text).error
    if error is not None:
        raise answers.Trap(error, answers.Category.SCRIPTING)
    return CallResult(text="Script file loaded and executed successfully")


def execute(core: Core, call: Call) -> CallResult:
    """Run a script; with `as-string` wait and return its output, else return its job's id."""
    _check_arguments(core, call)
    if core.spec.execute is Execute.NONE:
        raise answers.Trap("no such command", answers.Category.MISSING)
    script = _require_argument(call, "script")
    if len(script.encode(errors="surrogateescape")) > _MOST_SCRIPT:
        raise answers.Trap("invalid value for argument script", answers.Category.ARGUMENT)
    entries = len(core.history.entries)
    outcome = run.run_script(core, call.caller, script)
    if core.deviates(Deviation.SCRIPT_ENTRIES):
        core.history.join(entries)
    if core.deviates(Deviation.SCRIPT_STAYS):
        core.history.settle(entries)
    if "file" in call.arguments:
        _write(core, f"{call.arguments['file']}.txt", outcome.output)
    if "as-string" not in call.arguments or (call.console and core.deviates(Deviation.NESTED_EXECUTE)):
        if outcome.error is not None:
            core.note("script,error", outcome.error)
        return CallResult(ret=id_text(core.number()))
    if outcome.error is not None and core.spec.execute is Execute.TRAP:
        raise answers.Trap(outcome.error, answers.Category.SCRIPTING)
    return CallResult(ret=outcome.as_string)


def save(core: Core, call: Call) -> CallResult:
    """Save a backup of the configuration to a file."""
    _check_arguments(core, call)
    name = call.arguments.get("name", core.spec.name)
    _write(core, f"{name.removesuffix('.backup')}.backup", json.dumps(core.store.dump()))
    return CallResult()


def load(core: Core, call: Call) -> CallResult:
    """Load a backup, which reboots the router; the extension may be omitted, as with `save`."""
    _check_arguments(core, call)
    name = _require_argument(call, "name")
    contents = core.files[_find_file_name(core, name if name in core.files else f"{name}.backup")].contents
    core.history.clear()
    core.store.load(json.loads(contents))
    core.wants_reboot = True
    return CallResult()
