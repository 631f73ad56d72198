"""`skill play` as a process: one JSON object when it serves, and a clean end."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from command import skill

pytest.importorskip("viser")
pytestmark = pytest.mark.slow  # starts processes

SHIPPED = Path(__file__).parents[2] / "artifacts"
MAIN = "import sys; sys.argv[0] = 'skill'; from skillcli.cli.main import main; main()"
COMMAND = [sys.executable, "-c", MAIN, "--store", str(SHIPPED), "play"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_says_where_it_serves_and_ends_cleanly(number: signal.Signals) -> None:
    words = [*COMMAND, "reference-point/embed-means", "--json"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        told = json.loads(process.stdout.readline())
        host, port = told["url"].removeprefix("http://").split(":")
        assert told["id"] == "reference-point/embed-means-v1" and host == "127.0.0.1"
        with socket.create_connection((host, int(port)), timeout=30) as browser:
            browser.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
            assert b"200 OK" in browser.recv(1000)
        process.send_signal(number)
        rest, said = process.communicate(timeout=60)
    assert process.returncode == 0 and rest == "" and "nothing was recorded" in said and "Traceback" not in said


def test_what_cannot_be_played_ends_in_one_line(tmp_path: Path) -> None:
    for words, code, part in (
        (("reference-reach/compose",), 1, "expected an artifact of kind embed-means or pretrain"),
        (("nobody/pretrain",), 1, "no artifact 'nobody/pretrain'"),
        (("reference-point/pretrain", "--port", "0"), 2, "--port"),
        (("reference-point/pretrain", "--name", "../x"), 2, "cannot be part of an id"),
    ):
        result = skill("--store", SHIPPED, "play", *words)
        assert result.code == code and part in result.err and "Traceback" not in result.err, result
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = skill("--store", SHIPPED, "play", "reference-point/pretrain", "--port", str(port))
    assert result.code == 1 and f"port {port} is not free" in result.err
