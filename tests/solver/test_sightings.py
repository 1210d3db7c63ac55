"""Sightings as columns."""

import numpy as np

from solver.observations import Detections, Sighting
from solver.sightings import FARTHEST, gathered, layers

IDS = (7, 3, 5)


def test_columns_keep_the_order_of_the_batch_and_leave_out_what_is_no_use() -> None:
    batch = (
        Detections(1, (1.0, 2.0), (Sighting(5, 3.0, 0.1), Sighting(99, 1.0, 0.0))),
        Detections(2, (4.0, 5.0), (Sighting(7, float("nan"), 0.2), Sighting(3, 6.0, 0.3))),
        Detections(3, (float("inf"), 0.0), (Sighting(3, 6.0, 0.3),)),
    )
    found = gathered(IDS, batch)
    assert found.rows.tolist() == [2, 1]
    assert found.x.tolist() == [1.0, 4.0]
    assert found.y.tolist() == [2.0, 5.0]
    assert found.range.tolist() == [3.0, 6.0]
    assert found.bearing.tolist() == [0.1, 0.3]
    assert found.select(np.array([False, True])).rows.tolist() == [1]


def test_numbers_beyond_all_measurements_are_left_out() -> None:
    sightings = (Sighting(5, 1e160, 0.1), Sighting(3, 2.0, -1e200), Sighting(7, FARTHEST, 0.2))
    found = gathered(IDS, (Detections(1, (0.0, 0.0), sightings),))
    assert found.range.tolist() == [FARTHEST]
    assert not len(gathered(IDS, (Detections(1, (0.0, 1e300), sightings),)))


def test_nothing_seen() -> None:
    found = gathered(IDS, ())
    assert len(found) == 0
    assert list(layers(found)) == []


def test_a_layer_has_each_target_once() -> None:
    batch = tuple(
        Detections(k, (float(k), 0.0), tuple(Sighting(i, 1.0, 0.0) for i in seen))
        for k, seen in enumerate([(7, 5), (5,), (3, 5, 7)])
    )
    found = gathered(IDS, batch)
    parts = [layer.tolist() for layer in layers(found)]
    assert [sorted(found.rows[part].tolist()) for part in parts] == [[0, 1, 2], [0, 2], [2]]
    assert sorted(k for part in parts for k in part) == list(range(len(found)))
    # Robots by turns: the target seen thrice is seen by robots 0, 1 and 2.
    assert [found.x[k] for part in parts for k in part if found.rows[k] == 2] == [0.0, 1.0, 2.0]
