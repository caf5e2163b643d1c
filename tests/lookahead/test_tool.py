import pytest

pytest.importorskip("torch", reason="Q-networks need torch")

from tools.lookahead import att
from tsc_missing.config import RunSettings
from tsc_missing.lookahead.config import LookaheadSettings


def test_foresight_is_worth_something(small_net):
    run = RunSettings(net=str(small_net), horizon=300)
    plan = LookaheadSettings(nets=(str(small_net),), tried=1.0)
    assert att(run, "value", plan) < att(run, "value", None)
