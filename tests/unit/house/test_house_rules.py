"""The rules of tests/conftest.py, seen from outside: a test suite of its own under the same conftest."""

import socket
from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

CONFTEST = Path(__file__).parents[2] / "conftest.py"

SKIPS = {
    "mark": "import pytest\n@pytest.mark.skip(reason='no such tool')\ndef test_one(): pass\n",
    "condition": "import pytest\n@pytest.mark.skipif(True, reason='no such tool')\ndef test_one(): pass\n",
    "call": "import pytest\ndef test_one(): pytest.skip('no such tool')\n",
    "fixture": "import pytest\n@pytest.fixture\ndef f(): pytest.skip('no such tool')\ndef test_one(f): pass\n",
    "unittest": "import unittest\nclass T(unittest.TestCase):\n def test_one(self): self.skipTest('no such tool')\n",
    "module": "import pytest\npytest.skip('no such tool', allow_module_level=True)\ndef test_one(): pass\n",
}


BOTH = pytest.mark.parametrize("options", [(), ("-n", "2")], ids=["alone", "xdist"])


class Run:
    """A run of the inner suite: `suite` maps names of test files to their text."""

    def __init__(self, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
        self.pytester = pytester
        self.monkeypatch = monkeypatch
        pytester.makeconftest(CONFTEST.read_text())
        for name in ("PYTEST_ADDOPTS", "PYTEST_XDIST_WORKER", "PYTEST_XDIST_WORKER_COUNT", "CI"):
            monkeypatch.delenv(name, raising=False)

    def __call__(
        self, suite: dict[str, str], *options: str, ci: bool = True, allowed: str = ""
    ) -> tuple[int, dict[str, int], str]:
        self.pytester.makepyfile(**{f"test_{name}": text for name, text in suite.items()})
        (self.pytester.path / "allowed-skips.txt").write_text(allowed)
        if ci:
            self.monkeypatch.setenv("CI", "true")
        result = self.pytester.runpytest_subprocess("-p", "no:cacheprovider", *options)
        return int(result.ret), result.parseoutcomes(), result.stdout.str()


@pytest.fixture
def run(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> Run:
    return Run(pytester, monkeypatch)


@BOTH
def test_an_unreviewed_skip_fails_in_ci(run: Run, options: tuple[str, ...]) -> None:
    within = {name: text for name, text in SKIPS.items() if name != "module"}
    code, outcomes, said = run(within, *options)
    assert code == 1
    assert outcomes.get("failed", 0) + outcomes.get("errors", 0) == len(within)
    assert "not on the list tests/allowed-skips.txt: no such tool" in said


@BOTH
def test_an_unreviewed_skip_of_a_whole_file_fails_in_ci(run: Run, options: tuple[str, ...]) -> None:
    code, outcomes, said = run({"module": SKIPS["module"]}, *options)
    assert code != 0
    assert outcomes.keys() <= {"error", "errors"}
    assert "not on the list tests/allowed-skips.txt: no such tool" in said


@BOTH
def test_reviewed_skip_is_allowed_in_ci(run: Run, options: tuple[str, ...]) -> None:
    passing = {"passing": "def test_one(): pass\n"}
    _, outcomes, _ = run(SKIPS | passing, *options, allowed="# it is not packaged\nno such tool\n")
    assert outcomes == {"skipped": len(SKIPS), "passed": 1}


def test_allowed_reason_must_match_completely(run: Run) -> None:
    assert run({"call": SKIPS["call"]}, allowed="no such\n# no such tool\n")[1] == {"failed": 1}


def test_skips_are_allowed_outside_ci(run: Run) -> None:
    assert run({"call": SKIPS["call"]}, ci=False)[1] == {"skipped": 1}


def test_an_expected_failure_is_no_skip(run: Run) -> None:
    suite = {"expected": "import pytest\n@pytest.mark.xfail(strict=True)\ndef test_one(): assert False\n"}
    assert run(suite)[1] == {"xfailed": 1}


@pytest.mark.parametrize("address", ["192.0.2.1", "2001:db8::1", "device.example"])
def test_a_connection_beyond_loopback_fails_the_test(address: str) -> None:
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with socket.socket(family) as sock, pytest.raises(pytest.fail.Exception, match="beyond loopback"):
        sock.connect((address, 8729))


def test_loopback_is_open() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket() as client:
        assert client.connect_ex(server.getsockname()) == 0
