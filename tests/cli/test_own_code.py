"""Controllers and imputers of users' own, as docs/controllers.md has them, on the command line."""

import hashlib
import json
import re
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.cli.refusals import check_refusal, refused

PAGE = Path(__file__).parents[2] / "docs" / "controllers.md"
HALF = ("--missing", "random", "--rate", "0.5", "--horizon", "150")


def example(language):
    """The first block of the page in a language."""
    return re.search(rf"```{language}\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]


@pytest.fixture
def mine(command):
    """The page's example, and a second file that goes wrong in several ways."""
    path = command.cwd / "mine.py"
    path.write_text(example("python"))
    (command.cwd / "bad.py").write_text(
        "from mine import AsOthers, LongestWait, np\n"
        "class Raises(LongestWait):\n"
        "    def decide(self, observation):\n"
        "        raise ValueError('no idea')\n"
        "class Wants(LongestWait):\n"
        "    def __init__(self, option): ...\n"
        "class Halves(AsOthers):\n"
        "    def fill(self, observation):\n"
        "        filled = super().fill(observation)\n"
        "        return filled.filled(filled.values / 2, filled.exits)\n"
        "class Leaves(LongestWait):\n"
        "    def decide(self, observation):\n"
        "        print('going')\n"
        "        raise SystemExit(0)\n"
        "class Resets(LongestWait):\n"
        "    def reset(self, context):\n"
        "        raise ValueError('no')\n"
        "class Nowhere(LongestWait):\n"
        "    def decide(self, observation):\n"
        "        return super().decide(observation) + 99\n"
        "class Scribbles(LongestWait):\n"
        "    def reset(self, context):\n"
        "        super().reset(context)\n"
        "        context.turning_flows[:] = 0\n"
        "        context.sensors[:] = False\n"
        "    def decide(self, observation):\n"
        "        phases = super().decide(observation)\n"
        "        self.network.phases[:] = False\n"
        "        self.network.phase_mask[:] = False\n"
        "        observation.red_steps[:] = 0\n"
        "        observation.values[:] = 0\n"
        "        return phases * 0\n"
        "class Unsure(LongestWait):\n"
        "    needs_values = 'yes'\n"
    )
    return path


def run(command, *arguments):
    done = command("run", "--json", *arguments)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("mine.py:LongestWait", "a controller"),
        ("mine.py:Cautious", "a controller"),
        ("mine:Cautious", "a controller"),
        ("mine.py:AsOthers", "an imputer"),
    ],
)
def test_the_examples_keep_the_rules(command, mine, small_net, name, what):
    done = command("check", name, "--net", small_net)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{name}: {what} that keeps the rules (tried on small)\n"


def test_one_that_does_not_is_told_why(command, mine, small_net):
    for name, words in (
        ("bad.py:Raises", "at step 0 the controller raised ValueError('no idea')"),
        (
            "bad.py:Halves",
            "at step 0 the imputer raised "
            "ValueError('fill must leave the reported values as they are')",
        ),
    ):
        done = command("check", name, "--net", small_net)
        assert (done.returncode, done.stdout) == (1, "")
        assert done.stderr == f"{name}: {words}\n"


def test_a_run_with_both_is_of_another_kind_than_others(command, mine, small_net):
    both = ("--controller", "mine.py:LongestWait", "--imputer", "mine.py:AsOthers")
    found = run(command, "--net", small_net, *HALF, *both)
    assert found["out"] == "runs/small-random-0.5-LongestWait-seed0"
    assert found["resolved"]["blind"] == "fixed-time"
    assert found["result"]["fallbacks"] == 0
    assert found["result"]["imputation_mae"] > 0
    code = {name for name in found["checksums"] if name.startswith("code: ")}
    assert code == {"code: mine.py:LongestWait", "code: mine.py:AsOthers"}
    shipped = run(command, "--net", small_net, *HALF, *both[:2])
    assert shipped["result"]["imputation_mae"] != found["result"]["imputation_mae"]


def test_one_that_takes_the_holes_gets_no_imputer_and_no_cycle(command, mine, small_net):
    cautious = ("--net", small_net, *HALF, "--controller", "mine.py:Cautious")
    found = run(command, *cautious)
    assert found["resolved"]["blind"] == "none"
    assert found["result"]["imputation_mae"] is None
    assert found["result"]["fallbacks"] == 0
    imputer = ("--imputer", "mine.py:AsOthers")
    words = ["imputer: mine.py:AsOthers", "Cautious does not decide on filled values"]
    refused(command, "run", *cautious, *imputer, words=words)
    refused(command, "run", *imputer, words=["difflight does not decide on filled values"])


