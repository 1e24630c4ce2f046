"""Before and after the link: what is asked of a module, and what becomes of all that a gateway says."""

import importlib
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from ansible.errors import AnsibleConnectionFailure
from ansible.module_utils.testing import patch_module_args
from ansible.plugins.action import ActionBase
from impostor import HOSTILE, control_characters

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils import zipapp_action
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils import zipapp_action as thin
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.board.basic import MARK
from atlantis_netcfg.core.messages import Message, arg, msg
from atlantis_netcfg.core.stored_messages import pack

ROOT = Path(__file__).parents[3]
MODULES = "atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules"
TOKEN = "glpat-of-nobody"
BUILD = {"library": {"url": "https://git.example.org/a.git", "revision": "v1", "token": TOKEN}, "ros_setup": "/s"}


class Asked(Exception):
    """Stands for the end of a module's construction."""


def said(stdout: str, stderr: str = "", rc: int = 0, **more: Any) -> dict[str, Any]:  # noqa: ANN401
    return {"stdout": stdout, "stderr": stderr, "rc": rc, **more}


@pytest.mark.parametrize(
    "name", ["configure", "packages", "build", "bundle", "clock", "network", "env_conflicts", "connection_test"]
)
def test_action_and_module_share_one_argument_spec(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module = importlib.import_module(f"{MODULES}.{name}")
    taken: dict[str, Any] = {}

    def record(_self: object, argument_spec: dict[str, Any], **rules: Any) -> None:  # noqa: ANN401
        taken.update(rules, argument_spec=argument_spec)
        raise Asked

    monkeypatch.setattr(module.AnsibleModule, "__init__", record)
    with pytest.raises(Asked):
        module.main()
    rules = getattr(module, "RULES", {})
    assert taken == {"argument_spec": module.ARGUMENTS, "supports_check_mode": True, **rules}
    assert '"type": "path"' not in json.dumps(module.ARGUMENTS), "a path would be expanded on this computer"


def test_module_also_runs_as_an_ordinary_ansible_module(capsys: pytest.CaptureFixture[str]) -> None:
    module = importlib.import_module(f"{MODULES}.env_conflicts")
    with patch_module_args({"variables": {}, "why": "because", "_ansible_check_mode": True}), pytest.raises(SystemExit):
        module.main()
    told = json.loads(capsys.readouterr().out)
    assert (told["changed"], told["notes"]) == (False, [])
    with patch_module_args({"variables": {}}), pytest.raises(SystemExit):
        module.main()
    assert json.loads(capsys.readouterr().out)["msg"] == "missing required arguments: why"


def test_parameters_get_defaults_and_types() -> None:
    parameters, secrets, wrong = zipapp_action.validate_arguments(
        "configure", {"files": [{"path": "/a", "content": 1}], "units": [{"name": "b"}]}
    )
    assert (wrong, secrets) == (None, set())
    (file,), (unit,) = parameters["files"], parameters["units"]
    assert (file["content"], file["mode"], file["validate"], file["secret_content"]) == ("1", "0644", [], None)
    assert (unit["enabled"], unit["wait"], parameters["absent"], parameters["way_in"]) == (None, True, [], None)
    assert zipapp_action.validate_arguments("clock", {"now": "12.5"})[0] == {"now": 12.5, "tolerance_s": 300}


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("clock", {}, "missing required arguments: now"),
        ("clock", {"now": "noon"}, "unable to convert to float"),
        ("clock", {"now": 1, "nwo": 2}, r"Unsupported parameters for \(atlantis.netcfg.clock\) module: nwo. Supported"),
        ("configure", {"files": [{"path": "/a", "content": "", "moed": "0600"}]}, r"module: files\.moed"),
        ("configure", {"files": [{"path": "/a"}]}, "one of the following is required: content, secret_content"),
        ("build", {**BUILD, "library": {"url": "u"}}, "missing required arguments: revision found in library"),
    ],
)
def test_invalid_arguments_are_reported_before_sending(name: str, arguments: dict[str, Any], words: str) -> None:
    wrong = zipapp_action.validate_arguments(name, arguments)[2]
    assert wrong is not None
    assert re.search(words, wrong), wrong


def test_rules_between_parameters_are_checked() -> None:
    told = {"by": "netplan", "interface": "e", "address": "a", "gateway": "g", "path": "/p", "content": "c"}
    assert zipapp_action.validate_arguments("network", {**told, "action": "stage"})[2] is None
    assert "action is look but all of the following are missing: name" in str(
        zipapp_action.validate_arguments("network", {**told, "action": "look"})[2]
    )


def test_secret_is_masked_everywhere() -> None:
    _, secrets, _ = zipapp_action.validate_arguments("build", BUILD)
    assert secrets == {TOKEN}
    shown = zipapp_action.mask_secrets(
        {"msg": f"git said {TOKEN}", "notes": [TOKEN], "changed": True, "deep": {"a": [f"x{TOKEN}"]}}, secrets
    )
    assert TOKEN not in repr(shown)
    assert shown["changed"] is True
    _, secrets, wrong = zipapp_action.validate_arguments("build", {**BUILD, "jobs": TOKEN})
    assert TOKEN not in zipapp_action.mask_secrets({"msg": str(wrong)}, secrets)["msg"]
    cut = zipapp_action.mask_secrets(
        zipapp_action.answer(said("", f"Traceback\nValueError: {TOKEN}\n", 1), "build"), secrets
    )
    assert TOKEN not in repr(cut)
    assert cut["failed"] is True


