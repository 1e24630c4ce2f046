"""The ear asked in this process or in one of its own, and servers on loopback that behave as devices do.

from ear_stand import asked, listen, served
"""

import json
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from atlantis_netcfg.checklist.probes import Answer, Listen, Place, Question, Transcript
from atlantis_netcfg.checklist.probes.agent import BOOT, batch, program, read_result
from atlantis_netcfg.checklist.probes.agent.main import answer_all

LOOPBACK = "127.0.0.1"
ENOUGH_S = 30.0
"""Nobody waits so long: whatever a test expects ends the waiting."""


def listen(port: int, **how: Any) -> Listen:  # noqa: ANN401 - the fields of Listen
    return replace(Listen("it", Place.LAPTOP, "tcp", LOOPBACK, port), **how)


def asked(*questions: Question, deadline_s: float | None = None) -> dict[str, Answer]:
    by_name = {question.name: question for question in questions}
    made = batch(list(by_name.items()))
    told: dict[str, Any] = {}
    work = json.loads(json.dumps(made.request)) | ({} if deadline_s is None else {"deadline_s": deadline_s})
    answer_all(work, lambda key, said: told.update({key: json.loads(json.dumps(said))}))
    return {name: read_result(told[name], question, 1.0, 2.0) for name, question in by_name.items()}


def heard_by(question: Listen) -> Transcript:
    answer = asked(question)[question.name]
    assert isinstance(answer, Transcript)
    return answer


def asked_apart(*questions: Question, python: str = sys.executable) -> dict[str, Answer]:
    """The same by the program, in a process of its own."""
    by_name = {question.name: question for question in questions}
    feed = program(batch(list(by_name.items())).request)
    done = subprocess.run([python, "-I", "-c", BOOT], input=feed, capture_output=True, check=True)
    assert done.stderr == b""
    rows = (json.loads(line) for line in done.stdout.splitlines())
    return {row["key"]: read_result(row, by_name[row["key"]], 1.0, 2.0) for row in rows}


@contextmanager
def served(serve: Callable[[socket.socket], object], clients: int = 1) -> Iterator[int]:
    """A port at which so many clients are served, one after the other."""
    with socket.create_server((LOOPBACK, 0)) as door:

        def work() -> None:
            for _ in range(clients):
                client, _from = door.accept()
                with client:
                    serve(client)

        thread = threading.Thread(target=work)
        thread.start()
        yield door.getsockname()[1]
        thread.join()


def until_gone(client: socket.socket) -> bytes:
    said = b""
    while more := client.recv(4096):
        said += more
    return said
