"""docs/troubleshooting.md has a row for each message of exit codes 4, 5 and 6, and none for a message that is gone."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest
from failure_messages import LEAST, PACKAGE, REASONS, Message, failing, messages, passed_on, read

from atlantis_netcfg.cli.base.commands import COMMANDS, choose, load

PAGE = Path(__file__).parents[3] / "docs" / "troubleshooting.md"
ROW = re.compile(r"^\| (`.+`) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)
LINE = re.compile(r"^\| (?!You see|---)", re.MULTILINE)
MOST = 6
"""Different messages that one pattern may stand for: more would be a catch-all."""
_CALLER = "its callers give the whole text, which is read where they stand"
_CAUSE = "the text is that of the error that was caught, which has a row of its own"
_REASON = "the text is a reason that REASONS reads"
_DEVICE = "the text is the device's or the other program's own, behind its name"
PASSED_ON = {
    ("links/lte/rutos_client.py", "CertificateUnknown"): _CALLER,
    ("routeros/first_contact/run.py", "CutOff"): _CAUSE,
    ("routeros/first_contact/run.py", "DeviceError"): _REASON,
    ("routeros/first_contact/run.py", "PreflightError"): _REASON,
    ("cli/base/session.py", "CommandInterrupt"): _CALLER,
    ("cli/robot.py", "CostRefusal"): _CAUSE,
    ("routeros/console/terminal.py", "ConsoleLost"): _CAUSE,
    ("routeros/console/types.py", "ConsoleLost"): _CALLER,
    ("routeros/console/types.py", "ConsoleCommandError"): _CALLER,
    ("routeros/console/types.py", "HostKeyMismatch"): _CALLER,
    ("routeros/console/types.py", "UnknownHostKey"): _CALLER,
    ("operations/adopt.py", "ConsoleUnreachable"): _CAUSE,
    ("operations/lte/run.py", "LteResult"): _CAUSE,
    ("operations/qualify/far_end.py", "FarEndUnavailable"): _DEVICE,
    ("operations/robots/remote.py", "ListenError"): _DEVICE,
    ("operations/computers/remote_session.py", "HostKeyMismatch"): _DEVICE,
    ("operations/computers/remote_session.py", "ServerRefusal"): _DEVICE,
    ("operations/vpn/live.py", "StaleRecord"): _REASON,
    ("operations/vpn/router.py", "DeviceError"): _CAUSE,
    ("vpn/reports.py", "CorruptAuthorityError"): _REASON,
    ("vpn/router_import.py", "DeviceError"): _CAUSE,
    ("routeros/api/_values.py", "CertificateMismatch"): _CALLER,
    ("routeros/api/_values.py", "CertificateUnknown"): _CALLER,
    ("routeros/api/_values.py", "CommandError"): _CALLER,
    ("routeros/api/_values.py", "SessionLost"): _CALLER,
    ("routeros/apply/_change.py", "ActionError"): _DEVICE,
    ("routeros/apply/_change.py", "VerificationError"): _CALLER,
    ("routeros/apply/_contact.py", "Unfit"): "the text says which of two radio menus fits, in the words of the plan",
    ("routeros/apply/_executor.py", "Busy"): _CAUSE,
    ("routeros/pair/_transaction.py", "ProtectionLost"): _CAUSE,
    ("routeros/pair/_transaction.py", "SafeModeUnavailable"): _CAUSE,
    ("routeros/planner/__init__.py", "CannotPlan"): _REASON,
    ("vpn/authority/model.py", "AuthorityError"): _REASON,
    ("vpn/ledger/file.py", "CorruptLedgerError"): _REASON,
}
"""What has no words of its own, by file and by what makes it: each with the reason why its text is read elsewhere."""


@cache
def all_messages() -> set[Message]:
    return messages()


def worded() -> set[Message]:
    return {message for message in all_messages() if len(message.fixed) >= LEAST}


def rows() -> list[tuple[str, str, str]]:
    return ROW.findall(PAGE.read_text(encoding="utf-8"))


def patterns() -> list[str]:
    return [pattern for cell, _, _ in rows() for pattern in cell.strip("`").split("`<br>`")]


def shown_as(message: Message) -> str:
    """As the page can show it: a back-tick within a back-tick cannot be."""
    return message.text.replace("`", "")


def test_every_message_has_a_row() -> None:
    without = {m for m in worded() if not any(pattern in shown_as(m) for pattern in patterns())}
    assert sorted(without) == [], "add them to docs/troubleshooting.md: what is seen, why, what to do"


def test_every_row_is_about_a_message() -> None:
    texts = {shown_as(message) for message in worded()}
    assert [pattern for pattern in patterns() if not any(pattern in text for text in texts)] == []


def test_no_row_is_too_general() -> None:
    texts = {shown_as(message) for message in worded()}
    assert [pattern for pattern in patterns() if sum(pattern in text for text in texts) > MOST] == []
    assert [pattern for pattern in patterns() if len(re.sub(r"[^a-zA-Z]", "", pattern)) < LEAST] == []
    assert len(patterns()) == len(set(patterns()))


def test_every_row_has_a_cause_and_an_action() -> None:
    assert len(rows()) == len(LINE.findall(PAGE.read_text(encoding="utf-8"))) > 50
    assert [row for row in rows() if min(len(cell.strip()) for cell in row) < 5] == []


def test_messages_without_own_text_are_listed_with_a_reason() -> None:
    assert {(message.file, message.made_by) for message in all_messages() - worded()} == PASSED_ON.keys()


def test_advised_commands_and_arguments_exist() -> None:
    page = PAGE.read_text(encoding="utf-8")
    cells = [*(advice for _, _, advice in rows()), *(line for line in page.splitlines() if not line.startswith("|"))]
    advised = re.findall(r"`provision ([^`]+)`", "\n".join(cells))
    assert len(advised) > 20
    for text in advised:
        name, given = choose(text.split(), COMMANDS)
        command = load(name, COMMANDS).command
        known = {f"{word.name}=" for word in command.words} | {f"--{flag.name}" for flag in command.flags}
        assert [word for word in given if re.sub(r"=.*", "=", word) not in known] == [], text


def test_advised_standalone_arguments_exist() -> None:
    commands = [load(name, COMMANDS).command for name in COMMANDS]
    known = {f"{word.name}=" for command in commands for word in command.words}
    known |= {f"--{flag.name}" for command in commands for flag in command.flags}
    advice = " ".join(advice for _, _, advice in rows())
    alone = re.findall(r"`(--[\w-]+|[a-z]+=)[^` ]*`", advice)
    assert len(alone) > 5
    assert [word for word in alone if word not in known] == []


SOURCE = '''
class Lost(DeviceError):
    """No `exit` of its own."""
class Mended(Lost):
    exit = ExitCode.DONE
def f(name, ok):
    words = "the first" if ok else "the second"
    raise Lost(f"{name}: {words} has gone" + "!")
def g():
    work.result(Status.ROLLED_BACK, f"taken back: {why}", hint="again")
    Result(name, ExitCode.UNKNOWN if lost else ExitCode.DONE, message="nobody knows")
    tell([("stopped here", None)], ExitCode.FAILED)
    raise Mended("all is well again")
    work.result(Status.DONE, "all is well")
'''


@pytest.mark.parametrize("base", ["class DeviceError(Exception):\n    exit = ExitCode.FAILED\n"])
def test_messages_are_extracted_from_source(base: str) -> None:
    tree = ast.parse(base + SOURCE)
    failures = failing([tree])
    assert failures == {"DeviceError", "Lost"}
    assert sorted(text for _, text in read(tree, failures)) == [
        "nobody knows",
        "stopped here",
        "taken back: …",
        "…: the first has gone!",
        "…: the second has gone!",
    ]


def test_every_function_with_reasons_exists() -> None:
    for file, functions in REASONS.items():
        nodes = ast.walk(ast.parse((PACKAGE / file).read_text()))
        defined = {node.name for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)}
        assert set(functions.split()) - {"*"} <= defined, file


def test_reasons_are_read_only_from_their_modules() -> None:
    tree = ast.parse('def read():\n    damage = f"line {n} is damaged"\ndef other():\n    return "text"\n')
    assert list(passed_on(tree, "vpn/ledger/file.py")) == [("read", "line … is damaged")]
    assert list(passed_on(tree, "vpn/server.py")) == []
