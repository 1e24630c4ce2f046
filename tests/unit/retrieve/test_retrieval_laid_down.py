"""What either end of a retrieval gets, and that it goes when it is declared no more."""

from __future__ import annotations

import json

from retrieval_programs import CENTRE, GATEWAY, KEY, SHIPPED, with_retrieval

from atlantis_netcfg.gateway.base import gateway_base
from atlantis_netcfg.gateway.retrieval import PACKAGES, SERVICE, retrieval


def test_a_gateway_knows_where_to_send_and_by_which_key() -> None:
    declaration = with_retrieval()
    made = retrieval(declaration, declaration.hosts[GATEWAY])
    files = {file.path: file.content for file in made.files}
    assert json.loads(files["/etc/atlantis/retrieval.json"]) == {
        "from": "10.80.0.21",
        "from_host": GATEWAY,
        "to": CENTRE,
        "address": "10.80.0.2",
        "port": 22,
        "user": "svc-retrieval",
        "key": "/etc/ssh/ssh_host_ed25519_key",
        "sources": {GATEWAY: {"folder": "/var/lib/svc-recording"}},
    }
    assert files["/etc/atlantis/retrieval.known_hosts"] == f"{CENTRE} {KEY}\n"
    unit = files[f"/etc/systemd/system/{SERVICE}"].splitlines()
    assert "ProtectSystem=strict" in unit, "it cannot change a recording"
    assert "ConditionPathExists=/var/lib/atlantis/retrieval/job.json" in unit
    assert [(unit.name, unit.active) for unit in made.units] == [(SERVICE, None)], "a job starts it, no run does"


def test_the_control_centre_gives_that_key_one_program_alone() -> None:
    declaration = with_retrieval()
    made = retrieval(declaration, declaration.hosts[CENTRE])
    files = {file.path: file.content for file in made.files}
    words = f"/usr/bin/python3 -I /usr/local/lib/atlantis/retrieval_receive.py {GATEWAY} /srv/recordings 1000"
    assert files["/etc/atlantis/retrieval.keys"] == (f'restrict,from="10.80.0.21",command="{words}" {KEY} {GATEWAY}\n')
    assert "Match User svc-retrieval" in files["/etc/ssh/sshd_config.d/50-atlantis-retrieval.conf"]
    assert made.units == ()


def test_an_end_that_has_another_host_key_is_a_finding_of_every_run() -> None:
    declaration = with_retrieval()
    for name in (GATEWAY, CENTRE):
        (check,) = retrieval(declaration, declaration.hosts[name]).checks
        assert check.run == ("grep", "-qF", f" {KEY.split()[1]}", "/etc/ssh/ssh_host_ed25519_key.pub")
        assert "is not the declared one" in check.finding
        assert retrieval(declaration, declaration.hosts[name], rehearsed=True).checks == ()


def test_what_is_declared_no_more_goes_and_others_have_nothing() -> None:
    declared = with_retrieval()
    laid = {file.path for name in (GATEWAY, CENTRE) for file in retrieval(declared, declared.hosts[name]).files}
    for name in (GATEWAY, CENTRE, "te4sea-gateway"):
        made = retrieval(SHIPPED, SHIPPED.hosts[name])
        assert (made.files, made.units, made.checks) == ((), (), ())
        assert set(made.absent) == laid


def test_rsync_comes_with_either_end_alone() -> None:
    declared = with_retrieval()
    for name, there in ((GATEWAY, True), (CENTRE, True), ("te4sea-gateway", False)):
        packages = {package.name for package in gateway_base(declared, declared.hosts[name]).packages}
        assert (set(PACKAGES) <= packages) is there
