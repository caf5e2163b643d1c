import pytest

from tsc_missing.errors import UserError
from tsc_missing.offline import collect as collecting
from tsc_missing.offline.plan import CollectSettings


def plan(small_net, episodes):
    return CollectSettings(
        nets=(str(small_net),),
        demand="recorded",
        volume_min=1,
        volume_max=1,
        horizon=60,
        episodes=episodes,
    )


@pytest.mark.parametrize("workers", [1, 2])
def test_more_episodes_than_processes_run(monkeypatch, tmp_path, small_net, workers):
    monkeypatch.setattr(collecting, "RUNS_PER_PROCESS", 1)
    settings = plan(small_net, 3)
    seen = []
    data = collecting.collect(
        settings, tmp_path / "data", workers, lambda done, of: seen.append((done, of))
    )
    assert len(data.manifest.episodes) == 3
    assert seen == [(1, 3), (2, 3), (3, 3)]


def test_more_episodes_and_killed_before_they_are_summed_up(monkeypatch, tmp_path, small_net):
    out = tmp_path / "data"
    collecting.collect(plan(small_net, 1), out)
    manifest = (out / collecting.MANIFEST).read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(collecting, "_manifest", killed)
        with pytest.raises(KeyboardInterrupt):
            collecting.collect(plan(small_net, 2), out)
    assert (out / collecting.MANIFEST).read_bytes() == manifest
    assert len(collecting.collect(plan(small_net, 2), out).manifest.episodes) == 2
    (out / collecting.MANIFEST).write_text("{")
    assert len(collecting.collect(plan(small_net, 2), out).manifest.episodes) == 2


def test_killed_before_the_plan(tmp_path, small_net):
    out = tmp_path / "data"
    (out / "episodes").mkdir(parents=True)
    (out / ".plan.json.123").write_text("{")
    assert len(collecting.collect(plan(small_net, 1), out).manifest.episodes) == 1
    assert not (out / ".plan.json.123").exists()


def killed(*_):
    raise KeyboardInterrupt


def test_a_full_disk_is_one_line(small_net, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tsc_missing.offline.collect.write_json", full)
    with pytest.raises(UserError, match=r"out: .* \(No space left on device\); .* goes on"):
        collecting.collect(plan(small_net, 1), tmp_path / "d")
