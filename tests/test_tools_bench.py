"""The benchmark measures stages by their names, which the code may change."""

import importlib
from operator import attrgetter

import pytest

from tools.bench.programs.stages import STAGES


@pytest.mark.parametrize("stage", STAGES)
def test_every_stage_that_is_measured_is_there(stage):
    module, _, name = stage.partition(":")
    assert callable(attrgetter(name)(importlib.import_module(module)))
