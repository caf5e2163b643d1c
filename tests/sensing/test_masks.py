import contextlib
import io
import json
import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.networks import grid_network, tee_network
from tsc_missing.config import MissingSettings, RunSettings
from tsc_missing.errors import UserError
from tsc_missing.sensing.masks import SLOTS, load_mask, missing_share, save_mask
from tsc_missing.sensing.masks_of_runs import mask_of
from tsc_missing.sensing.patterns import draw_mask

NETWORK = grid_network(2, 3)
MASK = draw_mask(MissingSettings(pattern="lane", rate=0.4), NETWORK, 30, 7)


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "mask.npz"
    save_mask(path, MASK, NETWORK.ids)
    return path


def refused(path, message, network=NETWORK, steps=30):
    with pytest.raises(UserError, match=message) as caught:
        load_mask(path, network, steps)
    assert caught.value.field == "mask"
    assert "\n" not in str(caught.value)


def test_round_trip(saved):
    loaded = load_mask(saved, NETWORK, 30)
    assert loaded.dtype == np.bool_
    assert (loaded == MASK).all()


def test_longer_mask_is_cut(saved):
    assert (load_mask(saved, NETWORK, 12) == MASK[:12]).all()


def test_same_mask_same_bytes(saved, tmp_path):
    again = tmp_path / "again"  # no suffix is added
    save_mask(again, MASK, NETWORK.ids)
    assert again.read_bytes() == saved.read_bytes()


def test_short_mask(saved):
    refused(saved, "at least the run's 31 steps, found 30", steps=31)


def test_other_network(saved):
    refused(saved, "network grid, and names other", network=grid_network(3, 2))
    refused(saved, "network tee, and names other", network=grid_network(3, 3, "tee"))


def test_absent_slots_count_as_reported(saved):
    tee = tee_network()
    assert load_mask(saved, tee, 30)[:, ~tee.slot_mask].all()


def test_no_such_file_and_folder(tmp_path):
    refused(tmp_path / "none.npz", "cannot be read .No such file")
    refused(tmp_path, "cannot be read .Is a directory")


class Trap:
    def __reduce__(self):
        return (pytest.fail, ("the file was unpickled",))


def npy(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


@pytest.mark.parametrize(
    "content",
    [b"", b"hello", npy(MASK), npy(np.array([Trap()])), pickle.dumps(Trap())],
    ids=["empty", "text", "npy", "npy-object", "pickle"],
)
def test_not_a_mask_file(tmp_path, content):
    path = tmp_path / "mask.npz"
    path.write_bytes(content)
    refused(path, "not a mask file")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_cut_or_damaged_file_is_an_error_or_still_right(saved, tmp_path, data):
    whole = bytearray(saved.read_bytes())
    place = data.draw(st.integers(0, len(whole) - 1))
    if data.draw(st.booleans()):
        whole = whole[:place]
    else:
        whole[place] ^= data.draw(st.integers(1, 255))
    path = tmp_path / "damaged.npz"
    path.write_bytes(whole)
    with contextlib.suppress(UserError):
        assert (load_mask(path, NETWORK, 30) == MASK).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": np.array(2)}, "format 1"),
        ({"format": np.array("one")}, "format 1"),
        ({"format": np.array([1, 1])}, "format 1"),
        ({"slots": np.array(SLOTS[::-1])}, "its slots must be N-left"),
        ({"mask": MASK.astype(float)}, "must be bool .* found float64"),
        ({"mask": MASK[0]}, r"found bool \(6, 12\)"),
        ({"mask": MASK[:, :5]}, r"found bool \(30, 5, 12\)"),
        ({"mask": np.array([Trap()])}, "not a mask file"),
        ({"mask": None}, "not a mask file"),
    ],
)
def test_wrong_fields(tmp_path, change, message):
    fields = {
        "format": np.array(1),
        "mask": MASK,
        "intersections": np.array(NETWORK.ids),
        "slots": np.array(SLOTS),
    } | change
    path = tmp_path / "mask.npz"
    np.savez(path, **{name: value for name, value in fields.items() if value is not None})
    refused(path, message)


def test_missing_share_counts_slots_that_are_there():
    tee = tee_network()
    mask = np.ones((2, tee.n, 12), dtype=bool)
    assert missing_share(mask, tee.slot_mask) == 0
    mask[:, 4] = ~tee.slot_mask[4]
    assert missing_share(mask, tee.slot_mask) == pytest.approx(6 / 66)


def test_a_mask_of_a_run_that_decided_at_other_times(tmp_path):
    network = grid_network(2, 3)
    save_mask(tmp_path / "mask.npz", np.ones((40, 6, 12), dtype=bool), network.ids)
    missing = {"pattern": "file", "file": str(tmp_path / "mask.npz")}
    settings = RunSettings.model_validate({"missing": missing, "horizon": 300})
    assert mask_of(settings, network).shape == (20, 6, 12)  # no run.json beside it
    record = {"settings": {"signals": {"decision_interval": 30}}}
    (tmp_path / "run.json").write_text(json.dumps(record))
    with pytest.raises(UserError, match="its steps are of 30 s, the run's of 15 s"):
        mask_of(settings, network)
