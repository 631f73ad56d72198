"""`skill upload`, `skill download` and `skill ls --remote`, as a user meets them."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

from command import CHAIN, made, skill

from skillcli.store import ArtifactId
from skillcli.store.remote_files import LocalFiles
from skillcli.store.remote_index import Entry


def test_a_chain_goes_to_a_shared_store_and_back(chain: Path, tmp_path: Path) -> None:
    remote, other = f"file://{tmp_path}/remote", tmp_path / "other"
    ids = [f"tiny/{stage}-v1" for stage in CHAIN]
    sent = made("--store", chain, "upload", remote, "tiny/transfer-eval")
    assert (sent["transferred"], sent["skipped"], sent["renamed"]) == (ids, [], {})
    listed = made("--store", other, "ls", "--remote", remote)["artifacts"]
    assert [(one["id"], one["kind"], one["here"]) for one in listed] == [(f"tiny/{stage}-v1", stage, None) for stage in CHAIN]
    got = made("--store", other, "download", remote, "tiny/compose-v1")
    assert got["transferred"] == ids[:3] and got["bytes"] == sum(one["bytes"] for one in listed[:3])
    assert made("--store", other, "verify", "tiny/compose-v1", "--lineage")["ok"]
    assert made("--store", other, "download", remote, "tiny/compose-v1")["skipped"] == [ids[2]]
    here = {one["id"]: one["here"] for one in made("--store", other, "ls", "--remote", remote, "--name", "ti*")["artifacts"]}
    assert here == {**{one: one for one in ids[:3]}, ids[3]: None}
    assert [one["kind"] for one in made("ls", "--remote", remote, "--kind", "compose")["artifacts"]] == ["compose"]
    assert made("ls", "--remote", remote, "--before", "2020-01-01")["artifacts"] == []
    shown = skill("--store", other, "ls", "--remote", remote)
    assert shown.code == 0 and ids[3] in shown.out and "yes" in shown.out


def test_what_cannot_be_done_is_one_line(chain: Path, tmp_path: Path) -> None:
    remote = f"file://{tmp_path}/remote"
    (tmp_path / "file").touch()
    for code, words, said in (
        (1, ("download", remote, "tiny/compose"), "there are no artifacts at"),
        (1, ("ls", "--remote", remote), "there are no artifacts at"),
        (1, ("upload", f"file://{tmp_path}/not/there", "tiny/compose"), "there is no folder"),
        (1, ("upload", remote, "nobody"), "no artifact 'nobody'"),
        (2, ("upload", "ftp://host/x", "tiny/compose"), "expected an address"),
        (1, ("upload", f"file://{tmp_path}/file", "tiny/compose"), "check the address"),
        (2, ("upload", "file://r3", "tiny/compose"), f"did you mean file://{Path('r3').absolute()}?"),
        (2, ("download", "file://tmp/r3", "tiny/compose"), "did you mean file:///tmp/r3?"),
        (2, ("ls", "--remote", "file://localhost/mnt/r3"), "did you mean file:///mnt/r3?"),
        (2, ("ls", "--remote", remote, "--recipe", "smoke"), "do not go together"),
        (2, ("upload", remote), "Missing argument"),
    ):
        result = skill("--store", chain, *words)
        assert result.code == code and said in result.err, result.err
        assert result.err.count("error:") == 1 and "Traceback" not in result.err
    assert not (tmp_path / "remote").exists()


def test_a_listing_of_thousands_opens_no_artifact(tmp_path: Path) -> None:
    files = LocalFiles(tmp_path / "remote", "")
    for number in range(1, 1001):
        one = Entry(ArtifactId("many", "pretrain", number), "2026-01-01T00:00:00.000000+00:00", f"{number:064x}", "0" * 64, 9)
        path = files.root / one.name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    began = time.process_time()
    found = made("--store", tmp_path / "none", "ls", "--remote", f"file://{tmp_path}/remote")["artifacts"]
    assert time.process_time() - began < 2 and len(found) == 1000 and not any(one["whole"] for one in found)


def test_ctrl_c_ends_with_130_and_says_that_it_goes_on(chain: Path, tmp_path: Path) -> None:
    code = (
        "import sys, skillcli.store.remote_upload as u\n"
        "def wait(*_): print('sending', file=sys.stderr, flush=True); import time; time.sleep(60)\n"
        "u._send = wait\n"
        "from skillcli.cli.main import main\n"
        "main()"
    )
    words = ["--store", str(chain), "upload", f"file://{tmp_path}/remote", "tiny/compose"]
    with subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert "sending" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
    assert process.returncode == 130 and "what was transferred is whole and kept" in said
