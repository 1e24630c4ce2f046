"""What the frame of all commands does for those of two words, and for text that would do something to a terminal."""

import pytest

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.commands import COMMANDS
from atlantis_netcfg.cli.vpn import _common
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.printable import line as printable_line

OURS = [name for name in COMMANDS if name.startswith("vpn ")]


def test_bare_vpn_command_lists_its_subcommands(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["vpn"]) == ExitCode.USAGE
    said = capsys.readouterr().err
    assert all(name.removeprefix("vpn ") in said for name in OURS)
    for line in (["vpn", "--help"], ["-h", "vpn"]):
        assert main(line) == ExitCode.DONE
        told = capsys.readouterr().out
        assert [row.split("  ")[1] for row in told.splitlines() if row.startswith("  vpn ")] == OURS
        assert "  run " not in told


def test_error_prints_no_terminal_escapes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["vpn", "list", "partner=a", "\x1b[2J\u202e\x9b\udcff=x"]) == ExitCode.USAGE
    said = capsys.readouterr().err
    assert "\\u001b[2J\\u202e\\u009b\\udcff" in said
    assert said.replace("\n", "").isprintable()
    assert printable_line("čaj 🤖") == "čaj 🤖"


def test_interrupted_command_says_to_repeat_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(_arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(_common, "load_inventory", stopped)
    assert main(["vpn", "onboard", "device=coastal-gateway"]) == ExitCode.UNKNOWN
    assert "run the same command again" in capsys.readouterr().err
