"""Results of the action `prefetch`, for use by the tasks after it.

A task uses one only for exactly the request that it would send itself, within a minute, and only if no task before it
had to call the gateway: after such a call the gateway's state may differ from the prefetched one.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

VARIABLE: Final = "computer_prefetch"
"""Where playbooks register the result of the action. A registered variable ends with the run; no cache keeps it."""
_DISCARD_FACT: Final = "atlantis_prefetch_discarded"
"""Fact with the id of the prefetch result that must no longer be used."""
_MAX_AGE_S: Final = 60.0
_TIMES: Final = {"clock": "now"}
"""Module -> argument that differs in each call without changing the request."""
_KEY: Final = os.urandom(32)
"""Digest key; tasks are forks and share it. Requests hold secrets: digests without a key could be guessed."""


def pack(requests: Iterable[Mapping[str, Any]], answers: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the result of the action; `answers` belong to the first of the requests."""
    pairs = zip(requests, answers, strict=False)
    values = {_digest(request): dict(answer) for request, answer in pairs}
    return {"id": os.urandom(8).hex(), "monotonic_s": time.monotonic(), "answers": values}


def find_answer(variables: Mapping[str, Any], request: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the result for exactly this request, if there is one and it is still valid."""
    result = variables.get(VARIABLE) or {}
    is_discarded = (variables.get("ansible_facts") or {}).get(_DISCARD_FACT) == result.get("id")
    if is_discarded or time.monotonic() - result.get("monotonic_s", 0.0) > _MAX_AGE_S:
        return None
    answer = result["answers"].get(_digest(request))
    return None if answer is None else dict(answer)


def discard(variables: Mapping[str, Any]) -> dict[str, Any]:
    """Return task result data that invalidates the prefetched results."""
    result = variables.get(VARIABLE) or {}
    return {"ansible_facts": {_DISCARD_FACT: result["id"]}} if "id" in result else {}


def _digest(request: Mapping[str, Any]) -> str:
    params = {name: value for name, value in request["params"].items() if name != _TIMES.get(request["name"])}
    text = json.dumps({**request, "params": params}, default=str, sort_keys=True)
    return hashlib.blake2b(text.encode(), key=_KEY).hexdigest()