def test_one_that_raises_is_answered_for_and_the_table_says_why(command, mine, small_net):
    done = command("run", "--net", small_net, *HALF, "--controller", "bad.py:Raises")
    assert done.returncode == 0, done.stderr
    assert "60 decisions were answered by the safe fallback" in done.stdout
    assert "ValueError: no idea (bad.py:4 in decide)" in done.stdout


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none.py:Mine", ["there is no file none.py"]),
        ("nowhere:Mine", ["loading nowhere raised ModuleNotFoundError"]),
        ("broken.py:Mine", ["loading broken.py raised SyntaxError"]),
        (":Mine", ["FILE.py:CLASS"]),
        ("mine.py:LongWait", ["did you mean LongestWait?", "Cautious"]),
        ("mine.py:np", ["tsc_missing.controllers.base.Controller"]),
        ("mine.py:AsOthers", ["tsc_missing.controllers.base.Controller"]),
        ("mine.py:Controller", ["it must define decide, reset"]),
        ("mine.py", ["FILE.py:CLASS"]),
        ("leaves.py:Mine", ["loading leaves.py raised RuntimeError: it called sys.exit(0)"]),
        ("bad.py:Resets", ["reset raised ValueError: no"]),
        ("bad.py:Unsure", ["needs_values must be True or False"]),
        ("bad.py:Wants", ["making one raised TypeError", "option"]),
    ],
)
def test_what_is_no_controller(command, mine, name, words):
    (command.cwd / "broken.py").write_text("def:\n")
    (command.cwd / "leaves.py").write_text("raise SystemExit(0)\n")
    check_refusal(command, "run", "--controller", name, words=["controller: ", *words])
    assert not (command.cwd / "runs").exists()


