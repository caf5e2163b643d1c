"""Suites: what they say, and every way to get one wrong."""

import numpy as np
import pytest

from tests.networks import grid_network
from tsc_missing.batch.check import available
from tsc_missing.batch.keys import leaves, nested
from tsc_missing.batch.outage_suite import write_outage_suite
from tsc_missing.batch.suite import bundled_suites, read_suite
from tsc_missing.config import RunSettings
from tsc_missing.controllers.resolved import weights_of
from tsc_missing.errors import UserError
from tsc_missing.network.model import Network
from tsc_missing.paths import bundled
from tsc_missing.report.paper import Condition, find_number, paper_numbers, parse_condition
from tsc_missing.sensing.outage_list import read_outages
from tsc_missing.training.config import read_training

TABLES = {  # a suite repeats a table of the paper: suite -> number of its numbers in ours
    "random-missing": 105,
    "kriging": 119,
    "no-missing": 40,
    "ablation": 12,
    "unobserved-locations": 14,
    "limits": 15,
    "newyork-random": 21,
    "newyork-kriging": 28,
    "dcm-ablation": 10,
    "inverse-dynamics-ablation": 8,
    "sampling-steps": 16,
    "cql-model-based": 39,
}


def write(tmp_path, text):
    path = tmp_path / "suite.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", sorted(bundled_suites()))
def test_bundled_suites(name):
    suite = read_suite(name)
    assert len({run.name for run in suite.runs}) == len(suite.runs)
    _, lacking = available(suite.runs, skip=True)
    trainings = {path.stem for path in (bundled("scenarios") / "training").glob("*.toml")}
    for command in lacking.values():
        assert command.startswith(("tsc-train ", "python -m tools.strict "))
    for run in suite.runs:
        made = run.settings.diffusion.weights.removeprefix("runs/train-")
        assert run.settings.controller != "difflight" or made.replace("{net}-", "").format(
            pattern=run.settings.missing.pattern
        ) in (trainings)
    for training in trainings:
        read_training(training)


@pytest.mark.parametrize("name", sorted(TABLES))
def test_suites_have_every_number_of_their_table(name):
    suite = read_suite(name)
    own = {
        (key[1], key[2], key[3])
        for key in paper_numbers()
        if key[0] == suite.paper[0] and not key[0].endswith("-time")
    }
    found = {
        (run.dataset, run.settings.missing, run.paper, run.settings.diffusion.sampling_steps)
        for run in suite.runs
        if find_number(suite.paper, run.dataset, run) is not None
    }
    assert len(found) == TABLES[name]
    assert len(own) <= len(found)


def test_conditions_of_the_paper():
    assert parse_condition("KM(25%) w/o neighbors") == Condition("kriging", 0.25, adjacent=True)
    assert parse_condition("RM (50%)") == Condition("random", 0.5)
    assert parse_condition("KM(6.25%)") == Condition("kriging", 0.0625)
    assert parse_condition("RM(50%) 20-step") == Condition("random", 0.5, steps=20)
    assert parse_condition("no missing data") == Condition()


def test_axes_make_the_product_and_words(tmp_path):
    suite = read_suite(
        str(
            write(
                tmp_path,
                """
                [methods.held]
                controller = "max-queue"
                imputer = "last"
                [[runs]]
                method = ["held", "max-pressure"]
                net = "jinan"
                missing = { pattern = "kriging", rate = 0.25, adjacent = [false, true] }
                signals.yellow = [3, 5]
                diffusion.sampling_steps = [10, 20]
                seed = [0, 7]
                """,
            )
        )
    )
    assert len(suite.runs) == 2 * 2 * 2 * 2 * 2
    run = next(r for r in suite.runs if r.name.endswith("seed7") and "held" in r.method)
    assert run.name == "jinan_1-yellow_3-kriging-0.25-held-sampling_steps_10-seed7"
    assert (run.dataset, run.case) == ("jinan_1, yellow 3", "kriging 25 %")
    assert run.method == "held, sampling_steps 10"
    assert run.settings.imputer == "last"
    assert run.settings.signals.yellow == 3
    assert {r.case for r in suite.runs} == {"kriging 25 %", "kriging (adjacent) 25 %"}


def test_faults_that_last_are_a_case_of_their_own(tmp_path):
    text = (
        '[[runs]]\nmethod = "max-queue"\n'
        'missing = { pattern = "lane", rate = 0.25, lasting = [false, true] }\n'
    )
    single, lasting = read_suite(str(write(tmp_path, text))).runs
    assert (single.case, lasting.case) == ("lane 25 %", "lane (lasting) 25 %")
    assert single.name == "jinan_1-lane-0.25-max-queue-seed0"
    assert lasting.name == "jinan_1-lane-lasting-0.25-max-queue-seed0"


def test_what_bounds_a_controller_is_of_its_method(tmp_path):
    text = '[[runs]]\nmethod = "max-queue"\nsignals.min_space = [0, 9]\nhorizon = [60, 90]\n'
    runs = read_suite(str(write(tmp_path, text))).runs
    assert {run.method for run in runs} == {"max-queue, min_space 0", "max-queue, min_space 9"}
    assert {run.dataset for run in runs} == {"jinan_1, horizon 60", "jinan_1, horizon 90"}


