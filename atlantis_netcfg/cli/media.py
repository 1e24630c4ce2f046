"""Commands that write media: `gateway image` (a card) and `gateway bundle` (packages for a site without internet).

`provision gateway image`: write the card of a computer.

`provision gateway bundle`: all external files that the gateways of a site need, for a place without internet.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.computers.bundle.build import BundleSize
    from atlantis_netcfg.computers.bundle.manifest import Manifest
    from atlantis_netcfg.computers.image.writer import Card
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.common.request import Request
    from atlantis_netcfg.operations.image import ImageOrder, MadeImage


IMAGE = syntax.CommandSpec(
    "gateway image",
    "prepare a gateway's image, write it to a card and verify it",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.Word("device", "gateway computer of the site", is_required=True, example="coastal-gateway"),
        syntax.Word("from", "the vendor's image: raw, xz or gz", is_required=True, example="ubuntu-minimal.img.xz"),
        syntax.Word("to", "card path in /dev/disk/by-id; everything on it is erased", example="/dev/disk/by-id/usb-…"),
        syntax.Word("serial", "serial number of card or reader, to confirm the disk", example="20090516388200"),
        syntax.Word("sha256", "checksum of the vendor's image (default: file beside it)"),
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag(
            "image-only", "write the customised image to a new file, not to a card", takes="FILE", harmless=True
        ),
        syntax.Flag("yes", "with `serial=`: do not ask before writing"),
        syntax.JSON,
    ),
    details="Refused without writing: system disks, disks in use, and disks that are not on USB or in an SD/MMC slot.",
    changes=True,
    again="run the same command again: the card is rewritten from the beginning",
)


def run_image(arguments: syntax.Arguments) -> ExitCode:
    """Run `gateway image`: check all inputs first, ask, build the image, write it and read it back."""
    from pathlib import Path

    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import choose, load
    from atlantis_netcfg.operations.image import ImageOrder, prepare_image

    inventory = load(paths.inventory_folder(arguments.optional("inventory")))
    (host,) = choose(inventory, arguments.word("site"), [arguments.word("device")])
    image = Path(arguments.word("from"))
    order = ImageOrder(inventory, host, image, arguments.optional("sha256"), paths.state_dir())
    order.check()
    file = _file(arguments)
    card = None if file is not None else _card(arguments, inventory)
    as_json = arguments.flag("json")
    with progress(quiet=as_json) as notify, prepare_image(order, notify) as ready:
        return _print_image_result(order, ready, _keep(ready, file, card), as_json=as_json)


def _file(arguments: syntax.Arguments) -> Path | None:
    """Return the output file of the image; None if it goes to a card."""
    from pathlib import Path

    from atlantis_netcfg.core.errors import UsageError

    name, device = arguments.value("image-only"), arguments.optional("to")
    if (name is None) == (device is None):
        both = "`to=` and `--image-only` cannot be used together" if name else "no destination for the image"
        raise UsageError(both, hint="`to=/dev/disk/by-id/…` writes a card, `--image-only FILE` writes a file")
    if name is None:
        return None
    file = Path(name)
    if file.exists() or file.is_symlink():
        raise UsageError(f"{arg(file)} already exists", hint="give a new file name, or remove the existing file")
    if not file.parent.is_dir():
        raise UsageError(f"no such folder: {arg(file.parent)}", hint="create it first")
    return file


def _card(arguments: syntax.Arguments, inventory: Inventory) -> Card:
    """Return the card after the user's confirmation. Raises BlockDeviceError, UsageError, ConsentRefusal."""
    from pathlib import Path

    from atlantis_netcfg.computers.image.blocks import BlockTree, require_confirmation, require_writable_disk
    from atlantis_netcfg.computers.image.writer import Card
    from atlantis_netcfg.core.errors import UsageError

    if inventory.pilot.example_values:
        raise UsageError(
            "the inventory still contains example values: nobody could log in to a gateway made from it",
            hint="replace them and set `example_values: false` in group_vars/all/pilot.yml, or add --image-only FILE",
        )
    tree, device = BlockTree(), Path(arguments.word("to"))
    card = Card(device, require_writable_disk(tree, device), tree)
    if not arguments.flag("json"):
        print(card.disk.summary, flush=True)
    serial = arguments.optional("serial")
    if serial is None:
        require_confirmation(card.disk, _ask_serial(card))
        return card
    require_confirmation(card.disk, serial)
    if not arguments.flag("yes"):
        from atlantis_netcfg.cli.base.consent import require_agreement

        require_agreement(msg(f"Write {arg(device)}: everything on it will be erased. Continue?"))
    return card


