"""The bill of a device's run, and what a person is asked before: the lines of a report, from the result's `cost`.

Only what was sent over a link that is paid by the byte has one; docs/cost.md describes the object.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

__all__ = ["asked", "cost_lines"]


def asked(cost: Mapping[str, Any]) -> str:
    """What a person is told before, and asked to pay; above all that it is another link than the declared one."""
    return f"{cost['instead']}; {cost['words']}" if cost["instead"] else str(cost["words"])


def cost_lines(result: Mapping[str, Any], *, rehearsed: bool) -> Iterator[str]:
    """What it came to; of a rehearsal, which costs nothing, what a real run would ask and come to."""
    cost = result.get("cost")
    if cost is None:
        return
    if rehearsed and cost["words"]:
        yield f"a real run asks first: {asked(cost)}"
    yield f"{'and comes to' if rehearsed else 'cost over ' + str(cost['bearer'])}: {cost['bill_words']}"
