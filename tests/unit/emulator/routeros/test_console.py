"""Scripts of `/execute`: the subset, its quoting, its error texts (Manual, Scripting; Manual, Console)."""

from row_subtests import for_each_row
from twin_bench import make


def test_output_shows_where_a_script_failed() -> None:
    router = make()
    printed = router.script(
        ':put "ok 1"\n'
        "/ip pool add name=a ranges=10.0.0.1\n"
        ':put "ok 2"\n'
        "/ip/pool/add name=a ranges=10.0.0.2\n"
        ':put "never"\n'
    )
    assert printed == "ok 1\nok 2\nfailure: pool with such name exists (/ip/pool/add; line 4)"
    assert router.count("/ip/pool") == 1


def test_a_script_with_a_misspelt_name_does_not_start() -> None:
    router = make()
    assert router.script("/ip pool add name=a ranges=10.0.0.1\n/ip adress add") == (
        "bad command name adress (line 2 column 5)"
    )
    assert router.count("/ip/pool") == 0


PARSED = "(evl /ip/address/addaddress=10.9.9.9/24;;interface=ether2)"
PUT = [
    (':put "ready"', "ready"),
    (":put ready", "ready"),
    (":put 5;:put a#b", "5\na#b"),
    ('/ip address add address=10.0.0.1/24 \\\n# a note\n    # and another\n interface=ether1\n:put "x"', "x"),
    (":do {/interface ethernet set [find] comment=x mtu=1500} on-error={}\n:put a", "a"),
    (":do {:error bad} on-error={:put rescued}", "rescued"),
    ("/int eth print count-only", "8"),
    (":put [/ip addr find]", "*1"),
    ("/ip addr add addr=10.9.9.9/24 inter=ether2 !comm\n:put [/ip addr get *2 interface]", "ether2"),
    (":put [/interface print count-o where name=ether1]", "1"),
    (':put [:parse "/ip addr add addr=10.9.9.9/24 inter=ether2"]', PARSED),
    (
        "/ip firewall filter\nadd chain=input comment=b\nadd chain=input place-before=0\n:put [find chain=input]",
        "*2;*1",
    ),
    (
        "/ip address add address=2.2 interface=ether1\n:put [/ip address get [find interface=ether1] address]",
        "2.0.0.2/32",
    ),
    ("/tool netwatch add host=1.1.1.1 interval=2.2\n:put [/tool netwatch get *1 interval]", "2s200ms"),
    ("/ip dhcp-server add interface=ether1 lease-time=1w1d00:00:00\n:put [/ip dhcp-server get *1 lease-time]", "1w1d"),
    ('/ip route add gateway=10.64.101.9 pref-src=""\n:put a', "a"),
    ('/ip firewall filter add chain=input connection-state="" dst-address-type=""\n:put a', "a"),
    (
        "/ip firewall filter add chain=input comment=2.2 src-address=2.2\n:put [/ip firewall filter get *1 comment]",
        "2.2",
    ),
    (':put "a\\tb\\"c\\\\ \\24 \\$x\\_y"', 'a\tb"c\\ $ $x y'),
    (':put "Po\\C3\\A7o"', "Poço"),
    (':put "x$y z"', "x z"),
    (":put [/system/identity/get value-name=name]", "MikroTik"),
    (":put [/interface ethernet find default-name=ether3]", "*3"),
    (":put [/interface/ethernet/get ether2 name]", "ether2"),
    (":put [/ip/pool/add name=q ranges=10.0.0.1]", "*1"),
    (":put [/interface/print count-only]", "9"),
    (":put [/interface print count-only where name=ether1]", "1"),
    (":put [/system/identity/print as-value]", "name=MikroTik"),
    (":put [/ip/address/find where address=10.64.101.1/24]", ""),
    (':put [/ip/address/find where address="10.64.101.1/24"]', "*1"),
    ('# a remark\n\n:put "a"; :put "b"', "a\nb"),
    (':put "a\\\n    b"', "ab"),
    ("/ip firewall\n:put [filter/add chain=input]\n:put [/ip/firewall/filter/find]", "*1\n*1"),
    (
        "/safe-mode take\n:put [/safe-mode/get value-name=current]\n/safe-mode unroll",
        "true\nUnrolling Safe Mode... Success!",
    ),
]


@for_each_row(("text", "printed"), PUT)
def test_put(text: str, printed: str) -> None:
    assert make().script(text) == printed


