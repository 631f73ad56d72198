"""Servers for the tests of shared stores: S3 by moto, and SFTP by paramiko over a folder."""

from __future__ import annotations

import errno
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import boto3
import paramiko
import pytest
from moto.server import ThreadedMotoServer


@contextmanager
def s3(patch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Serve S3 with a bucket `group`; processes that are started inside find it too. Yield a client of it."""
    server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
    patch.setenv("AWS_ACCESS_KEY_ID", "test")
    patch.setenv("AWS_SECRET_ACCESS_KEY", "test")
    patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    client = boto3.client("s3")
    client.create_bucket(Bucket="group")
    try:
        yield client
    finally:
        server.stop()


class _Door(paramiko.ServerInterface):
    def check_auth_password(self, username: str, password: str) -> int:
        return paramiko.AUTH_SUCCESSFUL if (username, password) == ("ann", "secret") else paramiko.AUTH_FAILED

    def check_channel_request(self, kind: str, chanid: int) -> int:
        return paramiko.OPEN_SUCCEEDED


class _Handle(paramiko.SFTPHandle):
    def stat(self) -> Any:
        return paramiko.SFTPAttributes.from_stat(os.fstat(self.readfile.fileno()))


class _Folder(paramiko.SFTPServerInterface):
    """Absolute paths of this machine; renaming refuses to replace, as OpenSSH does."""

    def list_folder(self, path: str) -> Any:
        try:
            found = []
            for entry in Path(path).iterdir():
                attributes = paramiko.SFTPAttributes.from_stat(entry.stat())
                attributes.filename = entry.name
                found.append(attributes)
            return found
        except OSError as error:
            return paramiko.SFTPServer.convert_errno(error.errno)

    def stat(self, path: str) -> Any:
        try:
            return paramiko.SFTPAttributes.from_stat(Path(path).stat())
        except OSError as error:
            return paramiko.SFTPServer.convert_errno(error.errno)

    lstat = stat

    def open(self, path: str, flags: int, attr: Any) -> Any:
        try:
            number = os.open(path, flags, 0o644)
        except OSError as error:
            return paramiko.SFTPServer.convert_errno(error.errno)
        handle = _Handle(flags)
        handle.readfile = handle.writefile = os.fdopen(number, "wb" if flags & os.O_WRONLY else "rb")
        return handle

    def _done(self, call: Any, *paths: str) -> int:
        try:
            call(*paths)
        except OSError as error:
            return paramiko.SFTPServer.convert_errno(error.errno or errno.EIO)
        return paramiko.SFTP_OK

    def remove(self, path: str) -> int:
        return self._done(os.unlink, path)

    def mkdir(self, path: str, attr: Any) -> int:
        return self._done(os.mkdir, path)

    def posix_rename(self, oldpath: str, newpath: str) -> int:
        return self._done(os.replace, oldpath, newpath)

    def rename(self, oldpath: str, newpath: str) -> int:
        done = self._done(os.link, oldpath, newpath)
        return done or self._done(os.unlink, oldpath)


@contextmanager
def sftp(known_hosts: Path) -> Iterator[str]:
    """Serve this machine's files by SFTP; yield the beginning of its address. Its key is written to `known_hosts`."""
    key = paramiko.RSAKey.generate(2048)
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    known_hosts.parent.mkdir(parents=True, exist_ok=True)
    known_hosts.write_text(f"[127.0.0.1]:{port} {key.get_name()} {key.get_base64()}\n")
    transports: list[paramiko.Transport] = []

    def serve() -> None:
        with suppress(OSError):
            while True:
                connection, _ = listener.accept()
                transport = paramiko.Transport(connection)
                transports.append(transport)
                transport.add_server_key(key)
                transport.set_subsystem_handler("sftp", paramiko.SFTPServer, _Folder)
                with suppress(paramiko.SSHException):  # the other side did not like our key
                    transport.start_server(server=_Door())

    threading.Thread(target=serve, daemon=True).start()
    try:
        yield f"sftp://ann:secret@127.0.0.1:{port}"
    finally:
        listener.close()
        for transport in transports:
            transport.close()
