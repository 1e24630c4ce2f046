"""`:put [:parse "..."]` and `/console/inspect` of the twin, in the words that devices were recorded with."""

import pytest
from row_subtests import for_each_row
from twin_bench import make

from atlantis_netcfg.routeros.rsc import in_quotes

VERSIONS = ("7.16", "7.18.2", "7.20.8", "7.21.5", "7.23.3", "7.24")
ACCEPTED = {
    "/ip address print": "(evl /ip/address/print)",
    "/ip/address/add address=not-an-ip": "(evl /ip/address/addaddress=not-an-ip;)",
    "/interface ethernet monitor": "(evl /interface/ethernet/monitor)",
    ':put "bad parameter test"': "(evl /putmessage=bad parameter test)",
    ':put "expected: hello"': "(evl /putmessage=expected: hello)",
    "": "",
    "# a comment": "/",
}
"""tikoci/centrs, test/fixtures/parse-oracle.json; tikoci/lsp-routeros-ts, docs/parseil-format.md."""
NO_COMMAND = {
    "/interface ethernet poe monitor": "(<%% bad command name poe (line 1 column 21) poe;monitor)",
    "/zzz qqq print": "(<%% bad command name zzz (line 1 column 2) zzz;qqq;print)",
    "/partitions print": "(<%% bad command name partitions (line 1 column 2) partitions;print)",
    "/lcd show": "(<%% bad command name lcd (line 1 column 2) lcd;show)",
}
NO_ARGUMENT = {
    "/ip address add no-such-arg=x": ("(evl bad parameter no-such-arg (line 1 column 28) /ip/address/add)", 17),
    "/ip address print bogus-attr=1": ("(evl bad parameter bogus-attr (line 1 column 29) /ip/address/print)", 19),
    "/ip/address/add address=10.9.9.9/32 interface=ether1 no-such-arg=x": (
        "(evl bad parameter no-such-arg (line 1 column 54) /ip/address/add)",
        54,
    ),
}
"""The text from 7.23 on, and the column before (recorded on 7.22.1 for `type=` of a route)."""


def parse(version: str, text: str) -> str:
    return make(version=version, poe_ports=()).script(f":put [:parse {in_quotes(text)}]")


@for_each_row("version", VERSIONS)
@for_each_row("text", ACCEPTED)
def test_accepted_commands_are_printed_as_code(text: str, version: str) -> None:
    assert parse(version, text) == ACCEPTED[text]


@for_each_row("version", VERSIONS)
@for_each_row("text", NO_COMMAND)
def test_unknown_commands_are_reported(text: str, version: str) -> None:
    assert parse(version, text) == NO_COMMAND[text]


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("text", NO_ARGUMENT)
def test_unknown_arguments_are_reported(text: str, version: str) -> None:
    newer, column = NO_ARGUMENT[text]
    older = f"expected end of command (line 1 column {column})"
    assert parse(version, text) == (newer if version in ("7.23.3", "7.24") else older)


def test_parse_executes_nothing() -> None:
    router = make()
    before = router.text()
    assert router.script(r':put [:parse "/ip/pool/add name=p ranges=10.0.0.1"]').startswith("(evl /ip/pool/add")
    assert router.text() == before
    assert router.script("/ip/pool/add name=p ranges=10.0.0.1") == ""
    assert router.text() != before


def test_error_is_placed_where_its_command_would_be() -> None:
    text = "/ip/pool/print\n/lcd show"
    assert parse("7.23.3", text) == "(evl /ip/pool/print);(<%% bad command name lcd (line 2 column 2) lcd;show)"


def test_foreach_loop_over_texts_prints_script_output() -> None:
    inner = '[:execute script=(":put \\"<".$s.">\\"") as-string]'
    loop = f':foreach n,s in={{"a";"bc"}} do={{:local v {inner};:put "$n $v"}}'
    assert make().script(loop) == "0 <a>\n1 <bc>"


@pytest.mark.parametrize(
    ("condition", "output"), [('$v~"^ok"', "yes"), ('$v~"k\\$"', "no"), ('$v~"o[k]y*:"', "yes"), ('$v~"^k"', "no")]
)
def test_regular_expressions(condition: str, output: str) -> None:
    ok = ':local v [:execute script=":put \\"ok: 1\\"" as-string]'
    assert make().script(f'{ok}\n:if ({condition}) do={{:put "yes"}} else={{:put "no"}}') == output


@pytest.mark.parametrize("script", [":foreach i in=[/ip/pool/find] do={}", ":local a 1", ":foreach a,b in={1;2} do={}"])
def test_other_loops_and_variables_are_not_emulated(script: str) -> None:
    assert make().script(script).startswith("syntax error")


def test_inspect_lists_children_of_a_path() -> None:
    router = make()
    children = router.say("/console/inspect", "=request=child", "=path=ip,address")
    assert "!re =name=add =node-type=cmd =type=child" in children
    arguments = router.say("/console/inspect", "=request=child", "=path=ip,address,add", "=.proplist=name")
    assert "!re =name=interface" in arguments
    assert router.say("/console/inspect", "=request=child", "=path=/ip/address") == ["!done"]


@pytest.mark.parametrize(
    "where",
    [
        ("=path=ip,firewall,filter,add,action",),
        ("=path=ip,firewall,filter", "=input=add action="),
        ("=input=/ip/firewall/filter/add action=",),
    ],
)
def test_inspect_lists_completions(where: tuple[str, ...]) -> None:
    router = make()
    offered = router.say("/console/inspect", "=request=completion", *where, "=.proplist=completion")
    assert "!re =completion=accept" in offered
    assert len(offered) == 12
    some = router.say(
        "/console/inspect", "=request=completion", *where, "=.proplist=completion", "?completion=drop", "?completion=x"
    )
    assert some == ["!done"]


def test_inspect_offers_nothing_for_unknown_paths() -> None:
    ask = ("/console/inspect", "=request=completion", "=path=ip,firewall,filter,add,acton")
    assert make().say(*ask) == ["!done"]
    assert make().say("/console/inspect", "=request=highlight", "=input=/ip") == [
        "!trap =message=not rehearsed by the twin: /console/inspect request=highlight",
        "!done",
    ]