def test_a_list_of_tables_is_an_axis(tmp_path):
    text = (
        '[[runs]]\nmethod = "max-queue"\nsignals = [{yellow = 3}, {yellow = 4, all_red = 1}]\n'
        'sensor = [{kind = "lane"}, {kind = "area", length = 30.0}]\n'
    )
    runs = read_suite(str(write(tmp_path, text))).runs
    assert [run.dataset for run in runs] == [
        "jinan_1, yellow 3, kind lane",
        "jinan_1, yellow 3, kind area, length 30.0",
        "jinan_1, yellow 4, all_red 1, kind lane",
        "jinan_1, yellow 4, all_red 1, kind area, length 30.0",
    ]


def test_changes_replace_what_the_file_says(tmp_path):
    text = (
        "[[runs]]\nmethod = 'random'\nmissing = {pattern='random', rate=[0.1, 0.2]}\nseed = [0, 1]"
    )
    changes = ["seed=5", "missing.rate=[0.3, 0.4, 0.5]", "method=max-queue", "demand=recorded"]
    suite = read_suite(str(write(tmp_path, text)), changes)
    assert [run.settings.missing.rate for run in suite.runs] == [0.3, 0.4, 0.5]
    assert {(r.settings.seed, r.method, r.settings.demand) for r in suite.runs} == {
        (5, "max-queue", "recorded")
    }
    assert len(read_suite(str(write(tmp_path, text)), ["missing={pattern='none'}"]).runs) == 2


def test_a_change_in_a_list_of_tables_is_refused():
    with pytest.raises(UserError, match=r"--set: missing.adjacent .*list of tables in runs 1: set"):
        read_suite("headline", ["missing.adjacent=false"])
    assert len(read_suite("headline", ["missing=[{pattern='none'}]"]).runs) == 78


def test_strict_methods_have_the_weights_of_their_network_and_pattern():
    suite = read_suite("strict")
    strict = [run for run in suite.runs if run.method == "DiffLight, strict"]
    for run in strict:
        net, pattern = run.dataset, run.settings.missing.pattern
        assert weights_of(run.settings) == (f"strict-{net}-{pattern}",)
        assert run.train == f"python -m tools.strict {net} {pattern}"
        assert run.settings.mask_seed == (0 if pattern == "kriging" else None)
    assert {weights_of(run.settings)[0] for run in strict} == {
        f"strict-{net}-{pattern}"
        for net in ("hangzhou_1", "jinan_1")
        for pattern in ("random", "kriging")
    }
    for run in suite.runs:
        if run.method == "difflight-paper":
            pattern = run.settings.missing.pattern
            assert weights_of(run.settings) == (f"paper-{run.dataset}-{pattern}",)


def test_what_makes_all_the_weights_that_a_method_lacks(tmp_path):
    text = """
        [methods.own]
        controller = "difflight"
        diffusion.weights = "own-{net}-{pattern}-{seed}"
        diffusion.scoring = "queue"
        train = "make {net} {pattern}"
        [[runs]]
        method = "own"
        net = ["jinan", "hangzhou_2"]
        missing = [{ pattern = "random", rate = 0.5 }, { pattern = "lane", rate = 0.5 }]
        seed = [3, 4]
    """
    suite = read_suite(str(write(tmp_path, text)))
    assert weights_of(suite.runs[0].settings) == ("own-jinan_1-random-3",)
    there, lacking = available(suite.runs, skip=True)
    assert not there
    assert lacking == {"own": "make jinan_1 random; make hangzhou_2 random"}


def test_leaves_and_nested_are_inverse():
    values = RunSettings().model_dump()
    assert nested(dict(leaves(values))) == values


