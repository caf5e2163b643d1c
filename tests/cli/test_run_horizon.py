"""Plans on a traffic model through the real command line, on real SUMO."""

import pytest

from tests.cli.refusals import refused
from tests.cli.test_run import run_json

KRIGING = ("--missing", "kriging", "--rate", 0.25)


def travel_time(command, controller, *options):
    """att_all [s] of a quarter of an hour of the bundled Jinan."""
    options = ("--net", "jinan", "--controller", controller, "--horizon", 900, *options)
    return run_json(command, *options, "--no-decisions")["result"]["att_all"]


def test_plans_are_ahead_of_queues_with_blind_intersections(command):
    horizon, queue = (
        travel_time(command, name, *KRIGING) for name in ("rolling-horizon", "max-queue")
    )
    assert horizon < 0.97 * queue


def test_difflight_plans_alike_where_everything_is_observed(command):
    assert travel_time(command, "difflight") == travel_time(command, "rolling-horizon")


def test_wrong_counts_are_told_to_who_asks_for_counts_only(command, small_net):
    short = ("--net", small_net, "--horizon", 300, "--missing", "none", "--count-error", 1.5)
    right, wrong = (
        run_json(command, *options, "--controller", "max-queue")["result"]["att_all"]
        for options in (short[:-2], short)
    )
    assert right == wrong
    plans = [travel_time(command, "fixed-time", *more) for more in ((), short[-2:])]
    assert plans[0] != plans[1]


@pytest.mark.parametrize("error", ["-0.1", "nan", "3", "some"])
def test_count_errors_that_are_none(command, error):
    refused(command, "run", "--count-error", error, words=["--count-error", error])


def test_who_is_told_no_counts_leans_on_what_is_generated(command):
    told = ("--turning-counts", "none", *KRIGING)
    drawn, alone = (travel_time(command, name, *told) for name in ("difflight", "rolling-horizon"))
    assert drawn < alone


def test_counts_that_nobody_knows(command):
    refused(command, "run", "--turning-counts", "some", words=["--turning-counts", "some", "none"])


def test_an_error_of_no_counts(command):
    options = ("--turning-counts", "none", "--count-error", 0.3)
    refused(command, "run", *options, words=["count_error", "turning_counts none"])