REFUSED = [
    (":put 2 # note", "expected end of command (line 1 column 8)"),
    (":error x", "x (:error; line 1)"),
    (':do {/ip pool remove *5} on-error={:error "y"}', "y (:error; line 1)"),
    ("/ip address add co=x address=10.0.0.1/24", "expected end of command (line 1 column 17)"),
    ("/ip address add interface=ether1 x=1", "expected end of command (line 1 column 34)"),
    ("/i address print", "bad command name i (line 1 column 2)"),
    ("/ip adres print", "bad command name adres (line 1 column 5)"),
    ("/ip address add address=10.0.0.1/24 interface=ether1 disabled=true", "syntax error (line 1 column 63)"),
    ('/ip address add address=10.0.0.1/24 interface=ether1 disabled="false"', "syntax error (line 1 column 63)"),
    ("/ip route add dst-address=10.0.0.0/8 blackhole=yes", "expected end of command (line 1 column 47)"),
    ("/ip firewall filter add chain=input place-before=0", "no such item (/ip/firewall/filter/add; line 1)"),
    (
        "/interface vlan add name=v vlan-id=5000 interface=ether1",
        "value of vlan-id out of range (1..4094) (/interface/vlan/add; line 1)",
    ),
    (
        "/interface vlan add name=v vlan-id=abc interface=ether1",
        "invalid value for argument vlan-id (/interface/vlan/add; line 1)",
    ),
    (
        "/interface vlan add name=v vlan-id=5 interface=e99",
        "input does not match any value of interface (/interface/vlan/add; line 1)",
    ),
    (
        "/interface bonding add slaves=ether1 mode=none",
        "input does not match any value of mode (/interface/bonding/add; line 1)",
    ),
    ("/interface list member add list=all interface=", "syntax error (line 1 column 47)"),
    (':put "a', "syntax error (line 1 column 6)"),
    (':put "a\\qb"', "syntax error (line 1 column 8)"),
    (':put "cost $ 5"', "syntax error (line 1 column 12)"),
    (":local x 5", "syntax error (line 1 column 1)"),
    (":if (true) do={ }", "syntax error (line 1 column 6)"),
    (":if ([:len [/ip pool find]] = a) do={ }", "syntax error (line 1 column 31)"),
    (":if ([:len [/ip pool print]] = 0) do={ }", "syntax error (line 1 column 12)"),
    (":if ([:len [/ip pool find]] = 0) { }", "syntax error (line 1 column 34)"),
    (':if ($"response-count" = 0) do={ /ip pul print }', "bad command name pul (line 1 column 38)"),
    ("{ }", "syntax error (line 1 column 1)"),
    (":put [/ip/address/print]", "syntax error (line 1 column 6)"),
    ("/ip pool add name= ranges=10.0.0.1", "syntax error (line 1 column 19)"),
    ("/ip pool add name=a$b ranges=10.0.0.1", "syntax error (line 1 column 20)"),
    ("/ip pool add name=a\\b ranges=10.0.0.1", "syntax error (line 1 column 20)"),
    ("/ip pool add name=a ranges=10.0.0.1 colour=blue", "expected end of command (line 1 column 37)"),
    ("/ip pool add name=a ranges=10.0.0.1 blue", "expected end of command (line 1 column 37)"),
    (':put "a" :put "b"', "expected end of command (line 1 column 10)"),
    ("/ip pool frobnicate", "bad command name frobnicate (line 1 column 10)"),
    ("/ip pool add ranges=10.0.0.1 name=[/ip pool get]", "Script Error: missing value(s) of argument(s) number"),
    ("/ip pool add name=a", "Script Error: missing value(s) of argument(s) ranges"),
    ("/ip pool remove [find name=none]", "expected item id (/ip/pool/remove; line 1)"),
    ("\n/ip pool remove *77", "no such item (/ip/pool/remove; line 2)"),
    ("/ip pool remove 0", "no such item (/ip/pool/remove; line 1)"),
]


@for_each_row(("text", "words"), REFUSED)
def test_invalid_scripts_are_refused_and_change_nothing(text: str, words: str) -> None:
    router = make()
    before = router.text()
    assert router.script(text) == words
    assert router.text() == before


def test_selectors() -> None:
    router = make()
    script = (
        "/interface ethernet set [ find default-name=ether1 ] comment=one name=wan\n/interface ethernet\n"
        "set *2 comment=two\n"
        "set ether3 comment=three\n"
        "/interface/ethernet/set [find where comment=two] disabled=yes\n"
        "/system logging set 0 topics=info,!dhcp\n"
        "/ip firewall filter\nadd chain=input comment=a\n"
        "add chain=input comment=b place-before=[find comment=a]\n"
        "move [find comment=a] [find comment=b]\n"
        "remove [find comment=b]\n"
    )
    assert router.script(script) == ""
    assert router.value("/interface/ethernet", "comment", "?name=wan") == "one"
    assert router.value("/interface/ethernet", "disabled", "?name=ether2") == "true"
    assert router.value("/interface/ethernet", "comment", "?name=ether3") == "three"
    assert router.value("/system/logging", "topics") == "info,!dhcp"
    assert router.count("/ip/firewall/filter") == 1


def test_unset_in_a_script() -> None:
    router = make()
    assert (
        router.script("/ip firewall filter\nadd chain=input src-address=10.0.0.1\nset [find chain=input] !src-address")
        == ""
    )
    assert router.value("/ip/firewall/filter", "src-address") is None


def test_execute_errors_are_reported_as_traps() -> None:
    router = make(execute="trap")
    reply = router.say("/execute", "=script=/ip pool remove *5", "=as-string=")
    assert reply == ["!trap =category=3 =message=no such item", "!done"]


def test_execute_can_be_missing() -> None:
    router = make(execute="none")
    reply = router.say("/execute", '=script=:put "x"', "=as-string=")
    assert reply == ["!trap =category=0 =message=no such command", "!done"]


def test_without_as_string_execute_returns_the_job_and_logs_errors() -> None:
    router = make()
    (reply,) = router.say("/execute", "=script=/ip pool remove *5")
    assert reply.startswith("!done =ret=*")
    assert router.value("/log", "message", "?topics=script,error") == "no such item"


def test_script_has_only_the_permissions_of_its_user() -> None:
    router = make()
    watch = router.session("watch", "look")
    assert router.say("/execute", "=script=/ip pool add ranges=10.0.0.1", "=as-string=", by=watch) == [
        "!trap =message=not enough permissions (9)",
        "!done",
    ]


def test_too_long_script_is_refused() -> None:
    router = make()
    reply = router.say("/execute", f"=script=# {'x' * 65536}", "=as-string=")
    assert reply == ["!trap =category=1 =message=invalid value for argument script", "!done"]
    assert router.script("# " + "x" * 60000) == ""


# `:do { ... } on-error={ ... }` in scripts of the twin (Manual, Scripting).


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


@for_each_row("case", CASES, ids=str)
def test_do_on_error(case: str) -> None:
    script, output = CASES[case]
    router = make()
    router.script("/ip/address remove [find]")
    assert router.script(script) == output
