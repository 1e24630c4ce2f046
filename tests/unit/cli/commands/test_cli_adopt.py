"""What `provision device adopt` refuses before it contacts anything."""

from pathlib import Path

import pytest

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.adopt import _read_secret_file
from atlantis_netcfg.core.errors import UsageError

SITE = ("device", "adopt", "site=scc", "device=scc-router")


@pytest.mark.parametrize(
    ("typed", "code", "said"),
    [
        ((*SITE, "--rehearse", "via=telnet"), 3, "`via=telnet` is not a valid way to reach a router"),
        ((*SITE, "--rehearse", "via=serial:"), 3, "`via=serial:` is not a valid way to reach a router"),
        ((*SITE, "--rehearse", "wait=soon"), 3, "`wait=soon` is not a number of seconds"),
        (SITE, 3, "the inventory still contains example values"),
        (
            ("device", "adopt", "site=scc", "device=scc-vpn", "--rehearse"),
            7,
            "scc-vpn is a vpn server: only RouterOS devices can be adopted",
        ),
        (("device", "adopt", "site=scc", "device=scc-rooter", "--rehearse"), 7, "scc-rooter"),
    ],
)
def test_invalid_command_lines_are_refused(
    typed: tuple[str, ...], code: int, said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    del tmp_path
    assert main(typed) == code
    assert said in capsys.readouterr().err


def test_password_file_must_be_private(tmp_path: Path) -> None:
    file = tmp_path / "sticker.txt"
    file.write_text("5TICKER \n")
    file.chmod(0o644)
    with pytest.raises(UsageError, match="other users can read the password file") as refused:
        _read_secret_file(file)
    assert refused.value.hint == f"type `chmod 600 {file}`"
    file.chmod(0o600)
    assert _read_secret_file(file).reveal() == "5TICKER "
    assert "5TICKER" not in str(_read_secret_file(file))


def test_missing_password_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot read the password file"):
        _read_secret_file(tmp_path / "sticker.txt")
