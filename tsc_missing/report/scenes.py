"""The networks of runs, as maps need them."""

import json

from tsc_missing.errors import UserError
from tsc_missing.evaluation.scenario import find_scenario
from tsc_missing.network.folder import NET, NetworkFolder
from tsc_missing.report.results import Results, Run


def network_folder(run: Run) -> NetworkFolder | None:
    """The network that a run was on; None where it is not there any more, or is another now."""
    settings = run.spec.settings
    try:
        folder = find_scenario(settings.net, settings.demand).folder
    except UserError:
        return None
    was = json.loads(run.row["checksums"] or "{}").get(NET)
    return folder if was in (None, folder.manifest.files.get(NET)) else None


def without_network(results: Results) -> list[str]:
    """The datasets whose networks are not there as they were run."""
    first = {run.spec.dataset: run for run in reversed(results.finished)}
    return [dataset for dataset in results.datasets if network_folder(first[dataset]) is None]
