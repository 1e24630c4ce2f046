"""The program: all questions at once, each answered in a line of JSON as soon as it ends.

Some wait for others, which want the same end or share a medium with them. Whatever happens to one question, the others
are answered, and at the deadline everything ends with what was heard so far.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
import traceback
from typing import Any, Callable

from atlantis_netcfg.checklist.probes.agent.queries import discover, end_all, probing, run
from atlantis_netcfg.checklist.probes.agent.streams import ProbeError, ReceiveBuffer, serial, tcp, udp

_BREATH_S = 0.3
"""A server of one client, or a serial server, notices only then that the last one has gone."""
_GONE = ("silent", "unreachable")
_STREAMS: dict[str, Callable[[dict[str, Any], ReceiveBuffer], None]] = {"tcp": tcp, "udp": udp, "serial": serial}
_OTHERS: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {"run": run, "dhcp": probing, "dds": discover}


class _Request(threading.Thread):
    """A question, from its turn to its answer."""

    def __init__(
        self, row: dict[str, Any], before: list[_Request], tell: Callable[[str, dict[str, Any]], None]
    ) -> None:
        super().__init__(daemon=True)
        self.over = threading.Event()
        self.answer: dict[str, Any] = {}
        self._row, self._before, self._tell = row, before, tell
        self._sound: ReceiveBuffer | None = None
        self._lock = threading.Lock()

    def run(self) -> None:
        """Wait for its turn, and ask."""
        for other in self._before:
            other.over.wait()
        if self.over.is_set():  # given up meanwhile
            return
        self._say(self._same_end() or self._ask(), {})

    def give_up(self) -> None:
        """Tell what was heard so far, if it has not ended."""
        sound = self._sound
        self._say({} if sound is None else sound.as_answer(), {"trouble": "silent", "words": "timed out"})

    def _say(self, answer: dict[str, Any], more: dict[str, Any]) -> None:
        with self._lock:
            if not self.over.is_set():
                self.answer = {**answer, **more}
                self._tell(self._row["key"], self.answer)
                self.over.set()

    def _same_end(self) -> dict[str, Any] | None:
        """The answer of an end that was not there a moment ago: nobody knocks a second time."""
        for other in self._before:
            same = all(self._row.get(name) == other._row.get(name) for name in ("kind", "address", "port"))  # noqa: SLF001 - its like
            if same and self._row["kind"] == "tcp" and other.answer.get("trouble") in _GONE:
                return other.answer
        return None

    def _ask(self) -> dict[str, Any]:
        if self._before:
            time.sleep(_BREATH_S)
        try:
            if self._row["kind"] in _OTHERS:
                return _OTHERS[self._row["kind"]](self._row)
            self._sound = ReceiveBuffer(self._row["max_bytes"])
            _STREAMS[self._row["kind"]](self._row, self._sound)
            return self._sound.as_answer()
        except ProbeError as why:
            return {"trouble": why.trouble, "words": why.words}
        except Exception as fault:  # noqa: BLE001 - the other questions go on
            last = traceback.extract_tb(fault.__traceback__)[-1]
            return {"fault": f"{type(fault).__name__}: {fault} ({last.filename}, line {last.lineno})"}


def answer_all(requested: dict[str, Any], tell: Callable[[str, dict[str, Any]], None]) -> None:
    """Ask all `questions`, each `after` some before it, and tell the answers by their keys.

    After `deadline_s` what is missing is told as silent, with what was heard so far.
    """
    ends = time.monotonic() + requested["deadline_s"]
    work: list[_Request] = []
    for row in requested["questions"]:
        work.append(_Request(row, [work[number] for number in row["after"]], tell))
    for request in work:
        request.start()
    for request in work:
        request.over.wait(max(ends - time.monotonic(), 0.0))
    for request in reversed(work):  # who waits for another one must not begin now
        request.give_up()
    end_all()


def main(requested: dict[str, Any]) -> None:
    """Answer on the standard output; when nobody reads it any more, all is over."""
    lock = threading.Lock()

    def tell(key: str, result: dict[str, Any]) -> None:
        with lock:
            try:
                sys.stdout.write(json.dumps({"key": key, **result}, separators=(",", ":")) + "\n")
                sys.stdout.flush()
            except OSError:
                end_all()
                os._exit(1)

    answer_all(requested, tell)
    os._exit(0)  # threads that hang
