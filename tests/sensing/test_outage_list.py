from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.networks import grid_network, sharing_lanes, tee_network
from tsc_missing.errors import UserError
from tsc_missing.network.slots import APPROACHES
from tsc_missing.sensing.outage_list import SLOTS, read_outages

NETWORK = grid_network(2, 3)
STEPS, INTERVAL = 12, 15.0
SECONDS = st.one_of(st.none(), st.integers(0, 200))
ROWS = st.lists(
    st.tuples(
        st.sampled_from(NETWORK.ids), st.sampled_from(["", *APPROACHES, *SLOTS]), SECONDS, SECONDS
    ),
    min_size=1,
    max_size=5,
)


def written(tmp_path, text):
    path = tmp_path / "list.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def silent(row, step, identity, slot):
    where, what, begin, end = row
    time = step * INTERVAL
    during = (begin or 0) <= time and (end is None or time < end)
    return during and where == identity and (not what or slot == what or slot[0] == what)


@given(rows=ROWS)
def test_a_reading_is_lost_where_a_line_says_so(tmp_path_factory, rows):
    rows = [(a, b, c, d) for a, b, c, d in rows if d is None or d > (c or 0)]
    if not rows:
        return
    lines = [",".join("" if part is None else str(part) for part in row) for row in rows]
    text = "\n".join(["intersection,slot,begin,end", *lines])
    path = written(tmp_path_factory.mktemp("list"), text)
    cells = product(range(STEPS), NETWORK.ids, SLOTS)
    lost = [any(silent(row, *cell) for row in rows) for cell in cells]
    if any(lost):
        mask = read_outages(path, NETWORK, STEPS, INTERVAL)
        assert (mask.ravel() == ~np.array(lost)).all()
    else:
        with pytest.raises(UserError, match="no outage is in the 180 s of the run"):
            read_outages(path, NETWORK, STEPS, INTERVAL)


def test_an_end_may_be_said_to_be_never(tmp_path):
    path = written(tmp_path, f"intersection,end\n{NETWORK.ids[0]},inf")
    mask = read_outages(path, NETWORK, STEPS, INTERVAL)
    assert not mask[:, 0].any()
    assert mask[:, 1:].all()


def test_slots_that_are_not_there_count_as_reported(tmp_path):
    tee = tee_network()
    absent = ~tee.slot_mask
    assert absent.any()
    text = "intersection\n" + "\n".join(tee.ids)
    mask = read_outages(written(tmp_path, text), tee, STEPS, INTERVAL)
    assert (mask == absent).all()
    n = int(np.flatnonzero(absent.any(axis=1))[0])
    slot = SLOTS[int(np.flatnonzero(absent[n])[0])]
    path = written(tmp_path, f"intersection,slot\n{tee.ids[n]},{slot}\n")
    with pytest.raises(UserError, match=f"line 2: {tee.ids[n]} has no {slot}; it has [NESW]-"):
        read_outages(path, tee, STEPS, INTERVAL)


@pytest.mark.parametrize("separator", [",", ";"])
def test_what_spreadsheets_make_of_it(tmp_path, separator):
    """A byte order mark, blanks, quotes, line ends, columns in another order, empty lines."""
    identity = NETWORK.ids[1]
    text = f'\ufeffend, intersection ,begin\r\n60," {identity}",\r\n\r\n'
    path = written(tmp_path, text.replace(",", separator))
    mask = read_outages(path, NETWORK, STEPS, INTERVAL)
    assert not mask[:4, 1].any()
    assert mask[4:].all()
    assert mask[:, [0, 2, 3, 4, 5]].all()


@pytest.mark.parametrize("blank", ["\n", "\r\n \r\n", ",,\n"])
def test_blank_lines_before_the_names_of_the_columns(tmp_path, blank):
    path = written(tmp_path, f"{blank}intersection\n{NETWORK.ids[1]}")
    assert not read_outages(path, NETWORK, STEPS, INTERVAL)[:, 1].any()
    with pytest.raises(UserError, match=r"line [23]: unknown column slots"):
        read_outages(written(tmp_path, f"{blank}slots\nN"), NETWORK, STEPS, INTERVAL)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "it lists no outage; its columns are intersection, slot, begin, end"),
        ("intersection\n", "it lists no outage"),
        (b"\xff\xfe", "no text in UTF-8"),
        ("intersection,slots\n{0},N", "line 1: unknown column slots; did you mean slot"),
        ("slot\nN", "line 1: it must have a column intersection"),
        ("intersection,slot\n,N", "line 2: no intersection"),
        ("intersection,intersection\n{0},{0}", "line 1: a column is there twice"),
        ("intersection,\n{0},", "line 1: unknown column without a name"),
        ('intersection\n"' + 200_000 * "x", "it is no CSV"),
        ("intersection,begin,end\n{0},25200,28800", "no outage is in the 180 s of the run"),
        ("intersection,begin,end\n{0},61,74", "with a decision every 15 s"),
        ("intersection\nnowhere", "line 2: no intersection nowhere"),
        ("intersection,slot\n{0},North", "line 2: no slot North"),
        ("intersection,slot\n{0},n-left", "line 2: no slot n-left; did you mean N-left"),
        ("intersection,begin\n{0},1\n{0},soon", "line 3: at begin"),
        ("intersection,begin\n{0},-1", "line 2: at begin"),
        ("intersection,begin\n{0},nan", "line 2: at begin"),
        ("intersection,end\n{0},nan", "line 2: at end"),
        ("intersection,begin,end\n{0},9,9", "line 2: end 9 must be after begin 9"),
        ("intersection,slot\n{0},N,3", "line 2: more values than columns"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path, text, words):
    text = text if isinstance(text, bytes) else text.format(NETWORK.ids[0])
    with pytest.raises(UserError, match=words) as caught:
        read_outages(written(tmp_path, text), NETWORK, STEPS, INTERVAL)
    assert caught.value.field == "mask"


def test_no_file(tmp_path):
    with pytest.raises(UserError, match="cannot be read"):
        read_outages(tmp_path / "none.csv", NETWORK, STEPS, INTERVAL)


def test_movements_on_one_lane_fall_silent_together(tmp_path):
    path = written(tmp_path, f"intersection,slot\n{NETWORK.ids[1]},N-right\n")
    mask = read_outages(path, sharing_lanes(NETWORK), STEPS, INTERVAL)
    lost = [SLOTS[k] for k in np.flatnonzero(~mask[0, 1])]
    assert lost == ["N-straight", "N-right"]
    assert mask[:, 0].all()
