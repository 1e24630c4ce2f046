"""`:do { ... } on-error={ ... }` in scripts of the twin (Manual, Scripting)."""

from __future__ import annotations

import pytest
from twin_bench import make

CASES = {
    "nothing fails": (':do { :put "a" } on-error={ :put "b" }\n:put "c"', "a\nc"),
    "something fails": (':do {\n/ip/address/get [find] address\n:put "a"\n} on-error={\n:put "b"\n}\n:put "c"', "b\nc"),
    "inside another": (
        ':do { /ip/pool/remove [find] } on-error={ :do { /ip/pool/remove [find] } on-error={ :put "b" } }',
        "b",
    ),
    "nothing to rescue": (":do { /ip/pool/remove [find] } on-error={}", ""),
    "what was done stays": (
        ":do { /ip/pool add name=p ranges=10.0.0.1; /ip/pool remove q } on-error={}\n:put [/ip/pool/get p name]",
        "p",
    ),
    "no rescue": (':do { :put "a" }', "syntax error (line 1 column 17)"),
    "never closed": (':do { :put "a"', "expected end of command (line 1 column 15)"),
}


@pytest.mark.parametrize("case", CASES)
def test_attempts(case: str) -> None:
    script, output = CASES[case]
    router = make()
    router.script("/ip/address remove [find]")
    assert router.script(script) == output
