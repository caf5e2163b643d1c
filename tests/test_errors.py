"""The exception for a user's mistake."""

import pickle
from pathlib import Path

from tsc_missing.errors import UserError


def test_a_mistake_comes_back_whole_from_another_process():
    error = UserError("--data", Path("logs"), "there is no such folder", verdict="was not found")
    found = pickle.loads(pickle.dumps(error))
    assert type(found) is UserError
    assert str(found) == str(error) == "--data: logs was not found; there is no such folder"
    assert vars(found) == vars(error)
