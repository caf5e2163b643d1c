"""The networks of runs, as maps need them."""

import json
from typing import Literal

from tsc_missing.errors import UserError
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.network.folder import NET, NetworkFolder
from tsc_missing.report.results import Results, Run


def network_folder(run: Run) -> NetworkFolder | None:
    """The network that a run was on; None where it is not there any more, or is another now."""
    settings = run.spec.settings
    was = json.loads(run.row["checksums"] or "{}").get(NET)
    return unchanged_folder(settings.net, settings.demand, was)


def unchanged_folder(
    net: str, demand: Literal["auto", "profile", "recorded"], was: str | None
) -> NetworkFolder | None:
    """The network of that name; None where it is not there, or its net has another checksum."""
    try:
        folder = find_scenario(net, demand).folder
    except UserError:
        return None
    return folder if was in (None, folder.manifest.files.get(NET)) else None


def without_network(results: Results) -> list[str]:
    """The datasets whose networks are not there as they were run."""
    first = {run.spec.dataset: run for run in reversed(results.finished)}
    return [dataset for dataset in results.datasets if network_folder(first[dataset]) is None]