def test_one_that_leaves_python_costs_its_own_decisions_only(command, mine, small_net):
    found = run(command, "--net", small_net, *HALF, "--controller", "bad.py:Leaves")
    assert found["result"]["fallbacks"] == 60
    assert "it called sys.exit(0)" in found["fallback_error"]
    (command.cwd / "own.toml").write_text(
        f'[[runs]]\nmethod = ["bad.py:Leaves", "max-queue"]\nnet = "{small_net}"\nhorizon = 60\n'
    )
    done = command("batch", "own.toml", "--out", "b", "--workers", 2, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["finished"] == 2
    done = command("check", "bad.py:Leaves", "--net", small_net)
    assert done.returncode == 1
    assert "it called sys.exit(0)" in done.stderr


def test_what_it_writes_into_what_it_gets_reaches_nobody(command, mine, small_net):
    options = ("--net", small_net, "--horizon", 900, "--no-decisions")
    own = (*options, "--controller", "bad.py:Scribbles")
    found = run(command, *own, "--max-red", 60)
    stuck = run(command, *own, "--max-red", 0)
    assert found["result"]["fallbacks"] == 0
    assert found["result"]["att_all"] < stuck["result"]["att_all"]


def test_files_of_one_name_beside_two_controllers(command, mine, small_net):
    methods = []
    for folder, phase in (("one", 0), ("two", 1)):
        (command.cwd / folder).mkdir()
        (command.cwd / folder / "helper.py").write_text(f"PHASE = {phase}\nASKED = []\n")
        (command.cwd / folder / "mine.py").write_text(
            example("python").replace("import numpy as np", "import numpy as np\nimport helper")
            + "\n\nclass Helped(LongestWait):\n"
            "    needs_values = False\n"
            "    def reset(self, context):\n"
            "        helper.ASKED.append(1)\n"
            "        super().reset(context)\n"
            "    def decide(self, observation):\n"
            "        again = len(helper.ASKED) > 1\n"
            "        return np.full(self.network.n, 3 if again else helper.PHASE)\n"
        )
        methods.append(f"{folder}/mine.py:Helped")
    (command.cwd / "own.toml").write_text(
        f'[[runs]]\nmethod = {json.dumps(methods)}\nnet = "{small_net}"\nhorizon = 150\n'
        "signals.max_red = 0\nseed = [0, 1]\n"
    )
    done = command("batch", "own.toml", "--out", "b", "--workers", 1)
    assert done.returncode == 0, done.stderr
    for folder, phase in (("one", 0), ("two", 1)):
        for seed in (0, 1):
            name = f"small-none-{folder}_mine.py_Helped-seed{seed}"
            table = pq.read_table(command.cwd / "b" / "runs" / name / "decisions.parquet")
            assert set(table["phase"].to_pylist()) == {phase}


def test_what_ran_is_what_is_recorded_whatever_becomes_of_the_file(command, mine, small_net):
    (command.cwd / "gone.py").write_text(
        "from pathlib import Path\n" + mine.read_text() + "\n\nclass Gone(LongestWait):\n"
        "    def decide(self, observation):\n"
        "        Path('gone.py').unlink(missing_ok=True)\n"
        "        return super().decide(observation)\n"
    )
    was = hashlib.sha256((command.cwd / "gone.py").read_bytes()).hexdigest()
    found = run(command, "--net", small_net, *HALF, "--controller", "gone.py:Gone")
    assert found["checksums"]["code: gone.py:Gone"] == was
    assert found["result"]["fallbacks"] == 0


def test_a_log_has_no_phase_that_is_none(command, mine, small_net):
    wanted = ("--net", small_net, "--demand", "auto", "--episodes", 1, "--horizon", 150)
    for name, words in (("Nowhere", "decide gave no phase of"), ("Raises", "no idea")):
        policy = ("--unaware", 0, "--policy", f"bad.py:{name}")
        check_refusal(command, "collect", "--out", name, *wanted, *policy, words=[words])


def test_a_batch_notices_when_the_code_has_changed(command, mine, small_net):
    (command.cwd / "own.toml").write_text(
        f'[[runs]]\nmethod = ["mine.py:LongestWait", "max-queue"]\nnet = "{small_net}"\n'
        "horizon = 150\n"
    )
    batch = ("own.toml", "--out", "b", "--workers", 1, "--json")
    done = command("batch", *batch)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["finished"] == 2
    assert (command.cwd / "b" / "runs" / "small-none-mine.py_LongestWait-seed0").is_dir()
    mine.write_text(mine.read_text() + "\n# changed\n")
    done = command("batch", *batch)
    assert done.returncode == 2
    assert "code: mine.py:LongestWait" in done.stderr
    mine.unlink()  # a report is made of the runs alone
    done = command("report", "b", "--out", "r")
    assert done.returncode == 0, done.stderr
    assert "mine.py:LongestWait" in (command.cwd / "r" / "report.md").read_text()


def test_logs_of_a_policy_of_ones_own(command, mine, small_net):
    wanted = ("--net", small_net, "--demand", "auto", "--episodes", 1, "--horizon", 150)
    done = command("collect", "--out", "log", *wanted, "--policy", "mine.py:LongestWait")
    assert done.returncode == 0, done.stderr
    manifest = json.loads((command.cwd / "log" / "manifest.json").read_text())
    assert set(manifest["settings"]["code"]) == {"mine.py:LongestWait"}
    mine.write_text(mine.read_text() + "\n# changed\n")
    more = ("--net", small_net, "--demand", "auto", "--episodes", 2, "--horizon", 150)
    again = ("--out", "log", *more, "--policy", "mine.py:LongestWait")
    check_refusal(command, "collect", *again, words=["out: log ", "begun with code"])
    other = ("--out", "other", *wanted, "--policy", "mine.py:LongWait")
    check_refusal(command, "collect", *other, words=["policy: ", "did you mean LongestWait?"])
    assert not (command.cwd / "other").exists()


def test_the_suite_of_the_page_can_be_read(command, mine):
    (command.cwd / "page.toml").write_text(example("toml"))
    done = command("batch", "page.toml", "--list")
    assert done.returncode == 0, done.stderr
    assert "jinan_1-random-0.1-longest_wait-seed0" in done.stdout


def test_one_that_ends_everything_costs_nothing_else_and_keeps_nothing(command, mine, small_net):
    (command.cwd / "odd.py").write_text(
        "import os\n"
        "from tsc_missing.controllers.max_queue import MaxQueue\n"
        "class Stop(BaseException): ...\n"
        "class Stops(MaxQueue):\n"
        "    def decide(self, observation):\n"
        "        raise Stop('now')\n"
        "class Interrupts(MaxQueue):\n"
        "    def decide(self, observation):\n"
        "        raise KeyboardInterrupt\n"
        "class Moves(MaxQueue):\n"
        "    def reset(self, context):\n"
        "        super().reset(context)\n"
        "        assert os.environ.setdefault('WAS', str(id(self))) == str(id(self))\n"
        "        os.chdir('/')\n"
    )
    (command.cwd / "s.toml").write_text(
        'title = "Odd"\n[[runs]]\nmissing.pattern = "none"\nhorizon = 30\nseed = [0, 1]\n'
        f'net = "{small_net}"\n'
        'method = ["odd.py:Stops", "odd.py:Interrupts", "odd.py:Moves", "max-queue"]\n'
    )
    done = command("batch", "s.toml", "--out", "b", "--workers", 1, "--retries", 0)
    assert done.returncode == 1, done.stdout + done.stderr
    table = {
        row["run"]: row for row in pq.read_table(command.cwd / "b/results.parquet").to_pylist()
    }
    failed = {name: row["error"] for name, row in table.items() if row["status"] == "failed"}
    assert len(table) == 8
    assert all("Interrupts" in name and "KeyboardInterrupt" in why for name, why in failed.items())
    assert len(failed) == 2
    assert all(row["fallbacks"] == 12 for name, row in table.items() if "Stops" in name)
    assert all(row["fallbacks"] == 0 for name, row in table.items() if "Moves" in name)


def test_packages_installed_beside_a_file_are_loaded_once(command, small_net):
    site = command.cwd / ".venv" / "lib" / "site-packages"
    site.mkdir(parents=True)
    (site / "installed.py").write_text("import sys\nsys.loads = getattr(sys, 'loads', 0) + 1\n")
    (command.cwd / "mine.py").write_text(
        "import sys\n"
        f"sys.path.append({str(site)!r})\n"
        "import installed\n"
        "from tsc_missing.controllers.max_queue import MaxQueue\n"
        "class Mine(MaxQueue):\n"
        "    def decide(self, observation):\n"
        "        assert sys.loads == 1\n"
        "        return super().decide(observation)\n"
    )
    found = run(command, "--net", small_net, "--horizon", "30", "--controller", "mine.py:Mine")
    assert found["result"]["fallbacks"] == 0
