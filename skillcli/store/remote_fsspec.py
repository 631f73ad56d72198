"""The files of a shared store through fsspec: the only module that imports it, and only for the address that is given.

Object stores show a file whole or not at all. Elsewhere it gets a temporary name first, and then its own.
"""

from __future__ import annotations

import errno
import functools
import secrets
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

from skillcli.errors import StoreError, UsageError
from skillcli.plaintext import line
from skillcli.store.atomic import TEMPORARY
from skillcli.store.remote_files import Files, LocalFiles

T = TypeVar("T")

ATTEMPTS = 3  # of one request, where the library does not repeat it itself
SECONDS = 10  # to connect
_PAUSE_SECONDS = 0.5  # before the second attempt; twice as long before each further one


@dataclass(frozen=True)
class Scheme:
    """One kind of address."""

    package: str  # as it is installed
    extra: str  # of skillcli
    credentials: str  # where they are looked for
    whole: bool = True  # whether a file appears whole or not at all
    options: dict[str, Any] = field(default_factory=dict)


SCHEMES = {
    "s3": Scheme(
        "s3fs", "s3", "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE; AWS_ENDPOINT_URL names another server",
        options={"config_kwargs": {"connect_timeout": SECONDS, "read_timeout": 60, "retries": {"max_attempts": 2}}},
    ),
    "gs": Scheme("gcsfs", "gs", "log in with `gcloud auth application-default login`, or set GOOGLE_APPLICATION_CREDENTIALS"),
    "sftp": Scheme(
        "paramiko", "sftp", "give sftp://USER@HOST/PATH, and a key in the SSH agent or in ~/.ssh", whole=False,
        options={"timeout": SECONDS},
    ),
    "hf": Scheme("huggingface_hub", "hf", "log in with `hf auth login`, or set HF_TOKEN"),
}  # fmt: skip
_FORMS = "file:///FOLDER, s3://BUCKET/PATH, gs://BUCKET/PATH, sftp://USER@HOST/PATH, hf://datasets/USER/NAME"
_FINAL = (FileNotFoundError, FileExistsError, PermissionError, IsADirectoryError, NotADirectoryError)
_NO_CREDENTIALS = ("credential", "authentication", "passwordrequired", "token", "unauthorized")
_NETWORK = ("connect", "timeout", "ssh", "gaierror", "dns", "protocol", "eof", "http")


def open_remote(address: str) -> Files:
    """Return the files of a shared store; an address elsewhere is connected to.

    Raises:
        UsageError: it is not an address of a known form.
        StoreError: a package is not installed, or there is no connection.
    """
    scheme, rest, path = address.partition("://")
    if not rest or not path:
        hint = f"did you mean {Path(address).absolute().as_uri()}?" if scheme == address and address else f"one of {_FORMS}"
        raise UsageError(f"expected an address such as {_FORMS.split(',')[0]}, got {address!r}", hint)
    if scheme == "file":
        if not path.startswith("/"):
            raise UsageError(
                f"expected a whole path after file://, got {address!r}", f"did you mean file://{_whole_path(path)}?"
            )
        return LocalFiles(Path(path).absolute(), address)
    if scheme not in SCHEMES:
        raise UsageError(f"expected an address of the form {_FORMS}, got {address!r}", "choose one of these")
    if not path.strip("/"):
        raise UsageError(f"{address} names no bucket or folder", f"one of {_FORMS}")
    return FsspecFiles(address, SCHEMES[scheme])


def _whole_path(path: str) -> Path:
    """Guess which folder was meant by an address with two slashes: one of this machine, or one below the present folder."""
    host, _, rest = path.partition("/")
    if host == "localhost" or (rest and Path(f"/{host}").is_dir()):
        return Path(f"/{rest}" if host == "localhost" else f"/{path}")
    return Path(path).expanduser().absolute()


