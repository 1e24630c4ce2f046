"""Make a bundle: an interrupted run resumes, and a finished bundle is always complete.

Layout of a bundle:

- `manifest.json`, `manifest.json.asc`, `key.gpg`: signed description of the bundle
- `pool/*.deb`: packages of all hosts
- `hosts/HOST/repository/`: package index of one host
- `sources/git/SERVER/PATH/`: repositories of the libraries
- `images/`: the vendor's image, if one was given, and container images
"""

from __future__ import annotations

import base64
import fcntl
import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING
from urllib.parse import urljoin, urlsplit

from atlantis_netcfg import __version__
from atlantis_netcfg.computers.bundle import resolve
from atlantis_netcfg.computers.bundle.manifest import (
    KEY,
    MANIFEST,
    SIGNATURE,
    BundledLibrary,
    BundleFile,
    BundleImage,
    BundleSigner,
    HostPart,
    Manifest,
    content_id,
    run,
)
from atlantis_netcfg.computers.bundle.requirements import BundleError
from atlantis_netcfg.core.paths import require_own

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.computers.bundle.requirements import (
        BundleTarget,
        HostRequirements,
        Library,
        PackageRequirement,
        PackageSource,
        RequirementKey,
    )


_USER = "oauth2"
"""GitLab accepts any user name with an access token; NAME:TOKEN is for deploy tokens, which have a name."""
_DEPTH = 10
"""Maximum depth of submodules within submodules."""


@dataclass(slots=True)
class RepositorySet:
    """Bare git repositories of libraries in one folder.

    They are stored below `git/SERVER/PATH`, where git on the board finds them instead of `https://SERVER/PATH`
    (url.<base>.insteadOf of git-config(1)). Each has one commit, without history.
    """

    folder: Path
    commits: dict[tuple[str, str], str] = field(default_factory=dict)
    """URL and revision of each library -> its commit."""
    of: dict[tuple[str, str], set[str]] = field(default_factory=dict)
    """URL and revision of each library -> paths below `folder` of the repositories that it needs."""

    def files(self, library: Library) -> Iterator[tuple[str, Path]]:
        """Yield the files that a board needs for a library: path below its source folder, and local file."""
        for place in sorted(self.of[library.url, library.revision]):
            root = self.folder / place
            for path in sorted(root.rglob("*")):
                if path.is_file():
                    yield f"git/{place}/{path.relative_to(root).as_posix()}", path


def gather(libraries: Iterable[Library], work: Path) -> RepositorySet:
    """Fetch the repositories of these libraries; `work` caches downloads. Raises BundleError."""
    shutil.rmtree(work / "bare", ignore_errors=True)
    repositories = RepositorySet(work / "bare")
    for library in libraries:
        key = (library.url, library.revision)
        if key not in repositories.commits:
            repositories.of[key] = set()
            repositories.commits[key] = _place_repository(
                repositories, key, work, library, library.url, library.revision, 0
            )
    return repositories


def _place_repository(  # noqa: PLR0913, PLR0917 - a step of a walk
    repositories: RepositorySet, key: tuple[str, str], work: Path, library: Library, url: str, revision: str, depth: int
) -> str:
    """Store one repository at one revision, then its submodules; return the commit."""
    place = _repository_path(url)
    mirror, bare = work / "fetched" / place, repositories.folder / place
    environment = _git_credentials(library) if urlsplit(url)[:2] == urlsplit(library.url)[:2] else _SILENT
    commit = _fetch_revision(mirror, url, revision, environment)
    ref = f"refs/atlantis/{commit}"
    if not bare.exists():
        _git(bare, _SILENT, "init", "--quiet", "--bare", "--initial-branch=atlantis", str(bare))
        _strip_bare_repository(bare)
    refspecs = [f"+{ref}:{ref}", f"+{ref}:refs/heads/atlantis"]
    if not _is_commit(revision):
        refspecs.append(f"+refs/tags/{revision}:refs/tags/{revision}")
    words = ("fetch", "--quiet", "--depth", "1", "--no-tags", f"file://{mirror}", *refspecs)
    _git(bare, _SILENT, *_SMALL, *words)
    (bare / "FETCH_HEAD").unlink(missing_ok=True)
    repositories.of[key].add(place)
    for inner, inside in _submodules(mirror, url, commit, library.url):
        if depth == _DEPTH:
            raise BundleError(f"the submodules of {library.url} lead round in a circle", hint="ask its makers")
        _place_repository(repositories, key, work, library, inner, inside, depth + 1)
    return commit


