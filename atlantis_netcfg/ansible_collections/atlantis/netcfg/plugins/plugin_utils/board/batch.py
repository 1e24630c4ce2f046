"""Part of the zipapp: runs several modules in one call, in order, until one of them has something to change.

Each is run in check mode first. If it has nothing to change, it is run as requested, so that its result is the same as
that of a separate call. The first one that would change something or fails ends the batch: the caller requests that one
and all later ones separately. A request that is itself in check mode changes nothing, so only a failure ends it.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import zlib
from typing import Any, Callable, NoReturn

from ansible.module_utils.basic import MARK, tell_result


def main() -> None:
    """Run the requests from standard input; the result holds the results of the first of them."""
    answers: list[dict[str, Any]] = []
    for request in json.loads(zlib.decompress(sys.stdin.buffer.read()).decode()):
        answer = _run(request if request["check"] else {**request, "check": True, "log": False})
        if not request["check"] and answer.get("changed") is False:
            answer = _run(request)
        elif not request["check"]:
            break
        if answer.get("failed", True):
            break
        answers.append(answer)
        if not request["check"] and answer["changed"]:
            break
    tell_result({"answers": answers})


def _run(request: dict[str, Any]) -> dict[str, Any]:
    """Run one module in a child of this process, so that it is compiled once; one that prints no result has failed."""
    module = importlib.import_module(f"atlantis.modules.{request['name']}")
    request_file, answer_file = os.memfd_create("request"), os.memfd_create("answer")
    os.write(request_file, zlib.compress(json.dumps(request).encode()))
    os.lseek(request_file, 0, os.SEEK_SET)
    child = os.fork()
    if child == 0:
        _run_child(module.main, [request_file, answer_file, os.open(os.devnull, os.O_WRONLY)])
    os.waitpid(child, 0)
    os.close(request_file)
    with os.fdopen(answer_file, "rb") as output:
        output.seek(0)
        lines = output.read().decode("utf-8", "replace").split("\n")
    text = next((line[len(MARK) :] for line in reversed(lines) if line.startswith(MARK)), None)
    return {"failed": True} if text is None else {"failed": False, **json.loads(text)}


def _run_child(main: Callable[[], None], streams: list[int]) -> NoReturn:
    """Run a module with these files as its standard input, output and errors, and exit."""
    try:
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
        main()
    finally:
        os._exit(0)
