"""More than a hundred rows of others in a menu that is ours entirely: what a person is asked, and what is typed."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from quay import ROUTER, Quay, quay

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

WORDS = "the plan removes 101 rows that do not carry our mark: 101 from /ip firewall filter"


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Quay]:
    with quay(tmp_path) as opened:
        opened.configure()
        for each in range(1, 102):
            words = ["=chain=forward", "=action=drop", f"=src-address=198.18.0.{each}", "=comment=blocked"]
            opened.do("console", words=["/ip/firewall/filter/add", *words])
        yield opened


def left(at: Quay) -> int:
    return at.export().count("comment=blocked")


def test_many_foreign_rows_are_removed_after_two_confirmations(at: Quay) -> None:
    declined = at.typed("site=coastal", answer="yes\nno", code=4)
    assert f"{ROUTER}: {WORDS}" in declined
    assert "Remove them? Type remove (the whole word) to continue" in declined
    assert "Change coastal-router now" not in declined
    assert "not confirmed; nothing was changed" in declined
    assert left(at) == 101
    done = at.typed("site=coastal", answer="remove\nyes", code=0)
    assert "1 action on 101 rows applied and verified" in done
    assert left(at) == 0


def test_non_interactive_removal_needs_the_advised_flag(at: Quay) -> None:
    planned = at.provision("plan", "site=coastal", code=2).stdout
    assert "1 changes of 101 rows over" in planned
    assert f"note: {WORDS}" in " ".join(planned.split())
    refused = " ".join(at.provision("site=coastal", code=3).stderr.split())
    assert "no terminal to confirm this; nothing was changed:" in refused
    assert "then run the same command with `--yes --remove-foreign`" in refused
    told = at.json("site=coastal", "--yes", code=4)["devices"][ROUTER]
    assert "refused, nothing was changed: nobody has confirmed that it removes 101 rows" in told["message"]
    assert "run the same command with `--remove-foreign` (plain Ansible" in told["hint"]
    assert "`-e atlantis_remove_foreign=true`" in told["hint"]
    assert left(at) == 101
    assert at.playbook().returncode != 0
    assert left(at) == 101
    told = at.json("site=coastal", "--yes", "--remove-foreign", code=0)["devices"][ROUTER]
    assert (told["status"], told["planned"], told["rows"], left(at)) == ("changed", 1, 101, 0)


def test_plain_ansible_removes_foreign_rows_by_variable(at: Quay) -> None:
    done = at.playbook("-e", "atlantis_remove_foreign=true")
    assert done.returncode == 0, done.stdout
    assert left(at) == 0