def _ask_serial(card: Card) -> str:
    """Ask the user for the card's serial. Raises UsageError without a terminal."""
    import sys

    from atlantis_netcfg.cli.base.consent import read_line
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.core.language import translate

    what = "serial" if card.disk.serial else "name and size"
    if not sys.stdin.isatty():
        raise UsageError(
            f"no terminal to type the {arg(what)} of the card; nothing was written",
            hint=f"check the card, then add `serial={arg(card.disk.proof)} --yes`",
        )
    question = translate(f"Everything on it will be erased. Type its {arg(what)} ({arg(card.disk.proof)}) to continue:")
    return read_line(f"{question} ") or ""


def _keep(ready: MadeImage, file: Path | None, card: Card | None) -> dict[str, Any]:
    """Write the image to the file or card; return the result, for people and programs."""
    from dataclasses import asdict

    if file is not None:
        return {"file": str(file), "size": ready.save_as_file(file)}
    if card is None:
        raise AssertionError("neither a file nor a card")
    write_result, receipt = ready.write_to_card(card)
    disk = {"path": str(card.device), "name": card.disk.name, "serial": card.disk.serial, "size": card.disk.size}
    return {"device": disk, "written": asdict(write_result), "receipt": str(receipt)}


def _print_image_result(order: ImageOrder, ready: MadeImage, outcome: dict[str, Any], *, as_json: bool) -> ExitCode:
    from atlantis_netcfg.core.errors import ExitCode

    if as_json:
        image = {"name": order.image.name, "sha256": ready.image.sha256, "confirmed_by": ready.image.told_by}
        document = {"exit": 0, "site": order.host.site, "host": order.host.name, "image": image, "notes": ready.notes}
        print(json_text({**document, **outcome}))
        return ExitCode.DONE
    for note in ready.notes:
        print(translate(f"note: {arg(note)}"))
    if "file" in outcome:
        print(
            translate(
                f"{arg(outcome['file'])}: image of {arg(order.host.name)}, {arg(outcome['size'] / 1000000.0):.0f} MB; "
                "no card was written"
            )
        )
        return ExitCode.DONE
    write_result = outcome["written"]
    print(
        translate(
            f"{arg(order.host.name)}: written and verified in {arg(write_result['seconds']):.0f} s: "
            f"{arg(write_result['data'] / 1000000.0):.0f} MB of data, {arg(write_result['cleared'] / 1000000.0):.0f} "
            f"MB of zeros, {arg(write_result['skipped'] / 1000000.0):.0f} MB skipped, "
            f"{arg(write_result['compared'] / 1000000.0):.0f} MB compared"
        )
    )
    print(translate(f"recorded in {arg(outcome['receipt'])}"))
    print(translate("Not tested: booting the board from it. Its boot switch, if any, must be set to MMC."))
    return ExitCode.DONE


BUNDLE = syntax.CommandSpec(
    "gateway bundle",
    "pack a site's downloads for use without internet",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.DEVICES,
        syntax.Word("to", "bundle folder (default: in the state folder)", example="/media/usb/coastal"),
        syntax.Word("image", "vendor's image: lists the board's packages; also packed", example="x.img.xz"),
        syntax.Word("status", "copy of the board's /var/lib/dpkg/status (default: via SSH)"),
        syntax.Word(
            "mirror", "mirror of the distribution's archive to use", example="http://mirror.example.org/ubuntu"
        ),
        syntax.Word("keyring", "key of that archive (default: from this computer)", example="archive.gpg"),
        syntax.Word("check", "only check that this bundle is complete and up to date"),
        syntax.Word("key", "with `check=`: from now on, accept bundles signed by this key", example="4B63CF8F…"),
        syntax.INVENTORY,
    ),
    flags=(syntax.ASK_VAULT_PASS, syntax.JSON),
    details=(
        "Needs apt, gpg and git, but not root; the board may have another architecture. Existing files are not "
        "downloaded again. `provision site=S --offline BUNDLE` then downloads nothing."
    ),
)


