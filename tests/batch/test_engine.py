"""A Dask cluster whose scheduler is lost while a batch runs, without a cluster."""

import pytest

from tsc_missing.batch import engine
from tsc_missing.errors import UserError

distributed = pytest.importorskip("distributed", reason="Dask is not installed")
ADDRESS = "tcp://127.0.0.1:8786"


class Client:
    """What is used of Dask's client."""

    def __init__(self, *_, **__):
        self.status = Client.state

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.status = "closed"

    def get_executor(self, pure):
        return self

    def shutdown(self, wait=True):
        """Nothing runs."""


@pytest.fixture
def fault(monkeypatch, tmp_path):
    """Raises an error in the middle of a batch while the client has a status."""
    monkeypatch.setattr(distributed, "Client", Client)
    monkeypatch.setattr(engine, "_check_workers", lambda *_: None)

    def raised(error, state):
        monkeypatch.setattr(Client, "state", state, raising=False)
        with engine.cluster_engine(ADDRESS, tmp_path):
            raise error

    return raised


def test_a_scheduler_that_is_lost_is_no_folder_that_cannot_be_written(fault):
    error = OSError("Timed out trying to connect")
    with pytest.raises(UserError, match=r"^--cluster: .* does not answer any more; .*was lost"):
        fault(error, "connecting")
    with pytest.raises(OSError, match="No space left"):  # of the batch's folder
        fault(OSError(28, "No space left on device"), "running")
    with pytest.raises(ZeroDivisionError):
        fault(ZeroDivisionError(), "closed")