BLOCK = '[[runs]]\nmethod = "max-queue"\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["at least one [[runs]]"]),
        ("runs = 3", ["at least one [[runs]]"]),
        ("titel = 'x'\n" + BLOCK, ["titel", "did you mean title?"]),
        (BLOCK + "sead = 1", ["runs 1", "sead", "did you mean seed?"]),
        (BLOCK + "missing.rat = 1", ["missing.rat", "did you mean missing.rate?"]),
        (BLOCK + "missing = [{pattern='random', rat=0.1}]", ["missing.rat"]),
        (BLOCK + "seed = []", ["runs 1.seed", "it has no value"]),
        (BLOCK + "missing = {}", ["runs 1.missing", "it has no value"]),
        ("[[runs]]\nmethod = []", ["runs 1.method", "it has no value"]),
        (BLOCK + "seed = [1, 1]", ["two runs are called jinan_1-none-max-queue-seed1"]),
        (BLOCK + BLOCK, ["two runs are called jinan_1-none-max-queue-seed0"]),
        (BLOCK + "seed = [-1]", ["runs 1", "seed", "-1"]),
        (BLOCK + "signals.yellow = 5\n'signals.yellow' = 3", ["runs 1.signals.yellow", "twice"]),
        ("paper = ['random-mising']\n" + BLOCK, ["paper", "did you mean random-missing?"]),
        (f"[methods.{200 * 'a'}]\n[[runs]]\nmethod='{200 * 'a'}'", ["name of 219", "200 is the"]),
        (BLOCK + "missing.pattern = 'krigin'", ["runs 1", "krigin"]),
        (BLOCK + "missing.rate = 0.5", ["runs 1", "pattern"]),
        (BLOCK + "missing.pattern = 'kriging'", ["runs 1", "kriging needs a missing.rate from 0"]),
        (BLOCK + "vehicle = 3", ["runs 1", "vehicle"]),
        ("[methods.a]\ncolour = 1\n" + BLOCK, ["methods.a", "colour"]),
        ("[methods]\na = 1\n" + BLOCK, ["methods.a", "must be a table"]),
        ("methods = 1\n" + BLOCK, ["methods", "must be a table"]),
        (
            "[methods.a]\ncontroller = 'random'\nseed = 3\n[[runs]]\nmethod = 'a'\nseed = [0]",
            ["runs 1.seed", "the method a sets it too"],
        ),
        ("paper = 3\n" + BLOCK, ["paper"]),
        ("[[runs]\n", ["not valid TOML"]),
    ],
)
def test_wrong_suites(tmp_path, text, words):
    with pytest.raises(UserError) as caught:
        read_suite(str(write(tmp_path, text)))
    for word in ["suite", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize("change", ["seed", "sead=1", "missing.rat=0.1"])
def test_wrong_changes(change):
    with pytest.raises(UserError, match="--set"):
        read_suite("smoke", [change])


def test_unknown_suites_and_methods(tmp_path):
    with pytest.raises(UserError, match="did you mean smoke"):
        read_suite("smok")
    suite = read_suite(str(write(tmp_path, BLOCK.replace("queue", "quue"))))
    with pytest.raises(UserError, match="did you mean max-queue"):
        available(suite.runs, skip=True)


def test_methods_without_weights(tmp_path):
    text = '[[runs]]\nmethod = ["max-queue", "No", "No too"]\n'
    for name, training in (("No", "one"), ("No too", "two")):
        text += f'[methods."{name}"]\ncontroller = "difflight"\n'
        text += 'diffusion.weights = "nowhere"\n' + f'train = "tsc-train {training}"\n'
    suite = read_suite(str(write(tmp_path, text)))
    with pytest.raises(UserError) as caught:
        available(suite.runs, skip=False)
    for words in ("No (`tsc-train one`)", "No too (`tsc-train two`)", "--skip-unav"):
        assert words in str(caught.value)
    there, lacking = available(suite.runs, skip=True)
    assert [run.method for run in there] == ["max-queue"]
    assert list(lacking) == ["No", "No too"]


def test_an_unknown_controller_is_no_want_of_weights(tmp_path):
    text = "[methods.own]\ncontroller = 'difflght'\ntrain = 'tsc-train own'\n"
    suite = read_suite(str(write(tmp_path, f"{text}[[runs]]\nmethod = 'own'")))
    for skip in (False, True):
        with pytest.raises(UserError, match="own, controller: difflght is not"):
            available(suite.runs, skip)


@pytest.mark.parametrize(
    "ids",
    [
        ("路口一", "路口二"),
        ("a/b", "a b", "a_b"),
        ("a", "A", "a_"),
        ("none", "x"),
        ("y" * 300, "z"),
        ("y" * 90 + "1", "y" * 90 + "2"),
        ("a", "a-N"),
    ],
)
@pytest.mark.parametrize("approaches", [False, True])
def test_suites_of_outages_can_be_read_whatever_intersections_are_called(ids, approaches, tmp_path):
    network = grid_network(1, len(ids))
    nodes = zip(network.record.intersections, ids, strict=True)
    called = tuple(node.model_copy(update={"id": name}) for node, name in nodes)
    record = network.record.model_copy(update={"intersections": called})
    network = Network("städtchen", record)
    out = tmp_path / "s"
    names = write_outage_suite(
        network, out, approaches, {"method": ["max-queue"], "net": "jinan", "seed": [0, 1]}
    )
    suite = read_suite(str(out / "suite.toml"))
    each = [n for n in range(len(ids)) for _ in range(4 if approaches else 1)]
    assert len({run.name for run in suite.runs}) == 2 * (len(each) + 1)
    assert len({run.case for run in suite.runs}) == len(each) + 1
    assert {run.case for run in suite.runs if not run.settings.missing.file} == {"none"}
    assert "none" not in {run.case for run in suite.runs if run.settings.missing.file}
    dark = np.zeros_like(network.slot_mask)
    for n, name in zip(each, names, strict=True):
        mask = read_outages(out / name, network, 2, 15.0) | ~network.slot_mask
        assert (~mask[0, n]).sum() == network.slot_mask[n].sum() / (4 if approaches else 1)
        assert np.delete(mask, n, axis=1).all()
        dark |= ~mask[0]
    assert (dark == network.slot_mask).all()
