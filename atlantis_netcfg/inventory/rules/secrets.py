"""Rules for secrets: real ones are encrypted with Ansible Vault, and examples are marked as examples."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import BaseModel

from atlantis_netcfg.core import passwords
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import _draft
from atlantis_netcfg.inventory._yaml import SealedSecret
from atlantis_netcfg.inventory.examples import SSH_KEY, examples_in
from atlantis_netcfg.inventory.findings import Finding, Mark

if TYPE_CHECKING:
    from collections.abc import Iterator

_LENGTH = 12
_GUESSES = 10**10
"""Limit for "very hard to guess" in zxcvbn; a recorded WPA2 handshake allows a million guesses a second."""
_PREFIX = 32
"""Number of characters checked: longer secrets are keys, and checking a whole key takes long."""
_BY_PROVIDER = {("sim", "pin"), ("sim", "password")}
"""Secrets chosen by the provider, not by the users."""


def refuse_clear_text(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a real secret in clear text: the file goes into git."""
    for part, model in _holders(draft):
        for path, secret in _secrets(model):
            is_vaulted = isinstance(draft.nodes[part].at(*path).value, Secret)
            if not is_vaulted and not secret.is_example:
                name = str(path[-1])
                message = msg(f"`{arg(name)}` is in clear text")
                yield draft.finding_at(part, path, message, f"ansible-vault encrypt_string --stdin-name {name}")


def printable(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a secret can be typed on a console."""
    for part, model in _holders(draft):
        for path, secret in _secrets(model):
            if not isinstance(secret, SealedSecret) and not (secret.reveal() and secret.reveal().isprintable()):
                message = msg(f"`{arg(path[-1])}` is empty, or contains a line break or another control character")
                yield draft.finding_at(part, path, message, "create another one")


def weak(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a decrypted secret that is still an example or is easy to guess."""
    words = (*draft.sites, *draft.layout.hosts)
    for part, model in _holders(draft):
        for path, secret in _secrets(model):
            if isinstance(draft.nodes[part].at(*path).value, Secret) and not isinstance(secret, SealedSecret):
                message, hint = _weakness(str(path[-1]), secret.reveal(), words, is_ours=path[-2:] not in _BY_PROVIDER)
                if message:
                    yield draft.finding_at(part, path, message, hint)


def _weakness(name: str, text: str, words: tuple[str, ...], *, is_ours: bool) -> tuple[str, str]:
    """Return what is wrong with a secret and what to do; both are empty if nothing is wrong."""
    if "EXAMPLE" in text.upper():
        hint = "put the real value in the vault; until there is one, write EXAMPLE-… without `!vault`"
        return msg(f"`{arg(name)}` is in the vault, but is still an example"), hint
    if not (is_ours and text and text.isprintable()):  # for the latter two see above
        return "", ""
    hint = msg(
        f"create a random one (openssl rand -base64 18), then ansible-vault encrypt_string --stdin-name {arg(name)}"
    )
    if len(text) < _LENGTH:
        return msg(f"`{arg(name)}` has fewer than {arg(_LENGTH)} characters"), hint
    if passwords.guesses(text[:_PREFIX], words)[0] < _GUESSES:
        return msg(f"`{arg(name)}` is easy to guess"), hint
    return "", ""


def _holders(draft: _draft.Draft) -> Iterator[tuple[_draft.Part, BaseModel]]:
    """Yield every part that may hold a secret."""
    if draft.pilot is not None:
        yield _draft.Part("pilot"), draft.pilot
    for host, device in draft.devices.items():
        yield _draft.Part("device", host), device
    for name, vehicle in draft.vehicles.items():
        yield _draft.Part("vehicle", name), vehicle


def _secrets(model: BaseModel, path: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], Secret]]:
    for name in type(model).model_fields:
        value = getattr(model, name)
        for step, inner in (
            [((name, index), item) for index, item in enumerate(value)]
            if isinstance(value, tuple)
            else [((name,), value)]
        ):
            if isinstance(inner, Secret):
                yield (*path, *step), inner
            elif isinstance(inner, BaseModel):
                yield from _secrets(inner, (*path, *step))


def examples_left(draft: _draft.Draft) -> Iterator[Finding]:
    """Report example values that remain although `example_values` is false."""
    if draft.pilot is None or draft.pilot.example_values:
        return
    but = msg(f"but `example_values` is false ({arg(draft.where(_draft.Part('pilot'), 'example_values'))})")
    keys_by_mark: dict[Mark, list[str]] = {}
    for example in examples_in(draft.nodes.values()):
        if example.recognised is None:
            keys_by_mark.setdefault(Mark(example.file, example.line, 1), []).append(f"`{example.key}`")
        else:
            is_key = example.recognised == SSH_KEY
            hint = "write the real value, or set `example_values: true`"
            hint = "write the public key of a technician: the line of the .pub file" if is_key else hint
            mark = Mark(example.file, example.line, example.column)
            yield Finding.at(mark, msg(f"{arg(example.recognised)} is still an example, {arg(but)}"), hint)
    for mark, keys in keys_by_mark.items():
        words = join(", ", dict.fromkeys(keys))
        verb_phrase = f"{'is' if len(set(keys)) == 1 else 'are'} marked as an example"
        hint = "write the real value, and delete the mark `# EXAMPLE`; or set `example_values: true`"
        yield Finding.at(mark, msg(f"{arg(words)} {arg(verb_phrase)}, {arg(but)}"), hint)


RULES: tuple[_draft.Rule, ...] = (refuse_clear_text, printable, weak, examples_left)
