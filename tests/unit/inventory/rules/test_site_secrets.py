"""Every secret of the model that is vaulted is judged once it is open: an example, or an easy one, is no secret."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import inventory_cases
import pytest
from pydantic import BaseModel

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import InventoryInvalid, _schema, load, report, validate
from atlantis_netcfg.inventory._yaml import Node
from atlantis_netcfg.inventory.findings import Mark
from atlantis_netcfg.inventory.loader import _examine
from atlantis_netcfg.inventory.model import Partner, Pilot, Site, Vehicle

ROOTS: dict[str, type[BaseModel]] = {
    "pilot": Pilot,
    "partner": Partner,
    "site": Site,
    "vehicle": Vehicle,
    **_schema.DEVICES,
}
REFUSED = {"site location endpoints wifi key"}
"""A location has no key at all: tests/errors/wifi-key-of-a-location.yml."""
ASSIGNED = {"lte_router sim pin", "lte_router sim password"}
"""By the provider of the SIM: nobody here can make it longer."""


def kinds(annotation: Any) -> Iterator[type]:  # noqa: ANN401 - of any field
    if isinstance(annotation, type) and issubclass(annotation, BaseModel | Secret):
        yield annotation
    for inner in get_args(annotation):
        yield from kinds(inner)


def secrets_of(model: type[BaseModel], path: str) -> Iterator[str]:
    for name, field in model.model_fields.items():
        for kind in {*kinds(field.annotation)}:
            if issubclass(kind, Secret):
                yield f"{path} {name}"
            elif issubclass(kind, BaseModel):
                yield from secrets_of(kind, f"{path} {name}")


FIELDS = sorted({field for root, model in ROOTS.items() for field in secrets_of(model, root)} - REFUSED)


def below(node: Node, path: str) -> Iterator[tuple[str, Mark]]:
    if isinstance(node.value, dict):
        for name, value in node.value.items():
            yield from below(value, f"{path} {name}")
    elif isinstance(node.value, list):
        for value in node.value:
            yield from below(value, path)
    else:
        yield path, node.mark


@pytest.fixture(scope="module")
def every(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An inventory in which every secret is declared."""
    folder = tmp_path_factory.mktemp("every")
    inventory_cases.spoil(inventory_cases.load(Path(__file__).with_name("every_secret.yml")), folder)
    return folder


@pytest.fixture
def places(every: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Mark]:
    """A copy of it in the current folder, and where its secrets stand."""
    shutil.copytree(every, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    draft = _examine(Path("inventory"), None)[1]
    assert draft is not None
    marks: dict[str, Mark] = {}
    for part, node in draft.nodes.items():
        root = draft.kind_of(part.name) if part.sort == "device" else part.sort
        marks.update(below(node, str(root)))
    return marks


def vault(mark: Mark, secret: str) -> None:
    """Put a vaulted value in the place of an example."""
    path = Path(mark.file)
    lines = path.read_text().splitlines(keepends=True)
    line, begin = lines[mark.line - 1], mark.column - 1
    example = line[begin:].split("#")[0].rstrip(" }],\n")
    assert example.startswith("EXAMPLE-")
    sealed = f'!vault "$ANSIBLE_VAULT;1.1;AES256\\n{secret.encode().hex()}"'
    lines[mark.line - 1] = line[:begin] + sealed + line[begin + len(example) :]
    path.write_text("".join(lines))


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize(
    ("secret", "problem"),
    [
        ("EXAMPLE-of-a-secret-that-is-vaulted", "is in the vault, but is still an example"),
        ("a" * 24, "is easy to guess"),
        ("password12345678", "is easy to guess"),
        ("coastal-router-2026", "is easy to guess"),
        ("kX9#mQ2vLp7", "has fewer than 12 characters"),
        ("kX9#mQ2vLp7wRt4z", ""),
    ],
)
def test_secret_is_checked_and_reported_at_its_line(
    field: str, secret: str, problem: str, places: dict[str, Mark]
) -> None:
    mark = places[field]
    vault(mark, secret)
    ours = {
        f"{finding.file}:{finding.line}"
        for finding in validate(Path("inventory"), decrypt=inventory_cases.opened)
        if finding.message == f"`{field.rsplit(maxsplit=1)[-1]}` {problem}"
    }
    judged = problem and ("EXAMPLE" in secret or field not in ASSIGNED)
    assert ours == ({f"{mark.file}:{mark.line}"} if judged else set())


def test_weak_secret_is_an_inventory_error_and_is_not_shown(places: dict[str, Mark]) -> None:
    vault(places["router vpn_client password"], "password12345678")
    with pytest.raises(InventoryInvalid) as caught:
        load(Path("inventory"), decrypt=inventory_cases.opened)
    assert caught.value.exit is ExitCode.USAGE
    assert "`password` is easy to guess" in str(caught.value)
    assert "password12345678" not in report(caught.value.findings)


def test_encrypted_secret_is_not_checked(places: dict[str, Mark]) -> None:
    before = validate(Path("inventory"))
    vault(places["router vpn_client password"], "a" * 24)
    assert [finding.message for finding in validate(Path("inventory"))] == [finding.message for finding in before]


@pytest.mark.parametrize(
    "secret",
    ["f" * 31 + "8", "A" * 43 + "=", "bU0pG1zQmXwqv0c4T8n1R2y6JkLh3sDfAeWtYuIoPzM=", "glpat-8sJq2Vx_7Rk-LmT4wZ9p"],
)
def test_random_keys_and_tokens_are_accepted(secret: str, places: dict[str, Mark]) -> None:
    vault(places["pilot qualify key"], secret)
    messages = {finding.message for finding in validate(Path("inventory"), decrypt=inventory_cases.opened)}
    assert ("`key` is easy to guess" in messages) == secret.startswith(("f", "A"))
