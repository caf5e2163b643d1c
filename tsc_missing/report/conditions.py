"""Under which conditions the methods of a comparison ran, where they are not the same."""

from tsc_missing.report.results import Results, Run

TIMING = ("decision_interval", "yellow", "all_red", "min_green", "network_timing")


def unlike(results: Results) -> list[str]:
    """For each dataset and condition in which methods differ what they ran with, in words."""
    found = []
    for dataset in results.datasets:
        runs = [run for run in results.finished if run.spec.dataset == dataset]
        for name in _conditions(runs[0]):
            ran: dict[str, dict[str, None]] = {}
            for run in runs:
                ran.setdefault(_conditions(run)[name], {})[run.spec.method] = None
            if len(ran) > 1:
                words = "; ".join(
                    f"{value}: {', '.join(methods)}" for value, methods in ran.items()
                )
                found.append(f"{dataset}, {name} {words}")
    return found


def _conditions(run: Run) -> dict[str, str]:
    """The timing of the signals and the sensors, by the settings' names."""
    settings = run.spec.settings
    timing = {f"signals.{name}": str(getattr(settings.signals, name)) for name in TIMING}
    sensor = settings.sensor
    kind = f"area of {sensor.length:g} m" if sensor.kind == "area" else sensor.kind
    return {**timing, "sensor": kind}
