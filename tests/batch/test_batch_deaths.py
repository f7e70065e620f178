"""Deaths of workers: the photos that kill them are found, and cost no other."""

from collections import Counter

import pytest
from batches import tiny

from gauss2svg.batch import driver, worker
from gauss2svg.batch.many import Batch


class Deadly:
    """Stands in for Dask: workers die at some photos, before or after others are recorded."""

    def __init__(self, killers, recorded):
        self.killers, self.recorded = killers, recorded
        self.deaths = Counter()
        self.made = Counter()

    def answers(self, client, function, next_request, *_):
        (spec,) = function.args
        while (shard := next_request()) is not None:
            killers = [p for p in shard.photos if p.output in self.killers]
            at = shard.photos.index(killers[0]) if killers else len(shard.photos)
            record = driver.ShardRecord(spec.store, shard.key)
            made = [self.record(photo) for photo in shard.photos[:at]]
            if not killers:
                yield shard, worker.ShardResult(tuple(made))
                continue
            self.deaths[killers[0].output] += 1
            for one in made[: self.recorded]:
                record.done[one.output] = one
            record.write(working=True)
            yield shard, worker.ShardResult((), has_died=True)

    def record(self, photo):
        self.made[photo.output] += 1
        return driver.PhotoRecord(input=photo.path, output=photo.output, options="")


@pytest.mark.parametrize("recorded", [0, 3, 1000])
@pytest.mark.parametrize("killers", [[], [0], [39], [7, 8, 20]])
def test_photos_that_kill_workers_are_found_and_cost_no_other(
    killers, recorded, tmp_path, monkeypatch
):
    for number in range(40):
        (tmp_path / f"{number:02}.png").write_bytes(b"")
    deadly = Deadly({f"{number:02}.svg" for number in killers}, recorded)
    monkeypatch.setattr(driver, "answers", deadly.answers)
    monkeypatch.setattr(driver, "_SHARDS_A_WORKER", 1)
    with Batch([f"{tmp_path}/*.png"], tmp_path / "out", tiny()) as batch:
        spec = worker.BatchSpec(batch.options, batch.store, {}, "")
        found = list(driver.Driver(None, spec, batch.index, lambda: 1).records())
    assert Counter(one.output for one in found) == {f"{n:02}.svg": 1 for n in range(40)}
    failed = {one.output for one in found if one.error is not None}
    assert failed == deadly.killers
    assert all("2 workers died at it" in one.error for one in found if one.error)
    # With its record: once in the shard, once alone, once more.
    assert max(deadly.deaths.values(), default=0) <= (3 if recorded >= 40 else 9)
    if recorded >= 40:
        assert set(deadly.made.values()) == {1}


def test_refusals_count_on_where_a_worker_died():
    one = driver.Driver(None, worker.BatchSpec(tiny(), None, {}, ""), None, lambda: 1)
    photos = tuple(worker.BatchPhoto(name, name) for name in "abc")
    assert list(one._isolate(worker.Shard("x", photos, refusals=2), photos)) == []
    assert [shard.refusals for shard in one._again] == [2, 2, 2]