def _fetch_revision(mirror: Path, url: str, revision: str, environment: dict[str, str]) -> str:
    """Fetch a revision; fetch the history only if the server cannot serve a single commit."""
    if not (mirror / "HEAD").exists():
        shutil.rmtree(mirror, ignore_errors=True)
        mirror.mkdir(parents=True)
        _git(mirror, _SILENT, "init", "--quiet", "--bare", str(mirror))
    if _is_commit(revision):
        ways = [[revision], ["+refs/heads/*:refs/heads/*", "+refs/tags/*:refs/tags/*"]]
        rev = f"{revision}^{{commit}}"
    else:
        ways = [[f"+refs/tags/{revision}:refs/tags/{revision}"]]
        rev = f"refs/tags/{revision}^{{commit}}"
    text = ""
    for way in ways:
        shallow = [] if way[0].startswith("+refs/heads/") else ["--depth", "1"]
        if _is_commit(revision) and _is_complete(mirror, revision):
            break
        process = run(
            ["git", "-C", str(mirror), "-c", "protocol.version=2", "fetch", "--quiet", *shallow, url, *way],
            environment,
        )
        text = process.stderr.decode(errors="replace")
        if process.returncode == 0:
            break
    rev_parse = run(["git", "-C", str(mirror), "rev-parse", "--verify", "--quiet", rev], _SILENT)
    commit = rev_parse.stdout.decode().strip()
    if rev_parse.returncode != 0 or not _is_complete(mirror, commit):
        raise _fetch_error(url, revision, text)
    _git(mirror, _SILENT, "update-ref", f"refs/atlantis/{commit}", commit)
    return commit


def _submodules(mirror: Path, url: str, commit: str, home: str) -> Iterator[tuple[str, str]]:
    """Yield URL and commit of each submodule; SSH URLs on the server of `home` become HTTPS.

    Raises BundleError if a repository does not define the URL of a submodule.
    """
    tree = _git(mirror, _SILENT, "ls-tree", "-r", "-z", commit)
    commits = {row.split("\t", 1)[1]: row.split()[2] for row in tree.split("\0") if row.startswith("160000 ")}
    if not commits:
        return
    text = run(
        [
            "git",
            "-C",
            str(mirror),
            "config",
            "-z",
            "--blob",
            f"{commit}:.gitmodules",
            "--get-regexp",
            r"^submodule\..*",
        ],
        _SILENT,
    ).stdout.decode(errors="replace")
    settings = dict(row.split("\n", 1) for row in text.split("\0") if "\n" in row)
    places = {
        path: settings.get(f"{name.removesuffix('.path')}.url", "")
        for name, path in settings.items()
        if name.endswith(".path")
    }
    for path, inside in sorted(commits.items()):
        inner = places.get(path, "")
        if inner.startswith(("./", "../")):
            inner = urljoin(f"{url}/", inner).rstrip("/")
        inner = _by_https(inner, home)
        if urlsplit(inner).scheme not in {"http", "https"}:
            where = f"is at `{inner}`, which needs an account" if inner else "has no address in .gitmodules"
            raise BundleError(
                f"the submodule {path} of {url} {where}", hint="the partner has to give it an https address"
            )
        yield inner, inside


def _by_https(url: str, home: str) -> str:
    """Rewrite an SSH URL on the server of `home` to HTTPS, as git's insteadOf does on the board."""
    server = urlsplit(home)
    for start in (f"git@{server.hostname}:", f"ssh://git@{server.hostname}/"):
        if url.startswith(start):
            return f"{server.scheme}://{server.netloc}/{url.removeprefix(start)}"
    return url


def _repository_path(url: str) -> str:
    """Return the path of a repository below `git`, matching the insteadOf rule. Raises BundleError for other URLs."""
    place = url.partition("://")[2].rstrip("/")
    if not re.fullmatch(r"[A-Za-z0-9._+~@:/-]+", place) or ".." in place.split("/") or "/" not in place:
        raise BundleError(f"`{url}` is no address of a repository that a bundle can hold")
    return place


