"""What apt says, in a technician's words.

Every file of golden/apt was said in that situation, by apt 2.6.2 where its name tells no other one.
Its first line tells how apt was asked and how it ended, then comes what it said, then what we make of it.
"""

from pathlib import Path

from row_subtests import for_each_row

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.apt_messages import (
    explain_install_failure,
    explain_update_failure,
    other_source_notes,
)
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError

CASES = sorted((Path(__file__).parent / "golden" / "apt").glob("*.txt"))
RELEASE = "https://archive.example.org/ros jammy InRelease"


def told(why: ModuleError | None) -> str:
    return "nothing is wrong\n" if why is None else f"{why.message}\n-> {why.hint}\n"


@for_each_row("case", CASES, ids=[case.stem for case in CASES])
def test_apt_errors_are_explained(case: Path) -> None:
    asked, _, rest = case.read_text().partition("\n")
    said, _, words = rest.partition("# in words\n")
    _, kind, *of, _, code = asked.split()
    why = (
        explain_update_failure(said, int(code), of, "amd64") if kind == "update" else explain_install_failure(said, of)
    )
    assert told(why) == words


def test_every_apt_error_has_an_explanation() -> None:
    """Where apt's own words are handed on, that is on purpose: nobody knows a better one."""
    raw = {case.stem for case in CASES if "the text above is apt's output" in case.read_text()}
    assert raw == {"update-damaged-lists"}, "they are repaired before anybody reads this"


def test_architecture_not_used_by_the_computer_may_be_missing() -> None:
    said = f"N: Skipping acquire of configured file 'x' as repository '{RELEASE}' doesn't support architecture '{{}}'"
    url = ["https://archive.example.org/ros/"]
    assert explain_update_failure(said.format("armhf"), 0, url, "arm64") is None
    assert explain_update_failure(said.format("arm64"), 0, url, "arm64") is not None


def test_failures_of_other_sources_are_only_noted_once() -> None:
    said = (
        "W: Failed to fetch http://deb.example.org/debian/dists/x/InRelease  Could not resolve 'deb.example.org'\n"
        "W: Failed to fetch http://deb.example.org/debian/dists/y/InRelease  Could not resolve 'deb.example.org'\n"
        "W: Some index files failed to download. They have been ignored, or old ones used instead.\n"
    )
    ours = ["https://archive.example.org/ros"]
    assert explain_update_failure(said, 0, ours, "arm64") is None
    assert other_source_notes(said, ours) == [
        "the package lists of deb.example.org could not be updated; the previous ones are used"
    ]
    assert other_source_notes("Reading package lists...\n", ours) == []
