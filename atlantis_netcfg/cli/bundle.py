"""`provision bundle`: everything that the gateways of a site take from elsewhere, for a place without internet."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import ASK_VAULT_PASS, INVENTORY, JSON, ONLY, Command, Word
from atlantis_netcfg.core.errors import ExitCode

if TYPE_CHECKING:
    from pathlib import Path
    from typing import Any

    from atlantis_netcfg.bundle.build import Size
    from atlantis_netcfg.bundle.manifest import Manifest
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.request import Request

COMMAND = Command(
    "bundle",
    "pack everything that the gateways of a site take from the internet, for where there is none",
    words=(
        Word("site", "the site", required=True, example="coastal"),
        ONLY,
        Word("to", "the bundle, a folder; by default one in the state directory", example="/media/usb/coastal"),
        Word("image", "the vendor's image: says what is on the board already, and is packed too", example="x.img.xz"),
        Word("status", "a copy of the board's /var/lib/dpkg/status says it; without either the board is asked by SSH"),
        Word(
            "mirror", "of the distribution's archive, in place of its own", example="http://mirror.example.org/ubuntu"
        ),
        Word("keyring", "the key of that archive, in place of the one on this computer", example="archive.gpg"),
        Word("check", "open this bundle instead, and say whether it is whole and has what is declared"),
        Word("key", "with `check=`: take bundles signed by this key from now on", example="4B63CF8F…"),
        INVENTORY,
    ),
    flags=(ASK_VAULT_PASS, JSON),
    details=(
        "Needs apt, gpg and git, and no root; the board may be of another architecture. What was fetched before is not "
        "fetched again. `provision site=S --offline BUNDLE` then takes nothing from anywhere else."
    ),
)


def run(arguments: Arguments) -> ExitCode:
    """Make the bundle, or open one, and say what is in it."""
    from pathlib import Path

    from atlantis_netcfg.cli._passphrase import vault_of
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.declaration import load
    from atlantis_netcfg.operations.bundle import gateways_of, has_tokens
    from atlantis_netcfg.operations.request import Request

    named, check = arguments.optional("inventory"), arguments.optional("check")
    inventory = Path(named) if named else paths.checkout() / "inventory"
    declaration = load(inventory)
    if check is None and has_tokens(declaration):
        declaration = load(inventory, decrypt=vault_of(arguments).decrypt)
    hosts = gateways_of(declaration, arguments.word("site"), arguments.many("only"))
    request = Request()
    if check is not None:
        return _check(arguments, declaration, hosts, Path(check), request)
    _refuse_both(arguments)
    return _make(arguments, declaration, hosts, request)


def _refuse_both(arguments: Arguments) -> None:
    from atlantis_netcfg.core.errors import UsageError

    if arguments.optional("image") is not None and arguments.optional("status") is not None:
        raise UsageError("`image=` and `status=` both say what is on the board", hint="leave one of them out")
    if arguments.optional("key") is not None:
        site, key = arguments.word("site"), arguments.optional("key")
        raise UsageError(
            "`key=` goes with `check=`",
            hint=f"add `check=` and its folder: `provision bundle site={site} check=BUNDLE key={key}`",
        )


def _make(arguments: Arguments, declaration: Declaration, hosts: tuple[Host, ...], request: Request) -> ExitCode:
    from pathlib import Path

    from atlantis_netcfg.cli._progress import progress
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.operations.bundle import BundleRequest, made

    to, status, image, keyring = (arguments.optional(name) for name in ("to", "status", "image", "keyring"))
    site, as_json = arguments.word("site"), arguments.flag("json")
    bundle_request = BundleRequest(
        declaration,
        site,
        hosts,
        Path(to).absolute() if to else paths.private_directory(request.state / "bundles") / site,
        request,
        status=Path(status) if status else None,
        image=Path(image) if image else None,
        mirror=arguments.optional("mirror"),
        keyring=Path(keyring) if keyring else None,
    )

    def sized(size: Size) -> None:
        if not as_json:
            kept = size.whole - size.to_fetch
            have = f", {_mb(kept)} of it are here already" if kept else ""
            print(f"{size.packages} packages, {_mb(size.whole)}{have}: {_mb(size.to_fetch)} to fetch", flush=True)

    with progress(quiet=as_json) as notify:
        manifest = made(bundle_request, notify, sized)
    return _close(manifest, bundle_request.place, as_json=as_json)


def _check(
    arguments: Arguments, declaration: Declaration, hosts: tuple[Host, ...], place: Path, request: Request
) -> ExitCode:
    from atlantis_netcfg.operations.bundle import opened

    bundle = opened(declaration, hosts, place, request, accept=arguments.optional("key"))
    return _close(bundle.manifest, place, as_json=arguments.flag("json"))


def _close(manifest: Manifest, place: Path, *, as_json: bool) -> ExitCode:
    import json

    if as_json:
        document: dict[str, Any] = {
            "exit": int(ExitCode.DONE),
            "errors": [],
            "bundle": str(place),
            "size": manifest.size,
        }
        print(json.dumps({**document, **manifest.model_dump(mode="json")}, ensure_ascii=False))
        return ExitCode.DONE
    for name, part in manifest.hosts.items():
        carried = sum(file.size for file in manifest.of(name).values())
        sources = f", {len(part.libraries)} repositories of sources" if part.libraries else ""
        print(
            f"{name}: {part.distribution} {part.codename} {part.architecture}, {len(part.packages)} packages{sources},"
            f" {_mb(carried)} to carry at most"
        )
    if manifest.image is not None:
        print(f"image: {manifest.image.name}, SHA-256 {manifest.image.sha256}")
    print(f"{place}: bundle {manifest.id} of site {manifest.site}, {_mb(manifest.size)}, made {manifest.made}")
    print(f"signed by {manifest.key}")
    return ExitCode.DONE


def _mb(size: int) -> str:
    return f"{size / 1e6:.1f} MB"
