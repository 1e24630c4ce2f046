"""The docs keep their word: what they show on a console is run, in order, in the checkout of a stranger."""

import os
import re
import shlex
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import preforked
import pytest
from docs_console import Shown, shown
from house_checkout import ROOT, clean_environment, shared_checkout, start
from row_subtests import for_each_row

from atlantis_netcfg.cli.help import MEANING
from atlantis_netcfg.core.errors import WORST_FIRST, ExitCode

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
ELSEWHERE = {"quick-start.md", "inicio-rapido.md"}
"""test_quick_start.py types them: in a clone of its own, at a terminal."""
PROGRAM_ITSELF = "running.md"
"""The page of which every line starts the program itself; those of the others are typed into a prepared process."""
EXECUTED = [page for page in PAGES if page.name not in ELSEWHERE and shown(page)]


@pytest.fixture(scope="session")
def first_checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return shared_checkout(tmp_path_factory)


@dataclass(frozen=True)
class Own:
    """A checkout for one page, past its first start, and the words before each command that is typed in it."""

    place: Path
    prefix: tuple[str, ...] = ()


@pytest.fixture(scope="session")
def server(first_checkout: Path) -> int:
    """The descriptor of a process that has imported what commands need, from the shared checkout."""
    return preforked.server(str(first_checkout / ".venv" / "bin" / "python")).fileno()


@pytest.fixture
def checkout(first_checkout: Path, server: int, request: pytest.FixtureRequest, tmp_path: Path) -> Own:
    """Root lays a layer of the page's own over the shared checkout; anybody else copies it, which takes 10 s.

    In the layer `provision` is a client of the prepared process, but for one page.
    """
    if os.geteuid() == 0 and " " not in str(tmp_path):
        layers = [tmp_path / name for name in ("upper", "work", "below")]
        for layer in layers:
            layer.mkdir()
        upper, work, below = layers
        if request.getfixturevalue("page").name != PROGRAM_ITSELF:
            (upper / "provision").write_text(f'#!/bin/sh\nexec {shlex.join(preforked.client(server))} "$@"\n')
            (upper / "provision").chmod(0o755)
        options = f"lowerdir={below},upperdir={upper},workdir={work}"
        lay = f'mount --bind "$0" {below} && mount -t overlay overlay -o {options} "$0" && cd "$0" && exec "$@"'
        prefix = ("unshare", "--mount", "sh", "-c", lay, str(first_checkout))
        if subprocess.run([*prefix, "true"], capture_output=True, check=False).returncode == 0:
            return Own(first_checkout, prefix)
    own = shutil.copytree(first_checkout, tmp_path / "atlantis", symlinks=True)
    assert start(own, "--version", environment=clean_environment(HOME=str(tmp_path))).returncode == 0
    return Own(own)


@pytest.mark.slow
@pytest.mark.parametrize("page", EXECUTED, ids=lambda page: page.name)
def test_commands_of_each_page_behave_as_shown(page: Path, checkout: Own, server: int, tmp_path: Path) -> None:
    (tmp_path / "home").mkdir()
    environment = clean_environment(HOME=str(tmp_path / "home"), TERM="dumb")
    for command in shown(page):
        assert not command.answers, f"{command.place}: nobody is here to answer"
        process = subprocess.run(
            [*checkout.prefix, "bash", "-c", command.command],
            cwd=checkout.place,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            pass_fds=[server],
            text=True,
            check=False,
        )
        report = (
            f"{command.place}: $ {command.command}\nexit {process.returncode}, shown {command.exit}\n{process.stdout}"
        )
        assert process.returncode == command.exit, report
        assert command.agrees(process.stdout), f"{report}\nshown:\n{command.output}"


@for_each_row("page", PAGES, ids=lambda page: page.name)
def test_relative_links_resolve(page: Path) -> None:
    links = re.findall(r"\]\((?!https?:)([^)#]+)(?:#[^)]*)?\)", page.read_text())
    assert [link for link in links if not (page.parent / link).exists()] == []


def test_exit_code_table_matches_the_enum() -> None:
    rows = re.findall(r"^\| (\d) \| ([^|]+) \|", (ROOT / "docs" / "exit-codes.md").read_text(), re.MULTILINE)
    assert [(int(code), meaning) for code, meaning in rows] == [(int(code), MEANING[code]) for code in ExitCode]


def test_exit_code_order_matches_the_code() -> None:
    said = re.search(r"needs you most: ([\d, a-z]+)\.", (ROOT / "docs" / "exit-codes.md").read_text())
    assert said is not None
    page = [int(code) for code in re.findall(r"\d", said[1])]
    assert page == [int(code) for code in WORST_FIRST if code is not ExitCode.DONE]
    others = set(ExitCode) - set(WORST_FIRST)
    assert others == {ExitCode.NOTHING}, "what is nothing for one device is nothing beside the others"


PAGE = """\
text
<!-- exit: 0 2; output: example -->

```console
$ one
$ two \\
    more
said
```

<!-- not executed: it would delete you -->
```console
$ three
```

```sh
$ no console
```

```console
$ four
a … b
…
end
```

| It asks | You type, then Enter |
|---|---|
| Your name | `A. Technician` |
| Photo | nothing |

| It asks | You type |
"""


ANSWERS = (("Your name", "A. Technician"), ("Photo", ""))


def test_commands_of_a_page_are_parsed(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    assert shown(page) == [
        Shown("page.md:4", "one", 0, "", compared=False),
        Shown("page.md:4", "two more", 2, "said", compared=False),
        Shown("page.md:20", "four", 0, "a … b\n…\nend", compared=True, answers=ANSWERS),
    ]


@pytest.mark.parametrize(
    ("printed", "agrees"),
    [
        ("a x b\nend\n", True),
        ("a  b  \n1\n2\nend\n", True),
        ("a x b\nend\nmore\n", False),
        ("a x\nend\n", False),
        ("a x b c\nend\n", False),
        ("", False),
    ],
)
def test_ellipsis_matches_any_text(printed: str, agrees: bool) -> None:  # noqa: FBT001 - a column of the table
    assert Shown("page", "four", 0, "a … b\n…\nend", compared=True).agrees(printed) is agrees


@pytest.mark.parametrize(
    "page",
    [
        "```console\nno command\n```\n",
        "```console\n$ no end\n",
        "<!-- exit: 1 2 3 -->\n```console\n$ one\n$ two\n```\n",
        "<!-- exti: 1 -->\n```console\n$ one\n```\n",
        "```console\n$ one\n```\n\n| It asks | You type |\n|---|---|\n| no response |\n",
    ],
)
def test_malformed_block_is_refused(page: str, tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text(page)
    with pytest.raises(ValueError, match=r"page\.md:\d"):
        shown(tmp_path / "page.md")
