"""A port of the router: whether it has a link, how fast, and whether frames arrive broken.

Menus: `/interface/ethernet/monitor` (`status: link-ok`, `rate: 1Gbps`, `full-duplex: yes`) and the counters of
`/interface/print` (`rx-error`, `tx-error`, since the router was started). Manual, Ethernet and Interface.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.bearers.query import Query
from atlantis_netcfg.checklist.probes.evidence import read
from atlantis_netcfg.checklist.probes.not_run import rows_of, unasked
from atlantis_netcfg.checklist.probes.requests import Ask
from atlantis_netcfg.checklist.probes.results import Rows
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.probes.results import Answer
    from atlantis_netcfg.checklist.report import Evidence

__all__ = ["asks", "judge"]

_COUNTERS = ("name", "default-name", "running", "disabled", "rx-error", "tx-error", "link-downs")
_TRUE = frozenset({"true", "yes"})
_SLOW = frozenset({"10Mbps"})
"""What a cable with a broken pair, or an end set by hand, falls back to."""
_SHOWN = (("rate", "rate"), ("full-duplex", "full duplex"), ("rx-error", "frames received broken"))
_MORE = (("tx-error", "frames not sent"), ("link-downs", "times that the link was lost"))


def asks(router: str, port: str) -> tuple[Ask, ...]:
    """Give the questions about a port."""
    return (
        Ask("monitor", router, Query("/interface/ethernet", "monitor", (("numbers", port), ("once", "")))),
        Ask("interfaces", router, Query("/interface", "print", (), _COUNTERS)),
    )


def judge(router: str, port: str, results: Mapping[str, Answer]) -> Judged:
    """Judge the port; a menu that the router does not have is left out."""
    answers = [results.get(name) for name in ("monitor", "interfaces")]
    if all(not isinstance(answer, Rows) or answer.trouble is not None for answer in answers):
        return Judged((unasked(router, answers[0]),))
    monitor, interfaces = (rows_of(result) for result in answers)
    counted = None if interfaces is None else next((row for row in interfaces if row.get("name") == port), None)
    socket = next((row for row in interfaces or () if row.get("default-name") == port), None)
    if (socket or {}).get("name", port) != port or (counted or {}).get("default-name", port) != port:
        called = f"is called {socket['name']} there" if socket is not None else "is another socket there"
        message = f"port {port} of {router} {called}, so that what is told under that name is not about it"
        hint = "run the site, which gives ports their names back"
        return Judged((Finding(Verdict.FAIL, "port-renamed", message, hint),))
    if interfaces is not None and counted is None:
        message = f"{router} has no port {port}"
        hint = "correct `endpoints.ethernet.router_port`: the name is the router's own"
        return Judged((Finding(Verdict.FAIL, "no-port", message, hint),))
    local = [row for row in monitor or () if row.get("name", port) == port]
    values = {**(counted or {}), **(local[0] if local else {})}
    return Judged(tuple(_findings(router, port, values)), _evidence(router, port, values))


def _findings(router: str, port: str, values: Mapping[str, str]) -> Iterator[Finding]:
    if values.get("disabled") in _TRUE:
        hint = "run the site to enable it, or look who has disabled it"
        yield Finding(Verdict.FAIL, "port-disabled", f"port {port} of {router} is switched off", hint)
        return
    status = values.get("status") or {"true": "link-ok", "false": "no-link"}.get(values.get("running", ""), "")
    if status == "no-link":
        hint = "is the cable plugged in at both ends, and is the other end switched on?"
        yield Finding(Verdict.FAIL, "port-down", f"port {port} of {router} has no link", hint)
        return
    if status != "link-ok":
        text = f"`{status}`" if status else "nothing"
        message = f"{router} says {text} of the link of port {port}"
        yield Finding(Verdict.INCONCLUSIVE, "port-unknown", message, "look at the lamps of the port")
        return
    rate = values.get("rate")
    yield Finding(Verdict.PASS, "link", f"port {port} of {router} has a link{f' of {rate}' if rate else ''}")
    yield from _quality(router, port, values)


def _quality(router: str, port: str, values: Mapping[str, str]) -> Iterator[Finding]:
    hint = "change the cable, and set both ends to negotiate the rate themselves"
    if values.get("rate") in _SLOW:
        yield Finding(Verdict.WARN, "rate-low", f"port {port} of {router} runs at {values['rate']} only", hint)
    if values.get("full-duplex") in {"false", "no"}:
        yield Finding(Verdict.WARN, "half-duplex", f"port {port} of {router} runs in half duplex", hint)
    for name, words in (("rx-error", "received broken"), ("tx-error", "not sent")):
        count = values.get(name, "")
        if count.isdecimal() and int(count):
            message = f"port {port} of {router} has counted {count} frames {words} since it was started"
            yield Finding(Verdict.WARN, f"{name}s", message, "change the cable, then look whether the number grows")


def _evidence(router: str, port: str, values: Mapping[str, str]) -> tuple[Evidence, ...]:
    where = f"at port {port} of {router}"
    return tuple(read(f"{words} {where}", values[name]) for name, words in (*_SHOWN, *_MORE) if values.get(name))
