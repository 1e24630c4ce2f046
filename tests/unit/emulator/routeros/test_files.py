"""Files, import, export over the API, backup."""

from twin_bench import Bench, make


def put(router: Bench, name: str, contents: str) -> None:
    (reply,) = router.say("/file/add", f"=name={name}", f"=contents={contents}")
    assert reply.startswith("!done =ret=*")


def test_import_stops_at_the_first_error_and_undoes_nothing() -> None:
    router = make()
    put(
        router, "x.rsc", "/ip pool\nadd name=a ranges=10.0.0.1\nadd name=b rages=10.0.0.2\nadd name=c ranges=10.0.0.3\n"
    )
    assert router.say("/import", "=file-name=x.rsc") == [
        "!trap =category=3 =message=expected end of command (line 3 column 12)",
        "!done",
    ]
    assert router.say("/ip/pool/print", "=.proplist=name") == ["!re =name=a", "!done"]


def test_dry_run_finds_syntax_errors_only() -> None:
    router = make()
    put(router, "x.rsc", "/ip pool\nadd name=a ranges=nonsense\n")
    assert router.say("/import", "=file-name=x.rsc", "=verbose=yes", "=dry-run=") == ["!done"]
    assert router.count("/ip/pool") == 0
    put(router, "y.rsc", "/ip pool\nfrobnicate\n")
    assert router.say("/import", "=file-name=y.rsc", "=verbose=yes", "=dry-run=")[0] == (
        "!trap =category=3 =message=bad command name frobnicate (line 2 column 1)"
    )


def test_export_reaches_the_api_through_a_file() -> None:
    router = make()
    assert router.say("/export") == ["!done"]
    assert router.say("/export", "=file=now") == ["!done"]
    (piece, _) = router.say("/file/read", "=file=now.rsc", "=chunk-size=30", "=offset=2")
    assert piece == "!re =data=2026-01-01 08:00:00 by RouterO"
    assert router.value("/file", "type", "?name=now.rsc") == "script"


def test_reimport_of_own_export_fails_on_existing_names() -> None:
    router = make()
    router.script("/interface bridge add name=lan\n/ip address add address=10.0.0.1/24 interface=lan")
    router.say("/export", "=file=all", "=show-sensitive=")
    reply = router.say("/import", "=file-name=all.rsc")
    assert reply == ["!trap =category=3 =message=failure: already have interface with such name", "!done"]


def test_file_size_limit_and_names() -> None:
    router = make()
    assert router.say("/file/add", "=name=big", f"=contents={'x' * 61441}") == [
        "!trap =category=1 =message=invalid value for argument contents",
        "!done",
    ]
    put(router, "a.txt", "one")
    assert router.say("/file/add", "=name=a.txt")[0].startswith("!trap")
    router.say("/file/set", "=.id=a.txt", "=contents=two")
    assert router.value("/file", "contents", "?name=a.txt") == "two"
    assert router.say("/file/remove", "=.id=a.txt") == ["!done"]
    assert router.say("/file/remove", "=.id=a.txt") == ["!trap =category=0 =message=no such item", "!done"]


def test_loading_a_backup_needs_a_reboot() -> None:
    router = make()
    before = router.text()
    assert router.say("/system/backup/save", "=name=before") == ["!done"]
    router.say("/ip/pool/add", "=name=a", "=ranges=10.0.0.1")
    assert router.say("/system/backup/load", "=name=before.backup") == ["!done"]
    assert router.device.wants_reboot
    router.device.reboot()
    assert router.text() == before
    assert '"before.backup"' not in before
