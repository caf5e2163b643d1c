import pytest

from tsc_missing.offline import collect as collecting
from tsc_missing.offline.plan import CollectSettings


@pytest.mark.parametrize("workers", [1, 2])
def test_more_episodes_than_processes_run(monkeypatch, tmp_path, small_net, workers):
    monkeypatch.setattr(collecting, "RUNS_PER_PROCESS", 1)
    settings = CollectSettings(
        nets=(str(small_net),),
        demand="recorded",
        volume_min=1,
        volume_max=1,
        horizon=60,
        episodes=3,
    )
    seen = []
    data = collecting.collect(
        settings, tmp_path / "data", workers, lambda done, of: seen.append((done, of))
    )
    assert len(data.manifest.episodes) == 3
    assert seen == [(1, 3), (2, 3), (3, 3)]
