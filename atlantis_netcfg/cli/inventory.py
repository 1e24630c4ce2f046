"""`provision inventory init`: create a new inventory, from prompts, from an answer file, or from the example."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path
    from typing import Any

    from atlantis_netcfg.inventory import Inventory, InventoryInvalid
    from atlantis_netcfg.inventory.new_inventory.answers import InventoryAnswers
    from atlantis_netcfg.inventory.new_inventory.kept_answers import KeptAnswers


INIT = syntax.CommandSpec(
    "inventory init",
    "create a new inventory (interactive)",
    words=(syntax.Word("folder", "the new folder", is_required=True, example="my-pilot", bare=True),),
    flags=(
        syntax.Flag("from", "`example`: copy the shipped inventory, without questions", takes="example"),
        syntax.Flag("answers", "read the answers from this file (YAML) instead of asking", takes="FILE"),
        syntax.JSON,
    ),
    details=(
        "No device is contacted. Enter without an answer omits a feature, or writes a value marked EXAMPLE, for "
        "rehearsals only. Passwords are generated and encrypted with your vault password. Either all files are "
        "written or none, and only if the whole inventory is valid."
    ),
)


def run_init(arguments: syntax.Arguments) -> ExitCode:
    """Run `inventory init`: collect the answers, write the folder, and describe it."""
    from pathlib import Path

    from atlantis_netcfg.inventory import InventoryInvalid
    from atlantis_netcfg.inventory.new_inventory.kept_answers import KeptAnswers
    from atlantis_netcfg.inventory.new_inventory.writing import README, create, example_files, refuse_used

    folder = Path(arguments.word("folder"))
    as_json = arguments.flag("json")
    source = _source(arguments)
    refuse_used(folder)
    if source == "example":
        inventory = create(folder, {**example_files(_example_folder()), README: _readme(folder, is_encrypted=None)})
        return _print_created(folder, inventory, is_encrypted=None, as_json=as_json)
    result = _ask_person(KeptAnswers(folder)) if source == "questions" else _read(Path(source))
    if isinstance(result, InventoryInvalid):
        return _refuse(result, "in the answers; nothing was written", as_json=as_json)
    answers, raw_answers = result
    encrypt = _encrypt(ask=source == "questions")
    files = {**_files(answers, encrypt), README: _readme(folder, is_encrypted=encrypt is not None)}
    try:
        inventory = create(folder, files)
    except InventoryInvalid as error:
        KeptAnswers(folder).remove()
        return _keep(error, folder, raw_answers if source == "questions" else None, as_json=as_json)
    KeptAnswers(folder).remove()
    return _print_created(folder, inventory, is_encrypted=encrypt is not None, as_json=as_json)


def _source(arguments: syntax.Arguments) -> str:
    """Return `example`, `questions`, or the path of the answer file. Raises UsageError."""
    import sys

    from atlantis_netcfg.core.errors import UsageError

    example, file = arguments.value("from"), arguments.value("answers")
    if example is not None and file is not None:
        raise UsageError("`--from` and `--answers` cannot be used together", hint="keep one of them")
    if example not in (None, "example"):
        raise UsageError(f"`--from {arg(example)}`: unknown value", hint="choose one of: example")
    if example is None and file is None and (arguments.flag("json") or not sys.stdin.isatty()):
        raise UsageError(
            "no terminal to ask questions; nothing was written",
            hint="run the command on a terminal, or with `--answers FILE`, or with `--from example`",
        )
    return example or file or "questions"


def _example_folder() -> Path:
    from atlantis_netcfg.core import paths

    return paths.resource("inventory")


def _read(path: Path) -> tuple[InventoryAnswers, None] | InventoryInvalid:
    from atlantis_netcfg.inventory import InventoryInvalid
    from atlantis_netcfg.inventory.new_inventory.answers import InventoryAnswers
    from atlantis_netcfg.inventory.yaml_file import read

    block = read(path, InventoryAnswers, "the answers")
    return InventoryInvalid(block.findings) if block.findings or block.value is None else (block.value, None)


def _ask_person(store: KeptAnswers) -> tuple[InventoryAnswers, Mapping[str, Any]]:
    """Prompt for the answers. Raises UsageError at the end of input; then nothing was written."""
    from atlantis_netcfg.core import printable
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.core.language import translate
    from atlantis_netcfg.inventory.new_inventory.answers import InventoryAnswers
    from atlantis_netcfg.inventory.new_inventory.questions import Interview

    is_kept = True

    def ask(prompt: str) -> str:
        try:
            return input(f"{printable.line(prompt.strip())} ")
        except ValueError:  # bytes that are no text in the terminal's encoding
            return "\0"
        except EOFError:
            again = "run the command again" + (": it offers to continue where it stopped" if is_kept else "")
            raise UsageError("not all questions were answered; nothing was written", hint=again) from None

    def tell(words: str) -> None:
        print(translate(words))

    def keep(answers: Sequence[tuple[str, str]]) -> None:
        nonlocal is_kept
        try:
            if is_kept:
                store.write(answers)
        except (OSError, UsageError) as error:
            is_kept = False
            tell(msg(f"Your answers cannot be saved if you stop: {arg(error)}"))

    tell("Enter accepts the value in brackets, `<` goes back, `-` clears an earlier answer.")
    tell("Ctrl-C stops; the same command then offers to continue where it stopped.")
    answers = store.read()
    if answers:
        tell(msg(f"{arg(len(answers))} answers are saved from the last session."))
        if not Interview(ask, tell).yes("Continue with them?", default="yes"):
            store.remove()
            answers = []
    raw_answers = Interview(ask, tell, keep, answers).answers()
    return InventoryAnswers.model_validate(raw_answers), raw_answers


def _encrypt(*, ask: bool) -> Callable[[str], str] | None:
    """Return the function that encrypts a new secret; None if there is no vault password."""
    from getpass import getpass

    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.core.language import translate
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.operations.common.vault import Vault, is_configured

    if is_configured():
        return Vault().encrypt
    if not ask:
        return None
    password = getpass(translate("Choose a password for the inventory vault [passwords are EXAMPLE values]: "))
    if not password:
        return None
    if getpass(translate("The same again: ")) != password:
        raise UsageError("the two entries differ; nothing was written", hint="run the command again")
    return Vault(lambda _: Secret(password)).encrypt


def _files(answers: InventoryAnswers, encrypt: Callable[[str], str] | None) -> dict[str, str]:
    import yaml

    from atlantis_netcfg.inventory.new_inventory.files import files

    vehicles = yaml.safe_load((_example_folder() / "group_vars/all/vehicles.yml").read_text(encoding="utf-8"))
    return files(answers, vehicles["vehicles"], encrypt)


def _readme(folder: Path, *, is_encrypted: bool | None) -> str:
    """Return a file with the next steps; `is_encrypted` is None for the copied example."""
    vault = (
        "Passwords were generated and encrypted. Keep the vault password outside this folder: "
        "`ANSIBLE_VAULT_PASSWORD_FILE=FILE provision …`, or type it when asked."
        if is_encrypted
        else "Passwords are examples. Encrypt your own: `ansible-vault encrypt_string --stdin-name password`."
    )
    return f"""\
