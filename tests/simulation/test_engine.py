"""The SUMO process: one at a time, the same over TraCI, and errors in SUMO's own words."""

import shutil
import subprocess
import sys

import pytest

from tsc_missing.config import MissingSettings, RunSettings
from tsc_missing.evaluation.run import Options, execute, prepare
from tsc_missing.network.folder import read_folder
from tsc_missing.simulation.engine import Inputs, Simulation, SimulationError

NOTHING = '<routes><vType id="car"/></routes>'


@pytest.fixture
def inputs(small_net, tmp_path):
    routes = tmp_path / "none.rou.xml"
    routes.write_text(NOTHING)
    return Inputs(read_folder(small_net, "small").net_file, routes)


def test_a_second_simulation_in_the_process_is_refused(inputs):
    with Simulation(inputs) as first:
        first.advance(5)
        with pytest.raises(SimulationError, match="already running in this process"):
            Simulation(inputs).__enter__()
        first.advance(10)
        assert first.api.simulation.getTime() == 10


def test_one_after_the_other_is_fine(inputs):
    for _ in range(3):
        with Simulation(inputs) as simulation:
            simulation.advance(5)
            assert simulation.api.simulation.getTime() == 5


def test_errors_are_sumos_own_words(inputs, tmp_path):
    broken = tmp_path / "broken.net.xml"
    broken.write_text(inputs.net.read_text()[:20_000])
    with pytest.raises(SimulationError, match="SUMO: Error: "):
        Simulation(Inputs(broken, inputs.routes)).__enter__()
    inputs.routes.write_text(
        '<routes><vehicle id="0" depart="0"><route edges="nowhere"/></vehicle></routes>'
    )
    with pytest.raises(SimulationError, match="nowhere"), Simulation(inputs) as simulation:
        simulation.advance(5)
    inputs.routes.write_text(NOTHING)
    with Simulation(inputs) as simulation:
        simulation.advance(5)


@pytest.mark.parametrize("controller", ["max-queue", "delay_based", "actuated-recall"])
def test_over_traci_the_results_are_the_same(small_net, controller):
    missing = MissingSettings(pattern="lane", rate=0.3)
    settings = RunSettings(net=str(small_net), horizon=300, controller=controller, missing=missing)
    inside, outside = (
        execute(prepare(settings, Options(engine=engine))) for engine in ("libsumo", "traci")
    )
    changing = {"wall_s", "sim_s_per_wall_s", "decision_ms_median", "decision_ms_p99"}
    assert inside.model_dump(exclude=changing) == outside.model_dump(exclude=changing)


def test_without_sumos_programs_import_says_what_to_install(small_files, tmp_path):
    roadnet, _ = small_files
    code = (
        "import shutil, sys; shutil.which = lambda name: None\n"
        "from pathlib import Path; sys.executable = '/nowhere/python'\n"
        "from tsc_missing.network.cityflow import read_roadnet\n"
        "from tsc_missing.network.netconvert import write_net\n"
        f"write_net(read_roadnet(Path({str(roadnet)!r})), Path({str(tmp_path / 'x')!r}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "pip install 'tsc-missing[sumo]'" in done.stderr
    assert shutil.which("netconvert") is None or done.returncode != 0