def run_bundle(arguments: syntax.Arguments) -> ExitCode:
    """Run `gateway bundle`: build or open a bundle, and list its content."""
    from pathlib import Path

    from atlantis_netcfg.cli.base.passphrase import vault_of
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import load
    from atlantis_netcfg.operations.bundle import bundle_hosts, has_tokens
    from atlantis_netcfg.operations.common.request import Request

    inventory, check = paths.inventory_folder(arguments.optional("inventory")), arguments.optional("check")
    pilot_inventory = load(inventory)
    if check is None and has_tokens(pilot_inventory):
        pilot_inventory = load(inventory, decrypt=vault_of(arguments).decrypt)
    hosts = bundle_hosts(pilot_inventory, arguments.word("site"), arguments.many("device"))
    request = Request()
    if check is not None:
        return _check(arguments, pilot_inventory, hosts, Path(check), request)
    _refuse_both(arguments)
    return _make(arguments, pilot_inventory, hosts, request)


def _refuse_both(arguments: syntax.Arguments) -> None:
    from atlantis_netcfg.core.errors import UsageError

    if arguments.optional("image") is not None and arguments.optional("status") is not None:
        raise UsageError("`image=` and `status=` cannot be used together", hint="remove one of them")
    if arguments.optional("key") is not None:
        site, key = arguments.word("site"), arguments.optional("key")
        raise UsageError(
            "`key=` requires `check=`",
            hint=f"add `check=` and the bundle folder: `provision gateway bundle site={arg(site)} check=BUNDLE "
            f"key={arg(key)}`",
        )


def _make(arguments: syntax.Arguments, inventory: Inventory, hosts: tuple[Host, ...], request: Request) -> ExitCode:
    from pathlib import Path

    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.operations.bundle import BundleRequest, make_bundle

    to, status, image, keyring = (arguments.optional(name) for name in ("to", "status", "image", "keyring"))
    site, as_json = arguments.word("site"), arguments.flag("json")
    bundle_request = BundleRequest(
        inventory,
        site,
        hosts,
        Path(to).absolute() if to else paths.private_directory(request.state / "bundles") / site,
        request,
        status=Path(status) if status else None,
        image=Path(image) if image else None,
        mirror=arguments.optional("mirror"),
        keyring=Path(keyring) if keyring else None,
    )

    def show_size(size: BundleSize) -> None:
        if not as_json:
            local_bytes = size.whole - size.to_fetch
            have = msg(f", {arg(_mb(local_bytes))} already downloaded" if local_bytes else "")
            print(
                translate(
                    f"{arg(size.packages)} packages, {arg(_mb(size.whole))}{arg(have)}: {arg(_mb(size.to_fetch))} to "
                    "download"
                ),
                flush=True,
            )

    with progress(quiet=as_json) as notify:
        manifest = make_bundle(bundle_request, notify, show_size)
    return _print_bundle_result(manifest, bundle_request.place, as_json=as_json)


def _check(
    arguments: syntax.Arguments, inventory: Inventory, hosts: tuple[Host, ...], place: Path, request: Request
) -> ExitCode:
    from atlantis_netcfg.operations.bundle import open_for_hosts

    bundle = open_for_hosts(inventory, hosts, place, request, accept=arguments.optional("key"))
    return _print_bundle_result(bundle.manifest, place, as_json=arguments.flag("json"))


def _print_bundle_result(manifest: Manifest, place: Path, *, as_json: bool) -> ExitCode:
    if as_json:
        document: dict[str, Any] = {
            "exit": int(ExitCode.DONE),
            "errors": [],
            "bundle": str(place),
            "size": manifest.size,
        }
        print(json_text({**document, **manifest.model_dump(mode="json")}))
        return ExitCode.DONE
    for name, part in manifest.hosts.items():
        carry_bytes = sum(file.size for file in manifest.of(name).values())
        sources = msg(f", {arg(len(part.libraries))} source repositories" if part.libraries else "")
        system = f"{part.distribution} {part.codename} {part.architecture}"
        print(
            translate(
                f"{arg(name)}: {arg(system)}, {arg(len(part.packages))} packages{arg(sources)}, up to "
                f"{arg(_mb(carry_bytes))} to transfer"
            )
        )
    if manifest.image is not None:
        print(translate(f"image: {arg(manifest.image.name)}, SHA-256 {arg(manifest.image.sha256)}"))
    print(
        translate(
            f"{arg(place)}: bundle {arg(manifest.id)} of site {arg(manifest.site)}, {arg(_mb(manifest.size))}, created "
            f"{arg(manifest.made)}"
        )
    )
    print(translate(f"signed by {arg(manifest.key)}"))
    return ExitCode.DONE


def _mb(size: int) -> str:
    return f"{size / 1e6:.1f} MB"