def test_secret_is_masked_in_marked_texts_as_well() -> None:
    inside, across = msg(f"git said {arg(f'no to {TOKEN}')}"), msg(f"{arg(TOKEN[:5])}{arg(TOKEN[5:])} is refused")
    result = pack({"msg": inside, "notes": [across, msg(f"{arg(2.5)} s")]})
    shown = zipapp_action.clean_result(result, {TOKEN})
    assert TOKEN not in repr(shown)
    assert TOKEN not in repr([str.__str__(Message(text)) for text in shown["texts"]])
    assert [str.__str__(Message(text)) for text in shown["texts"]] == [shown["msg"], "2.5 s"]


def test_last_marked_line_is_the_result_despite_other_output() -> None:
    around = (
        f"Welcome aboard\n{MARK}broken\n{MARK}" + '{"changed": false}\n' + f'{MARK}{{"changed": true, "a": "\u2028"}}\n'
    )
    assert zipapp_action.answer(said(f"{around}bye\n"), "clock") == {"changed": True, "a": "\u2028"}


def test_ansible_internal_keys_are_dropped_from_gateway_output() -> None:
    told = f'{MARK}{{"ansible_facts": {{"a": 1}}, "_ansible_no_log": false, "changes": ["{{{{ 1 + 1 }}}}"]}}\n'
    assert zipapp_action.answer(said(told), "clock") == {"changes": ["{{ 1 + 1 }}"]}


@pytest.mark.parametrize(
    ("output", "words", "hint"),
    [
        (
            said("motd\n", "Killed\n", 137),
            "clock was cut off on this computer (exit 137):\nmotd\nKilled",
            "type the same",
        ),
        (said("", "", 1), "clock was cut off on this computer (exit 1) without output", "type the same"),
        (said(f'{MARK}{{"cha', "", 137), "clock was cut off", "type the same"),
        (said("", "/bin/sh: 1: python3: not found\n", 127), "has no Python where it is looked for", "apt-get install"),
        (said("", "", 0, python=(3, 6)), "has Python 3.6, and at least 3.8 is needed", "Ubuntu 20.04"),
    ],
)
def test_module_without_a_result_has_failed(output: dict[str, Any], words: str, hint: str) -> None:
    told = zipapp_action.answer(output, "clock")
    assert told["failed"] is True
    assert words in told["msg"]
    assert hint in told["hint"]


class Asks(zipapp_action.ZipappAction):
    """Asks a gateway that says this, or raises it."""

    module = "clock"

    def __init__(self, says: dict[str, Any] | Exception) -> None:
        self.says = says
        self._task = SimpleNamespace(no_log=True, check_mode=False)

    def _run_tool(self, name: str, asked: bytes, variables: dict[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        if isinstance(self.says, Exception):
            raise self.says
        return self.says


@pytest.mark.parametrize(
    "says",
    [
        said(f"{MARK}{json.dumps({'msg': HOSTILE, HOSTILE: {HOSTILE: [HOSTILE]}, 'diff': [{'before': HOSTILE}]})}\n"),
        said(HOSTILE, HOSTILE, 1),
        said("", HOSTILE, 127),
    ],
    ids=["result", "cut off", "no python"],
)
def test_gateway_output_has_no_control_characters(says: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thin, "end_with_parent", lambda: None)
    told = Asks(says).run_module("clock", {"now": 1}, {})
    assert control_characters("".join(_texts(told))) == []
    assert "evil\\u001b]0;owned" in "".join(_texts(told))


def test_connection_error_has_no_control_characters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thin, "end_with_parent", lambda: None)
    with pytest.raises(AnsibleConnectionFailure) as failed:
        Asks(AnsibleConnectionFailure(f"over ssh:\r\n{HOSTILE}\r\n")).run_module("clock", {"now": 1}, {})
    assert control_characters(str(failed.value)) == []
    assert str(failed.value).startswith("over ssh:\nevil\\u001b")
    assert failed.value.__suppress_context__, "Ansible prints causes as well"


class Stock(ActionBase):  # type: ignore[misc]  # ansible-core ships no type information
    """An action of Ansible's own."""

    def __init__(self, says: dict[str, Any] | Exception) -> None:
        self.says = says

    def run(self, tmp: Any = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:  # noqa: ANN401, ARG002
        if isinstance(self.says, Exception):
            raise self.says
        return self.says


class Guarded(thin.CleanedAction, Stock):
    """The same, cleaned."""


def test_builtin_actions_strip_control_characters_of_gateways() -> None:
    told = Guarded({"rc": 1, "stdout": HOSTILE, "stdout_lines": [HOSTILE]}).run()
    assert told["rc"] == 1
    assert control_characters("".join(_texts(told))) == []
    with pytest.raises(AnsibleConnectionFailure) as failed:
        Guarded(AnsibleConnectionFailure(HOSTILE)).run()
    assert control_characters(str(failed.value)) == []


def test_roles_use_no_builtin_action_that_contacts_a_gateway() -> None:
    """Of Ansible's own they use those that contact nobody."""
    allowed = {"assert", "debug", "import_role", "include_tasks", "meta"}
    used = {
        name
        for path in [*(ROOT / "roles").rglob("tasks/*.yml"), *(ROOT / "playbooks").glob("*.yml")]
        for name in re.findall(r"^ *(?:- )?ansible\.builtin\.(\w+):", path.read_text(), re.MULTILINE)
    }
    assert used - allowed == set()


def test_ansible_warnings_are_dropped_from_gateway_output() -> None:
    told = {"warnings": ["a"], "deprecations": [{"msg": "b"}], "exception": "c", "msg": "d"}
    assert zipapp_action.answer(said(f"{MARK}{json.dumps(told)}\n"), "clock") == {"msg": "d"}


def _texts(told: Any) -> list[str]:  # noqa: ANN401 - JSON
    if isinstance(told, dict):
        return [text for key, value in told.items() for text in (str(key), *_texts(value))]
    return [text for one in told for text in _texts(one)] if isinstance(told, list) else [str(told)]
