"""``tsc-batch`` as it is used: the real command line, real SUMO, processes that get killed."""

import json
import os
import re
import signal

import pytest

from tests.batch.cases import (
    PATIENCE,
    begun,
    finished,
    half_written,
    rows,
    runners,
    start,
    wait_for,
    write_suite,
)
from tests.cli.refusals import refused
from tsc_missing.batch.engine import _check_address
from tsc_missing.batch.worker import IDLE

LONG = 600_000  # [s] a horizon that no test waits for


def test_a_batch_is_what_its_runs_are_alone_and_runs_once(command, small_net):
    write_suite(command, small_net)
    done = command("batch", "small.toml", "--out", "b", "--workers", 1, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {
        "out": "b",
        "table": "b/results.parquet",
        "runs": 4,
        "finished": 4,
        "failed": {},
        "lacking": {},
    }
    out = command.cwd / "b"
    table = rows(out)
    name = "small-random-0.5-held-seed1"
    assert len(table) == 4
    assert table[name]["status"] == "finished"
    assert table[name]["imputer"] == "last"
    assert table[name]["demand"] == "auto"
    assert table[name]["demand_vehicles"] > 0
    assert "libsumo" in table[name]["versions"]
    assert "net.net.xml" in table[name]["checksums"]

    alone = command(
        *("run", "--net", small_net, "--horizon", 90, "--seed", 1),
        *("--controller", "max-queue", "--imputer", "last"),
        *("--missing", "random", "--rate", 0.5, "--out", "alone"),
    )
    assert alone.returncode == 0, alone.stderr
    folder = out / "runs" / name
    for file in ("trips.parquet", "mask.npz"):
        assert (command.cwd / "alone" / file).read_bytes() == (folder / file).read_bytes()
    assert json.loads((folder / "run.json").read_text())["settings"]["seed"] == 1

    masks = {run: row["mask.npz_sha256"] for run, row in table.items()}
    assert masks[name] == masks["small-random-0.5-max-queue-seed1"]
    assert masks[name] != masks["small-random-0.5-held-seed0"]

    made = {path.name: path.stat().st_mtime_ns for path in (out / "runs").iterdir()}
    again = command("batch", "small.toml", "--out", "b")
    assert again.returncode == 0, again.stderr
    assert {path.name: path.stat().st_mtime_ns for path in (out / "runs").iterdir()} == made
    assert rows(out) == table

    less = command("batch", "small.toml", "--out", "b", "--set", "seed=1")
    assert less.returncode == 0, less.stderr
    assert "not in the table: 2 runs in b/runs that this suite does not have" in less.stdout
    assert rows(out) == {run: row for run, row in table.items() if run.endswith("seed1")}


def test_killed_and_interrupted_batches_go_on(command, small_net):
    write_suite(command, small_net, horizon=300)
    options = ("small.toml", "--workers", 1)
    whole = command("batch", *options, "--out", "whole")
    assert whole.returncode == 0, whole.stderr

    out = command.cwd / "b"
    first = start(command, *options, "--out", "b")
    wait_for(lambda: finished(out) and half_written(out))
    first.kill()
    first.communicate(timeout=IDLE / 2)  # its worker, which has the same output, does not stay
    there = {name: (out / "runs" / name).stat().st_ino for name in finished(out)}
    assert 0 < len(there) < 4

    second = start(command, *options, "--out", "b")
    wait_for(lambda: len(finished(out)) > len(there))
    workers = runners(second.pid)
    second.send_signal(signal.SIGINT)
    _, errors = second.communicate(timeout=PATIENCE)
    assert second.returncode == 130, errors
    assert re.search(r"interrupted with [2-4] of 4 runs; the same command goes on\n$", errors)
    assert half_written(out) == []
    wait_for(lambda: not any(os.path.exists(f"/proc/{pid}/exe") for pid in workers))  # noqa: PTH110
    assert len(rows(out)) == 4

    third = command("batch", *options, "--out", "b")
    assert third.returncode == 0, third.stderr
    assert rows(out) == rows(command.cwd / "whole")
    assert {name: (out / "runs" / name).stat().st_ino for name in there} == there
    assert half_written(out) == []
    assert list(out.glob(".alive-*")) == []


def test_a_killed_worker_costs_its_run_only(command, small_net):
    write_suite(command, small_net, horizon=300, seeds="[0]")
    out = command.cwd / "b"
    process = start(command, "small.toml", "--workers", 1, "--retries", 1, "--out", "b")
    wait_for(lambda: begun(out))
    (worker,) = runners(process.pid)
    os.kill(worker, signal.SIGKILL)
    text, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, errors
    assert "2 of 2 runs finished" in text
    assert {row["status"] for row in rows(out).values()} == {"finished"}


def test_a_crash_is_recorded_and_stops_nobody(command, small_net):
    write_suite(command, small_net, horizon=f"[90, {LONG}]", methods='"max-queue"', seeds="[0]")
    out = command.cwd / "b"
    process = start(command, "small.toml", "--workers", 2, "--out", "b", "--retries", 0)
    wait_for(lambda: begun(out) and finished(out))
    busy = command("batch", "small.toml", "--out", "b")
    assert busy.returncode == 2
    assert "another tsc-batch is running in it" in busy.stderr
    for worker in runners(process.pid):
        os.kill(worker, signal.SIGKILL)
    text, _ = process.communicate(timeout=PATIENCE)
    long = f"small-horizon_{LONG}-random-0.5-max-queue-seed0"
    assert process.returncode == 1
    assert "1 of 2 runs finished" in text
    assert f"failed: {long}: its process ended with SIGKILL(-9)" in text
    row = rows(out)[long]
    assert (row["status"], row["attempts"], row["att_all"]) == ("failed", 1, None)
    assert row["error"] == "its process ended with SIGKILL(-9)"
    assert half_written(out) == []


def test_a_time_out_is_recorded_after_retries(command, small_net):
    write_suite(command, small_net, horizon=LONG, methods='"max-queue"', seeds="[0]")
    options = ("small.toml", "--out", "b", "--workers", 1, "--timeout", 2, "--retries", 1)
    done = command("batch", *options)
    assert done.returncode == 1
    assert "0 of 1 runs finished" in done.stdout
    (row,) = rows(command.cwd / "b").values()
    assert (row["status"], row["attempts"]) == ("failed", 2)
    assert row["error"] == "it took more than 2 s"
    assert half_written(command.cwd / "b") == []


def test_mistakes_are_found_before_anything_starts(command, small_net):
    write_suite(command, small_net, seeds="[]")
    refused(command, "batch", "small.toml", words=["runs 1.seed", "it has no value"])
    write_suite(command, small_net, methods='["max-queue", "BC"]')
    lacking = "BC on small (`tsc-train bc --data data/small`)"
    refused(command, "batch", "small.toml", words=[f"{lacking} have no weights", "--skip-"])
    done = command("batch", "small.toml", "--skip-unavailable", "--list")
    assert done.returncode == 0
    assert f"left out, no weights: {lacking}" in done.stderr
    assert done.stdout.count("to run") == 2
    write_suite(command, small_net, methods='"difflight"')
    weights = ("--set", "q_weights=nowhere", "--set", "diffusion.scoring=value")
    words = ["method difflight, q_weights: nowhere is not allowed"]
    refused(command, "batch", "small.toml", *weights, words=words)
    assert not (command.cwd / "runs").exists()
    (command.cwd / "other").mkdir()
    (command.cwd / "other" / "file").touch()
    write_suite(command, small_net)
    refused(
        command, "batch", "small.toml", "--out", "other", words=["--out", "something else is in it"]
    )
    rate = ("--set", "missing={pattern='kriging', rate=0.9}")
    refused(command, "batch", "small.toml", *rate, words=["rate", "0.9", "at most 3 of the 6"])


def test_a_timing_that_does_not_fit_the_network(command):
    made = command("net", "generate", "--rows", 1, "--columns", 2, "--out", "net")
    assert made.returncode == 0, made.stderr
    write_suite(command, "net/", methods='"max-queue"', seeds="[0]")
    words = ["decision-interval: 3 is not allowed", "the yellow takes 3 s"]
    refused(command, "batch", "small.toml", "--set", "signals.decision_interval=3", words=words)
    given = ("--set", "signals={yellow=1, decision_interval=3}")  # goes before the network's own
    assert command("batch", "small.toml", *given, "--list").returncode == 0


def test_the_program_of_a_network_that_came_without_one(command, small_net):
    write_suite(command, small_net, methods='"as-built"', seeds="[0]")
    words = ["controller: as-built", "small (cityflow) came without signal programs"]
    refused(command, "batch", "small.toml", words=words)


def test_a_suite_in_which_nothing_can_run(command, small_net):
    write_suite(command, small_net, methods='"BC"')
    skipping = ("small.toml", "--skip-unavailable")
    done = command("batch", *skipping, "--out", "b")
    assert (done.returncode, done.stdout) == (2, "")
    lacking = "BC on small (`tsc-train bc --data data/small`)"
    assert done.stderr.splitlines() == [
        f"left out, no weights: {lacking}",
        f"error: methods: {lacking} have no weights here; nothing else is in the suite; make some",
    ]
    assert not (command.cwd / "b").exists()
    listed = command("batch", *skipping, "--list")
    assert (listed.returncode, listed.stdout) == (0, "")


def test_results_of_other_versions_settings_and_inputs(command, small_net):
    write_suite(command, small_net, methods='"max-queue"', seeds="[0]", horizon=45)
    done = command("batch", "small.toml", "--out", "b")
    assert done.returncode == 0, done.stderr
    words = ["holds runs/small-random-0.5-max-queue-seed0 with other settings", "horizon was 45"]
    refused(command, "batch", "small.toml", "--out", "b", "--set", "horizon=60", words=words)
    path = command.cwd / "b" / "runs" / "small-random-0.5-max-queue-seed0" / "run.json"
    record = json.loads(path.read_text())
    path.write_text(json.dumps({**record, "checksums": {"net.net.xml": "0"}}))
    refused(
        command, "batch", "small.toml", "--out", "b", words=["other checksums", "net.net.xml was 0"]
    )
    path.write_text(json.dumps({**record, "versions": {"libsumo": "1.0"}}))
    words = ["other versions", "libsumo was 1.0", "--any-version"]
    refused(command, "batch", "small.toml", "--out", "b", "--list", words=["other versions"])
    path.write_text(json.dumps({**record, "versions": {**record["versions"], "libsumo": "1.0"}}))
    refused(command, "batch", "small.toml", "--out", "b", words=words)
    path.write_text(json.dumps({**record, "versions": {**record["versions"], "source": "1.0"}}))
    refused(command, "batch", "small.toml", "--out", "b", words=["versions", "source was 1.0"])
    kept = command("batch", "small.toml", "--out", "b", "--any-version", "--list")
    assert "1 run of other versions kept" in kept.stderr
    assert kept.stdout == "finished  small-random-0.5-max-queue-seed0\n"
    unknown = {**record["settings"], "signals": {"max_red": 240}}  # to a version without the others
    path.write_text(json.dumps({**record, "settings": unknown, "versions": {"libsumo": "1.0"}}))
    kept = command("batch", "small.toml", "--out", "b", "--any-version", "--list")
    assert kept.stdout == "finished  small-random-0.5-max-queue-seed0\n"
    wanted = ("--set", "signals.min_space=9")  # that version knew no such setting
    words = ["other settings", "signals.min_space was None, is 9"]
    refused(command, "batch", "small.toml", "--out", "b", *wanted, "--any-version", words=words)
    other = {**record["settings"], "signals": {"yellow": 4}}
    path.write_text(json.dumps({**record, "settings": other, "versions": {"libsumo": "1.0"}}))
    words = ["other settings", "signals.yellow was 4, is 5"]
    refused(command, "batch", "small.toml", "--out", "b", "--any-version", words=words)


def test_runs_of_other_batches_are_taken(command, small_net):
    write_suite(command, small_net, methods='"max-queue"', horizon=45)
    write_suite(command, small_net, horizon=45, seeds="[1, 2]", name="more")
    done = command("batch", "small.toml", "--out", "a", "--no-decisions")
    assert done.returncode == 0, done.stderr
    shared = "small-random-0.5-max-queue-seed1"
    source = command.cwd / "a" / "runs" / shared
    more = ("more.toml", "--out", "b", "--reuse", "a")
    listed = command("batch", *more, "--list")
    assert [line for line in listed.stdout.splitlines() if line.startswith("to take")] == [
        f"to take   {shared}"
    ]
    told = json.loads(command("batch", *more, "--list", "--json").stdout)
    assert told["reusable"] == {shared: f"a/runs/{shared}"}
    assert not (command.cwd / "b").exists()

    taken = command.cwd / "b" / "runs" / shared
    done = command("batch", *more, "--no-decisions")
    assert done.returncode == 0, done.stderr
    assert len(rows(command.cwd / "b")) == 4
    assert (taken / "run.json").read_bytes() == (source / "run.json").read_bytes()
    done = command("batch", "more.toml", "--out", "c", "--reuse", "b")  # has no decisions
    assert done.returncode == 0, done.stderr
    again = command.cwd / "c" / "runs" / shared
    assert (again / "decisions.parquet").is_file()
    assert (again / "trips.parquet").read_bytes() == (source / "trips.parquet").read_bytes()

    record = json.loads((source / "run.json").read_text())
    for changed in ({"versions": {"libsumo": "1.0"}}, {"checksums": {"net.net.xml": "0"}}):
        (source / "run.json").write_text(json.dumps({**record, **changed}))
        listed = command("batch", "more.toml", "--out", "d", "--reuse", "a", "--list")
        assert "to take" not in listed.stdout
    fewer = {key: value for key, value in record["settings"].items() if key != "q_weights"}
    older = {**record, "settings": fewer, "versions": {"libsumo": "1.0"}}
    (source / "run.json").write_text(json.dumps(older))
    listed = command("batch", *more[:2], "d", "--reuse", "a", "--any-version", "--list")
    assert f"to take   {shared}" in listed.stdout
    refused(command, "batch", "more.toml", "--reuse", "nowhere", words=["--reuse", "nowhere"])


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1"])
def test_a_cluster_that_is_not_there(command, small_net, address):
    pytest.importorskip("distributed", reason="Dask is not installed (the extra cluster)")
    write_suite(command, small_net)
    done = command("batch", "small.toml", "--out", "b", "--cluster", address)
    assert done.returncode == 2
    assert f"--cluster: {address}" in done.stderr
    assert "no Dask scheduler answers there" in done.stderr
    assert not (command.cwd / "b").exists()


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("foo", "missing port"),
        ("http://10.0.0.1:8786", "unknown address scheme 'http'"),
        ("tcp://10.0.0.1:port", "invalid literal"),
        ("10.0.0.1:99999", "no such port"),
        (":8786", "no host"),
    ],
)
def test_what_is_no_address_of_a_cluster(command, small_net, address, words):
    pytest.importorskip("distributed", reason="Dask is not installed (the extra cluster)")
    write_suite(command, small_net)
    wanted = [f"--cluster: {address} ", "HOST:PORT", words]
    refused(command, "batch", "small.toml", "--out", "b", "--cluster", address, words=wanted)


@pytest.mark.parametrize(
    "address",
    [
        *("scheduler:8786", "tcp://10.0.0.1:8786", "tls://scheduler:8786", "tcp://[::1]:8786"),
        *("ws://scheduler:8786", "wss://scheduler/dask", "ucx://10.0.0.1:8786", "inproc://1/2/3"),
    ],
)
def test_addresses_of_clusters(address):
    pytest.importorskip("distributed", reason="Dask is not installed (the extra cluster)")
    _check_address(address)


@pytest.mark.parametrize("out", ["/proc/batch", "small.toml/b"])
def test_a_folder_that_cannot_be_made(command, small_net, out):
    write_suite(command, small_net)
    words = [f"--out: {out} is not allowed; cannot be written ("]
    refused(command, "batch", "small.toml", "--out", out, words=words)