# The inventory of a pilot

1. `provision inventory validate inventory={folder}` checks all files; `--examples` lists the remaining examples.
2. Replace every value marked `# EXAMPLE` and delete the mark. After the last one, set `example_values: false` in
   `group_vars/all/pilot.yml`. This includes numbers, frequencies and prices as well as names and addresses.
3. Compare the list of ports in `host_vars/…-router.yml` with the cables, and add `poe:` where a port feeds a device.
4. Add `endpoints:` of each robot in `group_vars/all/vehicles.yml`: a person must confirm whatever is missing there.
5. {vault}
6. `provision site=SITE --rehearse inventory={folder}` rehearses a site on this computer.
7. Keep the folder in git.
"""


def _refuse(error: InventoryInvalid, where: str, *, as_json: bool) -> ExitCode:
    import dataclasses
    import sys

    from atlantis_netcfg.core.language import translate
    from atlantis_netcfg.inventory import report

    if as_json:
        rows = [dataclasses.asdict(finding) for finding in error.findings]
        print(json_text({"exit": int(error.exit), "errors": rows}))
    else:
        print(translate(report(error.findings, where)), file=sys.stderr)
    return error.exit


def _keep(error: InventoryInvalid, folder: Path, raw_answers: Mapping[str, Any] | None, *, as_json: bool) -> ExitCode:
    """Report answers that contradict each other, and save the user's answers."""
    import sys

    import yaml

    from atlantis_netcfg.core.atomic_files import write_atomically
    from atlantis_netcfg.core.language import as_typed, translate

    code = _refuse(error, "in the inventory built from the answers; nothing was written", as_json=as_json)
    if raw_answers is not None:
        number, path = 1, folder.with_name(f"{folder.name}-answers.yml")
        while path.exists():
            number += 1
            path = folder.with_name(f"{folder.name}-answers-{number}.yml")
        write_atomically(path, yaml.safe_dump(raw_answers, sort_keys=False, allow_unicode=True).encode(), mode=None)
        words = translate(f"Your answers are saved in {arg(path)}: correct them, then run")
        print(as_typed(f"{words}\n  provision inventory init {folder} --answers {path}"), file=sys.stderr)
    return code


def _print_created(folder: Path, inventory: Inventory, *, is_encrypted: bool | None, as_json: bool) -> ExitCode:
    import dataclasses

    from atlantis_netcfg.core.language import as_typed, translate

    sites = list(inventory.sites)
    if as_json:
        examples = [dataclasses.asdict(example) for example in inventory.examples]
        document = {"exit": 0, "errors": [], "inventory": str(folder), "sites": sites, "hosts": list(inventory.hosts)}
        print(json_text({**document, "examples": examples}))
        return ExitCode.DONE
    print(
        translate(
            f"{arg(folder)}: written and validated, no errors, {arg(len(inventory.hosts))} hosts at {arg(len(sites))} "
            "sites"
        )
    )
    if is_encrypted:
        print(translate("Passwords were generated and encrypted with your vault password."))
    if inventory.examples:
        print(translate(f"{arg(len(inventory.examples))} values are examples: this inventory is for rehearsals only."))
        print(as_typed(f"  provision inventory validate inventory={folder} --examples"))
    print(translate(f"Next: review {arg(folder / 'README.md')}, and rehearse a site:"))
    print(as_typed(f"  provision site={[*sites[1:], *sites][0]} --rehearse inventory={folder}"))
    return ExitCode.DONE