_SILENT = {"GIT_TERMINAL_PROMPT": "0", "GIT_ASKPASS": "/bin/false", "GIT_CONFIG_COUNT": "0"}
_SMALL = (
    "-c",
    "protocol.version=2",
    "-c",
    "fetch.unpackLimit=1",
    "-c",
    "pack.threads=1",
    "-c",
    "protocol.file.allow=always",
)
"""Options for git: one pack, the same each time."""


def _git_credentials(library: Library) -> dict[str, str]:
    """Return git's environment: the token is sent only to the library's own server.

    The token is passed only by environment (GIT_CONFIG_COUNT): it is in no argument, file or message.
    """
    if library.token is None:
        return _SILENT
    user, colon, password = library.token.partition(":")
    text = f"{user}:{password}" if colon else f"{_USER}:{library.token}"
    server = "://".join(urlsplit(library.url)[:2])
    return {
        **_SILENT,
        "GIT_CONFIG_COUNT": "1",
        "GIT_CONFIG_KEY_0": f"http.{server}/.extraHeader",
        "GIT_CONFIG_VALUE_0": f"Authorization: Basic {base64.b64encode(text.encode()).decode()}",
    }


def _is_commit(revision: str) -> bool:
    return re.fullmatch(r"[0-9a-f]{40}|[0-9a-f]{64}", revision) is not None


def _is_complete(mirror: Path, commit: str) -> bool:
    return run(["git", "-C", str(mirror), "rev-list", "--objects", "--max-count=1", commit], _SILENT).returncode == 0


def _strip_bare_repository(bare: Path) -> None:
    """Remove everything from a bare repository that is not needed for fetching."""
    shutil.rmtree(bare / "hooks", ignore_errors=True)
    shutil.rmtree(bare / "info", ignore_errors=True)
    (bare / "description").unlink(missing_ok=True)


def _git(folder: Path, environment: dict[str, str], *words: str) -> str:
    """Run git in a local repository, without network access."""
    folder.mkdir(parents=True, exist_ok=True)
    process = run(["git", "-C", str(folder), *words], environment)
    if process.returncode != 0:
        raise BundleError(f"git {words[0]}: {_last_message(process.stderr.decode(errors='replace'))}")
    return process.stdout.decode(errors="replace")


def _fetch_error(url: str, revision: str, text: str) -> BundleError:
    if re.search(r"Authentication failed|could not read|terminal prompts|returned error: 40[13]|Access denied", text):
        return BundleError(
            f"{url} is not given to us: {_last_message(text)}",
            hint="declare a `token` that may read it, or ask whether the one that is declared is still good",
        )
    if not text or re.search(r"couldn't find remote ref|not our ref|no such remote ref", text):
        return BundleError(f"{url} has no revision {revision}", hint="a tag, or a commit of 40 hex digits")
    return BundleError(f"{url} cannot be fetched: {_last_message(text)}", hint="type the same again: what came is kept")


