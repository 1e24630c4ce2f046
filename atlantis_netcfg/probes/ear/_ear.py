"""The program: all questions at once, each answered in a line of JSON as soon as it ends.

Questions come in queues: those of one queue want the same port, and are asked one after the other. Whatever happens to
one question, the others are answered, and at the deadline everything ends with what was heard so far.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from typing import Any, Callable

from atlantis_netcfg.probes.ear._datagrams import udp
from atlantis_netcfg.probes.ear._dhcp import probing
from atlantis_netcfg.probes.ear._programs import end_all, run
from atlantis_netcfg.probes.ear._serial import serial
from atlantis_netcfg.probes.ear._shared import NoAnswer, Sound
from atlantis_netcfg.probes.ear._streams import tcp

__all__ = ["answer_all", "main"]

_BREATH_S = 0.3
"""A server of one client, or a serial server, notices only then that the last one has gone."""
_STREAMS: dict[str, Callable[[dict[str, Any], Sound], None]] = {"tcp": tcp, "udp": udp, "serial": serial}
_OTHERS: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {"run": run, "dhcp": probing}


class _Queue(threading.Thread):
    """Questions of which one waits for the other."""

    def __init__(self, questions: list[dict[str, Any]], tell: Callable[[str, dict[str, Any]], None]) -> None:
        super().__init__(daemon=True)
        self._left, self._tell = list(questions), tell
        self._sound: Sound | None = None
        self._lock = threading.Lock()

    def run(self) -> None:
        """Ask them all."""
        while self._left:
            asked, self._sound = self._left[0], None
            said = self._answer(asked)
            with self._lock:
                if not self._left:
                    return
                del self._left[0]
                self._tell(asked["key"], said)
            if self._left:
                time.sleep(_BREATH_S)

    def give_up(self) -> None:
        """Tell what was heard so far, and of the rest that nothing was."""
        with self._lock:
            for asked in self._left:
                heard = {} if self._sound is None else self._sound.as_answer()
                self._sound = None
                self._tell(asked["key"], {**heard, "trouble": "silent", "words": "it was not over in time"})
            self._left = []

    def _answer(self, asked: dict[str, Any]) -> dict[str, Any]:
        try:
            if asked["kind"] in _OTHERS:
                return _OTHERS[asked["kind"]](asked)
            self._sound = Sound(asked["max_bytes"])
            _STREAMS[asked["kind"]](asked, self._sound)
            return self._sound.as_answer()
        except NoAnswer as why:
            return {"trouble": why.trouble, "words": why.words}
        except Exception as fault:  # noqa: BLE001 - the other questions go on
            return {"fault": f"{type(fault).__name__}: {fault}"}


def answer_all(asked: dict[str, Any], tell: Callable[[str, dict[str, Any]], None]) -> None:
    """Ask `queues` at once, and tell each answer by its key; after `deadline_s` what is missing is told as silent."""
    ends = time.monotonic() + asked["deadline_s"]
    queues = [_Queue(one, tell) for one in asked["queues"]]
    for queue in queues:
        queue.start()
    for queue in queues:
        queue.join(max(ends - time.monotonic(), 0.0))
    for queue in queues:
        queue.give_up()
    end_all()


def main(asked: dict[str, Any]) -> None:
    """Answer on the standard output; when nobody reads it any more, all is over."""
    lock = threading.Lock()

    def tell(key: str, said: dict[str, Any]) -> None:
        with lock:
            try:
                sys.stdout.write(json.dumps({"key": key, **said}, separators=(",", ":")) + "\n")
                sys.stdout.flush()
            except OSError:
                end_all()
                os._exit(1)

    answer_all(asked, tell)
    os._exit(0)  # threads that hang