class FsspecFiles:
    """Files behind an address that fsspec knows.

    Args:
        address: as typed.
        scheme: what is known about such addresses.
    """

    def __init__(self, address: str, scheme: Scheme) -> None:
        self.address = _without_password(address)
        self._scheme = scheme
        self._fs, path = self._try("connect to", functools.partial(_connected, address, scheme))
        self._root = path.rstrip("/")

    def names(self, folder: str) -> list[str]:
        """See `Files`."""
        self._fs.invalidate_cache()
        try:
            paths = self._try("list", lambda: self._fs.find(f"{self._root}/{folder}"))
        except FileNotFoundError:
            return []
        names = [path.removeprefix(f"{self._root}/") for path in paths]
        return [name for name in names if not name.rpartition("/")[2].startswith(".")]

    def read(self, name: str, most: int) -> bytes | None:
        """See `Files`."""
        try:
            return bytes(self._try("read", lambda: self._fs.cat_file(f"{self._root}/{name}", start=0, end=most + 1)))
        except FileNotFoundError:
            return None

    def write(self, name: str, data: bytes) -> None:
        """See `Files`."""
        path = f"{self._root}/{name}"

        def write() -> None:
            if self._scheme.whole:
                self._fs.pipe_file(path, data)
            else:
                self._beside(path, data, self._fs.ftp.posix_rename)

        self._writing(write)

    def create(self, name: str, data: bytes) -> bool:
        """See `Files`."""
        path = f"{self._root}/{name}"

        def create() -> bool:
            if self._scheme.whole:
                return self._create_object(path, data)
            try:
                self._beside(path, data, self._fs.ftp.rename)  # without the extension of OpenSSH, it refuses to replace
            except OSError:
                if self._fs.exists(path):
                    return False
                raise
            return True

        return self._writing(create)

    def _create_object(self, path: str, data: bytes) -> bool:
        try:
            self._fs.pipe_file(path, data, mode="create")
        except FileExistsError:
            return False
        except OSError as error:
            if error.errno != errno.ENOSYS:
                raise
            if self._fs.exists(path):  # a server that knows no conditions: of two at this very moment, both may pass
                return False
            self._fs.pipe_file(path, data)
        return True

    def _beside(self, path: str, data: bytes, rename: Callable[[str, str], object]) -> None:
        folder, _, last = path.rpartition("/")
        temporary = f"{folder}/{TEMPORARY}{secrets.token_hex(8)}"
        if not self._fs.exists(folder):
            self._fs.makedirs(folder, exist_ok=True)
        try:
            self._fs.pipe_file(temporary, data)
            rename(temporary, f"{folder}/{last}")
        finally:
            with suppress(Exception):  # renamed, or the connection is gone
                self._fs.ftp.remove(temporary)

    def _writing(self, call: Callable[[], T]) -> T:
        try:
            return self._try("write to", call)
        except FileNotFoundError as error:
            raise StoreError(
                f"cannot write to {self.address}: its bucket or folder does not exist", "create it, or check the address"
            ) from error

    def _try(self, action: str, call: Callable[[], T]) -> T:
        """Call, a few times if the network fails; a missing file raises FileNotFoundError, all else a StoreError."""
        attempts = 1 if getattr(getattr(self, "_fs", None), "async_impl", False) else ATTEMPTS  # these repeat themselves
        for attempt in range(1, attempts + 1):
            try:
                return call()
            except (StoreError, FileNotFoundError):
                raise
            except Exception as error:
                if attempt == attempts or isinstance(error, _FINAL) or not _is_network(error):
                    raise self._refusal(action, error) from error
                time.sleep(_PAUSE_SECONDS * 2 ** (attempt - 1))
                with suppress(Exception):
                    self._fs._connect()  # of sftp: a broken connection stays broken
        raise AssertionError

    def _refusal(self, action: str, error: Exception) -> StoreError:
        said = line(str(error).strip() or type(error).__name__)
        what = " ".join(f"{kind.__name__}" for kind in type(error).__mro__).lower()
        if any(word in what or word in said.lower() for word in _NO_CREDENTIALS):
            hint = self._scheme.credentials
        elif isinstance(error, PermissionError):
            hint = f"ask its owner to let you read and write there, or use other credentials: {self._scheme.credentials}"
        elif isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            hint = "the disk there is full: free some space, or choose another address"
        elif _is_network(error):
            hint = "check the address and the network, then run it again: what was transferred is kept"
        else:
            hint = "check the address, then run it again: what was transferred is kept"
        return StoreError(f"cannot {action} {self.address}: {said}", hint)


def _connected(address: str, scheme: Scheme) -> tuple[Any, str]:
    try:
        import fsspec

        options = dict(scheme.options)
        if scheme.package == "paramiko":
            options["host_key_policy"] = _known_hosts_only()
        fs, path = fsspec.core.url_to_fs(address, skip_instance_cache=True, **options)
    except ImportError as error:
        raise StoreError(
            f"{address.partition(':')[0]}:// needs the package {scheme.package}, which is not installed",
            f"pip install 'skillcli[{scheme.extra}]'",
        ) from error
    if scheme.package == "s3fs":
        fs.retries = ATTEMPTS
    return fs, path


def _known_hosts_only() -> Any:
    """Return a policy that accepts the keys of known_hosts alone: fsspec by itself trusts any server."""
    import paramiko

    class KnownHosts(paramiko.MissingHostKeyPolicy):  # type: ignore[misc]
        def missing_host_key(self, client: Any, hostname: str, key: Any) -> None:
            known = paramiko.HostKeys()
            with suppress(OSError):
                known.load(str(Path("~/.ssh/known_hosts").expanduser()))
            if not known.check(hostname, key):
                raise PermissionError(f"the key of {hostname} is not in ~/.ssh/known_hosts: connect once with `ssh`")

    return KnownHosts()


def _is_network(error: Exception) -> bool:
    if isinstance(error, _FINAL):
        return False
    names = " ".join(kind.__name__ for kind in type(error).__mro__[:-2]).lower()
    return isinstance(error, OSError | EOFError) or any(word in names for word in _NETWORK)


def _without_password(address: str) -> str:
    with suppress(ValueError):
        parts = urlsplit(address)
        if parts.password:
            return address.replace(f":{parts.password}@", "@", 1)
    return address
