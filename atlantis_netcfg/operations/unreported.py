"""Hosts of a run of which no result has come: what is known of them, from the journal that was written beforehand."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.crash import write_log
from atlantis_netcfg.errors import ExitCode, NetcfgError
from atlantis_netcfg.journal import Store
from atlantis_netcfg.journal.records import DeviceObserved, Planned, StateSaved
from atlantis_netcfg.routeros.apply import DeviceResult, Status

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.operations.request import Request
    from atlantis_netcfg.site import Declaration

__all__ = ["without_result"]

_READING = (DeviceObserved, StateSaved, Planned)
"""Records of a device on which nothing was changed or armed yet: whatever does that is recorded before it is sent."""


def without_result(  # noqa: PLR0913, PLR0917 - one call, from one place
    names: Sequence[str],
    declaration: Declaration,
    request: Request,
    runs: Mapping[str, str],
    reason: NetcfgError | str,
    output: str,
) -> dict[str, dict[str, Any]]:
    """Give each name a result that says what is known: `left-as-found` (4) or `unknown` (5), never nothing.

    `reason` is why they have none, as far as that is known; `output` is what Ansible has printed. It is kept in a log
    file, except after a refusal of ours, which says all there is.
    """
    if not names:
        return {}
    note, results = [] if isinstance(reason, NetcfgError) else _logged(output, request), {}
    for name in names:
        site = declaration.hosts[name].site
        run = runs.get(site, "")
        result = _result(name, site, run, str(reason) or "it has ended without a result", request)
        if isinstance(reason, NetcfgError) and result.status is not Status.UNKNOWN:
            # A refusal has a code of its own (a declaration that cannot be used: 3), but nothing of it is green.
            result = DeviceResult(name, result.status, reason.exit or ExitCode.FAILED, str(reason), reason.hint)
        results[name] = {**result.as_dict(), "notes": note, "other_end": None}
    return results


def _result(name: str, site: str, run: str, reason: str, request: Request) -> DeviceResult:
    if request.mode.reads_only:
        return DeviceResult(name, Status.LEFT_AS_FOUND, ExitCode.FAILED, f"not read: {reason}", _AGAIN)
    if run and _is_touched(name, site, run, request):
        hint = (
            "what was not confirmed the device takes back by itself, within ten minutes if the link has died; then:"
            f"  provision resume site={site} run={run}"
        )
        return DeviceResult(name, Status.UNKNOWN, ExitCode.UNKNOWN, f"the outcome is not known: {reason}", hint)
    return DeviceResult(name, Status.LEFT_AS_FOUND, ExitCode.FAILED, f"nothing was changed: {reason}", _AGAIN)


_AGAIN = "type the same command again"


def _is_touched(name: str, site: str, run: str, request: Request) -> bool:
    """Whether anything was, or may have been, sent that changes the device; a journal that is gone proves nothing."""
    try:
        records = Store(request.state, rehearsed=request.rehearsed).run(site, run).log.records
    except NetcfgError:
        return True
    return any(getattr(record, "device", None) == name and not isinstance(record, _READING) for record in records)


def _logged(output: str, request: Request) -> list[str]:
    """Keep what Ansible has printed in a log file, and name it."""
    if not output:
        return []
    try:
        return [f"what Ansible has printed is in {write_log(output + chr(10), request.command, request.state)}"]
    except (NetcfgError, OSError) as error:
        return [f"no log file could be written: {error}"]
