"""One list of checks serves `make lint` and pre-commit; one list of parts serves `make quick` and CONTRIBUTING.md."""

import re
import subprocess
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[3]
LISTED = [line.split() for line in (ROOT / "tests" / "parts.txt").read_text().splitlines() if not line.startswith("#")]
PARTS = {name: folders for name, *folders in LISTED}


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)


def test_each_folder_of_unit_tests_is_in_exactly_one_part() -> None:
    folders = [folder for part in PARTS.values() for folder in part]
    units = ROOT / "tests" / "unit"
    tests = [f"{path.relative_to(ROOT / 'tests')}/" for path in units.rglob("test_*.py")]
    assert len(PARTS) == len(LISTED)
    assert [test for test in tests if sum(test.startswith(f"{folder}/") for folder in folders) != 1] == []
    assert all((ROOT / "tests" / folder).is_dir() for folder in folders)


def test_contributing_lists_the_parts_with_their_duration() -> None:
    rows = re.findall(r"^\| `([\w-]+)` \| [^|]+ \| (\d+) \|$", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    assert [name for name, _ in rows] == list(PARTS)
    assert [name for name, seconds in rows if int(seconds) > 60] == []


def test_known_part_is_run_and_unknown_word_lists_the_parts() -> None:
    assert "tests collected" in run("tools/quick", "dds", "--collect-only").stdout
    for word in ("nonsense", "a/b", "#", ""):
        process = run("tools/quick", word)
        assert process.returncode == 3
        assert all(f" {part} " in " ".join(f"{process.stderr} ".split()) + " " for part in PARTS), process.stderr


def test_make_targets_run_the_tools() -> None:
    makefile = (ROOT / "Makefile").read_text()
    assert re.search(r"^quick:.*\n\t@tools/develop\n\t@tools/quick \$\(PART\) \$\(ARGS\)$", makefile, re.MULTILINE)
    assert re.search(r"^lint:.*\n\t@tools/develop\n\t@tools/lint$", makefile, re.MULTILINE)
    assert re.search(r"^docs:.*\n\t@tools/develop\n\t@tools/lint docs$", makefile, re.MULTILINE)


def test_pre_commit_runs_what_make_lint_runs() -> None:
    checks = run("tools/lint", "--list").stdout.split()
    (repo,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    assert repo["repo"] == "local"
    assert [hook["entry"] for hook in repo["hooks"]] == [f"tools/lint {check}" for check in checks]
    assert all(hook["id"] == hook["name"] == check for hook, check in zip(repo["hooks"], checks, strict=True))
    assert all(hook["language"] == "system" and hook["always_run"] for hook in repo["hooks"])
    assert all(hook["pass_filenames"] is False for hook in repo["hooks"])


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ((), 1, "failed: two"),
        (("one",), 0, ""),
        (("two",), 1, "failed: two"),
        (("three",), 3, "there is no check `three`"),
    ],
)
def test_lint_fails_when_one_check_fails(words: tuple[str, ...], code: int, said: str, tmp_path: Path) -> None:
    text = (ROOT / "tools" / "lint").read_text()
    text, number = re.subn(r'checks=".*"', 'checks="one two"', text)
    text, cases = re.subn(r"        ruff\) .*?(?=    esac)", "one) true ;;\ntwo) false ;;\n", text, flags=re.DOTALL)
    assert (number, cases) == (1, 1)
    (tmp_path / "tools").mkdir()
    (tmp_path / "tools" / "lint").write_text(text)
    process = run("sh", str(tmp_path / "tools" / "lint"), *words)
    assert (process.returncode, said in process.stderr) == (code, True)
