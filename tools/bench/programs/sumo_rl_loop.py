"""Commands a case's phases through sumo-rl: ``CASE_FOLDER SEED HORIZON INFO [SUMO ARGUMENT…]``.

INFO is ``info`` (sumo-rl's default: statistics of the system and of every agent at each step) or
``plain`` (observations and rewards only). LIBSUMO_AS_TRACI and SUMO_HOME must be set.
"""

import json
import sys
from pathlib import Path

from sumo_rl import SumoEnvironment  # type: ignore[import-untyped]

folder, seed, horizon, info, *extra = sys.argv[1:]
case = json.loads(Path(folder, "case.json").read_text(encoding="utf-8"))
signals = case["signals"]
theirs = ("--time-to-teleport", "--no-warnings")  # set by sumo-rl itself
options = [option for option in case["options"] if not option.startswith(theirs)]
environment = SumoEnvironment(
    net_file=case["phases_net"],
    route_file=case["routes"],
    num_seconds=int(horizon),
    delta_time=signals["decision_interval"],
    yellow_time=signals["yellow"],
    min_green=signals["decision_interval"] - signals["yellow"],
    time_to_teleport=-1,
    add_system_info=info == "info",
    add_per_agent_info=info == "info",
    sumo_seed=int(seed),
    sumo_warnings=False,
    additional_sumo_cmd=" ".join([*options, *extra]),
)
environment.reset()
for phases in case["phases"]:
    environment.step(dict(zip(case["ids"], phases, strict=True)))
environment.close()