def _last_message(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    messages = [line for line in lines if line.startswith(("fatal:", "error:", "remote:"))]
    return (messages or lines or ["it says nothing"])[-1]


@dataclass(slots=True)
class StagingDirectory:
    """A bundle that is being made.

    It is beside the bundle's final place, is kept when the run is interrupted, and is renamed at the end.
    """

    place: Path
    """Path of the finished bundle; an earlier one may be there."""
    folder: Path
    files: dict[str, BundleFile] = field(default_factory=dict)
    """Path in the bundle -> file."""

    @property
    def work(self) -> Path:
        """Temporary folder, deleted at the end."""
        return self.folder / "work"

    def add(self, path: str, source: Path | bytes) -> None:
        """Add a file to the bundle: bytes are written; a file is moved unless it is there already."""
        place = self.folder / path
        place.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(source, bytes):
            place.write_bytes(source)
        elif source != place:
            source.replace(place)
        self.files[path] = BundleFile(path=path, size=place.stat().st_size, sha256=resolve.sha256_of(place))

    def finish(self) -> None:
        """Remove files that are not part of the bundle, and replace an earlier bundle with it."""
        shutil.rmtree(self.work)
        bundle_names = {*self.files, MANIFEST, SIGNATURE}
        for path in sorted(self.folder.rglob("*"), reverse=True):
            inside = path.relative_to(self.folder).as_posix()
            if path.is_dir():
                with suppress(OSError):
                    path.rmdir()
            elif inside not in bundle_names:
                path.unlink()
        os.sync()
        place, old = self.place, _backup_path(self.place)
        shutil.rmtree(old, ignore_errors=True)
        if place.exists():
            place.rename(old)
        self.folder.rename(place)
        shutil.rmtree(old, ignore_errors=True)


def link_or_copy(source: Path, target: Path) -> None:
    """Hard-link a file, or copy it where the file system has no hard links."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


@contextmanager
def open_staging(place: Path) -> Iterator[StagingDirectory]:
    """Open the staging directory under a lock. Raises BundleError if the place is unusable or locked."""
    if re.search(r"[\s\"';]", str(place)):
        raise BundleError(f"no bundle can be made in {place}", hint="`to=` names a folder without blanks in its name")
    if place.is_symlink() or (place.exists() and not (place / MANIFEST).is_file() and not _is_empty_folder(place)):
        raise BundleError(f"{place} is there, and is no bundle", hint="`to=` names a new folder")
    if not place.parent.is_dir():
        raise BundleError(f"there is no folder {place.parent}", hint="make it first")
    staging = StagingDirectory(place, place.with_name(f".{place.name}.part"))
    with _translate_errors(place), _exclusive_lock(staging.folder):
        if _backup_path(place).exists() and not place.exists():
            _backup_path(place).rename(place)  # cut off while the new one was to take its place
        staging.work.mkdir(parents=True, exist_ok=True)
        yield staging


def _backup_path(place: Path) -> Path:
    """Return the temporary name of an earlier bundle during replacement."""
    return place.with_name(f".{place.name}.old")


def _is_empty_folder(place: Path) -> bool:
    return place.is_dir() and not any(place.iterdir())


@contextmanager
def _exclusive_lock(folder: Path) -> Iterator[None]:
    """Lock the folder against a second run. Raises BundleError."""
    folder.mkdir(exist_ok=True)
    require_own(folder, "remove it, or name another place with `to=`")
    current = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(current, fcntl.LOCK_EX | fcntl.LOCK_NB)
        _check_not_replaced(folder, current)
        yield
    except BlockingIOError as error:
        hint = "wait for its end, or name another place with `to=`"
        raise BundleError("another run makes this bundle now", hint=hint) from error
    finally:
        os.close(current)


def _check_not_replaced(folder: Path, current: int) -> None:
    """Raise BlockingIOError if the folder was replaced between opening and locking it."""
    if not folder.exists() or os.fstat(current).st_ino != folder.stat().st_ino:
        raise BlockingIOError


@contextmanager
def _translate_errors(place: Path) -> Iterator[None]:
    """Turn an OSError into a BundleError that says why the place cannot be written."""
    try:
        yield
    except OSError as error:
        raise BundleError(
            f"{place} cannot be made: {error.filename or place.parent}: {error.strerror or error}",
            hint="make room, or name another place with `to=`; what was fetched is kept",
        ) from error


Tell = Callable[[str, float | None], None]
"""Called with the current activity and its completed share from 0 to 1, where that is known."""


@dataclass(frozen=True, slots=True)
class BundlePurpose:
    """One host, its system, and the archive of that system's own packages."""

    requirements: HostRequirements
    target: BundleTarget
    archive: tuple[PackageSource, RequirementKey] | None
    """None: all packages come from the sources of the requirement."""


@dataclass(frozen=True, slots=True)
class BundleOrder:
    """Request for a bundle: contents and destination."""

    site: str
    revision: str
    """Revision of the inventory."""
    purposes: tuple[BundlePurpose, ...]
    place: Path
    image: Path | None = None
    """The vendor's image, which is copied into the bundle."""


@dataclass(frozen=True, slots=True)
class BundleSize:
    """Download size in bytes, reported before the download starts."""

    packages: int
    whole: int
    to_fetch: int
    """Bytes to download, without what an interrupted or earlier bundle has left."""


def make(order: BundleOrder, signer: BundleSigner, tell: Tell, on_size: Callable[[BundleSize], None]) -> Manifest:
    """Make the bundle; `on_size` receives the download size first and may refuse. Raises BundleError."""
    with open_staging(order.place) as work:
        for each in order.purposes:
            _check_archives(each.requirements)
        tell("asking what there is", None)
        roots = {each.requirements.host: _root(work, each) for each in order.purposes}
        lacking = {
            each.requirements.host: roots[each.requirements.host].missing_files(_missing(each))
            for each in order.purposes
        }
        _reuse(work, lacking)
        on_size(_size(roots, lacking))
        libraries = gather(
            (library for each in order.purposes for library in each.requirements.libraries), work.work / "git"
        )
        for each in order.purposes:
            _fetch(roots[each.requirements.host], each, lacking[each.requirements.host], tell)
        work.add(KEY, signer.public)
        hosts = {}
        for each in order.purposes:
            part = _packages(work, signer, each, lacking[each.requirements.host])
            hosts[each.requirements.host] = _containers(work, _libraries(work, part, each, libraries), each)
        manifest = _write_manifest(work, order, signer, hosts)
        work.finish()
    return manifest


def _fetch(root: resolve.Root, purpose: BundlePurpose, files: Sequence[resolve.DebFile], tell: Tell) -> None:
    words = f"fetching packages for {purpose.requirements.host}"
    root.fetch(_missing(purpose), files, lambda share: tell(words, share))


def _missing(purpose: BundlePurpose) -> list[PackageRequirement]:
    """Return the packages that the target does not have yet, sorted."""
    has = purpose.target.installed_packages
    return sorted(
        {each for each in purpose.requirements.packages if not each.fits(has.get(each.name))},
        key=lambda package: package.apt_argument,
    )


def _root(work: StagingDirectory, purpose: BundlePurpose) -> resolve.Root:
    request, target = purpose.requirements, purpose.target
    expected_release = (request.distribution or target.distribution, request.codename or target.codename)
    if expected_release != (target.distribution, target.codename):
        raise BundleError(
            f"{request.host}: what is declared needs {' '.join(expected_release)}, and its system is {target.title}",
            hint="take the image of that release, or declare the `distribution` of ROS 2 that this one has",
        )
    if purpose.archive is not None:
        source, key = purpose.archive
        request = replace(request, sources=(*request.sources, source), keys=(*request.keys, key))
    root = resolve.Root.make(work.work / "hosts" / request.host, work.work, target, request)
    if _missing(purpose):
        root.update()
    return root


def _size(roots: dict[str, resolve.Root], lacking: dict[str, tuple[resolve.DebFile, ...]]) -> BundleSize:
    files = {file.name: (root, file) for name, root in roots.items() for file in lacking[name]}
    missing = [file.size for root, file in files.values() if not root.has(file)]
    return BundleSize(len(files), sum(file.size for _, file in files.values()), sum(missing))


def _packages(
    work: StagingDirectory, signer: BundleSigner, purpose: BundlePurpose, files: Sequence[resolve.DebFile]
) -> HostPart:
    """Add a host's packages and their index to the bundle."""
    request, target = purpose.requirements, purpose.target
    packages = [resolve.read_package(_archive_path(work, file), file.sha256) for file in files]
    current = {}
    for package, file in zip(packages, files, strict=True):
        path = f"pool/{package.file}"
        if path not in work.files:
            work.add(path, _archive_path(work, file))
        if work.files[path].sha256 != file.sha256:
            raise BundleError(
                f"two sources have different packages of the same name and version: {package.file}",
                hint="leave one of the sources out",
            )
        current[f"repository/{path}"] = path
    for name, data in resolve.index(packages, target, signer).items():
        path = f"hosts/{request.host}/repository/{name}"
        work.add(path, data)
        current[f"repository/{name}"] = path
    current["repository/atlantis.gpg"] = KEY
    return HostPart(
        architecture=target.architecture,
        distribution=target.distribution,
        codename=target.codename,
        wished={each.name: each.version for each in request.packages},
        installed={
            each.name: target.installed_packages[each.name]
            for each in request.packages
            if each.name in target.installed_packages
        },
        packages={package.name: package.version for package in packages},
        held=current,
    )


def _archive_path(work: StagingDirectory, file: resolve.DebFile) -> Path:
    """Return the path of a package file: in the bundle if already added, else in apt's folder."""
    inside = f"pool/{_pool_name(file)}"
    return work.folder / inside if inside in work.files else work.work / "archives" / file.name


def _pool_name(file: resolve.DebFile) -> str:
    """Return a package file's name in the bundle; apt writes the colon of an epoch as %3a."""
    return file.name.replace("%3a", "-")


def _reuse(work: StagingDirectory, lacking: dict[str, tuple[resolve.DebFile, ...]]) -> None:
    """Reuse package files of an earlier or interrupted bundle in this place; hashes are checked afterwards."""
    for file in {file.name: file for files in lacking.values() for file in files}.values():
        target = work.work / "archives" / file.name
        for place in (work.folder, work.place):
            earlier = place / "pool" / _pool_name(file)
            if not target.exists() and earlier.is_file() and earlier.stat().st_size == file.size:
                link_or_copy(earlier, target)


def _libraries(work: StagingDirectory, part: HostPart, purpose: BundlePurpose, repositories: RepositorySet) -> HostPart:
    """Add a host's libraries to the bundle."""
    current, libraries = dict(part.held), []
    for library in purpose.requirements.libraries:
        for path, source in repositories.files(library):
            inside = f"sources/{path.replace(':', '-')}"
            if inside not in work.files:
                work.add(inside, source.read_bytes())
            current[f"sources/{path}"] = inside
        commit = repositories.commits[library.url, library.revision]
        libraries.append(BundledLibrary(url=library.url, revision=library.revision, commit=commit))
    return part.model_copy(update={"held": current, "libraries": tuple(libraries)})


def _check_archives(requirements: HostRequirements) -> None:
    """Raise BundleError if a container archive is missing or does not match the inventory's SHA-256."""
    for archive in requirements.archives:
        hint = f"the partner's archive belongs in {archive.path.parent}; `sha256sum` says which one it is"
        if not archive.path.is_file():
            raise BundleError(f"{requirements.host}: there is no {archive.path}", hint=hint)
        if (digest := resolve.sha256_of(archive.path)) != archive.sha256:
            words = f"{archive.path} has the SHA-256 {digest}, and {archive.sha256} is declared"
            raise BundleError(f"{requirements.host}: {words}", hint=hint)


def _containers(work: StagingDirectory, part: HostPart, purpose: BundlePurpose) -> HostPart:
    """Add the images of a host's containers to the bundle."""
    for archive in purpose.requirements.archives:
        _copy(work, archive.path, archive.bundle_path)
    images = {archive.bundle_path: archive.bundle_path for archive in purpose.requirements.archives}
    return part.model_copy(update={"held": {**part.held, **images}})


def _copy(work: StagingDirectory, file: Path, path: str) -> None:
    """Copy a large file into the bundle, unless an identical one is there."""
    place = work.folder / path
    if not (
        place.is_file()
        and place.stat().st_size == file.stat().st_size
        and resolve.sha256_of(place) == resolve.sha256_of(file)
    ):
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place)
    work.add(path, place)


def _image(work: StagingDirectory, image: Path | None) -> BundleImage | None:
    if image is None:
        return None
    path = f"images/{image.name}"
    _copy(work, image, path)
    return BundleImage(name=image.name, sha256=work.files[path].sha256, path=path)


def _write_manifest(
    work: StagingDirectory, order: BundleOrder, signer: BundleSigner, hosts: dict[str, HostPart]
) -> Manifest:
    """Write the manifest and its signature, which makes the folder a bundle."""
    image = _image(work, order.image)
    files = tuple(work.files[path] for path in sorted(work.files))
    manifest = Manifest(
        id=content_id(files, hosts),
        site=order.site,
        made=datetime.now(UTC).isoformat(timespec="seconds"),
        tool=__version__,
        revision=order.revision,
        key=signer.fingerprint,
        files=files,
        hosts=hosts,
        image=image,
    )
    data = manifest.encode()
    (work.folder / MANIFEST).write_bytes(data)
    (work.folder / SIGNATURE).write_bytes(signer.sign_detached(data))
    return manifest
