"""Who calls the workers: threads of this process, or a Dask cluster; the same calls for both."""

import concurrent.futures
import contextlib
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsc_missing.batch import worker
from tsc_missing.batch.folder import Failure
from tsc_missing.batch.task import Task
from tsc_missing.batch.worker import Care, Outcome, supervise
from tsc_missing.errors import UserError
from tsc_missing.versions import versions

CLUSTER = "--cluster"
PORTS = range(1, 65536)
PATIENCE = 10.0  # [s] to wait for a cluster to answer, and for its first worker


@dataclass(frozen=True)
class Engine:
    """Something that runs calls, several at a time."""

    executor: Executor
    places: Callable[[], int]  # how many calls it can run at a time
    busy: Callable[[], int]  # how many of this process's workers have a run; 0 on a cluster


@contextlib.contextmanager
def local_engine(workers: int) -> Iterator[Engine]:
    """A thread for each worker of this machine; ending early ends the workers at once."""
    worker.stopping.clear()
    executor = ThreadPoolExecutor(workers, thread_name_prefix="tsc-batch")
    try:
        yield Engine(executor, lambda: workers, worker.busy)
    except BaseException:
        worker.stopping.set()
        executor.shutdown(wait=False, cancel_futures=True)
        worker.kill_all()
        raise
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
        worker.close_all()


@contextlib.contextmanager
def cluster_engine(address: str, out: Path) -> Iterator[Engine]:
    """The workers of a Dask cluster that see the folder ``out`` and have these versions."""
    try:
        from distributed import Client
        from distributed.comm import CommClosedError
    except ModuleNotFoundError:
        raise UserError(
            CLUSTER, address, "Dask is not installed: pip install 'tsc-missing[cluster]'"
        ) from None
    _check_address(address)
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UserError(
            CLUSTER, address, f"no Dask scheduler answers there ({type(error).__name__})"
        ) from None
    try:
        with client:
            _check_workers(client, address, out)
            executor = client.get_executor(pure=False)
            try:
                yield Engine(executor, lambda: sum(client.nthreads().values()), lambda: 0)
            except BaseException as error:
                lost = isinstance(error, OSError) and client.status != "running"
                executor.shutdown(wait=False)  # cancels what waits; what runs sees it is unwanted
                if lost:
                    raise _lost(address, error) from error
                raise
            executor.shutdown()
    except (CommClosedError, TimeoutError) as error:
        raise _lost(address, error) from error


def _lost(address: str, error: BaseException) -> UserError:
    words = f"its scheduler was lost ({type(error).__name__}); the same command goes on"
    return UserError(CLUSTER, address, words, verdict="does not answer any more")


def _check_address(address: str) -> None:
    """Raise ``UserError`` unless a scheduler may have that address; nothing is asked of it.

    A Dask client of an address that is none takes long to go away.
    """
    from distributed.comm import parse_address, parse_host_port
    from distributed.comm.registry import get_backend

    try:
        scheme, place = parse_address(address)
        get_backend(scheme)
        if scheme in ("tcp", "tls"):  # others have addresses of their own kind
            host, port = parse_host_port(place)
            if not host or port not in PORTS:
                raise ValueError("no host" if not host else "no such port")
    except ValueError as error:
        words = "it must be HOST:PORT or SCHEME://HOST:PORT, as tcp://10.0.0.1:8786"
        raise UserError(CLUSTER, address, f"{words} ({error})") from None


def _check_workers(client: Any, address: str, out: Path) -> None:
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise UserError(CLUSTER, address, "the scheduler there has no workers") from None
    try:
        there = client.run(_look, out.resolve())
    except ImportError as error:
        raise UserError(CLUSTER, address, f"its workers lack a package: {error}") from None
    for name, found in there.items():
        if found["versions"] != versions():
            raise UserError(
                CLUSTER, address, f"its worker {name} has {found['versions']}, here {versions()}"
            )
        if not found["sees"]:
            raise UserError(
                CLUSTER, address, f"its worker {name} does not see {out}: share the folder"
            )


def _look(out: Path) -> dict[str, Any]:
    """What a worker of the cluster has."""
    return {"versions": versions(), "sees": out.is_dir()}


def run_tasks(engine: Engine, tasks: Sequence[Task], care: Care) -> Iterator[Outcome]:
    """The outcome of each task as it ends, in any order."""
    submit = engine.executor.submit
    names = {submit(supervise, task, care): task.name for task in tasks}
    for future in concurrent.futures.as_completed(names):
        try:
            yield future.result()
        except Exception as error:  # the cluster gave it up: worker after worker died of it
            words = " ".join(str(error).split())
            failure = Failure(kind="crash", error=f"{type(error).__name__}: {words}")
            yield Outcome(names[future], failure, 0.0)


@contextlib.contextmanager
def alive_file(out: Path) -> Iterator[Path]:
    """A file that says that the batch wants its runs; those of earlier batches go away."""
    for old in out.glob(".alive-*"):
        old.unlink(missing_ok=True)
    path = out.resolve() / f".alive-{uuid.uuid4().hex}"
    path.touch()
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)
